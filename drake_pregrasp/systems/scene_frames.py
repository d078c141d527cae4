"""Poses of the frames of another scene."""

from collections.abc import Mapping

from pydrake.common.value import AbstractValue
from pydrake.geometry import FrameId, FramePoseVector, QueryObject
from pydrake.systems.framework import Context, LeafSystem

from drake_pregrasp.systems.ports import declare_output


class SceneFrames(LeafSystem):
    """Poses of frames in a SceneGraph, for their counterparts in another one.

    .. pydrake_system::

        name: SceneFrames
        input_ports:
        - query_object
        output_ports:
        - geometry_pose

    Port `query_object` accepts SceneGraph's `QueryObject`.

    Port `geometry_pose` emits a `FramePoseVector`: the pose in W of each counterpart.

    Args:
        counterparts: Frame in the other SceneGraph of each frame of `query_object`.
    """

    def __init__(self, counterparts: Mapping[FrameId, FrameId]) -> None:
        super().__init__()
        self._counterparts = dict(counterparts)
        model = AbstractValue.Make(QueryObject())
        self._query = self.DeclareAbstractInputPort("query_object", model)
        poses = AbstractValue.Make(FramePoseVector())
        declare_output(self, "geometry_pose", poses, self._calc_poses, self._query)

    def _calc_poses(self, context: Context) -> FramePoseVector:
        query, poses = self._query.Eval(context), FramePoseVector()
        for frame, counterpart in self._counterparts.items():
            poses.set_value(counterpart, query.GetPoseInWorld(frame))
        return poses
