"""Margins of force closure: min-weight, Ferrari-Canny, and a certified lower bound in closed form.

All use the primitive wrenches of a grasp: the wrenches on the object of the edges of a pyramid
inside each contact's friction cone, per newton of normal force.
"""

from collections.abc import Callable

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, QhullError

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.quality.grasp_quality import contact_blocks, longest_arm

CONE_MODELS = ("hard_finger", "soft_finger", "frictionless")
"""Contact models with a friction cone. The complete model has none, because it also pulls."""

_RANK_TOLERANCE = 1e-9  # Of singular values, for wrenches of the order of one.

_ROUNDING = 1e-13  # Of weights that add up to one.
_MOST_STEPS = 500  # Random grasps need a tenth of them at most.

LARGEST_LOAD = 10.0
"""Multiple of a wrench from which on contacts count as equally strong."""

CONE_EDGES = 8
"""Number of edges of the pyramid inside a friction cone."""

FRICTION = 0.7
"""Default of Coulomb's coefficient: rubber on most materials."""

TORSIONAL_FRICTION = 0.004
"""Largest moment about the normal of a soft finger per newton of normal force, in metres.

It is 3 pi/16 times friction times the patch's radius (Johnson, Contact Mechanics, 1985, for a
Hertzian patch that turns as a whole): 4 mm for a patch of radius 10 mm with friction 0.7.
"""


LargestMinimum = Callable[[FloatArray], float]
"""An implementation of `largest_minimum`."""


def min_weight_margin(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    friction: float,
    *,
    model: str = "hard_finger",
    torsional_friction: float = TORSIONAL_FRICTION,
    solve: LargestMinimum | None = None,
) -> float:
    """Returns the normalised min-weight margin of a grasp, in [0, 1].

    The m primitive wrenches of all contacts must balance with weights a >= 0 that add up to one;
    the margin is m times the largest possible minimum of a. It is above zero if and only if the
    grasp has force closure, which Q_MSV, Q_GII and Q_VEW do not measure. The metric is that of
    FRoGGeR (Li et al., arXiv 2302.13687). It does not depend on the unit of length.

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (n, 3), in metres.
        nhat: Outward unit normals at the contacts, in the same frame, shape (n, 3).
        friction: Coulomb's coefficient.
        model: One of `CONE_MODELS`.
        torsional_friction: Torsional friction of the soft finger, in metres.
        solve: Implementation of `largest_minimum`.

    Raises:
        InvalidArgumentError: If there is no such model, or a coefficient is below 0.
    """
    W = primitive_wrenches(
        p_CoMC, nhat, friction, model=model, torsional_friction=torsional_friction
    )
    # With torques in this unit, tolerances have the same meaning for objects of any size.
    W[3:] /= longest_arm(p_CoMC)
    return (solve or largest_minimum)(np.ascontiguousarray(W))


def largest_minimum(W: FloatArray) -> float:
    """Returns m times the largest possible minimum of the weights of m wrenches, at least 0.

    With a = b + l, b >= 0, the program is: max l with W (b + l) = 0, sum (b + l) = 1. The dual
    simplex method (Lemke, Naval Research Logistics Quarterly 1, 1954) solves it: of the basis of l
    and six elements of b, l falls in each step, until no weight is negative.

    Args:
        W: Wrenches of the order of one, shape (6, m), such that a has no solution or a bounded one.
    """
    m = W.shape[1]
    # One row for each wrench component, and one for l, which the last equation eliminates from the
    # others. The last column is the right side.
    T = np.full((7, m + 1), 1 / max(m, 1))
    for k in range(6):
        T[k, m] = -np.sum(W[k]) / max(m, 1)
        T[k, :m] = W[k] + T[k, m]
    for step in range(_MOST_STEPS):
        row = step
        if step >= 6:
            row = int(np.argmin(T[:6, m]))
            if T[row, m] >= -_ROUNDING:
                return max(0.0, float(m * T[6, m]))
        elif T[row, m] > 0:  # Each component enters the basis once, with any sign.
            T[row] *= -1
        column, least = -1, np.inf
        for j in range(m):
            if T[row, j] < -_RANK_TOLERANCE and T[6, j] < -least * T[row, j]:
                column, least = j, -T[6, j] / T[row, j]
        if column < 0:  # The wrenches leave out a direction.
            return 0.0
        T[row] /= T[row, column]
        for k in range(7):
            if k != row:
                T[k] -= T[k, column] * T[row]
    return 0.0


