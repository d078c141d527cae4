"""Writing files and reading them back, with errors that name them."""

import contextlib
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
