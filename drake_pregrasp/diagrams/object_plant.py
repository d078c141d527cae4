"""The moving object, as one diagram."""

from collections.abc import Callable
from typing import Any

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_pregrasp.diagrams.conveyor_motion import add_conveyor
from drake_pregrasp.diagrams.motion_config import (
    Conveyor,
    MotionConfig,
    PoseStream,
    Push,
    Toss,
)
from drake_pregrasp.diagrams.moving_object import MovingObject
from drake_pregrasp.diagrams.object_config import ObjectConfig
from drake_pregrasp.diagrams.push_motion import add_push
from drake_pregrasp.diagrams.replay_motion import add_replay
from drake_pregrasp.diagrams.toss_motion import add_toss

_MOTIONS: dict[type, Callable[[DiagramBuilder, ObjectConfig, Any, Any], MovingObject]] = {
    Conveyor: add_conveyor,
    Toss: add_toss,
    Push: add_push,
    PoseStream: add_replay,
}


class ObjectPlant(Diagram):
    """An object that a conveyor carries, that flies, that is pushed, or that follows a recording.

    .. pydrake_system::

        name: ObjectPlant
        output_ports:
        - X_WO
        - query_object

    Port `X_WO` emits a `RigidTransform`: the true pose of the object O in the world W. A table's
    top is the plane z = 0 of W; what stands on it starts at rest with its centre of mass over
    W's origin, and with the axes of W.

    Port `query_object` emits SceneGraph's `QueryObject`, for visualizers.

    The attributes `plant` and `scene_graph` hold the object's model and what shows it.

    Args:
        object_config: The object.
        motion_config: How it moves.
        plant_config: Time step and contact model.
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph

    def __init__(
        self,
        object_config: ObjectConfig,
        motion_config: MotionConfig,
        plant_config: MultibodyPlantConfig,
    ) -> None:
        super().__init__()
        builder = DiagramBuilder()
        add_motion = _MOTIONS[type(motion_config)]
        moving = add_motion(builder, object_config, motion_config, plant_config)
        self.plant, self.scene_graph = moving.plant, moving.scene_graph
        builder.ExportOutput(moving.X_WO, "X_WO")
        builder.ExportOutput(self.scene_graph.get_query_output_port(), "query_object")
        builder.BuildInto(self)
