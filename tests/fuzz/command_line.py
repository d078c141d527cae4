"""Command line of the harnesses: cases to run, time limit, and output."""

import argparse
import collections
import math
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple


class Result(NamedTuple):
    """The outcome of a case.

    Attributes:
        number: Number of the case.
        kind: How it was made.
        outcome: What came of it, in a few words.
        failure: The case and the error if it is not as it should be, else empty.
        seconds: Processor time that it took.
    """

    number: int
    kind: str
    outcome: str
    failure: str
    seconds: float


def main(description: str | None, results: Callable[[int, int, int], Iterator[Result]]) -> int:
    """Prints failures, and how many cases had which outcome; returns 1 if any failed.

    Args:
        description: Description of the harness.
        results: Function that yields the results of a seed, from a number up to another.
    """
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=10_000, help="number of cases")
    parser.add_argument("--seed", type=int, default=0, help="the same one makes the same cases")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--minutes", type=float, default=math.inf, help="time after which to end")
    options = parser.parse_args()
    counts: collections.Counter[tuple[str, str]] = collections.Counter()
    failed, slowest, start = 0, (0.0, -1), time.perf_counter()
    for result in results(options.seed, options.first, options.first + options.count):
        counts[result.kind, result.outcome] += 1
        slowest = max(slowest, (result.seconds, result.number))
        if result.failure:
            failed += 1
            print(
                f"--- {result.number} {result.kind} {result.outcome}\n{result.failure}", flush=True
            )
        if time.perf_counter() - start > 60 * options.minutes:
            break
    for (kind, outcome), number in sorted(counts.items()):
        print(f"{kind:8} {outcome:30} {number}")
    print(f"{sum(counts.values())} cases in {time.perf_counter() - start:.0f} s;", end=" ")
    print(f"{slowest[1]} took {slowest[0]:.2f} s; {failed} failures")
    return 1 if failed else 0
