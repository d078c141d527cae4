"""The quality of the grasp that the contact goals would make."""

import numpy as np
from pydrake.common.containers import namedview
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.contact_selection import is_active
from drake_pregrasp.planning.grasp_quality import GraspQuality, grasp_quality

GraspQualityView = namedview("GraspQualityView", GraspQuality.names())
"""Names the elements of the port `grasp_quality`: `GraspQualityView(port.Eval(context)).q_msv`."""


class GraspQualityMonitor(LeafSystem):
    """Measures contact goals against the true pose of the object O in the world W.

    .. pydrake_system::

        name: GraspQualityMonitor
        input_ports:
        - p_WC
        - X_WO
        - contact_status
        output_ports:
        - grasp_quality

    Port `p_WC` accepts a vector of 3n: contact points in W, one after another, in metres.

    Port `X_WO` accepts a `RigidTransform`: the object's true pose.

    Port `contact_status` (optional) accepts a vector of n `ContactStatus` values; only active
    contacts count. Unconnected, all do.

    Port `grasp_quality` emits a vector of 5: q_msv, q_gii and q_vew of the complete grasp matrix
    about the true centre of mass, then graspable and indeterminate (Eq. 8-9) of the hard-finger
    model, each 0 or 1. `GraspQualityView` names them.

    Args:
        num_contacts: n.
        p_OCoM: The object's centre of mass in O, shape (3,), in metres; O's origin by default.
    """

    def __init__(self, *, num_contacts: int, p_OCoM: FloatArray | None = None) -> None:
        super().__init__()
        self._p_OCoM = np.zeros(3) if p_OCoM is None else np.array(p_OCoM)
        self._p_WC = self.DeclareVectorInputPort("p_WC", 3 * num_contacts)
        self._X_WO = self.DeclareAbstractInputPort("X_WO", AbstractValue.Make(RigidTransform()))
        self._contact_status = self.DeclareVectorInputPort("contact_status", num_contacts)
        self.DeclareVectorOutputPort(
            "grasp_quality",
            len(GraspQuality.names()),
            self._calc_quality,
            {self.all_input_ports_ticket()},
        )

    def _calc_quality(self, context: Context, output: BasicVector) -> None:
        p_WC: FloatArray = self._p_WC.Eval(context).reshape(-1, 3)
        X_WO: RigidTransform = self._X_WO.Eval(context)
        if self._contact_status.HasValue(context):
            p_WC = p_WC[is_active(self._contact_status.Eval(context))]
        output.SetFromVector(grasp_quality(p_WC - X_WO @ self._p_OCoM).to_vector())
