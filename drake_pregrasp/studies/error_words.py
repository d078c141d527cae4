"""Errors of parallel jobs, in a line that gets from process to process and into a table."""

import traceback
from pathlib import Path

from drake_pregrasp.errors import PregraspError


def in_words(error: BaseException) -> str:
    """Returns an error in one line: its message, and its kind and place if it is a defect."""
    if isinstance(error, PregraspError) and (message := " ".join(str(error).split())):
        return message
    place = ""
    if frames := traceback.extract_tb(error.__traceback__):
        place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})"
    return " ".join(f"{type(error).__name__}: {error}".split()) + place
