"""The four strategies that move a contact inside its safe region: Eq. 3 and Eq. 5-7 as weights.

The paper weighs a candidate q_n by a measure of the partial grasp matrix at q_n and leaves open
which matrix that is. Both readings are here:

- `contact`: the 6 x 6 matrix of q_n alone. With rho = |q_n - CoM|, sigma_min is
  sqrt(1 + rho²/4) - rho/2 and sigma_max = 1/sigma_min: Eq. 6 is the square of Eq. 5, and Eq. 7 is
  constant.
- `hand`: the whole G with the contact of q_n's region moved to q_n and the other active ones held.

Either is nearly flat over a region. Stretched, b_n - min b over the region, the weights say where
in the region the measure is better rather than that it is good all over.
"""

from collections.abc import Callable

import numpy as np

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.contact_selection import (
    SelectionInput,
    WeightFunction,
    gaussian_log_weights,
)
from drake_pregrasp.planning.extreme_singular_values import extreme_singular_values
from drake_pregrasp.planning.safe_regions import NO_REGION

STRATEGIES = ("position", "msv", "gii", "vew")
"""Position tracking (Eq. 3), and the measures of Eq. 5, 6 and 7."""

READINGS = ("contact", "hand")
"""The two readings of the partial grasp matrix."""

Measure = Callable[[SelectionInput], FloatArray]
"""Maps a selection's input to b_n for each candidate, shape (N,)."""


def make_strategy(name: str, *, reading: str = "hand", stretch: bool = True) -> WeightFunction:
    """Returns a strategy as a weight function.

    Args:
        name: One of `STRATEGIES`.
        reading: One of `READINGS`; `position` has only one.
        stretch: Whether to stretch the weights over each region; not for `position`.

    Raises:
        InvalidArgumentError: If there is no such strategy or reading.
    """
    if name not in STRATEGIES:
        raise InvalidArgumentError(f"no strategy {name!r}; there are: {', '.join(STRATEGIES)}")
    if reading not in READINGS:
        raise InvalidArgumentError(f"no reading {reading!r}; there are: {', '.join(READINGS)}")
    if name == "position":
        return position_tracking
    measures: dict[tuple[str, str], Measure] = {
        ("msv", "contact"): contact_msv,
        ("gii", "contact"): contact_gii,
        ("vew", "contact"): contact_vew,
        ("msv", "hand"): hand_msv,
        ("gii", "hand"): hand_gii,
        ("vew", "hand"): hand_vew,
    }
    measure = measures[name, reading]

    def log_weights(selection: SelectionInput) -> FloatArray:
        b = measure(selection)
        if stretch:
            b = stretched(b, selection)
        with np.errstate(divide="ignore"):
            logarithms: FloatArray = np.log(b)
        return logarithms

    return log_weights


def position_tracking(selection: SelectionInput) -> FloatArray:
    """Returns log(b_n) of Eq. 3 about the centre of mass, up to a constant."""
    surface = selection.surface
    return gaussian_log_weights(surface.p_OQ, surface.p_OCoM, selection.covariance_O)


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


def stretched(b: FloatArray, selection: SelectionInput) -> FloatArray:
    """Returns b_n less the least b over the candidate's region, shape (N,)."""
    labels = selection.regions.labels
    least = np.full(len(selection.p_OC) + 1, np.inf)
    np.minimum.at(least, labels, b)
    assert NO_REGION == -1  # Candidates without region gather in the last place.
    difference: FloatArray = b - least[labels]
    return difference


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
