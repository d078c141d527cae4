"""A certified lower bound of the min-weight margin, in closed form, for thousands of grasps.

The min-weight margin of m primitive wrenches W is m times the largest least weight among all
weights a with

    A a = e,   A = [W; 1ᵀ] (7 x m),   e = (0, 0, 0, 0, 0, 0, 1):

they balance, and they add up to one. (A largest least weight is never below the one of any such a,
and it is what the linear programme finds.) The one of least norm is

    a = Aᵀ y,   (A Aᵀ) y = e,

so m min(a) is never above the margin. Where it is positive, all weights are, and with A of full
rank that is force closure. Where it is not, nothing is known. It equals the margin where the
wrenches add up to zero: then all weights are equal and both are one.

Replacing W by S W, with any invertible S, replaces y by a y that gives the same a. So neither
margin depends on the unit of length, nor on the point that torques are about.

The wrenches of contact i are P_i E, the edges E (k x e) being those of `cone_edges` and P_i its
block G_i over a row (1, 0, ...). As E Eᵀ is diagonal, A Aᵀ is the sum of P_i (E Eᵀ) P_iᵀ over the
contacts. Moving one contact changes one term of rank k <= 4, and the 7 x 7 system is solved for
all its places at once.
"""

import numpy as np

from drake_pregrasp.planning.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.planning.contact_models import contact_blocks
from drake_pregrasp.planning.force_closure import (
    TORSIONAL_FRICTION,
    cone_edges,
    longest_arm,
)

_RANK_TOLERANCE = 1e-10  # Of a pivot over the largest one, torques being divided by an arm.


def least_norm_margin(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    friction: float,
    *,
    model: str = "hard_finger",
    torsional_friction: float = TORSIONAL_FRICTION,
) -> FloatArray:
    """Returns the lower bound m min(a) of the margin, at most 1, for sets of n contacts at once.

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (..., n, 3), in metres.
        nhat: Outward unit normals there, in the same frame, shape (..., n, 3).
        friction: Coulomb's coefficient.
        model: One of `CONE_MODELS`.
        torsional_friction: Of the soft finger, in metres.

    Returns:
        Shape (...); -inf where the wrenches don't span all there are.

    Raises:
        InvalidArgumentError: As of `min_weight_margin`.
    """
    E = cone_edges(friction, model, torsional_friction)
    P = _balance_blocks(p_CoMC, nhat, model, longest_arm(p_CoMC))
    y, spans = _solve(np.sum(_grams(P, E), axis=2))
    weights = _edge_weights(P, E, y[:, None, None])
    least = np.min(weights, axis=(0, 1), initial=np.inf)
    m = E.shape[1] * p_CoMC.shape[-2]
    return np.where(spans, m * np.where(spans, least, 0), -np.inf)


def moved_least_norm_margin(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    friction: float,
    *,
    moved: IntArray,
    p_CoMQ: FloatArray,
    nhat_Q: FloatArray,
    model: str = "hard_finger",
    torsional_friction: float = TORSIONAL_FRICTION,
) -> FloatArray:
    """Returns `least_norm_margin` of one grasp with one contact moved, for N places at once.

    Args:
        p_CoMC: As for `least_norm_margin`, shape (n, 3).
        nhat: As for `least_norm_margin`, shape (n, 3).
        friction: As for `least_norm_margin`.
        moved: Index of the contact that moves to each place, shape (N,).
        p_CoMQ: Lever arms of the places, shape (N, 3), in metres.
        nhat_Q: Outward unit normals there, shape (N, 3).
        model: As for `least_norm_margin`.
        torsional_friction: As for `least_norm_margin`.

    Returns:
        Shape (N,).

    Raises:
        InvalidArgumentError: As of `min_weight_margin`.
    """
    E = cone_edges(friction, model, torsional_friction)
    arm = max(longest_arm(p_CoMC), longest_arm(p_CoMQ))
    P = _balance_blocks(p_CoMC, nhat, model, arm)
    P_Q = _balance_blocks(p_CoMQ, nhat_Q, model, arm)
    held = _grams(P, E)
    others = np.sum(held, axis=2)[:, :, None] - held
    y, spans = _solve(others[:, :, moved] + _grams(P_Q, E))
    least = np.min(_edge_weights(P_Q, E, y[:, None]), axis=0)
    n = len(p_CoMC)
    for i in range(n):
        places = np.flatnonzero(moved == i)
        held_P = np.delete(P, i, axis=2)[..., None]
        weights = _edge_weights(held_P, E, y[:, None, None, places])
        least[places] = np.minimum(least[places], np.min(weights, axis=(0, 1), initial=np.inf))
    return np.where(spans, n * E.shape[1] * np.where(spans, least, 0), -np.inf)


# Below, the 7 rows of A come first and the many grasps last, so that loops over few rows vectorise.


def _balance_blocks(p_CoMC: FloatArray, nhat: FloatArray, model: str, arm: float) -> FloatArray:
    """Returns P_i, shape (7, k, n, ...) for contacts (..., n, 3), torques divided by an arm."""
    G = contact_blocks(p_CoMC, nhat, model)
    G[..., 3:, :] /= arm
    ones = np.zeros((*G.shape[:-2], 1, G.shape[-1]))
    ones[..., 0] = 1
    P = np.concatenate([G, ones], axis=-2)
    return np.ascontiguousarray(P.transpose(-2, -1, -3, *range(P.ndim - 3)))


def _grams(P: FloatArray, E: FloatArray) -> FloatArray:
    """Returns P_i (E Eᵀ) P_iᵀ, shape (7, 7, n, ...)."""
    scaled = P * np.sum(E**2, axis=1).reshape(-1, *[1] * (P.ndim - 2))
    grams: FloatArray = np.einsum("ak...,bk...->ab...", scaled, P)
    return grams


def _edge_weights(P: FloatArray, E: FloatArray, y: FloatArray) -> FloatArray:
    """Returns the weights Eᵀ P_iᵀ y of the edges, shape (e, n, ...), y running along axis 0."""
    components = np.sum(P * y, axis=0)
    weights: FloatArray = np.tensordot(E.T, components, axes=1)
    return weights


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
        spans &= pivot > _RANK_TOLERANCE * largest
        pivot = np.where(spans, pivot, 1)
        L[j + 1 :, j] = M[j + 1 :, j] / pivot
        M[j + 1 :, j + 1 :] -= L[j + 1 :, None, j] * M[None, j, j + 1 :]
    y = np.zeros((size, *M.shape[2:]))
    y[-1] = 1 / pivot
    for j in reversed(range(size - 1)):
        y[j] = -np.sum(L[j + 1 :, j] * y[j + 1 :], axis=0)
    return y, spans
