"""The command line of the harnesses: which cases are tried, for how long, and what is printed."""

import argparse
import collections
import math
import time
from collections.abc import Callable
from typing import NamedTuple

Counts = collections.Counter[tuple[str, str]]


class Found(NamedTuple):
    """What came of many cases.

    Attributes:
        counts: How many there were of each kind with each outcome.
        failures: Some of those that are not as they should be, in words.
        failed: How many of those there are.
        slowest: How long the slowest took, in seconds of processor time, and its number.
    """

    counts: Counts
    failures: list[str]
    failed: int
    slowest: tuple[float, int]


def main(description: str | None, cases: str, run: Callable[[int, int, int, float], Found]) -> int:
    """Prints the counts and the failures; returns 1 if there are any.

    Args:
        description: Of the harness.
        cases: What the cases are called.
        run: Tries so many cases of a seed, from a number on, for so many seconds.
    """
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=10_000, help=f"how many {cases}")
    parser.add_argument("--seed", type=int, default=0, help="the same one makes the same ones")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--minutes", type=float, default=math.inf, help="end after these")
    options = parser.parse_args()
    start = time.perf_counter()
    found = run(options.count, options.seed, options.first, 60 * options.minutes)
    for (kind, outcome), number in sorted(found.counts.items()):
        print(f"{kind:8} {outcome:30} {number}")
    for failure in found.failures:
        print(failure)
    longest, number = found.slowest
    seconds = time.perf_counter() - start
    print(f"{sum(found.counts.values())} {cases} in {seconds:.0f} s;", end=" ")
    print(f"{number} took {longest:.2f} s; {found.failed} failures")
    return 1 if found.failed else 0
