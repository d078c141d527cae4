"""Output: files with errors that name them, and solver messages kept off the terminal."""

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator
from pathlib import Path

from drake_pregrasp.errors import OutputError


def writing(path: Path) -> contextlib.AbstractContextManager[None]:
    """Turns the system's errors inside into an `OutputError`: what file can't be written."""
    return _naming(path, "written")


def reading_back(path: Path) -> contextlib.AbstractContextManager[None]:
    """Turns the system's errors inside into an `OutputError`: what file can't be read."""
    return _naming(path, "read back")


@contextlib.contextmanager
def _naming(path: Path, what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        where, why = error.filename or path, error.strerror or error
        raise OutputError(f"{where}: can't be {what}: {why}") from error
    except UnicodeDecodeError as error:
        raise OutputError(f"{path}: can't be {what}: is no text in UTF-8") from error


def write_text(path: Path, text: str) -> None:
    """Writes a text file.

    Raises:
        OutputError: If that fails.
    """
    with writing(path):
        path.write_text(text, encoding="utf-8")


_STDOUT = 1


@contextlib.contextmanager
def without_solver_chatter() -> Iterator[None]:
    """Drops what compiled code writes to the standard output; Python's own goes on.

    OSQP 1.0 prints a line at every solution (github.com/osqp/osqp/issues/785), and
    `DifferentialInverseKinematicsSystem` solves with it fifty times a second.
    """
    sys.stdout.flush()
    kept = os.dup(_STDOUT)
    before = sys.stdout
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), _STDOUT)
        if _writes_to(before, _STDOUT):
            sys.stdout = os.fdopen(os.dup(kept), "w", encoding=before.encoding)
        yield
    finally:
        ctypes.CDLL(None).fflush(None)  # What is still in the buffer of compiled code.
        if sys.stdout is not before:
            sys.stdout.close()
            sys.stdout = before
        os.dup2(kept, _STDOUT)
        os.close(kept)


def _writes_to(stream: object, number: int) -> bool:
    try:
        return stream.fileno() == number  # type: ignore[attr-defined,no-any-return]
    except (AttributeError, OSError):
        return False
