"""Margins of force closure: min-weight, Ferrari-Canny, and the largest load.

They use exact friction cones. With B_i of `friction_cones`, contact i exerts the wrenches B_i g_i
with g_i in the second-order cone, g_0 >= |(g_1, g_2, ...)|: its normal force is g_0, and the other
components are tangential forces and a moment over the largest ones per newton.
"""

from collections.abc import Callable, Sequence
from typing import Any

import clarabel
import numpy as np
from scipy.linalg import null_space
from scipy.sparse import csc_matrix
from scipy.spatial import ConvexHull

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.quality.grasp_quality import contact_blocks, longest_arm

CONE_MODELS = ("hard_finger", "soft_finger", "frictionless")
"""Contact models with a friction cone. The complete model has none, because it also pulls."""

LEAST_MARGIN = 1e-7
"""Margin up to which a grasp counts as not force-closed."""

LEAST_SPREAD = 1e-12
"""Least share of an eigenvalue in the trace of a Gram matrix of wrenches that span all wrenches."""

LARGEST_LOAD = 10.0
"""Multiple of a wrench from which on contacts count as equally strong."""

FRICTION = 0.7
"""Default of Coulomb's coefficient: rubber on most materials."""

TORSIONAL_FRICTION = 0.004
"""Largest moment about the normal of a soft finger per newton of normal force, in metres.

It is that of `torsional_friction_of` for a patch of radius 10 mm with friction 0.7.
"""


def torsional_friction_of(friction: float, patch_radius: FloatArray) -> FloatArray:
    """Returns the largest moments about the normal per newton of normal force, in metres.

    It is 3 pi/16 times friction times the radius for a Hertzian patch that turns as a whole
    (Johnson, Contact Mechanics, 1985; Ciocarlie, Lackner & Allen, World Haptics 2007). An even
    pressure, as under a flat pad, allows 2/3 instead of 3 pi/16, and an even pressure along a line,
    as where the pad touches a cylinder, 1/2.

    Args:
        friction: Coulomb's coefficient.
        patch_radius: Radii of the patches in metres, of any shape; 0 for a hard finger.
    """
    return np.asarray(3 * np.pi / 16 * friction * np.asarray(patch_radius))


_RANK_TOLERANCE = 1e-9  # Of singular values, relative to the largest.
_ACCURACY = 1e-10  # Of the solver: absolute and relative gap, and infeasibility.
_SOLVED = ("Solved", "AlmostSolved")
_EDGES = np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]])
_DESCENTS = 50  # Largest number of steps of a descent to a facet's minimum.
_ROUGHEST, _FRICTION_STEP = 2.0, 0.05  # Largest friction to try, and the step.


LargestMinimum = Callable[[FloatArray], float]
"""An implementation of `largest_minimum`."""


def min_weight_margin(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    friction: float,
    *,
    model: str = "hard_finger",
    torsional_friction: float | FloatArray = TORSIONAL_FRICTION,
    solve: LargestMinimum | None = None,
) -> float:
    """Returns the normalised min-weight margin of a grasp, in [0, 1].

    Internal forces balance each other, with normal forces that add up to one newton. The margin is
    n times the largest possible minimum, over the n contacts, of the normal force less the normal
    force that friction needs. It is above zero if and only if the grasp has force closure with
    these cones, which Q_MSV, Q_GII and Q_VEW do not measure. It is the limit, for pyramids with
    more and more edges, of the metric of FRoGGeR (Li et al., arXiv 2302.13687), and depends neither
    on the axes of a frame nor on the unit of length.

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (n, 3), in metres.
        nhat: Outward unit normals at the contacts, in the same frame, shape (n, 3).
        friction: Coulomb's coefficient.
        model: One of `CONE_MODELS`.
        torsional_friction: Torsional friction of the soft fingers, a scalar or of shape (n,), in
            metres.
        solve: Implementation of `largest_minimum`.

    Raises:
        InvalidArgumentError: If there is no such model, or a coefficient is below 0.
    """
    B = friction_cones(p_CoMC, nhat, friction, model, torsional_friction)
    # With torques in this unit, tolerances have the same meaning for objects of any size.
    B[:, 3:] /= longest_arm(p_CoMC)
    return (solve or largest_minimum)(B)


def needed_friction(
    grasps: Sequence[tuple[FloatArray, FloatArray, dict[str, Any]]], least: float
) -> float:
    """Returns the least friction with which one of some grasps has force closure, within 0.05.

    Args:
        grasps: Lever arms, normals and further arguments of each grasp, for `min_weight_margin`.
        least: Smallest coefficient of friction to try.

    Returns:
        The coefficient; infinite if neither the smallest one nor any up to 2 suffices.
    """
    tried = np.arange(least, _ROUGHEST, _FRICTION_STEP)
    for friction in [*tried.tolist(), max(least, _ROUGHEST)]:
        if any(min_weight_margin(p, n, friction, **model) > 0 for p, n, model in grasps):
            return float(friction)
    return np.inf


