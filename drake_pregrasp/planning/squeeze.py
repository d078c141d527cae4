"""How hard each fingertip presses to hold an object: forces in balance, inside friction cones."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.contact_models import contact_axes
from drake_pregrasp.planning.force_closure import (
    TORSIONAL_FRICTION,
    cone_edges,
    longest_arm,
    primitive_wrenches,
)

_MODEL = "hard_finger"

# Weight of the balance against the size of forces: what is left out of balance is then about a
# thousandth of the forces, unless the cones themselves leave more.
_BALANCE = 300.0


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
    least_normal: float,
) -> Squeeze:
    """Returns the smallest forces that balance a wrench, each inside its friction cone.

    It is the force-balance programme of grasping (Buss, Hashimoto & Moore, 1996, with pyramids in
    place of cones): min sum |f_i|² over f_i = R_i E a_i, a_i >= 0, with G f + wrench = 0 as a
    large penalty, so that forces come out where nothing balances, too. Each contact starts with
    the least normal force, spread evenly over its edges; non-negative least squares adds the rest.

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (n, 3), in metres.
        nhat: Outward unit normals there, in the same frame, shape (n, 3).
        wrench: What else acts on the object, as its weight: force in N and torque about the centre
            of mass in N m, in that frame, shape (6,).
        friction: Coulomb's coefficient to plan with. The margin to the real one is what holds
            when contacts, poses and forces are not quite as planned.
        least_normal: Normal force that every fingertip has at least, in newtons.

    Raises:
        InvalidArgumentError: If a number is below 0, or there is no contact.
    """
    if len(p_CoMC) == 0:
        raise InvalidArgumentError("a squeeze needs one contact at least")
    if not least_normal >= 0:
        raise InvalidArgumentError(f"least_normal must be at least 0 N, not {least_normal}")
    E = cone_edges(friction, _MODEL, TORSIONAL_FRICTION)
    W = primitive_wrenches(
        p_CoMC, nhat, friction, model=_MODEL, torsional_friction=TORSIONAL_FRICTION
    )
    scale = np.ones((6, 1))
    scale[3:] /= longest_arm(p_CoMC)
    W, w = W * scale, wrench * scale[:, 0]
    n, edges = len(p_CoMC), E.shape[1]
    start = np.full(n * edges, least_normal / edges)
    sizes = np.kron(np.eye(n), E)
    A = np.vstack([_BALANCE * W, sizes])
    b = -np.concatenate([_BALANCE * (W @ start + w), sizes @ start])
    added, _ = nnls(A, b)
    a = start + added
    local = (E @ a.reshape(n, edges).T).T
    forces: FloatArray = np.einsum("nij,nj->ni", contact_axes(nhat), local)
    return Squeeze(forces, float(np.linalg.norm(W @ a + w)))
