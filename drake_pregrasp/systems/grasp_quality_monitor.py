"""Quality of the grasp that the contact goals would make."""

from pydrake.common.containers import namedview
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, LeafSystem

from drake_pregrasp.arrays import FloatArray, are_valid_points
from drake_pregrasp.config.planner_config import MeasuresConfig
from drake_pregrasp.config.validation import checked
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.grasp_quality import (
    NEED_NORMALS,
    GraspQuality,
    characteristic_length,
    grasp_quality,
)
from drake_pregrasp.systems.ports import POSE, declare_output, is_valid

GraspQualityView = namedview("GraspQualityView", GraspQuality.names())
"""Names the elements of the port `grasp_quality`: `GraspQualityView(port.Eval(context)).q_msv`."""


class GraspQualityMonitor(LeafSystem):
    """Measures the quality of contact goals at the true pose of the object O in the world W.

    .. pydrake_system::

        name: GraspQualityMonitor
        input_ports:
        - p_WC
        - X_WO
        - contact_status
        output_ports:
        - grasp_quality

    Port `p_WC` accepts a vector of 3n: contact points in W, one after another, in metres. Points
    that are not finite are ignored.

    Port `X_WO` accepts a `RigidTransform`: the object's true pose. If it is invalid, all contacts
    are ignored.

    Port `contact_status` (optional) accepts a vector of n `ContactStatus` values. Contacts that are
    not active are ignored. If the port is unconnected, all contacts are active.

    Port `grasp_quality` emits a vector of 5: q_msv, q_gii and q_vew of the grasp matrix about the
    true centre of mass, then graspable and indeterminate, each 0 or 1, as `grasp_quality` computes
    them. With the complete contact model, the last two are those of the hard finger.
    `GraspQualityView` names the elements.

    Args:
        config: Contact model and unit of lever arms; `MeasuresConfig()` by default.
        surface: The object's surface. The normal at a contact is that of the nearest allowed point.
        num_contacts: Number of contacts n.

    Raises:
        InvalidArgumentError: If a field of `config` is out of its range.
    """

    def __init__(
        self,
        config: MeasuresConfig | None = None,
        *,
        surface: ObjectSurface,
        num_contacts: int,
    ) -> None:
        super().__init__()
        config = checked(config or MeasuresConfig()).resolved()
        self._surface, self._contact_model = surface, config.contact_model
        self._length = characteristic_length(
            config.length, config.contact_model, surface.longest_lever_arm
        )
        self._p_WC = self.DeclareVectorInputPort("p_WC", 3 * num_contacts)
        self._X_WO = self.DeclareAbstractInputPort("X_WO", POSE)
        self._contact_status = self.DeclareVectorInputPort("contact_status", num_contacts)
        size, inputs = len(GraspQuality.names()), self.all_input_ports_ticket()
        declare_output(self, "grasp_quality", size, self._calc_quality, inputs)

    def _calc_quality(self, context: Context) -> FloatArray:
        p_WC: FloatArray = self._p_WC.Eval(context).reshape(-1, 3)
        X_WO: RigidTransform = self._X_WO.Eval(context)
        counts = are_valid_points(p_WC)
        if self._contact_status.HasValue(context):
            counts &= self._contact_status.Eval(context) > 0
        if not is_valid(X_WO):
            counts[:] = False
            X_WO = RigidTransform()
        p_OC: FloatArray = (X_WO.inverse() @ p_WC[counts].T).T
        r, model = p_OC - self._surface.p_OCoM, self._contact_model
        nhat_OC = self._surface.project(p_OC)[1] if model in NEED_NORMALS else None
        return grasp_quality(r, nhat_OC, model=model, length=self._length).to_vector()
