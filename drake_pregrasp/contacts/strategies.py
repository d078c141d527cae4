"""Strategies: weights b_n of the candidates q_n of a safe region (Eq. 5-7), and blends of them.

A strategy maps the selection's input and the index i of a contact to log(b_n) of the candidates in
its region S_i, shape (k,). `STRATEGIES` lists the names.

The paper weights a candidate by a measure of the partial grasp matrix G_qn, but does not define
this matrix. There are two readings:

- `contact`: the 6 x 6 matrix of q_n alone. With rho = |q_n - CoM|, sigma_min is
  sqrt(1 + rho²/4) - rho/2 and sigma_max = 1/sigma_min: isotropy is sigma_min², and the volume is
  constant.
- `hand`: the matrix of the whole hand with contact i at q_n, and the other active contacts fixed.

These measures ignore force closure. The strategy `margin`, which the paper does not have, weights a
candidate by a lower bound of the hand's min-weight margin, in the reading `hand` only.

All these weights are nearly constant over a region. Stretched weights, b_n - min b over the region,
depend only on the differences within the region.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.centroids import position_tracking
from drake_pregrasp.contacts.selection_input import SelectionInput, WeightFunction
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.quality.force_closure import FRICTION, moved_least_norm_margin
from drake_pregrasp.quality.grasp_quality import skew

STRATEGIES = ("position", "msv", "gii", "vew", "margin")
"""Position tracking, the three measures of the grasp matrix, and the force-closure margin."""

READINGS = ("contact", "hand")
"""The two readings of the partial grasp matrix."""

BLEND = "blend"
"""Name of a blend in a configuration, besides the names of single strategies."""

FLAT = 1e-13
"""Share of the mean weight below which stretched weights are only rounding errors."""

Measure = Callable[[SelectionInput, int], FloatArray]
"""Maps a selection's input and the index of a contact to b_n of its region, shape (k,)."""


def hand_singular_values(r: FloatArray, q: FloatArray) -> FloatArray:
    """Returns the singular values of the hand's G_qn, ascending, for each place q_n, shape (k, 6).

    They are the square roots of the eigenvalues of G Gᵀ. With G_i = [[I, 0], [[r_i]x, I]] and the
    lever arms r_i of n contacts about the centre of mass, the product is

        G Gᵀ = [[n I, -[t]x], [[t]x, n I + B]],  t = sum r_i,  B = sum (|r_i|² I - r_i r_iᵀ),

    since [r]x [r]xᵀ = |r|² I - r rᵀ.

    Args:
        r: Lever arms of the fixed contacts, shape (n - 1, 3), in metres.
        q: Lever arms of the places q_n of one more contact, shape (k, 3), in metres.
    """
    n = len(r) + 1
    t = r.sum(axis=0) + q
    second_moment = r.T @ r + q[:, :, None] * q[:, None, :]
    B = np.trace(second_moment, axis1=1, axis2=2)[:, None, None] * np.eye(3) - second_moment
    GGT = np.zeros((len(q), 6, 6))
    GGT[:, :3, :3] = n * np.eye(3)
    GGT[:, 3:, :3] = skew(t)
    GGT[:, :3, 3:] = -GGT[:, 3:, :3]
    GGT[:, 3:, 3:] = n * np.eye(3) + B
    sigma: FloatArray = np.sqrt(np.maximum(np.linalg.eigvalsh(GGT), 0))
    return sigma


def hand_msv(selection: SelectionInput, i: int) -> FloatArray:
    """Returns b_n = sigma_min(G_qn) (Eq. 5)."""
    sigma_min: FloatArray = hand_singular_values(*selection.lever_arms(i))[:, 0]
    return sigma_min


def hand_gii(selection: SelectionInput, i: int) -> FloatArray:
    """Returns b_n = sigma_min(G_qn) / sigma_max(G_qn) (Eq. 6)."""
    sigma = hand_singular_values(*selection.lever_arms(i))
    isotropy: FloatArray = sigma[:, 0] / sigma[:, -1]
    return isotropy


def hand_vew(selection: SelectionInput, i: int) -> FloatArray:
    """Returns b_n = k sqrt(det(G_qn G_qnᵀ)) with k = 1 (Eq. 7).

    The determinant is the product of the squared singular values.
    """
    volume: FloatArray = np.prod(hand_singular_values(*selection.lever_arms(i)), axis=1)
    return volume


