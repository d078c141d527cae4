"""How the commands that make many runs end, and what their options share."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.studies.failed_file import FAILED
from drake_pregrasp.studies.interruptible import INTERRUPTED_STATUS, interruptible
from drake_pregrasp.studies.step_bar import step_bar

MOST_SEEDS = 10_000
"""How many seeds a study may have."""

FAILED_STATUS = 1
"""Exit status if some runs have failed."""


class ManyRuns(NamedTuple):
    """What a study of many runs has left.

    Attributes:
        report: The page.
        wanted: How many runs were wanted.
        made: How many of them are there.
        failed: How many of them have failed.
    """

    report: Path
    wanted: int
    made: int
    failed: int


def carry_out(
    make: Callable[[Callable[[int, int], None]], ManyRuns], *, noun: str, results: Path
) -> int:
    """Makes the runs, says what is there, and returns the exit status.

    Args:
        make: Makes them, and is given what shows how many are done, of how many.
        noun: What one is called.
        results: The file that gets what each came to; failures are in the same folder.
    """
    try:
        with interruptible(), step_bar(noun) as on_progress:
            found = make(on_progress)
    except KeyboardInterrupt:
        print(
            f"drake-pregrasp: interrupted: the {noun}s so far are in {results};"
            " the same command goes on from there",
            file=sys.stderr,
        )
        return INTERRUPTED_STATUS
    print(f"{found.made} of {found.wanted} {noun}s are there")
    print(f"report in {found.report}: open it in a browser")
    if found.failed:
        print(
            f"drake-pregrasp: {_counted(found.failed, noun)} failed:"
            f" {results.with_name(FAILED)} says why; the same command tries again",
            file=sys.stderr,
        )
        return FAILED_STATUS
    return 0


def check_bounds(options: argparse.Namespace, **bounds: tuple[int, int | None]) -> None:
    """Checks options that are whole numbers, or not set.

    Raises:
        InvalidArgumentError: If one is less than the first of its bounds, or more than the second.
    """
    for name, (least, most) in bounds.items():
        value = getattr(options, name)
        if value is not None and value < least:
            raise InvalidArgumentError(f"--{name}: {value} must be {least} or more")
        if value is not None and most is not None and value > most:
            raise InvalidArgumentError(f"--{name}: {value} must be {most} or less")


def names_of(text: str) -> list[str]:
    """Returns the names in a list that commas separate."""
    return [name.strip() for name in text.split(",")]


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
