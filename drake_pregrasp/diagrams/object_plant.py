"""Plant with the moving object, as one diagram."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import trimesh
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ApplyMultibodyPlantConfig,
    ExternallyAppliedSpatialForceMultiplexer,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.object_config import (
    Conveyor,
    MotionConfig,
    ObjectConfig,
    Push,
    Toss,
)
from drake_pregrasp.diagrams.expected_path import (
    Motion,
    initial_pose,
    initial_velocities,
    read_motion,
)
from drake_pregrasp.diagrams.object_body import FRICTION, add_object, add_obstacle_bodies
from drake_pregrasp.diagrams.object_contact import separate_contacts
from drake_pregrasp.diagrams.wiring import connect
from drake_pregrasp.estimation.recorded_poses import RecordedPoses
from drake_pregrasp.geometry.convex_pieces import convex_pieces
from drake_pregrasp.geometry.motion_profiles import VelocityProfile
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.geometry.solids import BoxSolid, HalfSpace, Solid
from drake_pregrasp.resources import resource_folder
from drake_pregrasp.systems.giver import Giver
from drake_pregrasp.systems.launch_and_landing import Landing, Launch
from drake_pregrasp.systems.mujoco_model import mujoco_substeps
from drake_pregrasp.systems.mujoco_plant import MujocoPlant
from drake_pregrasp.systems.ports import BODY_MOTIONS
from drake_pregrasp.systems.sources import BodyPose, MovingSolid, ObjectMotion, PoseReplay
from drake_pregrasp.visualization.drawing import draw_giver

DRAKE, MUJOCO = ENGINES = ("drake", "mujoco")
"""Names of the engines that simulate a plant."""

ForceMakers = Sequence[tuple[str, Callable[[RigidBody], LeafSystem]]]
"""Names of systems with forces on a body, such as `ObjectShake`, and functions that make them."""


Drives = dict[str, tuple[ModelInstanceIndex, VelocityProfile]]
"""Models that move along profiles, and these profiles, by the names of the systems that do it."""


class MovingObject(NamedTuple):
    """A plant with an object, and what simulates it.

    Attributes:
        plant: Plant with the object's body.
        scene_graph: SceneGraph with its geometry.
        X_WO: Port with the object's pose.
        dynamics: System that simulates the plant: the plant itself, or MuJoCo with a model of it.
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph
    X_WO: OutputPort
    dynamics: MultibodyPlant | MujocoPlant


def add_to_package_map(parser: Parser) -> None:
    """Adds `package://drake_pregrasp`, the shipped models, to the package map of a parser."""
    parser.package_map().AddPackageXml(str(resource_folder("models") / "package.xml"))


def add_model(plant: MultibodyPlant, file: str) -> ModelInstanceIndex:
    """Adds a shipped model to a plant, and returns its instance."""
    parser = Parser(plant)
    add_to_package_map(parser)
    (model,) = parser.AddModelsFromUrl(f"package://drake_pregrasp/{file}")
    return model


