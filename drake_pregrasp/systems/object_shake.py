"""Force that shakes an object that a hand has held for a while."""

import numpy as np
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, LeafSystem

from drake_pregrasp.config.object_config import GRAVITY
from drake_pregrasp.grasping.grasp_state import GraspPhase
from drake_pregrasp.grasping.held_criterion import shake_force
from drake_pregrasp.systems import ports


class ObjectShake(LeafSystem):
    """Shakes a held object by a force at its centre of mass, along the axes of W.

    .. pydrake_system::

        name: ObjectShake
        input_ports:
        - grasp_report
        output_ports:
        - spatial_forces

    Port `grasp_report` (optional) accepts a vector of 4: that of `GraspSequencer`. If the port is
    unconnected, there is no force.

    Port `spatial_forces` emits a list of `ExternallyAppliedSpatialForce`, for a plant's port
    `applied_spatial_force`: the object's weight times `shake_force` while the hand holds it.

    Args:
        body: Body of the object in a finalized plant.
    """

    def __init__(self, body: RigidBody) -> None:
        super().__init__()
        self._index, self._p_OCoM = body.index(), body.default_com()
        self._weight = GRAVITY * body.default_mass()
        self._report = self.DeclareVectorInputPort("grasp_report", 4)
        forces, sources = ports.APPLIED_FORCES, (self._report, self.time_ticket())
        ports.declare_output(self, "spatial_forces", forces, self._calc_forces, *sources)

    def _calc_forces(self, context: Context) -> list[ExternallyAppliedSpatialForce]:
        if not self._report.HasValue(context):
            return []
        phase, since, *_ = self._report.Eval(context)
        if phase != GraspPhase.HOLD:
            return []
        share = shake_force(context.get_time() - since)
        if not share.any():
            return []
        F_CoM_W = SpatialForce(tau=np.zeros(3), f=self._weight * share)
        return ports.applied_force(self._index, self._p_OCoM, F_CoM_W)
