"""How well a measure tells successes from failures."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import rankdata

from drake_pregrasp.errors import InvalidArgumentError


class Ranking(NamedTuple):
    """How a measure ranks successes and failures.

    Attributes:
        auc: Probability that a success has a higher value than a failure, ties counted half: the
            area under the receiver operating characteristic. Nan if either is missing.
        successes: How many with a value there are.
        failures: The same.
        left_out: How many have no value, whatever they are.
    """

    auc: float
    successes: int
    failures: int
    left_out: int


def rank(values: ArrayLike, succeeded: ArrayLike) -> Ranking:
    """Ranks values: Mann and Whitney's statistic, from the ranks of the successes.

    Args:
        values: Of the measure, shape (n,); nan where there is none.
        succeeded: Whether each is a success, shape (n,).

    Raises:
        InvalidArgumentError: If the shapes differ.
    """
    v, s = np.asarray(values, dtype=float), np.asarray(succeeded, dtype=bool)
    if v.ndim != 1 or v.shape != s.shape:
        raise InvalidArgumentError(
            f"values and succeeded must be lists of one length, not of shapes {v.shape}, {s.shape}"
        )
    there = ~np.isnan(v)
    left_out = int(np.sum(~there))
    v, s = v[there], s[there]
    successes, failures = int(np.sum(s)), int(np.sum(~s))
    if successes == 0 or failures == 0:
        return Ranking(math.nan, successes, failures, left_out)
    ranks = float(np.sum(rankdata(v)[s]))
    above = ranks - successes * (successes + 1) / 2
    return Ranking(above / (successes * failures), successes, failures, left_out)
