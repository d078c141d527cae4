"""Exact confidence intervals of shares."""

from typing import NamedTuple

from scipy.stats import beta

from drake_pregrasp.errors import InvalidArgumentError

CONFIDENCE = 0.95
"""Least probability that an interval covers the true share."""


class Interval(NamedTuple):
    """A confidence interval of a share, from 0 to 1."""

    low: float
    high: float


def share_interval(successes: int, trials: int, *, confidence: float = CONFIDENCE) -> Interval:
    """Returns Clopper and Pearson's interval (Biometrika 26, 1934).

    Its ends are the shares at which so many successes, or more, or fewer, have half of what is
    left to the confidence as their probability: quantiles of the beta distribution.

    Args:
        successes: How many there are.
        trials: Out of how many; of none nothing is known, and the interval is all of [0, 1].
        confidence: Between 0 and 1.

    Raises:
        InvalidArgumentError: If there are more successes than trials, or fewer than none, or if
            the confidence isn't between 0 and 1.
    """
    if not 0 <= successes <= trials:
        raise InvalidArgumentError(f"successes: {successes} must be from 0 to trials, {trials}")
    if not 0 < confidence < 1:
        raise InvalidArgumentError(f"confidence: {confidence} must be between 0 and 1")
    tail = (1 - confidence) / 2
    failures = trials - successes
    low = float(beta.ppf(tail, successes, failures + 1)) if successes else 0.0
    high = float(beta.ppf(1 - tail, successes + 1, failures)) if failures else 1.0
    return Interval(low, high)