def ferrari_canny(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    friction: float,
    *,
    length: float,
    model: str = "hard_finger",
    torsional_friction: float = TORSIONAL_FRICTION,
) -> float:
    """Returns the radius of the largest ball about the origin inside the grasp wrench space.

    The space is the convex hull of the primitive wrenches: normal forces that add up to one newton
    (the L1 metric of Ferrari & Canny, ICRA 1992). The radius is the norm of the smallest wrench
    that the grasp cannot resist, in newtons, with torques divided by `length`. It is zero without
    force closure.

    Args:
        p_CoMC: As for `min_weight_margin`.
        nhat: As for `min_weight_margin`.
        friction: As for `min_weight_margin`.
        length: Length by which torques are divided, in metres, greater than zero.
        model: One of `CONE_MODELS`.
        torsional_friction: As for `min_weight_margin`.

    Raises:
        InvalidArgumentError: As for `min_weight_margin`, or if the length is not above 0.
    """
    if not length > 0:
        raise InvalidArgumentError(f"length must be greater than 0 m, not {length}")
    W = primitive_wrenches(
        p_CoMC, nhat, friction, model=model, torsional_friction=torsional_friction
    )
    W[3:] /= longest_arm(p_CoMC)
    # A hull in six dimensions has at least seven corners.
    if W.shape[1] <= len(W) or not _spans_all_wrenches(W):
        return 0.0
    W[3:] *= longest_arm(p_CoMC) / length
    try:
        hull = ConvexHull(W.T)
    except QhullError:  # All wrenches lie in one plane that does not contain the origin.
        return 0.0
    # Each facet's plane is normal @ x + offset = 0, with its unit normal pointing out.
    return max(0.0, float(-np.max(hull.equations[:, -1])))


def largest_load(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    friction: float,
    *,
    wrench: FloatArray,
    normal_forces: FloatArray,
) -> float:
    """Returns the largest multiple of a wrench on the object that hard fingers balance.

    It is 0 if the fingers do not even balance each other, and at most `LARGEST_LOAD`.

    Args:
        p_CoMC: As for `min_weight_margin`.
        nhat: As for `min_weight_margin`.
        friction: As for `min_weight_margin`.
        wrench: Force in N and torque about the centre of mass in N m, shape (6,).
        normal_forces: Smallest and largest normal force of each contact, shape (2, n), in N.
    """
    W = primitive_wrenches(p_CoMC, nhat, friction, model="hard_finger", torsional_friction=0.0)
    balance = np.hstack([W, wrench[:, None]])
    balance[3:] /= longest_arm(p_CoMC)
    normals = np.hstack([np.kron(np.eye(len(nhat)), np.ones(CONE_EDGES)), np.zeros((len(nhat), 1))])
    least, most = normal_forces
    solution = linprog(
        c=np.append(np.zeros(W.shape[1]), -1.0),
        A_eq=balance,
        b_eq=np.zeros(6),
        A_ub=np.vstack([normals, -normals]),
        b_ub=np.append(most, -least),
        bounds=[(0, None)] * W.shape[1] + [(0, LARGEST_LOAD)],
    )
    return float(solution.x[-1]) if solution.success else 0.0


def primitive_wrenches(
    p_CoMC: FloatArray, nhat: FloatArray, friction: float, *, model: str, torsional_friction: float
) -> FloatArray:
    """Returns the wrenches of the cones' edges per newton of normal force, shape (6, en).

    Args:
        p_CoMC: As for `min_weight_margin`.
        nhat: As for `min_weight_margin`.
        friction: As for `min_weight_margin`.
        model: One of `CONE_MODELS`.
        torsional_friction: As for `min_weight_margin`.

    Returns:
        The wrenches for e edges per contact, force rows first, torques in N m per newton.
    """
    edges = cone_edges(friction, model, torsional_friction)
    wrenches = contact_blocks(p_CoMC, nhat, model) @ edges
    W: FloatArray = wrenches.transpose(1, 0, 2).reshape(6, -1)
    return W


