"""Squeeze forces that balance a wrench: a second-order cone program over friction cones.

It is in `systems` because it uses Drake's `MathematicalProgram`.
"""

from functools import partial

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram
from scipy.linalg import block_diag

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.rotations import skew
from drake_pregrasp.grasping.grasp_state import GiveUp, GraspSettings, Squeeze
from drake_pregrasp.quality.force_closure import torsional_friction_of
from drake_pregrasp.quality.grasp_quality import contact_axes, contact_blocks, longest_arm

PREFERRED_SHARE = 0.5
"""Share of the friction coefficient that forces need not exceed if larger forces can avoid it."""

LOAD_CHANGE = 0.5
"""Largest change of the load that the planned forces bear within their friction cones, in any
direction, as a share of the load."""

# Balance takes precedence over the preferred cones, these over changes of the load, and these over
# small forces, whose cost is 1 per squared newton. Such linear costs do not change the solution if
# it can do without.
_IMBALANCE_COST = 1e6  # Per newton of the residual.
_EXCESS_COST = 1e4  # Per newton outside the preferred cones.
_CHANGE_COST = 1e3  # Per newton by which a change of the load leaves the cones.

_IN_BALANCE = 0.02  # Largest residual of a balanced squeeze, in newtons.
_DAMPING = 0.01  # Squared singular value of G below which contacts hardly bear a push.
_UNLIMITED = 1e4  # Replaces a limit, to find out whether it prevents balance.


def plan_squeeze(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    wrench: FloatArray,
    *,
    friction: float,
    least_normal: float,
    largest_normal: float | FloatArray,
    patch_radii: FloatArray | None = None,
    jacobians: FloatArray | None = None,
    efforts: FloatArray | None = None,
) -> Squeeze:
    """Returns the smallest forces that balance a wrench, each inside its friction cone.

    This is the force-balance program of grasping (Buss, Hashimoto & Moore, 1996) with Coulomb's
    cones. In the axes of each contact, f_i = (n_i, t_i) with the normal force n_i and the force
    t_i along the surface. With weights a, b and the imbalance r = G f + wrench it is

        min |f|² + a |r| + b s  over f, s >= 0, with
        least <= n_i <= largest,   |t_i| <= mu n_i,   |t_i| <= mu n_i / 2 + s,   |J^T f| <= efforts.

    The smallest forces lie on their cones. Cones of half the width leave a margin for errors; the
    forces exceed them by s only if nothing else balances the wrench.

    If all fingers are equally stiff, a push d, of shape (3,), on the centre of mass changes the
    forces by -P d, where P is the first three columns of the damped inverse G^T (G G^T + k I)^-1.
    The small k leaves out pushes that the contacts can hardly bear. T_i and N_i are the rows of P
    for t_i and n_i, and c is `LOAD_CHANGE` times the force of the wrench. The forces stay in their
    cones for all pushes up to c, in newtons, if

        |t_i| <= mu n_i - c (|T_i| + mu |N_i|)

    where |T_i| is the spectral norm, so that the bound does not depend on the axes. A further slack
    relaxes it where limits of force or torque, which count for the unchanged load only, prevent it.

    A soft finger also exerts a moment m_i about its normal. With e_i = 3 pi/16 times the radius of
    its patch, the limit surface of force and moment is an ellipsoid (Howe & Cutkosky, 1996):
    |(t_i, m_i/e_i)| <= mu n_i replaces |t_i| <= mu n_i, and m_i/e_i counts as a force in the cost
    and in a change of the load.

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (n, 3), in metres.
        nhat: Outward unit normals at the contacts, in the frame of `p_CoMC`, shape (n, 3).
        wrench: Other wrench on the object, such as its weight: force in N and torque about the
            centre of mass in N m, in the frame of `p_CoMC`, shape (6,).
        friction: Coulomb's coefficient mu of the plan. The margin to the real coefficient covers
            errors of contacts, poses and forces.
        least_normal: Least normal force in newtons.
        largest_normal: Largest normal force in newtons, a scalar or of shape (n,).
        patch_radii: Radii of the patches of soft fingers, and 0 for hard ones, shape (n,), in
            metres; None if all are hard.
        jacobians: Jacobians J_i of the contacts' velocities in that frame, shape (n, 3, nq); None
            for no limits on joints.
        efforts: Largest torque of each joint, shape (nq,), in N m.

    Raises:
        InvalidArgumentError: If bounds are out of range, or if there is no contact.
    """
    if len(p_CoMC) == 0:
        raise InvalidArgumentError("a squeeze needs at least one contact")
    if not np.all((least_normal >= 0) & (least_normal <= np.asarray(largest_normal))):
        raise InvalidArgumentError(
            f"normal forces need 0 N <= least <= largest, not {least_normal} and {largest_normal} N"
        )
    R, G = contact_axes(nhat), contact_blocks(p_CoMC, nhat, "soft_finger")
    scale, n = np.ones(6), len(R)
    scale[3:] /= longest_arm(p_CoMC)
    arms = torsional_friction_of(1.0, np.zeros(n) if patch_radii is None else patch_radii)
    soft = np.flatnonzero(arms)
    columns = np.hstack([*G[:, :, :3], arms[soft] * G[soft, :, 3].T])
    torques = np.empty((0, columns.shape[1]))
    if jacobians is not None:  # tau = sum of J_i^T R_i f_i; moments are too small to count.
        torques = np.einsum("nji,njk->ink", jacobians, R).reshape(-1, 3 * n)
        torques = np.pad(torques, ((0, 0), (0, len(soft))))
    balance = scale[:, None] * columns, scale * wrench, soft
    limits: dict[GiveUp, FloatArray] = {
        GiveUp.NEEDS_FORCE: np.broadcast_to(largest_normal, n),
        GiveUp.NEEDS_TORQUE: np.empty(0) if efforts is None else efforts,
        GiveUp.NEEDS_FRICTION: np.array(friction),
    }
    f, residual = _solve(*balance, torques, least_normal, *limits.values())
    forces = np.einsum("nij,nj->ni", R, f)
    internal = internal_forces(p_CoMC, forces)
    squeeze = Squeeze(forces, residual, internal, np.zeros(forces.shape))
    if residual <= _IN_BALANCE:
        return squeeze
    force, torque = GiveUp.NEEDS_FORCE, GiveUp.NEEDS_TORQUE
    for lacks in ((force,), (torque,), (force, torque), (GiveUp.NEEDS_FRICTION,)):
        without = limits | {lack: np.full(limits[lack].shape, _UNLIMITED) for lack in lacks}
        others = torques, least_normal, *without.values()
        if _solve(*balance, *others, has_margins=False)[1] <= _IN_BALANCE:
            return squeeze._replace(lack=lacks[-1])
    return squeeze