def contact_msv(selection: SelectionInput, i: int) -> FloatArray:
    """Returns the smallest singular value of each candidate's own matrix."""
    rho = np.linalg.norm(selection.lever_arms(i)[1], axis=1)
    sigma_min: FloatArray = np.sqrt(1 + rho**2 / 4) - rho / 2
    return sigma_min


def contact_gii(selection: SelectionInput, i: int) -> FloatArray:
    """Returns the isotropy of each candidate's own matrix."""
    return contact_msv(selection, i) ** 2


def contact_vew(selection: SelectionInput, i: int) -> FloatArray:
    """Returns the volume of each candidate's own matrix, whose determinant is one everywhere."""
    return np.ones(len(selection.regions.members(i)))


def hand_margin(selection: SelectionInput, i: int, *, friction: float = FRICTION) -> FloatArray:
    """Returns the lower bound b of the hand's margin with contact i at each candidate, shape (k,).

    The contacts are hard fingers. A negative b is replaced by b / (1 - b), which keeps the order
    and is never below -1, so that places far from force closure hardly affect the stretch.

    Args:
        selection: Contacts and their regions.
        i: Index of the contact.
        friction: Coulomb's coefficient.
    """
    surface = selection.surface
    active, members = np.flatnonzero(selection.active), selection.regions.members(i)
    bound = moved_least_norm_margin(
        selection.p_OC[active] - surface.p_OCoM,
        selection.project(selection.p_OC[active])[1],
        friction,
        moved=int(np.searchsorted(active, i)),
        p_CoMQ=surface.p_OQ[members] - surface.p_OCoM,
        nhat_Q=surface.nhat_OQ[members],
    )
    # 1/(1 - b) - 1 is b/(1 - b), and -1 for b = -inf, where the bound does not exist.
    return np.where(bound < 0, 1 / (1 - np.minimum(bound, 0)) - 1, bound)


_MEASURES: Mapping[tuple[str, str], Measure] = {
    ("msv", "contact"): contact_msv,
    ("gii", "contact"): contact_gii,
    ("vew", "contact"): contact_vew,
    ("msv", "hand"): hand_msv,
    ("gii", "hand"): hand_gii,
    ("vew", "hand"): hand_vew,
}


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
        reading: One of `READINGS`; `position` and `margin` ignore it.
        stretch: Whether to stretch the weights over each region; `position` ignores it.
        power: Exponent of the weights, after the stretch; `position` ignores it. The larger it is,
            the closer the weighted centroid is to the best point.
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
        return position_tracking
    measure = (
        partial(hand_margin, friction=friction) if name == "margin" else _MEASURES[name, reading]
    )

    def log_weights(selection: SelectionInput, i: int) -> FloatArray:
        b = measure(selection, i)
        if stretch:
            b = stretched(b, selection.surface.areas[selection.regions.members(i)])
        with np.errstate(divide="ignore"):
            logarithms: FloatArray = power * np.log(np.maximum(b, 0))
        return logarithms

    return log_weights


def stretched(b: FloatArray, areas: FloatArray) -> FloatArray:
    """Returns b_n - min b over a region, shape (k,); zeros if the differences are only rounding.

    Args:
        b: Weights of the region's candidates, shape (k,).
        areas: Surface area that each candidate represents, shape (k,), in m².
    """
    difference: FloatArray = b - b.min()
    return difference if difference @ areas > FLAT * (b @ areas) else np.zeros(len(b))


def make_blend(weights: Mapping[str, float], **options: Any) -> WeightFunction:
    """Returns the weight function of b_n = sum_s w_s b_n,s / max b_s, with maxima over the region.

    The weights of every strategy s are therefore from 0 to 1 in each region, in any unit. If all
    weights of a strategy are zero in a region, the strategy has no influence there.

    Args:
        weights: Weights w_s by the strategies' names, 0 for missing names. Only ratios matter.
        options: Further arguments of `make_strategy`.

    Raises:
        InvalidArgumentError: As for `make_strategy`, or if a weight is negative, or all are zero.
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
    parts = [(w, make_strategy(s, **options)) for s, w in weights.items() if w > 0]

    def log_weights(selection: SelectionInput, i: int) -> FloatArray:
        b = np.zeros(len(selection.regions.members(i)))
        for weight, strategy in parts:
            log_b = strategy(selection, i)
            highest = np.max(log_b)
            b += weight * np.exp(log_b - (highest if highest > -np.inf else 0.0))
        with np.errstate(divide="ignore"):
            logarithms: FloatArray = np.log(b)
        return logarithms

    return log_weights
