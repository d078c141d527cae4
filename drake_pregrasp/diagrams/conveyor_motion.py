"""The object on a table that moves."""

from collections.abc import Callable

from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp.diagrams.motion_config import Conveyor
from drake_pregrasp.diagrams.moving_object import MovingObject, add_model, add_pose_output
from drake_pregrasp.diagrams.object_body import add_object_body, standing_position
from drake_pregrasp.diagrams.object_config import ObjectConfig
from drake_pregrasp.planning.velocity_profile import VelocityProfile
from drake_pregrasp.systems.object_motion import ObjectMotion


def add_conveyor(
    builder: DiagramBuilder,
    object_config: ObjectConfig,
    motion: Conveyor,
    plant_config: MultibodyPlantConfig,
    *,
    add_more: Callable[[MultibodyPlant, RigidBody], None] | None = None,
) -> MovingObject:
    """Puts the object at rest on the middle of a table that then moves as commanded.

    What else there is in the plant is added by `add_more`, which is given the object's body.
    """
    plant, scene_graph = AddMultibodyPlant(plant_config, builder)
    body = add_object_body(plant, object_config)
    table = add_model(plant, "conveyor_table.sdf")
    if add_more is not None:
        add_more(plant, body)
    plant.Finalize()
    X_WO = RigidTransform(standing_position(object_config))
    plant.SetDefaultFloatingBaseBodyPose(body, X_WO)
    profile = VelocityProfile(motion.velocities())
    command = builder.AddNamedSystem("object_motion", ObjectMotion(profile))
    builder.Connect(command.get_output_port(), plant.get_desired_state_input_port(table))
    return MovingObject(plant, scene_graph, add_pose_output(builder, plant, body))