def plan_lift(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    active: BoolArray,
    settings: GraspSettings,
    *,
    load: FloatArray,
    stop: FloatArray,
    friction: float,
    patch_radii: FloatArray,
    jacobians: FloatArray | None,
    efforts: FloatArray,
) -> Squeeze:
    """Returns the squeeze with which k active fingers of n lift an object; zero for the others.

    If the least force of a finger would tip the object, fingers press with twice the touch force.

    Args:
        p_CoMC: Lever arms of the active fingers, shape (k, 3), in metres.
        nhat: Outward unit normals at their contacts, shape (k, 3).
        active: Mask of the active fingers, shape (n,).
        settings: Settings of the grasp, with the limits of the normal forces.
        load: Weight and inertia of the object in the lift, shape (3,), in newtons.
        stop: Part of it while the hand stops, shape (3,), in newtons.
        friction: As for `plan_squeeze`.
        patch_radii: As for `plan_squeeze`, of all fingers, shape (n,).
        jacobians: As for `plan_squeeze`, of the active fingers.
        efforts: As for `plan_squeeze`.
    """
    forces, internal = np.zeros((2, len(active), 3))
    if not np.all(np.isfinite([p_CoMC, nhat])):
        return Squeeze(forces, float(np.linalg.norm(load)), internal, internal)
    plan = partial(
        plan_squeeze,
        *(p_CoMC, nhat, np.append(load, np.zeros(3))),
        friction=friction,
        largest_normal=np.broadcast_to(settings.largest_force, active.shape)[active],
        patch_radii=patch_radii[active],
        jacobians=jacobians,
        efforts=efforts,
    )
    planned = plan(least_normal=settings.least_force)
    if planned.residual > settings.imbalance:
        planned = plan(least_normal=min(settings.least_force, 2 * settings.touch_force))
    forces[active], internal[active] = planned.forces, planned.internal
    stopping = np.zeros(forces.shape)
    stopping[active] = balancing_forces(p_CoMC, np.append(stop, np.zeros(3)))
    return planned._replace(forces=forces, internal=internal, stopping=stopping)


