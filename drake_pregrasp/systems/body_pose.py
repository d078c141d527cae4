"""The pose of one body, out of the list that a MultibodyPlant emits."""

from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context, LeafSystem


class BodyPose(LeafSystem):
    """Emits the pose of one body of a MultibodyPlant.

    .. pydrake_system::

        name: BodyPose
        input_ports:
        - body_poses
        output_ports:
        - X_WB

    Port `body_poses` accepts a list of `RigidTransform`: the plant's port of that name.

    Port `X_WB` emits a `RigidTransform`: the pose of body B in the world W.

    Args:
        body_index: The body B.
    """

    def __init__(self, body_index: BodyIndex) -> None:
        super().__init__()
        self._body_index = int(body_index)
        self._body_poses = self.DeclareAbstractInputPort(
            "body_poses", AbstractValue.Make([RigidTransform()])
        )
        self.DeclareAbstractOutputPort(
            "X_WB",
            lambda: AbstractValue.Make(RigidTransform()),
            self._calc_pose,
            {self._body_poses.ticket()},
        )

    def _calc_pose(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._body_poses.Eval(context)[self._body_index])
