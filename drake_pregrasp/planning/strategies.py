"""The strategies that move a contact inside its safe region: Eq. 3 and measures as weights.

The paper weighs a candidate q_n by a measure of the partial grasp matrix at q_n (Eq. 5-7) and
leaves open which matrix that is. Both readings are here:

- `contact`: the 6 x 6 matrix of q_n alone. With rho = |q_n - CoM|, sigma_min is
  sqrt(1 + rho²/4) - rho/2 and sigma_max = 1/sigma_min: Eq. 6 is the square of Eq. 5, and Eq. 7 is
  constant.
- `hand`: the whole G with the contact of q_n's region moved to q_n and the other active ones held.

These measures don't see force closure. The strategy `margin`, which the paper does not have, weighs
a candidate by a lower bound of the hand's min-weight margin, in the reading `hand` only.

Either is nearly flat over a region. Stretched, b_n - min b over the region, the weights say where
in the region the measure is better rather than that it is good all over.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.candidate_measures import (
    contact_gii,
    contact_msv,
    contact_vew,
    hand_gii,
    hand_margin,
    hand_msv,
    hand_vew,
)
from drake_pregrasp.planning.contact_selection import gaussian_log_weights
from drake_pregrasp.planning.force_closure import FRICTION
from drake_pregrasp.planning.kernels import FLAT, KINDS
from drake_pregrasp.planning.safe_regions import NO_REGION
from drake_pregrasp.planning.selection_input import KernelStrategy, SelectionInput, WeightFunction

STRATEGIES = ("position", "msv", "gii", "vew", "margin")
"""Position tracking (Eq. 3), the measures of Eq. 5, 6 and 7, and the force-closure margin."""

READINGS = ("contact", "hand")
"""The two readings of the partial grasp matrix."""

Measure = Callable[[SelectionInput], FloatArray]
"""Maps a selection's input to b_n for each candidate, shape (N,)."""


def make_strategy(
    name: str,
    *,
    reading: str = "hand",
    stretch: bool = True,
    power: float = 1.0,
    friction: float = FRICTION,
) -> WeightFunction:
    """Returns a strategy as a weight function.

    Args:
        name: One of `STRATEGIES`.
        reading: One of `READINGS`; `position` and `margin` have only one.
        stretch: Whether to stretch the weights over each region; not for `position`.
        power: Exponent of the weights, after the stretch; not for `position`. The larger it is,
            the nearer the centroid of Eq. 4 comes to the best point.
        friction: Coulomb's coefficient, for `margin`.

    Raises:
        InvalidArgumentError: If there is no such strategy or reading, or a number is out of range.
    """
    if name not in STRATEGIES:
        raise InvalidArgumentError(f"no strategy {name!r}; there are: {', '.join(STRATEGIES)}")
    if reading not in READINGS:
        raise InvalidArgumentError(f"no reading {reading!r}; there are: {', '.join(READINGS)}")
    if not power > 0:
        raise InvalidArgumentError(f"power must be greater than 0, not {power}")
    if not friction >= 0:
        raise InvalidArgumentError(f"friction must be at least 0, not {friction}")
    if name == "position":
        return KernelStrategy(position_tracking, name, stretch=False)
    margin = partial(hand_margin, friction=friction)
    measures: dict[tuple[str, str], Measure] = {
        ("msv", "contact"): contact_msv,
        ("gii", "contact"): contact_gii,
        ("vew", "contact"): contact_vew,
        ("margin", "contact"): margin,
        ("msv", "hand"): hand_msv,
        ("gii", "hand"): hand_gii,
        ("vew", "hand"): hand_vew,
        ("margin", "hand"): margin,
    }
    measure = measures[name, reading]

    def log_weights(selection: SelectionInput) -> FloatArray:
        b = measure(selection)
        if stretch:
            b = stretched(b, selection)
        with np.errstate(divide="ignore"):
            logarithms: FloatArray = power * np.log(np.maximum(b, 0))
        return logarithms

    if name in KINDS and reading == "hand" and power == 1:
        return KernelStrategy(log_weights, name, stretch)
    return log_weights


def position_tracking(selection: SelectionInput) -> FloatArray:
    """Returns log(b_n) of Eq. 3 about the centre of mass, up to a constant."""
    surface = selection.surface
    return gaussian_log_weights(surface.p_OQ, surface.p_OCoM, selection.covariance_O)


def stretched(b: FloatArray, selection: SelectionInput) -> FloatArray:
    """Returns b_n less the least b over the candidate's region, shape (N,).

    What is left is zero in a region where it is nothing but rounding.
    """
    labels, areas = selection.regions.labels, selection.surface.areas
    least = np.full(len(selection.p_OC) + 1, np.inf)
    np.minimum.at(least, labels, b)
    assert NO_REGION == -1  # Candidates without region gather in the last place.
    difference: FloatArray = b - least[labels]
    sums = [np.zeros(len(least)), np.zeros(len(least))]
    for total, values in zip(sums, (difference, b), strict=True):
        np.add.at(total, labels, values * areas)
    is_flat = sums[0] <= FLAT * sums[1]
    difference[is_flat[labels]] = 0
    return difference
