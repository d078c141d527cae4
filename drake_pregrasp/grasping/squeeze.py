"""How a hand goes on with an object that it has just gripped on a moving table."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.rotations import rotation_matrix
from drake_pregrasp.quality.contact_models import contact_axes
from drake_pregrasp.quality.force_closure import (
    TORSIONAL_FRICTION,
    cone_edges,
    longest_arm,
    primitive_wrenches,
)

_MODEL = "hard_finger"

# Weights against the size of forces: what is left out of balance is then some hundred-thousandth of
# them, unless cones and bounds leave more; and bounds come before the balance.
_BALANCE = 300.0
_BOUNDS = 6000.0

FRICTION_SHARES = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Of the coefficient that is given: cones that `safest_squeeze` tries, one after another."""

_IN_BALANCE = 0.02  # Newtons that may be left.
_PASSES = 50  # Changes of the active set for each unknown, at most.


class Squeeze(NamedTuple):
    """Forces of fingertips on an object.

    Attributes:
        forces: Shape (n, 3), in newtons.
        residual: What the object is out of balance by, in newtons: torques count divided by the
            longest lever arm.
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

    It is the force-balance programme of grasping (Buss, Hashimoto & Moore, 1996, with pyramids in
    place of cones): min sum |f_i|² over f_i = R_i E a_i, a_i >= 0, with G f + wrench = 0 and with
    normal forces in bounds. Bounds get slack variables, and all equations a large weight, so that
    it is a matter of non-negative least squares, and forces come out where nothing balances, too.

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (n, 3), in metres.
        nhat: Outward unit normals there, in the same frame, shape (n, 3).
        wrench: What else acts on the object, as its weight: force in N and torque about the centre
            of mass in N m, in that frame, shape (6,).
        friction: Coulomb's coefficient to plan with. The margin to the real one is what holds
            when contacts, poses and forces are not quite as planned.
        least_normal: Normal force that every fingertip has at least, in newtons, or that of each,
            shape (n,).
        largest_normal: The same at most.

    Raises:
        InvalidArgumentError: If bounds or friction are out of their ranges, or there is no contact.
    """
    if len(p_CoMC) == 0:
        raise InvalidArgumentError("a squeeze needs one contact at least")
    if not np.all((np.asarray(least_normal) >= 0) & (least_normal <= np.asarray(largest_normal))):
        raise InvalidArgumentError(
            f"normal forces must be from 0 N on, and not from {least_normal} to {largest_normal} N"
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
    # Unknowns: a, then how far each normal force is above its least, and below its largest.
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
    except RuntimeError:  # It came to no end: there is no squeeze to rely on.
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
    """Returns the squeeze that needs least friction, of some steps, and balances a wrench.

    The smallest forces lie on the edges of their cones. Where there is room for larger ones, cones
    are made narrower, so that forces that come out otherwise than planned stay inside the true
    ones. What balances with no narrower cone is planned with the widest.

    Args:
        p_CoMC: As for `squeeze_forces`, like all others.
        nhat: Outward unit normals.
        wrench: What else acts on the object.
        friction: The largest coefficient to plan with.
        least_normal: In newtons.
        largest_normal: In newtons.
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


@dataclass(frozen=True, eq=False)
class Coasting:
    """A motion that goes on with a constant twist, and then comes to rest evenly.

    Attributes:
        R_WG: Orientation at the start, shape (3, 3).
        p_WG: Position at the start, shape (3,), in metres.
        w_WG: Angular velocity, in rad/s.
        v_WG: Velocity of the origin, in m/s.
    """

    R_WG: FloatArray
    p_WG: FloatArray
    w_WG: FloatArray
    v_WG: FloatArray

    def after(self, elapsed: float, *, coast: float, stop: float) -> "Coasting":
        """Returns pose and twist some time later.

        Args:
            elapsed: Seconds since the start, at least 0.
            coast: Seconds for which the twist stays.
            stop: Seconds in which it then vanishes, above 0.
        """
        t = min(max(elapsed - coast, 0.0), stop)
        way, share = min(elapsed, coast) + t - t**2 / (2 * stop), 1 - t / stop
        return Coasting(
            rotation_matrix(self.w_WG * way) @ self.R_WG,
            self.p_WG + self.v_WG * way,
            self.w_WG * share,
            self.v_WG * share,
        )

    def to_vector(self) -> FloatArray:
        """Returns everything in one vector of 18."""
        return np.concatenate([self.R_WG.ravel(), self.p_WG, self.w_WG, self.v_WG])

    @staticmethod
    def from_vector(vector: FloatArray) -> "Coasting":
        """Returns the motion that `to_vector` made a vector of."""
        return Coasting(vector[:9].reshape(3, 3), *np.array(vector[9:]).reshape(3, 3))
