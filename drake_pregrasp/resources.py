"""The folders of models and scenarios, from a checkout and from an installed wheel alike.

And the one rule for paths in scenario files, `resolve_path`.
"""

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
        InvalidArgumentError: If it is a URL of another kind.
    """
    if text.startswith(MODELS_URL):
        return resource_folder("models") / text.removeprefix(MODELS_URL)
    if "://" in text:
        raise InvalidArgumentError(f"{text}: only {MODELS_URL} is known as a URL")
    return (folder / Path(text).expanduser()).resolve()
