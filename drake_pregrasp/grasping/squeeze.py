"""Squeeze forces that balance a wrench."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.quality.force_closure import (
    TORSIONAL_FRICTION,
    cone_edges,
    longest_arm,
    primitive_wrenches,
)
from drake_pregrasp.quality.grasp_quality import contact_axes

_MODEL = "hard_finger"

# Weights of the equations relative to the size of the forces: with them, the residual is about 1e-5
# of the forces if cones and bounds allow it. Bounds take precedence over balance.
_BALANCE = 300.0
_BOUNDS = 6000.0

FRICTION_SHARES = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Shares of the friction coefficient that `safest_squeeze` tries in this order."""

_IN_BALANCE = 0.02  # Largest residual of a balanced squeeze, in newtons.
_PASSES = 50  # Largest number of active-set changes per unknown.


class Squeeze(NamedTuple):
    """Forces of fingertips on an object.

    Attributes:
        forces: Forces on the object in the frame of the contacts, shape (n, 3), in newtons.
        residual: Norm of the unbalanced wrench, in newtons, with torques divided by the longest
            lever arm.
    """

    forces: FloatArray
    residual: float


def squeeze_forces(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    wrench: FloatArray,
    *,
    friction: float,
    least_normal: float | FloatArray,
    largest_normal: float | FloatArray,
) -> Squeeze:
    """Returns the smallest forces that balance a wrench, each inside its friction cone.

    This is the force-balance program of grasping (Buss, Hashimoto & Moore, 1996, with pyramids
    in place of cones): min sum |f_i|² over f_i = R_i E a_i, a_i >= 0, with G f + wrench = 0 and
    with normal forces in bounds. Bounds get slack variables, and all equations get a large weight.
    The result is a non-negative least-squares problem, which always has a solution.

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (n, 3), in metres.
        nhat: Outward unit normals at the contacts, in the frame of `p_CoMC`, shape (n, 3).
        wrench: Other wrench on the object, such as its weight: force in N and torque about the
            centre of mass in N m, in the frame of `p_CoMC`, shape (6,).
        friction: Coulomb friction coefficient of the plan. The margin to the real coefficient
            covers errors of contacts, poses and forces.
        least_normal: Least normal force in newtons, a scalar or of shape (n,).
        largest_normal: Largest normal force in newtons, a scalar or of shape (n,).

    Raises:
        InvalidArgumentError: If bounds or friction are out of range, or if there is no contact.
    """
    if len(p_CoMC) == 0:
        raise InvalidArgumentError("a squeeze needs at least one contact")
    if not np.all((np.asarray(least_normal) >= 0) & (least_normal <= np.asarray(largest_normal))):
        raise InvalidArgumentError(
            f"normal forces need 0 N <= least <= largest, not {least_normal} and {largest_normal} N"
        )
    E = cone_edges(friction, _MODEL, TORSIONAL_FRICTION)
    W = primitive_wrenches(
        p_CoMC, nhat, friction, model=_MODEL, torsional_friction=TORSIONAL_FRICTION
    )
    scale = np.ones((6, 1))
    scale[3:] /= longest_arm(p_CoMC)
    W, w = W * scale, wrench * scale[:, 0]
    n, edges = len(p_CoMC), E.shape[1]
    normals, none = np.kron(np.eye(n), E[:1]), np.zeros((n, n))
    sizes = np.kron(np.eye(n), E)
    # Unknowns: a, then slacks of the least and of the largest normal forces.
    A = np.block(
        [
            [_BALANCE * W, np.zeros((6, 2 * n))],
            [_BOUNDS * normals, -_BOUNDS * np.eye(n), none],
            [_BOUNDS * normals, none, _BOUNDS * np.eye(n)],
            [sizes, np.zeros((len(sizes), 2 * n))],
        ]
    )
    b = [-_BALANCE * w, _BOUNDS * np.full(n, least_normal), _BOUNDS * np.full(n, largest_normal)]
    target = np.concatenate([*b, np.zeros(len(sizes))])
    try:
        solution, _ = nnls(A, target, maxiter=_PASSES * A.shape[1])
    except RuntimeError:  # No convergence, so no reliable squeeze.
        return Squeeze(np.zeros((n, 3)), float(np.linalg.norm(w)))
    a = solution[: n * edges]
    local = (E @ a.reshape(n, edges).T).T
    forces: FloatArray = np.einsum("nij,nj->ni", contact_axes(nhat), local)
    return Squeeze(forces, float(np.linalg.norm(W @ a + w)))


def safest_squeeze(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    wrench: FloatArray,
    *,
    friction: float,
    least_normal: float,
    largest_normal: float | FloatArray,
) -> Squeeze:
    """Returns the squeeze that balances a wrench with the smallest of `FRICTION_SHARES`.

    The smallest forces lie on the edges of their cones. Narrower cones with larger forces leave a
    margin, so that forces with errors stay inside the true cones. If no narrower cone balances the
    wrench, the full cone is used.

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (n, 3), in metres.
        nhat: Outward unit normals at the contacts, in the frame of `p_CoMC`, shape (n, 3).
        wrench: Other wrench on the object in N and N m, in the frame of `p_CoMC`, shape (6,).
        friction: Largest friction coefficient for the plan.
        least_normal: Least normal force in newtons.
        largest_normal: Largest normal force in newtons, a scalar or of shape (n,).
    """
    for share in FRICTION_SHARES:
        squeeze = squeeze_forces(
            p_CoMC,
            nhat,
            wrench,
            friction=share * friction,
            least_normal=least_normal,
            largest_normal=largest_normal,
        )
        if squeeze.residual <= _IN_BALANCE:
            break
    return squeeze
