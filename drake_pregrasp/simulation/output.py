"""Writing files, with errors that name them."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from drake_pregrasp.errors import OutputError


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turns the system's errors inside into an `OutputError` that names the file."""
    try:
        yield
    except OSError as error:
        where, why = error.filename or path, error.strerror or error
        raise OutputError(f"{where}: can't be written: {why}") from error


def write_text(path: Path, text: str) -> None:
    """Writes a text file.

    Raises:
        OutputError: If that fails.
    """
    with writing(path):
        path.write_text(text, encoding="utf-8")
