"""Files that are whole whenever a study is killed."""

import os
from pathlib import Path
from typing import IO

from drake_pregrasp.simulation.output import writing


def replace_whole(path: Path, text: str) -> None:
    """Writes a file beside the one that is there, and puts it in its place when it is complete.

    Raises:
        OutputError: If that fails.
    """
    whole = path.with_name(f"{path.name}.new")
    with writing(path):
        whole.write_text(text, encoding="utf-8", newline="\n")
        whole.replace(path)


def append_safely(file: IO[str], text: str, path: Path) -> None:
    """Adds text to an open file, and doesn't return before it is on the disk.

    Args:
        file: Open for appending.
        text: What to add; it ends with the end of a line.
        path: Its name, for errors.

    Raises:
        OutputError: If that fails.
    """
    with writing(path):
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


def whole_lines(text: str) -> str:
    """Returns a file's text without what follows the last end of a line.

    That is of a process that was killed while it wrote.
    """
    return text[: text.rfind("\n") + 1]