def largest_minimum(B: FloatArray) -> float:
    """Returns n max min_i (g_i0 - |g_it|) over sum B_i g_i = 0, sum g_i0 = 1, at least 0.

    The dual has six unknowns instead of kn: min 1 + b y over 1 + b y - B_i0 y >= |B_itᵀ y| for all
    i, with the mean b of the columns B_i0.

    Args:
        B: Wrenches of the cones, of the order of one, shape (n, 6, k).
    """
    n, _, k = B.shape
    if n == 0:
        return 0.0
    mean = np.sum(B[:, :, 0], axis=0) / n
    A = B.transpose(0, 2, 1).copy()
    A[:, 0] -= mean
    A = A.reshape(n * k, 6)
    spread = np.linalg.eigvalsh(A.T @ A)
    if not spread[0] > LEAST_SPREAD * np.sum(spread):
        return 0.0  # Forces cannot balance, or resist no wrench in some direction.
    least = _minimum(mean, A, np.tile(np.eye(k)[0], n), _cones(n, k))
    return 0.0 if least is None else max(0.0, 1 + least[0])


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

    The space is the convex hull of what the contacts exert with normal forces that add up to one
    newton (the L1 metric of Ferrari & Canny, ICRA 1992). The radius is the norm of the smallest
    wrench that the grasp cannot resist, in newtons, with torques divided by `length`. It is zero
    without force closure.

    The radius is the minimum of the support function h(u) = max_i (B_i0 u + |B_itᵀ u|) over unit
    vectors u, which is not a convex program. The facets of a polytope inside the space tell where
    local minima can be. From there, u descends: the next u minimises h over the plane that touches
    the sphere at u, a second-order cone program.

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (n, 3), in metres.
        nhat: Outward unit normals at the contacts, in the same frame, shape (n, 3).
        friction: Coulomb's coefficient.
        length: Length by which torques are divided, in metres, greater than zero.
        model: One of `CONE_MODELS`.
        torsional_friction: Torsional friction of the soft finger, in metres.

    Raises:
        InvalidArgumentError: If there is no such model, a coefficient is below 0, or the length is
            not above 0.
    """
    if not length > 0:
        raise InvalidArgumentError(f"length must be greater than 0 m, not {length}")
    cones = friction, model, torsional_friction
    B = friction_cones(p_CoMC, nhat, *cones)
    B[:, 3:] /= longest_arm(p_CoMC)
    if largest_minimum(B) <= LEAST_MARGIN:
        return 0.0
    B[:, 3:] *= longest_arm(p_CoMC) / length
    # Facets may be joggled, because they are only where descents start.
    facets = ConvexHull(_edge_wrenches(B), qhull_options="QJ").equations
    radii, inner = _support(B, facets[:, :6]), -facets[:, 6]
    order = np.argsort(radii)
    radius = float(radii[order[0]])
    for facet in order:
        if inner[facet] < radius:
            radius = min(radius, _descended(B, facets[facet, :6], float(radii[facet])))
    return radius


def _edge_wrenches(B: FloatArray) -> FloatArray:
    """Returns wrenches on the boundary of the cones, one row each, shape (m, 6)."""
    k = B.shape[2] - 1
    edges = np.vstack([np.zeros((1, k)), np.eye(k), -np.eye(k)])
    if k > 1:
        edges = np.vstack([edges, np.pad(_EDGES[4:] / np.sqrt(2), ((0, 0), (0, k - 2)))])
    directions = np.hstack([np.ones((len(edges), 1)), edges])
    wrenches: FloatArray = np.einsum("nik,ek->nei", B, directions).reshape(-1, 6)
    return wrenches


def _support(B: FloatArray, u: FloatArray) -> FloatArray:
    """Returns the support function of the grasp wrench space for directions u, shape (..., 6)."""
    components = np.einsum("nik,...i->...nk", B, u)
    tangential = np.linalg.norm(components[..., 1:], axis=-1)
    support: FloatArray = np.max(components[..., 0] + tangential, axis=-1)
    return support


def _descended(B: FloatArray, u: FloatArray, radius: float) -> float:
    """Returns the local minimum of the support function below u, a unit vector of shape (6,)."""
    n, _, k = B.shape
    rows, first = B.transpose(0, 2, 1).reshape(n * k, 6), np.tile(np.eye(k)[0], n)
    for _ in range(_DESCENTS):
        # min t over t - B_i0 w >= |B_itᵀ w| with w = u + Z v: Z v is across u.
        Z = null_space(u[None])
        A = np.column_stack([rows @ Z, -first])
        found = _minimum(np.eye(6)[5], A, -rows @ u, _cones(n, k))
        if found is None:
            break
        u = u + Z @ found[1][:5]
        u /= np.linalg.norm(u)
        before, radius = radius, min(radius, float(_support(B, u)))
        if not radius < before - _ACCURACY / 10:
            break
    return radius


def largest_load(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    friction: float,
    *,
    wrench: FloatArray,
    normal_forces: FloatArray,
    model: str = "hard_finger",
    torsional_friction: float | FloatArray = TORSIONAL_FRICTION,
) -> float:
    """Returns the largest multiple of a wrench on the object that fingers balance.

    It is 0 if the fingers do not even balance each other, and at most `LARGEST_LOAD`.

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (n, 3), in metres.
        nhat: Outward unit normals at the contacts, in the same frame, shape (n, 3).
        friction: Coulomb's coefficient.
        wrench: Force in N and torque about the centre of mass in N m, shape (6,).
        normal_forces: Smallest and largest normal force of each contact, shape (2, n), in N.
        model: One of `CONE_MODELS`.
        torsional_friction: Torsional friction of the soft fingers, a scalar or of shape (n,), in
            metres.
    """
    B = friction_cones(p_CoMC, nhat, friction, model, torsional_friction)
    n, _, k = B.shape
    unit = float(np.max(normal_forces))
    least, most = normal_forces / unit
    # Forces g in this unit and the multiple are sums of the columns of Z, which balance.
    balance = np.hstack([B.transpose(1, 0, 2).reshape(6, k * n), wrench[:, None] / unit])
    balance[3:] /= longest_arm(p_CoMC)
    Z = null_space(balance, rcond=_RANK_TOLERANCE)
    forces, multiple = Z[:-1], Z[-1:]
    A = np.vstack([forces[::k], -forces[::k], multiple, -multiple, -forces])
    b = np.concatenate([most, -least, [LARGEST_LOAD, 0.0], np.zeros(k * n)])
    cones = [clarabel.NonnegativeConeT(2 * n + 2), *_cones(n, k)]
    found = _minimum(-multiple[0], A, b, cones)
    return 0.0 if found is None else max(0.0, -found[0])


def friction_cones(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    friction: float,
    model: str,
    torsional_friction: float | FloatArray,
) -> FloatArray:
    """Returns B_i, whose columns are the wrenches of the components of g_i, shape (..., 6, k).

    A hard finger has Coulomb's cone. The tangential force and the moment of a soft finger are
    together inside an ellipsoid.

    Args:
        p_CoMC: Lever arms, shape (..., 3), in metres.
        nhat: Outward unit normals, shape (..., 3).
        friction: Coulomb's coefficient.
        model: One of `CONE_MODELS`.
        torsional_friction: Torsional friction of the soft fingers, in metres, a scalar or of the
            shape of the contacts, (...); a finger whose value is 0 is hard.

    Returns:
        The wrenches, force rows first, torques in N m per newton.

    Raises:
        InvalidArgumentError: If there is no such model, or a coefficient is below 0.
    """
    if model not in CONE_MODELS:
        raise InvalidArgumentError(
            f"no contact model with a friction cone {model!r}; there are: {', '.join(CONE_MODELS)}"
        )
    for name, value in (("friction", friction), ("torsional_friction", torsional_friction)):
        if not np.all(np.asarray(value) >= 0):
            raise InvalidArgumentError(f"{name} must be at least 0, not {value}")
    B = contact_blocks(p_CoMC, nhat, model)
    B[..., 1:3] *= friction
    B[..., 3:] *= np.asarray(torsional_friction)[..., None, None]
    return B


def _cones(n: int, k: int) -> list[object]:
    """Returns n second-order cones of k dimensions for the solver."""
    return [clarabel.NonnegativeConeT(n)] if k == 1 else [clarabel.SecondOrderConeT(k)] * n


def _minimum(
    c: FloatArray, A: FloatArray, b: FloatArray, cones: list[object]
) -> tuple[float, FloatArray] | None:
    """Returns min c x over b - A x in the cones, and x; None if there is no minimum."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.equilibrate_enable = False  # The rows are of the order of one.
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _ACCURACY
    settings.reduced_tol_gap_abs = settings.reduced_tol_gap_rel = LEAST_MARGIN
    settings.reduced_tol_feas = LEAST_MARGIN
    rows, columns = A.shape
    starts, rows_of_values = np.arange(columns + 1) * rows, np.tile(np.arange(rows), columns)
    sparse = csc_matrix((A.T.ravel(), rows_of_values, starts), shape=A.shape)
    nothing = csc_matrix((columns, columns))
    solution = clarabel.DefaultSolver(nothing, c, sparse, b, cones, settings).solve()
    if str(solution.status) not in _SOLVED:
        return None
    return float(solution.obj_val), np.array(solution.x)