def add_moving_object(
    builder: DiagramBuilder,
    shape: Shape,
    mass: float,
    motion: MotionConfig | RecordedPoses,
    plant_config: MultibodyPlantConfig,
    *,
    friction: float = FRICTION,
    obstacles: Sequence[MovingSolid] = (),
    add_more: Callable[[MultibodyPlant], object] | None = None,
    separate_more: Callable[[MultibodyPlant, SceneGraph], object] | None = None,
    holds_pose: bool = False,
    forces: ForceMakers = (),
    engine: str = DRAKE,
) -> MovingObject:
    """Adds a plant with the object, and what moves it.

    Args:
        builder: Builder of the diagram.
        shape: Shape of the object in O.
        mass: Mass of the object, in kg.
        motion: Motion of the object.
        plant_config: Time step and contact model.
        friction: Coulomb's coefficient of the object.
        obstacles: Obstacles that are bodies.
        add_more: Function that adds more models to the plant, such as a hand. A pusher then moves
            back after the push, so that it leaves them room, and an object with recorded poses is
            a body that they can take (`Giver`).
        separate_more: Function that filters collisions of these models in the finalized plant.
        holds_pose: Whether the pose of a time step is held until the next one (`BodyPose`), for
            ticks whose times equal those of time steps only up to rounding.
        forces: Systems with forces on the object's body.
        engine: What simulates the plant, one of `ENGINES`.

    Raises:
        InvalidArgumentError: If MuJoCo is chosen but not installed.
    """
    motion = read_motion(motion)
    if isinstance(motion, RecordedPoses) and add_more is None:
        return _add_replay(builder, shape, mass, motion, plant_config)
    if engine == DRAKE:
        plant, scene_graph = AddMultibodyPlant(plant_config, builder)
    else:
        plant, scene_graph = _modelled_plant(builder, plant_config)
    body = add_object(plant, shape, mass, friction=friction, slides=isinstance(motion, Toss))
    drives = _add_drives(plant, motion, retreat=RETREAT if add_more else 0.0)
    moving = add_obstacle_bodies(plant, scene_graph, obstacles, body)
    for index, (instance, speed) in enumerate(moving):
        drives[f"obstacle_motion_{index}"] = instance, VelocityProfile([[0.0, speed]])
    if add_more is not None:
        add_more(plant)
    plant.Finalize()
    separate_contacts(plant, scene_graph, body, is_convex=shape.mesh.is_convex)
    if separate_more is not None:
        separate_more(plant, scene_graph)
    plant.SetDefaultFloatingBaseBodyPose(body, initial_pose(motion, shape))
    sources = {name: make(body) for name, make in forces}
    dynamics, rates = plant, {carrier: p.at(0.0)[1] for carrier, p in drives.values()}
    if engine == MUJOCO:
        velocities = initial_velocities(plant, body, motion, rates, steps=mujoco_substeps(plant))
        dynamics = _add_mujoco(builder, plant, scene_graph, body, shape.mesh, velocities)
    else:
        if np.any(velocities := initial_velocities(plant, body, motion, rates)):
            sources["launch"] = Launch(plant, velocities)
        if isinstance(motion, Toss):
            solids = [o.solid for o in obstacles if not np.any(o.velocity)]
            solids += [TABLE_TOP] if motion.table else []
            if solids:
                sources["landing"] = _landing(plant, body, shape.mesh, solids, friction)
        elif isinstance(motion, RecordedPoses):
            _draw_giver(builder, scene_graph, motion, shape.mesh)
            sources["giver"] = Giver(plant, body, motion)
    for name, (instance, profile) in drives.items():
        drive = ObjectMotion(profile, plant.GetDefaultPositions(instance)[0])
        builder.AddNamedSystem(name, drive)
        builder.Connect(drive.get_output_port(), dynamics.get_desired_state_input_port(instance))
    if sources:
        _add_forces(builder, dynamics, sources)
    body_pose = BodyPose(body.index(), time_step=plant_config.time_step if holds_pose else 0.0)
    pose = builder.AddNamedSystem("object_pose", body_pose)
    builder.Connect(dynamics.get_body_poses_output_port(), pose.get_input_port())
    return MovingObject(plant, scene_graph, pose.get_output_port(), dynamics)


def _add_drives(plant: MultibodyPlant, motion: Motion, *, retreat: float) -> Drives:
    """Adds what carries or pushes the object; returns its model and the rates of its joints."""
    if isinstance(motion, Conveyor):
        table = add_model(plant, "conveyor_table.sdf")
        plant.GetJointByName("slide", table).set_default_translation(motion.position[0])
        return {"object_motion": (table, VelocityProfile(motion.velocities()))}
    if isinstance(motion, Push):
        profile = VelocityProfile(push_profile(motion, retreat))
        return {"object_motion": (_add_pusher(plant, motion), profile)}
    if isinstance(motion, Toss) and motion.table:
        add_model(plant, "table.sdf")
    return {}


