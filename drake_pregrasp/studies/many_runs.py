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

FAILED_STATUS = 1
"""Exit status if some runs have failed."""


class ManyRuns(NamedTuple):
    """What a study of many runs has left.

    Attributes:
        report: The page.
        wanted: How many runs were wanted.
        made: How many of them are there.
        failed: How many have failed, of all that the folder knows of.
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
            f"drake-pregrasp: {found.failed} {noun}s failed: {results.with_name(FAILED)} says why;"
            " the same command tries them again",
            file=sys.stderr,
        )
        return FAILED_STATUS
    return 0


def check_at_least(options: argparse.Namespace, **least: int) -> None:
    """Checks options that are whole numbers, or not set.

    Raises:
        InvalidArgumentError: If one is less than it has to be.
    """
    for name, bound in least.items():
        value = getattr(options, name)
        if value is not None and value < bound:
            raise InvalidArgumentError(f"--{name}: {value} must be {bound} or more")


def names_of(text: str) -> list[str]:
    """Returns the names in a list that commas separate."""
    return [name.strip() for name in text.split(",")]
