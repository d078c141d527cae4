"""Output files with errors that name them, and interrupts."""

import contextlib
import fcntl
import os
import secrets
import signal
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from drake_pregrasp.errors import OutputError
from drake_pregrasp.resources import real_path

INTERRUPTED_STATUS = 130
"""Exit status of an interrupted command."""


@contextlib.contextmanager
def handling(handler: Callable[[int, Any], object], *numbers: signal.Signals) -> Iterator[None]:
    """Handles signals by a function, and by the handlers of before when the context ends.

    Args:
        handler: Function of the signal's number and the interrupted frame.
        numbers: Signals.
    """
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, former in before.items():
            signal.signal(number, former)


@contextlib.contextmanager
def writing(path: Path, what: str = "written") -> Iterator[None]:
    """Turns the operating system's errors into an `OutputError` that names the written file."""
    try:
        yield
    except OSError as error:
        where, why = error.filename2 or error.filename or path, error.strerror or error
        raise OutputError(f"{where}: cannot be {what}: {why}") from error
    except UnicodeDecodeError as error:
        raise OutputError(f"{path}: cannot be {what}: is not UTF-8 text") from error


def reading_back(path: Path) -> contextlib.AbstractContextManager[None]:
    """Turns the operating system's errors into an `OutputError` that names the read file."""
    return writing(path, "read back")


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yields the path of a temporary file that replaces `path` atomically at the end.

    A link at `path` is replaced as well, and what it names stays. After an error, the temporary
    file is deleted, and `path` is unchanged.
    """
    partial = path.with_name(f".{secrets.token_hex(8)}_{path.name}")
    try:
        yield partial
        partial.replace(path)
    except OSError as error:
        if error.filename is not None and Path(error.filename) == partial:
            error.filename = str(path)
        raise
    finally:
        with contextlib.suppress(OSError):
            partial.unlink()


def own_file(path: str, flags: int) -> int:
    """Opens a file of a folder that others may have prepared; an `opener` of Python's `open`.

    A link is not followed, and a pipe is not waited for.
    """
    return os.open(path, flags | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)


@contextlib.contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Locks a folder against other writing processes, until the end of the block or process.

    Raises:
        OutputError: If another process has claimed the folder, or it cannot be written.
    """
    path = folder / ".lock"
    with writing(path):
        file = open(path, "r+b", opener=own_file)  # noqa: SIM115
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            is_free = os.fstat(file.fileno()).st_nlink > 0  # Not deleted by its last owner.
        except BlockingIOError:
            is_free = False
        if not is_free:
            raise OutputError(f"{folder}: another run is writing into it; choose another folder")
        try:
            yield
        finally:
            path.unlink(missing_ok=True)


def make_folder(folder: Path) -> None:
    """Makes a folder and its parents if they do not exist.

    Raises:
        OutputError: If the folder cannot be made.
    """
    for part in (*reversed(folder.parents), folder):
        if part.exists() and not part.is_dir():
            raise OutputError(f"{part}: is a file, not a folder; choose another folder (--out)")
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)


def make_numbered_folder(path: Path) -> Path:
    """Makes a new folder, whose name is that of `path` with the first free number.

    Raises:
        OutputError: If the folder cannot be made.
    """
    number = 1
    while os.path.lexists(folder := path.with_name(f"{path.name}-{number}")):
        number += 1
    with writing(folder):
        folder.mkdir()
    return folder


def swap_in(partial: Path, folder: Path, names: Sequence[str]) -> None:
    """Moves files of a folder into another one, and deletes the others of their names there.

    Args:
        partial: Folder of the files, which is deleted.
        folder: Folder to move them to.
        names: Names of the files that may be in either folder.

    Raises:
        OutputError: If a file cannot be replaced.
    """
    for name in names:
        with writing(folder / name):
            if (partial / name).exists():
                (partial / name).replace(folder / name)
            else:
                (folder / name).unlink(missing_ok=True)
    with writing(partial):
        partial.rmdir()


def write_text(path: Path, text: str) -> None:
    """Writes a text file atomically.

    Raises:
        OutputError: If the file cannot be written.
    """
    with writing(path), replacing(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


def check_new(path: Path) -> None:
    """Checks that a file that the user has named is not there.

    Raises:
        OutputError: If it is.
    """
    if path.is_file():
        raise OutputError(f"{path} is there already; name another file")


def write_named_text(path: Path, text: str) -> None:
    """Writes a text to what the user has named: a file, perhaps by a link, a device or a pipe.

    Args:
        path: Path of the file.
        text: The text.

    Raises:
        OutputError: If it cannot be written.
    """
    with writing(path):
        if path.is_file() or not path.exists():
            write_text(real_path(path), text)
        else:
            path.write_text(text, encoding="utf-8", newline="\n")
