"""The first stage of the planner: a safe region for each contact."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, LeafSystem

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.safe_regions import NO_REGION, SafeRegions, compute_safe_regions
from drake_pregrasp.planning.surface import ForbiddenPoints, ObjectSurface


class SafeRegionPartitioner(LeafSystem):
    """Divides the object's surface into the contacts' safe regions (Eq. 1-2). It has no state.

    .. pydrake_system::

        name: SafeRegionPartitioner
        input_ports:
        - X_WO_estimated
        - p_WC
        - contact_weights
        - obstacles
        output_ports:
        - safe_regions

    Port `X_WO_estimated` accepts a `RigidTransform`: where the object O is believed to be in W.

    Port `p_WC` accepts a vector of 3n: the contact points c_i in W, one after another, in metres.

    Port `contact_weights` (optional) accepts a vector of n: h_i in m²; -inf says that the finger
    is lost. Unconnected, all are zero.

    Port `obstacles` (optional) accepts `ForbiddenPoints` in W, which join the surface's own.

    Port `safe_regions` emits `SafeRegions` over the surface's candidate points.

    Args:
        surface: The object's surface.
        num_contacts: n.
    """

    def __init__(self, *, surface: ObjectSurface, num_contacts: int) -> None:
        super().__init__()
        self._surface = surface
        self._num_contacts = num_contacts
        self._X_WO_estimated = self.DeclareAbstractInputPort(
            "X_WO_estimated", AbstractValue.Make(RigidTransform())
        )
        self._p_WC = self.DeclareVectorInputPort("p_WC", 3 * num_contacts)
        self._contact_weights = self.DeclareVectorInputPort("contact_weights", num_contacts)
        self._obstacles = self.DeclareAbstractInputPort(
            "obstacles", AbstractValue.Make(ForbiddenPoints.none())
        )
        self.DeclareAbstractOutputPort(
            "safe_regions",
            self._allocate_regions,
            self._calc_regions,
            {self.all_input_ports_ticket()},
        )

    def _allocate_regions(self) -> AbstractValue:
        return AbstractValue.Make(
            SafeRegions(
                labels=np.full(len(self._surface.p_OQ), NO_REGION),
                lost=np.zeros(self._num_contacts, dtype=bool),
            )
        )

    def _calc_regions(self, context: Context, output: AbstractValue) -> None:
        X_OW: RigidTransform = self._X_WO_estimated.Eval(context).inverse()
        p_WC: FloatArray = self._p_WC.Eval(context).reshape(-1, 3)
        weights = np.zeros(self._num_contacts)
        if self._contact_weights.HasValue(context):
            weights = self._contact_weights.Eval(context)
        forbidden = self._surface.forbidden
        if self._obstacles.HasValue(context):
            obstacles: ForbiddenPoints = self._obstacles.Eval(context)
            p_OZ = (X_OW @ obstacles.points.T).T
            forbidden = forbidden.joined(ForbiddenPoints(p_OZ, obstacles.radii))
        p_OC = (X_OW @ p_WC.T).T
        output.set_value(compute_safe_regions(self._surface.p_OQ, p_OC, weights, forbidden))
