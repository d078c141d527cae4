"""The quality of the grasp that the contact goals would make."""

from pydrake.common.containers import namedview
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_pregrasp.arrays import FloatArray, are_valid_points
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.contact_models import CONTACT_MODELS, NEED_NORMALS
from drake_pregrasp.quality.grasp_quality import GraspQuality, grasp_quality
from drake_pregrasp.systems.pose_ports import is_valid

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

    Port `p_WC` accepts a vector of 3n: contact points in W, one after another, in metres. Those
    that aren't finite don't count.

    Port `X_WO` accepts a `RigidTransform`: the object's true pose. Without one, as if it isn't
    finite or its rotation is none, no contact counts.

    Port `contact_status` (optional) accepts a vector of n `ContactStatus` values; only active
    contacts count. Unconnected, all do.

    Port `grasp_quality` emits a vector of 5: q_msv, q_gii and q_vew of the grasp matrix about the
    true centre of mass, then graspable and indeterminate (Eq. 8-9), each 0 or 1. The last two are
    of the hard finger if the contact model is the complete one. `GraspQualityView` names them.

    Args:
        surface: The object's surface, whose nearest allowed point has the normal of a contact.
        num_contacts: n.
        contact_model: One of `CONTACT_MODELS`.
        length: Unit of the lever arms in the measures, in metres; 0 means the longest one on the
            object, and for the complete model one metre, as in the paper.

    Raises:
        InvalidArgumentError: If there is no such contact model, or the length is below 0.
    """

    def __init__(
        self,
        *,
        surface: ObjectSurface,
        num_contacts: int,
        contact_model: str = "complete",
        length: float = 0.0,
    ) -> None:
        super().__init__()
        if contact_model not in CONTACT_MODELS:
            raise InvalidArgumentError(
                f"no contact model {contact_model!r}; there are: {', '.join(CONTACT_MODELS)}"
            )
        if not length >= 0:
            raise InvalidArgumentError(f"length must be at least 0 m, not {length}")
        self._surface = surface
        self._contact_model = contact_model
        natural = 1.0 if contact_model == "complete" else surface.longest_lever_arm
        self._length = length if length > 0 else natural
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
        counts = are_valid_points(p_WC)
        if self._contact_status.HasValue(context):
            counts &= is_active(self._contact_status.Eval(context))
        if not is_valid(X_WO):
            counts[:] = False
            X_WO = RigidTransform()
        p_WC = p_WC[counts]
        p_OC: FloatArray = (X_WO.inverse() @ p_WC.T).T
        nhat_OC = None
        if self._contact_model in NEED_NORMALS:
            _, nhat_OC = self._surface.project(p_OC)
        quality = grasp_quality(
            p_OC - self._surface.p_OCoM, nhat_OC, model=self._contact_model, length=self._length
        )
        output.SetFromVector(quality.to_vector())
