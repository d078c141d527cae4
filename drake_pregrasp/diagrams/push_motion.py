"""The object that something pushes over a table."""

import math

from pydrake.geometry import CollisionFilterDeclaration, GeometrySet
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp.diagrams.motion_config import Push
from drake_pregrasp.diagrams.moving_object import MovingObject, add_model, add_pose_output
from drake_pregrasp.diagrams.object_body import (
    add_object_body,
    add_solid_collision,
    standing_position,
)
from drake_pregrasp.diagrams.object_config import ObjectConfig
from drake_pregrasp.planning.velocity_profile import VelocityProfile
from drake_pregrasp.systems.object_motion import ObjectMotion

TIP_RADIUS = 0.012
"""Radius of the pusher's tip in `pusher.sdf`, in metres."""

RAMP = 0.1
"""Seconds in which the tip comes up to its speed, and in which it stops."""


def add_push(
    builder: DiagramBuilder,
    object_config: ObjectConfig,
    motion: Push,
    plant_config: MultibodyPlantConfig,
) -> MovingObject:
    """Puts the object at rest on a table, and a pusher behind it."""
    plant, scene_graph = AddMultibodyPlant(plant_config, builder)
    body = add_object_body(plant, object_config)
    solid = add_solid_collision(plant, body, object_config)
    table = plant.GetBodyByName("table", add_model(plant, "table.sdf"))
    pusher = add_model(plant, "pusher.sdf")
    R_WP = RotationMatrix.MakeZRotation(motion.direction)
    behind = [-(motion.start_distance + TIP_RADIUS), motion.offset, motion.height]
    plant.WeldFrames(
        plant.world_frame(),
        plant.GetFrameByName("guide", pusher),
        RigidTransform(R_WP, R_WP @ behind),
    )
    plant.Finalize()
    # The object stands on its feet; its whole bottom on the table would be one hopping contact.
    scene_graph.collision_filter_manager().Apply(
        CollisionFilterDeclaration().ExcludeBetween(
            GeometrySet(solid), GeometrySet(plant.GetCollisionGeometriesForBody(table))
        )
    )
    X_WO = RigidTransform(standing_position(object_config))
    plant.SetDefaultFloatingBaseBodyPose(body, X_WO)
    profile = VelocityProfile(push_profile(motion))
    command = builder.AddNamedSystem("object_motion", ObjectMotion(profile))
    builder.Connect(command.get_output_port(), plant.get_desired_state_input_port(pusher))
    return MovingObject(plant, scene_graph, add_pose_output(builder, plant, body))


def push_profile(motion: Push) -> list[list[float]]:
    """Returns rows of times and speeds of the tip: at rest, up, on for its distance, and down."""
    ramp = min(RAMP, motion.distance / motion.speed)
    up = motion.start + ramp
    down = motion.start + motion.distance / motion.speed
    corners = [(0.0, 0.0), (motion.start, 0.0), (up, motion.speed), (down, motion.speed)]
    corners.append((down + ramp, 0.0))
    return [[time, speed] for time, speed in dict(corners).items()]  # Some times may be the same.


def push_direction(motion: Push) -> list[float]:
    """Returns the unit vector that the tip moves along, in W."""
    return [math.cos(motion.direction), math.sin(motion.direction), 0.0]
