"""The object that follows recorded poses."""

from pathlib import Path

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp.diagrams.motion_config import PoseStream
from drake_pregrasp.diagrams.moving_object import MovingObject
from drake_pregrasp.diagrams.object_body import add_object_body
from drake_pregrasp.diagrams.object_config import ObjectConfig
from drake_pregrasp.planning.recorded_poses import read_recorded_poses
from drake_pregrasp.resources import resolve_path
from drake_pregrasp.systems.pose_replay import PoseReplay


def add_replay(
    builder: DiagramBuilder,
    object_config: ObjectConfig,
    motion: PoseStream,
    plant_config: MultibodyPlantConfig,
) -> MovingObject:
    """Moves the object along the poses of a file.

    The plant only holds the body's model and is no part of the diagram: nothing is simulated.
    """
    plant = MultibodyPlant(plant_config.time_step)
    scene_graph = builder.AddNamedSystem("scene_graph", SceneGraph())
    source = plant.RegisterAsSourceForSceneGraph(scene_graph)
    body = add_object_body(plant, object_config)
    plant.Finalize()
    poses = read_recorded_poses(resolve_path(motion.file, Path.cwd()))
    replay = builder.AddNamedSystem(
        "pose_replay", PoseReplay(poses, plant.GetBodyFrameIdOrThrow(body.index()))
    )
    builder.Connect(replay.GetOutputPort("geometry_pose"), scene_graph.get_source_pose_port(source))
    return MovingObject(plant, scene_graph, replay.GetOutputPort("X_WO"))
