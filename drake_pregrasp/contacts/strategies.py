"""Linear blends of strategies: several ends at once, each with a weight of its own.

Each maps a selection's input to b_n for each candidate, shape (N,), for Eq. 5-7 and the margin.

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

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.centroids import gaussian_log_weights
from drake_pregrasp.contacts.selection_input import KernelStrategy, SelectionInput, WeightFunction
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.kernels import FLAT, KINDS
from drake_pregrasp.quality.force_closure import FRICTION, moved_least_norm_margin
from drake_pregrasp.quality.singular_values import extreme_singular_values
from drake_pregrasp.regions.safe_regions import NO_REGION


def contact_msv(selection: SelectionInput) -> FloatArray:
    """Eq. 5 of the candidate's own matrix."""
    surface = selection.surface
    rho = np.linalg.norm(surface.p_OQ - surface.p_OCoM, axis=1)
    sigma_min: FloatArray = np.sqrt(1 + rho**2 / 4) - rho / 2
    return sigma_min


def contact_gii(selection: SelectionInput) -> FloatArray:
    """Eq. 6 of the candidate's own matrix."""
    return contact_msv(selection) ** 2


def contact_vew(selection: SelectionInput) -> FloatArray:
    """Eq. 7 of the candidate's own matrix, whose determinant is one everywhere."""
    return np.ones(len(selection.surface.p_OQ))


def hand_msv(selection: SelectionInput) -> FloatArray:
    """Eq. 5 of the hand's matrix with the region's contact at the candidate."""
    return _hand_extremes(selection)[0]


def hand_gii(selection: SelectionInput) -> FloatArray:
    """Eq. 6 of the hand's matrix with the region's contact at the candidate."""
    sigma_min, sigma_max = _hand_extremes(selection)
    return sigma_min / sigma_max


def hand_vew(selection: SelectionInput) -> FloatArray:
    """Eq. 7 of the hand's matrix with the region's contact at the candidate.

    det(G Gᵀ) = n³ det(n I + sum(|rho_i|² I - rho_i rho_iᵀ)), rho_i being r_i less their mean.
    """
    t, second_moment, n = _hand_sums(selection)
    S = second_moment - np.einsum("ki,kj->kij", t, t) / n
    inertia = (n + np.trace(S, axis1=1, axis2=2))[:, None, None] * np.eye(3) - S
    volume: FloatArray = np.sqrt(n**3 * np.linalg.det(inertia))
    return volume


def hand_margin(selection: SelectionInput, *, friction: float = FRICTION) -> FloatArray:
    """The bound b of the hand's margin, hard fingers, with the region's contact at the candidate.

    Where b < 0 it is b / (1 - b), which keeps the order, is never below -1, and so leaves places
    that are far from force closure without a say in how the others compare.
    """
    surface, regions = selection.surface, selection.regions
    active = np.flatnonzero(regions.sizes() > 0)
    p_OC = selection.p_OC[active]
    values = np.zeros(len(surface.p_OQ))
    inside = np.flatnonzero(regions.labels != NO_REGION)
    bound = moved_least_norm_margin(
        p_OC - surface.p_OCoM,
        surface.project(p_OC)[1],
        friction,
        moved=np.searchsorted(active, regions.labels[inside]),
        p_CoMQ=surface.p_OQ[inside] - surface.p_OCoM,
        nhat_Q=surface.nhat_OQ[inside],
    )
    # 1/(1 - b) - 1 is b/(1 - b), and -1 for the b = -inf of a grasp that can't be told.
    values[inside] = np.where(bound < 0, 1 / (1 - np.minimum(bound, 0)) - 1, bound)
    return values


def _hand_extremes(selection: SelectionInput) -> tuple[FloatArray, FloatArray]:
    t, second_moment, n = _hand_sums(selection)
    B = np.trace(second_moment, axis1=1, axis2=2)[:, None, None] * np.eye(3) - second_moment
    return extreme_singular_values(t, B, n)


def _hand_sums(selection: SelectionInput) -> tuple[FloatArray, FloatArray, int]:
    """Returns sum r (N, 3), sum r rᵀ (N, 3, 3) and n, with each candidate in its contact's place.

    A candidate without a region has a place beside the active contacts; its values are not used.
    """
    surface, regions = selection.surface, selection.regions
    r = selection.p_OC - surface.p_OCoM
    q = surface.p_OQ - surface.p_OCoM
    active = regions.sizes() > 0
    held = np.vstack([np.where(active[:, None], r, 0), np.zeros(3)])
    held_moments = np.einsum("ki,kj->kij", held, held)
    others = held.sum(axis=0) - held
    others_moments = held_moments.sum(axis=0) - held_moments
    t = others[regions.labels] + q
    return t, others_moments[regions.labels] + np.einsum("ki,kj->kij", q, q), int(active.sum())


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
