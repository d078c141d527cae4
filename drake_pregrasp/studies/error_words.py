"""Errors of parallel jobs, in a line that gets from process to process and into a table."""

import traceback
from pathlib import Path


def in_words(error: BaseException) -> str:
    """Returns an error's kind, message and place, in one line."""
    place = ""
    if frames := traceback.extract_tb(error.__traceback__):
        place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})"
    return " ".join(f"{type(error).__name__}: {error}".split()) + place