def _modelled_plant(
    builder: DiagramBuilder, config: MultibodyPlantConfig
) -> tuple[MultibodyPlant, SceneGraph]:
    """Returns a plant that is not part of the diagram, and the SceneGraph of its geometry."""
    plant = MultibodyPlant(config.time_step)
    ApplyMultibodyPlantConfig(config, plant)
    scene_graph = builder.AddNamedSystem("scene_graph", SceneGraph())
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    return plant, scene_graph


def _add_mujoco(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    body: RigidBody,
    mesh: trimesh.Trimesh,
    velocities: FloatArray,
) -> MujocoPlant:
    """Adds MuJoCo with a model of a plant, and moves the plant's geometry with it."""
    _, surface = plant.GetCollisionGeometriesForBody(body)
    pieces, inspector = {surface: convex_pieces(mesh)}, scene_graph.model_inspector()
    dynamics = MujocoPlant(plant, inspector, pieces, velocities=velocities)
    builder.AddNamedSystem("plant", dynamics)
    poses = builder.AddNamedSystem("geometry_poses", MultibodyPositionToGeometryPose(plant, True))
    builder.Connect(dynamics.get_state_output_port(), poses.get_input_port())
    source = scene_graph.get_source_pose_port(plant.get_source_id())
    builder.Connect(poses.get_output_port(), source)
    return dynamics


def _landing(
    plant: MultibodyPlant,
    body: RigidBody,
    mesh: trimesh.Trimesh,
    solids: Sequence[Solid],
    friction: float,
) -> Landing:
    """Returns the impacts of a body on solids in Drake's plant."""
    coulomb = 2 * friction * FRICTION / (friction + FRICTION)  # As Drake combines them.
    corners = mesh.convex_hull.vertices
    return Landing(plant, body, points=corners, solids=solids, friction=coulomb)


def _draw_giver(
    builder: DiagramBuilder, scene_graph: SceneGraph, poses: RecordedPoses, mesh: trimesh.Trimesh
) -> None:
    """Draws what moves a body along recorded poses."""
    source, frame = draw_giver(scene_graph, mesh)
    replay = builder.AddNamedSystem("giver_poses", PoseReplay(poses, frame))
    geometry_pose = replay.GetOutputPort("geometry_pose")
    builder.Connect(geometry_pose, scene_graph.get_source_pose_port(source))


def _add_forces(
    builder: DiagramBuilder, dynamics: MultibodyPlant | MujocoPlant, sources: dict[str, LeafSystem]
) -> None:
    """Adds systems with forces on bodies to a plant, and connects those that read their motions."""
    total = ExternallyAppliedSpatialForceMultiplexer(len(sources))
    builder.AddNamedSystem("spatial_forces", total)
    for index, (name, source) in enumerate(sources.items()):
        builder.AddNamedSystem(name, source)
        for port in BODY_MOTIONS:
            if source.HasInputPort(port):
                connect(builder, dynamics, port, source)
        builder.Connect(source.get_output_port(), total.get_input_port(index))
    builder.Connect(total.get_output_port(), dynamics.get_applied_spatial_force_input_port())


TIP_RADIUS = 0.012
"""Radius of the pusher's tip in `pusher.sdf`, in metres."""

RAMP = 0.1
"""Time in which the tip accelerates to its speed, and in which it stops, in seconds."""


def _add_pusher(plant: MultibodyPlant, motion: Push) -> ModelInstanceIndex:
    """Adds a table under the object and a pusher behind it; returns the pusher's instance."""
    add_model(plant, "table.sdf")
    pusher = add_model(plant, "pusher.sdf")
    guide = plant.GetFrameByName("guide", pusher)
    R_WP = RotationMatrix.MakeZRotation(motion.direction)
    behind = [-(motion.start_distance + TIP_RADIUS), motion.offset, motion.height]
    plant.WeldFrames(plant.world_frame(), guide, RigidTransform(R_WP, R_WP @ behind))
    return pusher


RETREAT = 0.1
"""Distance by which a pusher moves back from an object that a hand takes, in metres."""


