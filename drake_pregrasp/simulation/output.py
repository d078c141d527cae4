"""Output files with errors that name them, and interrupts."""

import contextlib
import fcntl
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from drake_pregrasp.errors import OutputError

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
        where, why = error.filename or path, error.strerror or error
        raise OutputError(f"{where}: cannot be {what}: {why}") from error
    except UnicodeDecodeError as error:
        raise OutputError(f"{path}: cannot be {what}: is not UTF-8 text") from error


def reading_back(path: Path) -> contextlib.AbstractContextManager[None]:
    """Turns the operating system's errors into an `OutputError` that names the read file."""
    return writing(path, "read back")


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yields the path of a temporary file that replaces `path` atomically at the end.

    After an error, the temporary file is deleted, and `path` is unchanged. A device or a pipe is
    written directly.
    """
    target = path.resolve()
    if target.exists() and not target.is_file():
        yield path
        return
    partial = target.with_name(f".{os.getpid()}_{target.name}")
    try:
        yield partial
        partial.replace(target)
    except OSError as error:
        if error.filename is not None and Path(error.filename) == partial:
            error.filename = str(path)
        raise
    finally:
        with contextlib.suppress(OSError):
            partial.unlink()


@contextlib.contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Locks a folder against other writing processes, until the end of the block or process.

    Raises:
        OutputError: If another process has claimed the folder, or it cannot be written.
    """
    path = folder / ".lock"
    with writing(path):
        file = path.open("w")
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
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)


def write_text(path: Path, text: str) -> None:
    """Writes a text file atomically.

    Raises:
        OutputError: If the file cannot be written.
    """
    with writing(path), replacing(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")
