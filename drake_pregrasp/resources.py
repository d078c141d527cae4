"""Paths of the package's and of users' files, and bounded reading."""

import atexit
import contextlib
import dataclasses
import hashlib
import importlib.util
import multiprocessing
import os
import shutil
import tempfile
from collections.abc import Sequence
from importlib.machinery import PathFinder
from pathlib import Path

from drake_pregrasp.errors import InvalidArgumentError, MissingPackageError, ScenarioError

_PACKAGE = Path(__file__).resolve().parent

MODELS_URL = "package://drake_pregrasp/"
"""Prefix of paths into the package's own folder of models."""


def resource_folder(name: str) -> Path:
    """Returns the folder `models` or `scenarios`.

    It is inside the package in a wheel, and beside it in a checkout.
    """
    inside = _PACKAGE / name
    return inside if inside.is_dir() else _PACKAGE.parent / name


def resolve_path(text: str, folder: Path) -> Path:
    """Returns the absolute path of a file that a scenario names.

    Args:
        text: Name of the file: absolute, relative to `folder`, or after `MODELS_URL` relative to
            the folder `models`. A `~` is the home folder.
        folder: Folder at which relative names start.

    Raises:
        InvalidArgumentError: If it is a URL of another kind, cannot be a file's name, or leads out
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
        path.exists()  # Raises an error if the name is too long.
    except (OSError, RuntimeError, ValueError) as error:
        if isinstance(error, InvalidArgumentError):
            raise
        why = getattr(error, "strerror", None) or str(error)
        raise InvalidArgumentError(f"{text!r} cannot be a file: {why}") from error
    return path


def python_package(name: str) -> Path | None:
    """Returns the folder of an installed Python package, which is not imported; None if absent."""
    spec = PathFinder.find_spec(name) if name.isidentifier() else None
    return Path(spec.origin).parent if spec and spec.origin else None


def require_packages(*modules: str, extra: str, purpose: str) -> None:
    """Raises an error unless Python packages are installed; they are not imported.

    Args:
        modules: Names of the packages' modules.
        extra: Extra of this package that installs them.
        purpose: Subject of the message: what needs them.

    Raises:
        MissingPackageError: If one is missing; the message has the command that installs it.
    """
    if missing := [name for name in modules if importlib.util.find_spec(name) is None]:
        raise missing_package(" and ".join(missing), extra=extra, purpose=purpose)


def missing_package(package: str, *, extra: str, purpose: str) -> MissingPackageError:
    """Returns the error that a package of an extra is not installed, with the command for it."""
    return MissingPackageError(
        f"{purpose} needs {package}; pip install 'drake_pregrasp[{extra}]' brings it"
    )


def real_path(path: Path) -> Path:
    """Returns an absolute path without symbolic links, but for those that are a loop.

    `Path.resolve` raises an error for a loop in Python 3.11. No file can be opened there anyway.
    """
    return Path(os.path.realpath(path))


def file_url(path: Path) -> str:
    """Returns the URL of a file as Drake reads it, which knows no `%20` for a space."""
    return f"file://{path}"


def check_inside(path: Path, folders: Sequence[Path]) -> None:
    """Raises an error unless a file is in one of some folders, at any depth.

    Args:
        path: Path of the file; symbolic links are resolved.
        folders: Allowed folders.

    Raises:
        InvalidArgumentError: If the file is elsewhere; the message names the option to allow it.
    """
    there = real_path(path)
    if any(there.is_relative_to(real_path(folder)) for folder in folders):
        return
    names = ", ".join(dict.fromkeys(str(real_path(folder)) for folder in folders))
    raise InvalidArgumentError(
        f"{there} is outside of {names}; if you trust it, add --allow {there.parent}"
        " (in Python: folders)"
    )


_MEGABYTE = 1_000_000


def read_bounded(path: Path, most: int) -> bytes:
    """Returns the content of a file.

    Args:
        path: Regular file: a pipe or a device may never end.
        most: Largest allowed size, in bytes.

    Raises:
        InvalidArgumentError: If the file is not a regular file, cannot be read, or is larger.
    """
    try:
        if path.exists() and not path.is_file():
            raise InvalidArgumentError(f"{path}: cannot be read: it is no regular file")
        with path.open("rb") as file:
            data = file.read(most + 1)
    except (OSError, ValueError) as error:
        if isinstance(error, InvalidArgumentError):
            raise
        why = getattr(error, "strerror", None) or str(error)
        raise InvalidArgumentError(f"{path}: cannot be read: {why}") from error
    if len(data) > most:
        raise InvalidArgumentError(
            f"{path}: cannot be read: it has more than {most / _MEGABYTE:g} MB; make it smaller"
        )
    return data


def read_bounded_text(path: Path, most: int) -> str:
    """Returns the text of a UTF-8 file, without a byte order mark.

    Args:
        path: As for `read_bounded`.
        most: As for `read_bounded`.

    Raises:
        InvalidArgumentError: As for `read_bounded`, or if the file is not UTF-8.
    """
    try:
        return read_bounded(path, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InvalidArgumentError(f"{path}: cannot be read: {error}") from error


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
        config: Dataclass whose paths are the strings with the metadata `path`.
        folder: Folder at which relative paths start; see `resolve_path`.
        allowed: Folders that may hold the files, at any depth; None for any folder.
        source: Name of the configuration's origin, for error messages.
        key: Dotted path of the configuration in its origin.

    Raises:
        ScenarioError: If a file is elsewhere, or a string cannot be a file's name.
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


def copies_folder() -> Path:
    """Returns this process's folder for copies, which is removed when the process ends.

    It is the same in each call. Its name is derived from a secret key of the process, so nobody
    else can make it before. A fork has a folder of its own.
    """
    owner = os.getpid()
    digest = hashlib.sha256(multiprocessing.current_process().authkey + b"%d" % owner)
    folder = Path(tempfile.gettempdir()) / f"drake_pregrasp-{digest.hexdigest()[:16]}"
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
        atexit.register(_remove, folder, owner)
    return folder


def _remove(folder: Path, owner: int) -> None:
    if os.getpid() == owner:  # Forks inherit what is registered.
        shutil.rmtree(folder, ignore_errors=True)