def cone_edges(friction: float, model: str, torsional_friction: float) -> FloatArray:
    """Returns the edges of a contact's cone in the coordinates of its model: n, t, o, moment.

    A soft finger has two more edges, with a moment and without tangential force: the polytope is
    inscribed in the ellipsoid that bounds moment and tangential force together.

    Returns:
        The edges as columns of E, shape (k, e). The first row, the normal forces, is all ones, and
        E Eᵀ is diagonal.

    Raises:
        InvalidArgumentError: If there is no such model, or a coefficient is below 0.
    """
    if model not in CONE_MODELS:
        raise InvalidArgumentError(
            f"no contact model with a friction cone {model!r}; there are: {', '.join(CONE_MODELS)}"
        )
    for name, value in (("friction", friction), ("torsional_friction", torsional_friction)):
        if not value >= 0:
            raise InvalidArgumentError(f"{name} must be at least 0, not {value}")
    if model == "frictionless":
        return np.ones((1, 1))
    angles = 2 * np.pi * np.arange(CONE_EDGES) / CONE_EDGES
    E = np.stack([np.ones(CONE_EDGES), friction * np.cos(angles), friction * np.sin(angles)])
    if model == "soft_finger":
        twists = np.array([[1.0, 1], [0, 0], [0, 0]])
        moments = np.append(np.zeros(CONE_EDGES), [torsional_friction, -torsional_friction])
        E = np.vstack([np.hstack([E, twists]), moments])
    return E


def _spans_all_wrenches(W: FloatArray) -> bool:
    """Returns whether the rank is six; torques are in a unit that makes them comparable."""
    return bool(np.linalg.matrix_rank(W, tol=_RANK_TOLERANCE) == len(W))


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
    """Returns the lower bound m min(a) of the margin for sets of n contacts at once, shape (...).

    It is at most 1, and -inf where the primitive wrenches do not span all wrenches.

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (..., n, 3), in metres.
        nhat: Outward unit normals at the contacts, in the same frame, shape (..., n, 3).
        friction: Coulomb's coefficient.
        model: One of `CONE_MODELS`.
        torsional_friction: Torsional friction of the soft finger, in metres.

    Raises:
        InvalidArgumentError: As for `min_weight_margin`.
    """
    E = cone_edges(friction, model, torsional_friction)
    P = balance_blocks(p_CoMC, nhat, model, longest_arm(p_CoMC))
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
    moved: int,
    p_CoMQ: FloatArray,
    nhat_Q: FloatArray,
    model: str = "hard_finger",
    torsional_friction: float = TORSIONAL_FRICTION,
) -> FloatArray:
    """Returns `least_norm_margin` of a grasp with one contact at each of N places, shape (N,).

    Args:
        p_CoMC: As for `least_norm_margin`, shape (n, 3).
        nhat: As for `least_norm_margin`, shape (n, 3).
        friction: As for `least_norm_margin`.
        moved: Index of the contact that moves to the places.
        p_CoMQ: Lever arms of the places, shape (N, 3), in metres.
        nhat_Q: Outward unit normals at the places, shape (N, 3).
        model: As for `least_norm_margin`.
        torsional_friction: As for `least_norm_margin`.

    Raises:
        InvalidArgumentError: As for `min_weight_margin`.
    """
    E = cone_edges(friction, model, torsional_friction)
    arm = max(longest_arm(p_CoMC), longest_arm(p_CoMQ))
    P = balance_blocks(p_CoMC, nhat, model, arm)
    P_Q = balance_blocks(p_CoMQ, nhat_Q, model, arm)
    others = np.delete(P, moved, axis=2)
    y, spans = _solve(np.sum(_grams(others, E), axis=2)[:, :, None] + _grams(P_Q, E))
    least = np.min(_edge_weights(P_Q, E, y[:, None]), axis=0)
    weights = _edge_weights(others[..., None], E, y[:, None, None])
    least = np.minimum(least, np.min(weights, axis=(0, 1), initial=np.inf))
    n = len(p_CoMC)
    if model == "hard_finger" and n < 3:  # No moment about the line through both; rounding has one.
        spans = np.zeros_like(spans)
    return np.where(spans, n * E.shape[1] * np.where(spans, least, 0), -np.inf)


# Below, the 7 rows of A come first and the many grasps last, so that loops over few rows vectorise.


def balance_blocks(p_CoMC: FloatArray, nhat: FloatArray, model: str, arm: float) -> FloatArray:
    """Returns P_i, shape (7, k, n, ...), of contacts (..., n, 3); torques are divided by an arm."""
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
    """Returns the weights Eᵀ P_iᵀ y of the edges, shape (e, n, ...), for y along axis 0."""
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
        spans &= pivot > GRAM_RANK_TOLERANCE * largest
        pivot = np.where(spans, pivot, 1)
        L[j + 1 :, j] = M[j + 1 :, j] / pivot
        M[j + 1 :, j + 1 :] -= L[j + 1 :, None, j] * M[None, j, j + 1 :]
    y = np.zeros((size, *M.shape[2:]))
    y[-1] = 1 / pivot
    for j in reversed(range(size - 1)):
        y[j] = -np.sum(L[j + 1 :, j] * y[j + 1 :], axis=0)
    return y, spans
