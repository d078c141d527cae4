"""Lower bounds of the min-weight margin in closed form, for many grasps at once."""

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.quality.force_closure import TORSIONAL_FRICTION, friction_cones
from drake_pregrasp.quality.grasp_quality import longest_arm

GRAM_RANK_TOLERANCE = 1e-10
"""Least share of a pivot in the largest one, with torques divided by an arm."""


def least_norm_margin(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    friction: float,
    *,
    model: str = "hard_finger",
    torsional_friction: float = TORSIONAL_FRICTION,
) -> FloatArray:
    """Returns a lower bound of the margin for sets of n contacts at once, shape (...).

    It is n min_i (g_i0 - |g_it|) for the internal forces of least norm, g_i = P_iᵀ y with
    M y = e, M = sum P_i P_iᵀ and P_i = [B_i; 1 0 ... 0]. It is at most 1, and -inf where M is
    singular.

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (..., n, 3), in metres.
        nhat: Outward unit normals at the contacts, in the same frame, shape (..., n, 3).
        friction: Coulomb's coefficient.
        model: One of `CONE_MODELS`.
        torsional_friction: Torsional friction of the soft finger, in metres.

    Raises:
        InvalidArgumentError: If there is no such model, or a coefficient is below 0.
    """
    cones = friction, model, torsional_friction
    P = balance_blocks(p_CoMC, nhat, *cones, longest_arm(p_CoMC))
    y, spans = _solve(np.sum(_grams(P), axis=2))
    least = np.min(_cone_margins(P, y[:, None, None]), axis=0, initial=np.inf)
    return np.where(spans, p_CoMC.shape[-2] * np.where(spans, least, 0), -np.inf)


def moved_least_norm_margin(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    friction: float,
    *,
    moved: int,
    p_CoMQ: FloatArray,
    nhat_Q: FloatArray,
    model: str = "hard_finger",
    torsional_friction: float | FloatArray = TORSIONAL_FRICTION,
) -> FloatArray:
    """Returns `least_norm_margin` of a grasp with one contact at each of N places, shape (N,).

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (n, 3), in metres.
        nhat: Outward unit normals at the contacts, in the same frame, shape (n, 3).
        friction: Coulomb's coefficient.
        moved: Index of the contact that moves to the places.
        p_CoMQ: Lever arms of the places, shape (N, 3), in metres.
        nhat_Q: Outward unit normals at the places, shape (N, 3).
        model: One of `CONE_MODELS`.
        torsional_friction: Torsional friction of the soft fingers, a scalar or of shape (n,), in
            metres.

    Raises:
        InvalidArgumentError: If there is no such model, or a coefficient is below 0.
    """
    arm = max(longest_arm(p_CoMC), longest_arm(p_CoMQ))
    cones, own = (friction, model), np.broadcast_to(torsional_friction, len(p_CoMC))
    others = np.delete(balance_blocks(p_CoMC, nhat, *cones, own, arm), moved, axis=2)
    P_Q = balance_blocks(p_CoMQ, nhat_Q, *cones, own[moved], arm)
    y, spans = _solve(np.sum(_grams(others), axis=2)[:, :, None] + _grams(P_Q))
    least = np.min(_cone_margins(others[..., None], y[:, None, None]), axis=0, initial=np.inf)
    least = np.minimum(least, _cone_margins(P_Q, y[:, None]))
    n = len(p_CoMC)
    if model == "hard_finger" and n < 3:  # No moment about the line through both; rounding has one.
        spans = np.zeros_like(spans)
    return np.where(spans, n * np.where(spans, least, 0), -np.inf)


# Below, the 7 rows of A come first and the many grasps last, so that loops over few rows vectorise.


def balance_blocks(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    friction: float,
    model: str,
    torsional_friction: float | FloatArray,
    arm: float,
) -> FloatArray:
    """Returns P_i, shape (7, k, n, ...), of contacts (..., n, 3); torques are divided by an arm."""
    B = friction_cones(p_CoMC, nhat, friction, model, torsional_friction)
    B[..., 3:, :] /= arm
    ones = np.zeros((*B.shape[:-2], 1, B.shape[-1]))
    ones[..., 0] = 1
    P = np.concatenate([B, ones], axis=-2)
    return np.ascontiguousarray(P.transpose(-2, -1, -3, *range(P.ndim - 3)))


def _grams(P: FloatArray) -> FloatArray:
    """Returns P_i P_iᵀ, shape (7, 7, n, ...)."""
    grams: FloatArray = np.einsum("ak...,bk...->ab...", P, P)
    return grams


def _cone_margins(P: FloatArray, y: FloatArray) -> FloatArray:
    """Returns g_i0 - |g_it| of g_i = P_iᵀ y, shape (n, ...), for y along axis 0."""
    g = np.sum(P * y, axis=0)
    margins: FloatArray = g[0] - np.sqrt(np.sum(g[1:] ** 2, axis=0))
    return margins


def _solve(M: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Returns y of M y = e, shape (7, ...), and whether M has full rank, by M = L D Lᵀ.

    As L is unit triangular and e has only its last element, D Lᵀ y = e.
    """
    size = len(M)
    largest = np.max(np.einsum("aa...->a...", M), axis=0)
    M, L = M.copy(), np.zeros_like(M)
    spans = np.ones(M.shape[2:], dtype=bool)
    pivot = largest
    for j in range(size):
        pivot = M[j, j]
        spans &= pivot > GRAM_RANK_TOLERANCE * largest
        pivot = np.where(spans, pivot, 1)
        L[j + 1 :, j] = M[j + 1 :, j] / pivot
        M[j + 1 :, j + 1 :] -= L[j + 1 :, None, j] * M[None, j, j + 1 :]
    y = np.zeros((size, *M.shape[2:]))
    y[-1] = 1 / pivot
    for j in reversed(range(size - 1)):
        y[j] = -np.sum(L[j + 1 :, j] * y[j + 1 :], axis=0)
    return y, spans
