"""Files of the package and of users: where they are, and reading them within limits."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from drake_pregrasp.errors import InvalidArgumentError, ScenarioError

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


_MEGABYTE = 1_000_000


def read_bounded(path: Path, most: int) -> bytes:
    """Returns what a file holds.

    Args:
        path: The file. A pipe or a device, which may never end, is none.
        most: Bytes that it may have.

    Raises:
        InvalidArgumentError: If it is no regular file, can't be read, or is larger.
    """
    try:
        if path.exists() and not path.is_file():
            raise InvalidArgumentError(f"{path}: can't be read: it is no regular file")
        with path.open("rb") as file:
            data = file.read(most + 1)
    except (OSError, ValueError) as error:
        if isinstance(error, InvalidArgumentError):
            raise
        why = getattr(error, "strerror", None) or str(error)
        raise InvalidArgumentError(f"{path}: can't be read: {why}") from error
    if len(data) > most:
        raise InvalidArgumentError(
            f"{path}: can't be read: it has more than {most / _MEGABYTE:g} MB; make it smaller"
        )
    return data


def read_bounded_text(path: Path, most: int) -> str:
    """Returns what a file of UTF-8 holds, without a byte order mark.

    Args:
        path: As for `read_bounded`.
        most: As for `read_bounded`.

    Raises:
        InvalidArgumentError: As for `read_bounded`, or if it is no UTF-8.
    """
    try:
        return read_bounded(path, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InvalidArgumentError(f"{path}: can't be read: {error}") from error


def make_paths_absolute(
    config: object,
    folder: Path,
    *,
    allowed: Sequence[Path] | None = None,
    source: str = "scenario",
    key: str = "",
) -> None:
    """Makes every path in a configuration absolute, in place; URLs stay.

    Args:
        config: A dataclass. Its paths are the texts whose fields have the metadata `path`.
        folder: Where relative paths start; see `resolve_path`.
        allowed: Folders that files may be in, or below. None: anywhere.
        source: Where the configuration is from, for the message.
        key: Dotted path of the configuration in it.

    Raises:
        ScenarioError: If a file is elsewhere, or a text can't be the name of one.
    """
    for f in dataclasses.fields(config) if dataclasses.is_dataclass(config) else ():
        value = getattr(config, f.name)
        path = f"{key}.{f.name}" if key else f.name
        if f.metadata.get("path"):
            if value and "://" not in value:
                setattr(config, f.name, _absolute(value, folder, allowed, source, path))
        else:
            for part in value if isinstance(value, list) else [value]:
                make_paths_absolute(part, folder, allowed=allowed, source=source, key=path)


def _absolute(
    text: str, folder: Path, allowed: Sequence[Path] | None, source: str, key: str
) -> str:
    try:
        path = resolve_path(text, folder)
        if allowed is not None:
            check_inside(path, allowed)
    except InvalidArgumentError as error:
        raise ScenarioError(source, key, str(error)) from error
    return str(path)