def balancing_forces(p_CoMC: FloatArray, wrench: FloatArray) -> FloatArray:
    """Returns the smallest forces that balance a wrench, -G⁺ wrench, shape (n, 3), in newtons.

    G is the grasp matrix of points without moments, with torques over the longest lever arm.

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (n, 3), in metres.
        wrench: The wrench: force in N, and torque about the centre of mass in N m, shape (6,).
    """
    length = longest_arm(p_CoMC)
    arms = skew(p_CoMC / length)
    G = np.concatenate([np.broadcast_to(np.eye(3), arms.shape), arms], axis=1)
    forces = np.linalg.pinv(np.concatenate(G, axis=1)) @ np.append(wrench[:3], wrench[3:] / length)
    return np.asarray(-forces.reshape(-1, 3))


def internal_forces(p_CoMC: FloatArray, forces: FloatArray) -> FloatArray:
    """Returns the nearest forces that exert no wrench, shape (n, 3), in newtons.

    They are the projection (I - G⁺ G) f of the forces f on the null space of the grasp matrix G of
    points without moments (Yoshikawa & Nagai, 1991).

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (n, 3), in metres.
        forces: Forces at the contacts, in the frame of `p_CoMC`, shape (n, 3), in newtons.
    """
    wrench = np.append(np.sum(forces, axis=0), np.sum(np.cross(p_CoMC, forces), axis=0))
    return forces + balancing_forces(p_CoMC, wrench)


def _solve(
    G: FloatArray,
    wrench: FloatArray,
    soft: IntArray,
    torques: FloatArray,
    least: float,
    largest: FloatArray,
    efforts: FloatArray,
    friction: FloatArray,
    *,
    has_margins: bool = True,
) -> tuple[FloatArray, float]:
    """Returns forces in the axes of their contacts, shape (n, 3), and the norm of the residual.

    The columns of G and of the torques are those of the n forces, then of the moments of the soft
    fingers. Without margins, forces need no more than to lie in their cones.
    """
    n, size = (G.shape[1] - len(soft)) // 3, G.shape[1]
    change = LOAD_CHANGE * float(np.linalg.norm(wrench[:3]))
    shares = change * np.linalg.solve(G @ G.T + _DAMPING * np.eye(6), G).T[:, :3]
    program = MathematicalProgram()
    x = program.NewContinuousVariables(size)
    imbalance, excess, shortfall = program.NewContinuousVariables(3)
    program.Add2NormSquaredCost(np.eye(size), np.zeros(size), x)
    program.AddLinearCost(
        _IMBALANCE_COST * imbalance + _EXCESS_COST * excess + _CHANGE_COST * shortfall
    )
    residual = block_diag(1.0, G)  # Times (imbalance, x), plus the wrench: (imbalance, r).
    program.AddLorentzConeConstraint(residual, np.append(0.0, wrench), np.append(imbalance, x))
    program.AddBoundingBoxConstraint(0, np.inf, np.array([excess, shortfall]))
    program.AddBoundingBoxConstraint(np.full(n, least), largest, x[: 3 * n : 3])
    for i in range(n):
        tangential = [3 * i + 1, 3 * i + 2, *(3 * n + np.flatnonzero(soft == i))]
        T, N = shares[tangential], shares[3 * i]
        changed = float(np.linalg.norm(T, 2) + friction * np.linalg.norm(N))
        limit = float(friction) * x[3 * i]
        margins = PREFERRED_SHARE * limit + excess, limit - changed + shortfall
        for most in (limit, *margins) if has_margins else (limit,):
            program.AddLorentzConeConstraint(np.array([most, *x[tangential]]))
    if len(torques):
        program.AddLinearConstraint(torques, -efforts, efforts, x)
    result = ClarabelSolver().Solve(program)
    if not result.is_success():
        return np.zeros((n, 3)), float(np.linalg.norm(wrench))
    found: FloatArray = result.GetSolution(x)
    return found[: 3 * n].reshape(n, 3), float(np.linalg.norm(G @ found + wrench))