def push_profile(motion: Push, retreat: float = 0.0) -> list[list[float]]:
    """Returns rows of times and speeds of the pusher's tip, in s and m/s.

    Args:
        motion: The push.
        retreat: Distance by which the tip moves back afterwards, in metres.
    """
    ramp = min(RAMP, motion.distance / motion.speed)
    up = motion.start + ramp
    down = motion.start + motion.distance / motion.speed
    corners = [(0.0, 0.0), (motion.start, 0.0), (up, motion.speed), (down, motion.speed)]
    corners.append((down + ramp, 0.0))
    if retreat:
        back, end = down + 2 * ramp, down + ramp + retreat / motion.speed
        corners += [(back, -motion.speed), (max(back, end), -motion.speed)]
        corners.append((max(back, end) + ramp, 0.0))
    return [[time, speed] for time, speed in dict(corners).items()]  # Without repeated times.


TABLE = MovingSolid(HalfSpace(np.zeros(3), np.array([0.0, 0.0, 1.0])), np.zeros(3))
"""Half-space below the top of a table, which no fingertip may touch."""

TABLE_TOP = BoxSolid(np.array([0.0, 0.0, -0.015]), np.eye(3), np.array([1.2, 0.8, 0.03]))
"""The table of `table.sdf` in W."""


def _add_replay(
    builder: DiagramBuilder,
    shape: Shape,
    mass: float,
    poses: RecordedPoses,
    plant_config: MultibodyPlantConfig,
) -> MovingObject:
    """Adds a replay of recorded poses.

    The plant holds the model of the body only. It is not part of the diagram: nothing is simulated.
    """
    plant, scene_graph = _modelled_plant(builder, plant_config)
    body = add_object(plant, shape, mass)
    plant.Finalize()
    frame = plant.GetBodyFrameIdOrThrow(body.index())
    replay = builder.AddNamedSystem("pose_replay", PoseReplay(poses, frame))
    drawn = scene_graph.get_source_pose_port(plant.get_source_id())
    builder.Connect(replay.GetOutputPort("geometry_pose"), drawn)
    return MovingObject(plant, scene_graph, replay.GetOutputPort("X_WO"), plant)


class ObjectPlant(Diagram):
    """Simulates an object that a conveyor carries, that flies, is pushed, or follows a recording.

    .. pydrake_system::

        name: ObjectPlant
        output_ports:
        - X_WO
        - query_object

    Port `X_WO` emits a `RigidTransform`: the true pose of the object O in the world W. The top of a
    table is the plane z = 0 of W. An object on a table starts at rest with its centre of mass over
    the origin of W, and with the axes of W, unless a conveyor's `position` and `yaw` say otherwise.

    Port `query_object` emits SceneGraph's `QueryObject`, for visualizers.

    The attributes `plant` and `scene_graph` hold the plant and its SceneGraph, and `dynamics` the
    system that simulates the plant.

    Args:
        object_config: The object.
        motion_config: Motion of the object.
        plant_config: Time step and contact model.
        shape: Shape of the object, if it has been made.
        obstacles: Obstacles that are bodies.
        forces: Systems with forces on the object's body.
        engine: What simulates the plant, one of `ENGINES`.
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph
    dynamics: MultibodyPlant | MujocoPlant

    def __init__(
        self,
        object_config: ObjectConfig,
        motion_config: MotionConfig | RecordedPoses,
        plant_config: MultibodyPlantConfig,
        *,
        shape: Shape | None = None,
        obstacles: Sequence[MovingSolid] = (),
        forces: ForceMakers = (),
        engine: str = DRAKE,
    ) -> None:
        super().__init__()
        builder = DiagramBuilder()
        self.plant, self.scene_graph, X_WO, self.dynamics = add_moving_object(
            builder,
            shape or object_config.make_shape(),
            object_config.mass,
            motion_config,
            plant_config,
            obstacles=obstacles,
            forces=forces,
            engine=engine,
        )
        builder.ExportOutput(X_WO, "X_WO")
        builder.ExportOutput(self.scene_graph.get_query_output_port(), "query_object")
        builder.BuildInto(self)
