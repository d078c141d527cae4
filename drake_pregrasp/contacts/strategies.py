"""Strategies: weights b_n of the candidates q_n of a safe region (Eq. 5-7), and blends of them.

A strategy maps the selection's input and the index i of a contact to log(b_n) of the candidates in
its region S_i, shape (k,). `STRATEGIES` lists the names.

The paper weights a candidate by a measure of the partial grasp matrix G_qn, but does not define
this matrix. There are two readings:

- `contact`: the matrix of q_n alone. With the complete model and rho = |q_n - CoM|, sigma_min is
  sqrt(1 + rho²/4) - rho/2 and sigma_max = 1/sigma_min: isotropy is sigma_min², and the volume is
  constant. The matrices of the other contact models have at most four columns: sigma_min is zero.
- `hand`: the matrix of the whole hand with contact i at q_n, and the other active contacts fixed.

These measures ignore force closure. The strategy `margin`, which the paper does not have, weights a
candidate by a lower bound of the hand's min-weight margin, and `independence`, after the
independent contact regions that the paper names, by how far the contact may slip from there. Both
are for hard fingers, in the reading `hand` only.

All these weights are nearly constant over a region. Stretched weights, b_n - min b over the region,
depend only on the differences within the region.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.contacts.centroids import position_tracking
from drake_pregrasp.contacts.selection_input import SelectionInput, WeightFunction
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.quality import grasp_quality
from drake_pregrasp.quality.force_closure import FRICTION, LEAST_MARGIN
from drake_pregrasp.quality.margin_bounds import moved_least_norm_margin
from drake_pregrasp.regions.finger_measures import FINGER_MEASURES
from drake_pregrasp.regions.independent_regions import slip_radii

STRATEGIES = ("position", "msv", "gii", "vew", "margin", "independence", *FINGER_MEASURES)
"""Position tracking, the three measures of the grasp matrix, the force-closure margin, how far a
contact may slip without losing force closure, and the measures of a hand's fingers."""

READINGS = ("contact", "hand")
"""The two readings of the partial grasp matrix."""

BLEND = "blend"
"""Name of a blend in a configuration, besides the names of single strategies."""

RANK_TOLERANCE = 1e-6
"""Share of the largest eigenvalue of G Gᵀ up to which another one counts as zero.

Singular values are then exact to 1e-9 where they are not zero, since an eigenvalue has the rounding
error of the largest one.
"""

FLAT = 1e-13
"""Share of the mean weight below which stretched weights are only rounding errors."""

Measure = Callable[[SelectionInput, int], FloatArray]
"""Maps a selection's input and the index of a contact to b_n of its region, shape (k,)."""


def singular_values(
    selection: SelectionInput, i: int, *, reading: str, contact_model: str, length: float
) -> FloatArray:
    """Returns the singular values of G_qn for each candidate of a region, ascending, shape (k, 6).

    They are the square roots of the eigenvalues of G Gᵀ = sum G_j G_jᵀ over the contacts, where the
    contact model decides G_j. As in `grasp_quality`, they are zero if G has fewer than six columns
    or a lower rank; here that is below a thousandth of the largest one. One complete contact has
    the rank six.

    Args:
        selection: Contacts and their regions.
        i: Index of the contact.
        reading: One of `READINGS`.
        contact_model: One of `CONTACT_MODELS`.
        length: Unit of the lever arms, in metres; 0 for the default of `characteristic_length`.
    """
    surface, members = selection.surface, selection.regions.members(i)
    unit = grasp_quality.characteristic_length(length, contact_model, surface.longest_lever_arm)
    q = (surface.p_OQ[members] - surface.p_OCoM) / unit
    A = grasp_quality.contact_blocks(q, surface.nhat_OQ[members], contact_model)
    GGT = A @ A.swapaxes(1, 2)
    if reading == "hand":
        others = np.flatnonzero(selection.active)
        p_OC = selection.p_OC[others[others != i]]
        r = (p_OC - surface.p_OCoM) / unit
        A = grasp_quality.contact_blocks(r, selection.surface.project(p_OC)[1], contact_model)
        GGT += np.sum(A @ A.swapaxes(1, 2), axis=0)
    squares = np.linalg.eigvalsh(GGT)
    least = 0.0 if contact_model == "complete" else RANK_TOLERANCE
    squares[squares <= least * squares[:, -1:]] = 0
    sigma: FloatArray = np.sqrt(squares)
    return sigma


def smallest_singular_value(sigma: FloatArray) -> FloatArray:
    """Returns b_n = sigma_min(G_qn) (Eq. 5), shape (k,), of ascending values, shape (k, 6)."""
    return sigma[:, 0]


def isotropy_index(sigma: FloatArray) -> FloatArray:
    """Returns b_n = sigma_min(G_qn) / sigma_max(G_qn) (Eq. 6), as `smallest_singular_value`."""
    return sigma[:, 0] / sigma[:, -1]


def ellipsoid_volume(sigma: FloatArray) -> FloatArray:
    """Returns b_n = k sqrt(det(G_qn G_qnᵀ)) with k = 1 (Eq. 7), as `smallest_singular_value`.

    The determinant is the product of the squared singular values.
    """
    volume: FloatArray = np.prod(sigma, axis=1)
    return volume


