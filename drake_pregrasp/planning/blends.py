"""Linear blends of strategies: several ends at once, each with a weight of its own."""

from collections.abc import Mapping

import numpy as np

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.force_closure import FRICTION
from drake_pregrasp.planning.selection_input import SelectionInput, WeightFunction
from drake_pregrasp.planning.strategies import STRATEGIES, make_strategy

BLEND = "blend"
"""What a setting calls a blend, beside the names of single strategies."""


def make_blend(
    weights: Mapping[str, float],
    *,
    reading: str = "hand",
    stretch: bool = True,
    power: float = 1.0,
    friction: float = FRICTION,
) -> WeightFunction:
    """Returns b_n = sum_s w_s b_n,s / max b_s, each maximum over the candidate's region.

    The weights of every strategy s so reach from 0 to 1 in each region, whatever their units are.
    A strategy without a preference in a region, all its weights being zero, has no say there.

    Args:
        weights: w_s by the strategies' names; what is missing is zero. Their ratios count.
        reading: As for `make_strategy`.
        stretch: As for `make_strategy`.
        power: As for `make_strategy`.
        friction: As for `make_strategy`.

    Raises:
        InvalidArgumentError: As of `make_strategy`, or if a weight is negative, or all are zero.
    """
    for name, weight in weights.items():
        if name not in STRATEGIES:
            raise InvalidArgumentError(f"no strategy {name!r}; there are: {', '.join(STRATEGIES)}")
        if not 0 <= weight < np.inf:
            raise InvalidArgumentError(f"the weight of {name} must be at least 0, not {weight}")
    if not any(weight > 0 for weight in weights.values()):
        raise InvalidArgumentError(
            f"a blend needs a weight above 0 for one of: {', '.join(STRATEGIES)}"
        )
    parts = [
        (w, make_strategy(s, reading=reading, stretch=stretch, power=power, friction=friction))
        for s, w in weights.items()
        if w > 0
    ]

    def log_weights(selection: SelectionInput) -> FloatArray:
        b = sum(weight * _scaled(strategy(selection), selection) for weight, strategy in parts)
        with np.errstate(divide="ignore"):
            logarithms: FloatArray = np.log(b)
        return logarithms

    return log_weights


def _scaled(log_weights: FloatArray, selection: SelectionInput) -> FloatArray:
    """Returns b_n over the largest b in the candidate's region, shape (N,)."""
    labels = selection.regions.labels
    largest = np.full(len(selection.p_OC) + 1, -np.inf)
    np.maximum.at(largest, labels, log_weights)
    largest[np.isneginf(largest)] = 0
    scaled: FloatArray = np.exp(log_weights - largest[labels])
    return scaled
