"""Measures of a candidate: by its own grasp matrix (`contact_`) or the hand's with it (`hand_`).

Each maps a selection's input to b_n for each candidate, shape (N,), for Eq. 5-7 and the margin.
"""

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.extreme_singular_values import extreme_singular_values
from drake_pregrasp.planning.force_closure import FRICTION
from drake_pregrasp.planning.least_norm_margin import moved_least_norm_margin
from drake_pregrasp.planning.safe_regions import NO_REGION
from drake_pregrasp.planning.selection_input import SelectionInput


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