def margin_bounds(
    selection: SelectionInput, i: int, candidates: IntArray, friction: float
) -> FloatArray:
    """Returns the lower bound of the hand's margin with contact i at each candidate, shape (k,).

    Args:
        selection: Contacts and their regions.
        i: Index of the contact.
        candidates: Indices of the candidates, shape (k,).
        friction: Coulomb's coefficient.
    """
    surface, active = selection.surface, np.flatnonzero(selection.active)
    return moved_least_norm_margin(
        selection.p_OC[active] - surface.p_OCoM,
        selection.surface.project(selection.p_OC[active])[1],
        friction,
        moved=int(np.searchsorted(active, i)),
        p_CoMQ=surface.p_OQ[candidates] - surface.p_OCoM,
        nhat_Q=surface.nhat_OQ[candidates],
    )


def hand_margin(selection: SelectionInput, i: int, *, friction: float = FRICTION) -> FloatArray:
    """Returns `margin_bounds` b of a region's candidates, shape (k,).

    A negative b is replaced by b / (1 - b), which keeps the order and is never below -1, so that
    places far from force closure hardly affect the stretch.
    """
    bound = margin_bounds(selection, i, selection.regions.members(i), friction)
    # 1/(1 - b) - 1 is b/(1 - b), and -1 for b = -inf, where the bound does not exist.
    return np.where(bound < 0, 1 / (1 - np.minimum(bound, 0)) - 1, bound)


def finger_measure(selection: SelectionInput, i: int, *, name: str) -> FloatArray:
    """Returns one of the `FINGER_MEASURES` of finger i at each candidate, shape (k,).

    It is zero where the finger cannot bring its tip.

    Args:
        selection: Contacts and their regions.
        i: Index of the contact.
        name: One of `FINGER_MEASURES`.
    """
    n, surface = selection.regions.members(i), selection.surface
    measures = selection.regions.constraints.predicates.finger_measures_at(
        np.full(len(n), i), surface.p_OQ[n], surface.nhat_OQ[n]
    )
    return np.nan_to_num(measures[:, FINGER_MEASURES.index(name)])


def hand_independence(
    selection: SelectionInput, i: int, *, friction: float = FRICTION
) -> FloatArray:
    """Returns `slip_radii` of a region's candidates, with the other contacts fixed, shape (k,)."""
    everywhere = np.arange(len(selection.surface.p_OQ))
    is_closed = margin_bounds(selection, i, everywhere, friction) > LEAST_MARGIN
    return slip_radii(selection.surface, is_closed, selection.regions.members(i))


MEASURES: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "msv": smallest_singular_value,
    "gii": isotropy_index,
    "vew": ellipsoid_volume,
}
"""The measures of singular values, by the names of their strategies."""

HAND_MEASURES = {"margin": hand_margin, "independence": hand_independence}
"""The measures of friction cones, by the names of their strategies."""


def _measure_of_matrix(selection: SelectionInput, i: int, *, name: str, **model: Any) -> FloatArray:
    if (name, model["reading"], model["contact_model"]) == ("vew", "contact", "complete"):
        return np.ones(len(selection.regions.members(i)))  # The determinant is one everywhere.
    return MEASURES[name](singular_values(selection, i, **model))


def make_strategy(
    name: str,
    *,
    reading: str = "hand",
    contact_model: str = "complete",
    length: float = 0.0,
    stretch: bool = True,
    power: float = 1.0,
    friction: float = FRICTION,
) -> WeightFunction:
    """Returns a strategy as a weight function.

    Args:
        name: One of `STRATEGIES`.
        reading: One of `READINGS`; only msv, gii and vew use it and the next two.
        contact_model: One of `CONTACT_MODELS`.
        length: Unit of the lever arms, in metres; 0 for the default of `characteristic_length`.
        stretch: Whether to stretch the weights over each region; `position` ignores it.
        power: Exponent of the weights, after the stretch; `position` ignores it. The larger it is,
            the closer the weighted centroid is to the best point.
        friction: Coulomb's coefficient, for `margin` and `independence`.

    Raises:
        InvalidArgumentError: If there is no such strategy, reading or contact model, or a number is
            out of range.
    """
    if name not in STRATEGIES:
        raise InvalidArgumentError(f"no strategy {name!r}; there are: {', '.join(STRATEGIES)}")
    if reading not in READINGS:
        raise InvalidArgumentError(f"no reading {reading!r}; there are: {', '.join(READINGS)}")
    if contact_model not in grasp_quality.CONTACT_MODELS:
        models = ", ".join(grasp_quality.CONTACT_MODELS)
        raise InvalidArgumentError(f"no contact model {contact_model!r}; there are: {models}")
    if not length >= 0:
        raise InvalidArgumentError(f"length must be at least 0 m, not {length}")
    if not power > 0:
        raise InvalidArgumentError(f"power must be greater than 0, not {power}")
    if not friction >= 0:
        raise InvalidArgumentError(f"friction must be at least 0, not {friction}")
    if name == "position":
        return position_tracking
    measure: Measure
    if name in HAND_MEASURES:
        measure = partial(HAND_MEASURES[name], friction=friction)
    elif name in FINGER_MEASURES:
        measure = partial(finger_measure, name=name)
    else:
        model: dict[str, Any] = {"contact_model": contact_model, "length": length}
        measure = partial(_measure_of_matrix, name=name, reading=reading, **model)

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
