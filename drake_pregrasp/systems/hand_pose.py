"""Where a hand holds its palm while the object moves."""

from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, LeafSystem


class HandPose(LeafSystem):
    """Carries a hand's frame along with an object, without turning it.

    .. pydrake_system::

        name: HandPose
        input_ports:
        - X_WO_estimated
        output_ports:
        - X_WH

    Port `X_WO_estimated` accepts a `RigidTransform`: where the object O is believed to be in W.

    Port `X_WH` emits a `RigidTransform`: the hand H in W. Its orientation is constant; so is its
    place relative to the object's origin if it follows, else its place in W.

    Args:
        X_WH: The constant orientation, and the place in W of a hand that stays, or relative to the
            object's origin of one that follows.
        follow: Whether the hand follows.
    """

    def __init__(self, X_WH: RigidTransform, *, follow: bool = True) -> None:
        super().__init__()
        self._X = X_WH
        self._follow = follow
        self._X_WO_estimated = self.DeclareAbstractInputPort(
            "X_WO_estimated", AbstractValue.Make(RigidTransform())
        )
        self.DeclareAbstractOutputPort(
            "X_WH",
            lambda: AbstractValue.Make(RigidTransform()),
            self._calc_pose,
            {self._X_WO_estimated.ticket()},
        )

    def _calc_pose(self, context: Context, output: AbstractValue) -> None:
        p_WH = self._X.translation()
        if self._follow:
            p_WH = p_WH + self._X_WO_estimated.Eval(context).translation()
        output.set_value(RigidTransform(self._X.rotation(), p_WH))
