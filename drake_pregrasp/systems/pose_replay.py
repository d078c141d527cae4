"""Recorded poses, played."""

from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.value import AbstractValue
from pydrake.geometry import FrameId, FramePoseVector
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, LeafSystem

from drake_pregrasp.planning.recorded_poses import RecordedPoses


class PoseReplay(LeafSystem):
    """Emits the recorded pose at the Context's time.

    .. pydrake_system::

        name: PoseReplay
        output_ports:
        - X_WO
        - geometry_pose

    Port `X_WO` emits a `RigidTransform`: the pose of the object O in the world W.

    Port `geometry_pose` emits a `FramePoseVector`: the same for SceneGraph.

    Args:
        poses: What is replayed.
        frame_id: The object's frame in SceneGraph; a new one if left out, for a diagram without.
    """

    def __init__(self, poses: RecordedPoses, frame_id: FrameId | None = None) -> None:
        super().__init__()
        self._poses = poses
        self._frame_id = FrameId.get_new_id() if frame_id is None else frame_id
        self._pose = self.DeclareAbstractOutputPort(
            "X_WO",
            lambda: AbstractValue.Make(RigidTransform()),
            self._calc_pose,
            {self.time_ticket()},
        )
        self.DeclareAbstractOutputPort(
            "geometry_pose",
            lambda: AbstractValue.Make(FramePoseVector()),
            self._calc_geometry_pose,
            {self.time_ticket()},
        )

    def _calc_pose(self, context: Context, output: AbstractValue) -> None:
        p_WO, R_WO = self._poses.at(context.get_time())
        x, y, z, w = R_WO.as_quat()
        output.set_value(RigidTransform(RotationMatrix(Quaternion(w, x, y, z)), p_WO))

    def _calc_geometry_pose(self, context: Context, output: AbstractValue) -> None:
        poses = FramePoseVector()
        poses.set_value(self._frame_id, self._pose.Eval(context))
        output.set_value(poses)
