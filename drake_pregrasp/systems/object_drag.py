"""Force with which a user drags an object, as if by an elastic band."""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce, SpatialVelocity
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.object_config import GRAVITY
from drake_pregrasp.systems import ports

STRONGEST = 2.0
"""Largest force, as a share of the object's weight."""

# As Drake's `MeshcatMouseSpring`, in 1/s² and 1/s. That one takes the point A in W from the page:
# while the body moves on, the force does not change, so a slow page makes it oscillate. It also
# needs a plant without other forces, and Python has no binding for it.
_STIFFNESS = 100.0
_DAMPING = _STIFFNESS**0.5


class ObjectDrag(LeafSystem):
    """Pulls a point A of a body B towards a target T, as a spring and a damper with bounded force.

    .. pydrake_system::

        name: ObjectDrag
        input_ports:
        - body_poses
        - body_spatial_velocities
        output_ports:
        - spatial_forces

    Ports `body_poses` and `body_spatial_velocities` accept lists of `RigidTransform` and
    `SpatialVelocity`: the plant's ports of these names.

    Port `spatial_forces` emits a list of `ExternallyAppliedSpatialForce`, for the plant's port
    `applied_spatial_force`. With the mass m, the force at A is f = m (k p_AT - sqrt(k) v_WA) for
    k = 100 / s². Neither the spring nor the sum exceeds `STRONGEST` times the weight. Without a
    target, the list is empty.

    A and T are parameters of the Context (`set_pull`).

    Args:
        body: The body B in a finalized plant.
    """

    def __init__(self, body: RigidBody) -> None:
        super().__init__()
        self._index, self._mass = body.index(), body.default_mass()
        self._pull = self.DeclareNumericParameter(BasicVector(np.full(6, np.nan)))
        self._X_WB, self._V_WB = ports.declare_inputs(self, **ports.BODY_MOTIONS).values()
        sources = (self._X_WB, self._V_WB, self.all_parameters_ticket())
        forces = ports.APPLIED_FORCES
        ports.declare_output(self, "spatial_forces", forces, self._calc_forces, *sources)

    def set_pull(self, context: Context, p_BA: FloatArray, p_WT: FloatArray) -> None:
        """Sets the point A in B and its target T in W, in metres, in a Context of this system.

        If one of them is not finite, nothing pulls.
        """
        pull = np.concatenate([p_BA, p_WT])
        context.get_mutable_numeric_parameter(self._pull).SetFromVector(pull)

    def _calc_forces(self, context: Context) -> list[ExternallyAppliedSpatialForce]:
        p_BA, p_WT = context.get_numeric_parameter(self._pull).value().reshape(2, 3)
        if not np.isfinite([p_BA, p_WT]).all():
            return []
        X_WB: RigidTransform = self._X_WB.Eval(context)[self._index]
        V_WB: SpatialVelocity = self._V_WB.Eval(context)[self._index]
        v_WA = V_WB.Shift(X_WB.rotation() @ p_BA).translational()
        a = _bounded(_bounded(_STIFFNESS * (p_WT - X_WB @ p_BA)) - _DAMPING * v_WA)
        return ports.applied_force(self._index, p_BA, SpatialForce(np.zeros(3), self._mass * a))


def _bounded(a: FloatArray) -> FloatArray:
    """Returns an acceleration of at most `STRONGEST` times that of gravity, shape (3,)."""
    size = float(np.linalg.norm(a))
    return a * min(1.0, STRONGEST * GRAVITY / size) if size else a
