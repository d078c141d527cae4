"""The folders of models and scenarios, from a checkout and from an installed wheel alike.

And the one rule for paths in scenario files, `resolve_path`.
"""

from collections.abc import Sequence
from pathlib import Path

from drake_pregrasp.errors import InvalidArgumentError

_PACKAGE = Path(__file__).resolve().parent

MODELS_URL = "package://drake_pregrasp/"
"""What a path into the package's own folder of models starts with."""


def resource_folder(name: str) -> Path:
    """Returns the folder `models` or `scenarios`.

    A wheel holds them inside the package, a checkout beside it.
    """
    inside = _PACKAGE / name
    return inside if inside.is_dir() else _PACKAGE.parent / name


def resolve_path(text: str, folder: Path) -> Path:
    """Returns the absolute path of a file that a scenario names.

    Args:
        text: The name: absolute, relative to `folder`, or after `MODELS_URL` relative to the
            folder `models`. A `~` is the home folder.
        folder: Where relative names start.

    Raises:
        InvalidArgumentError: If it is a URL of another kind, can't be a file's name, or leads out
            of `models`.
    """
    if "://" in text and not text.startswith(MODELS_URL):
        raise InvalidArgumentError(f"{text}: only {MODELS_URL} is known as a URL")
    try:
        if text.startswith(MODELS_URL):
            models = resource_folder("models")
            path = models / text.removeprefix(MODELS_URL)
            if path.resolve().is_relative_to(models.resolve()):
                return path
            raise InvalidArgumentError(f"{text}: leads out of {MODELS_URL}")
        path = (folder / Path(text).expanduser()).resolve()
        path.exists()  # It says whether a name is too long.
    except (OSError, RuntimeError, ValueError) as error:
        if isinstance(error, InvalidArgumentError):
            raise
        why = getattr(error, "strerror", None) or str(error)
        raise InvalidArgumentError(f"{text!r} can't be a file: {why}") from error
    return path


def check_inside(path: Path, folders: Sequence[Path]) -> None:
    """Raises an error unless a file is in one of some folders, or below.

    Args:
        path: Of the file; what symbolic links lead to counts.
        folders: Which.

    Raises:
        InvalidArgumentError: If it isn't; the message says how to allow it.
    """
    there = path.resolve()
    if any(there.is_relative_to(folder.resolve()) for folder in folders):
        return
    names = ", ".join(dict.fromkeys(str(folder.resolve()) for folder in folders))
    raise InvalidArgumentError(
        f"{there} is outside of {names}; if you trust it, add --allow {there.parent}"
        " (in Python: folders)"
    )
