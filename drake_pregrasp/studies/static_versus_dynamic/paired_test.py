"""Whether one arm succeeds more often than another, with the same seeds."""

from collections.abc import Iterable
from typing import NamedTuple

from scipy.stats import binom

SIGNIFICANT = 0.05
"""Differences with a smaller probability by chance are said to be shown."""


class PairedTest(NamedTuple):
    """Exact McNemar test of two arms.

    Attributes:
        pairs: How many pairs there are.
        gained: In how many of them only the first arm succeeds.
        lost: In how many only the second.
        p: Probability of a difference at least as large, either way, if neither is better.
    """

    pairs: int
    gained: int
    lost: int
    p: float


def paired_test(pairs: Iterable[tuple[bool, bool]]) -> PairedTest:
    """Returns the exact test of McNemar (Psychometrika 12, 1947).

    Pairs in which both succeed, or none, say nothing on the difference. Among the others either
    is as likely as the other if no arm is better: a fair coin.

    Args:
        pairs: Whether the first and the second arm succeed, with one seed each.
    """
    pairs = list(pairs)
    gained = sum(first and not second for first, second in pairs)
    lost = sum(second and not first for first, second in pairs)
    tail = float(binom.cdf(min(gained, lost), gained + lost, 0.5))
    return PairedTest(len(pairs), gained, lost, min(1.0, 2 * tail))


def least_pairs(num_tests: int) -> int:
    """Returns the fewest pairs with which one of so many tests can show a difference.

    Even if the pairs all differ in one direction, p is 2 / 2^pairs, and Holm's correction of the
    smallest p is a factor of the number of tests.

    Args:
        num_tests: How many tests are corrected together, 1 or more.
    """
    pairs = 1
    while num_tests * 2.0 ** (1 - pairs) >= SIGNIFICANT:
        pairs += 1
    return pairs
