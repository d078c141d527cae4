"""Arms, hands, objects and bases in plants that somebody builds with Drake's parser."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.geometry import AddRigidHydroelasticProperties, Box, ProximityProperties
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, EventStatus
from pydrake.systems.primitives import ConstantVectorSource

import drake_pregrasp as dp
from drake_pregrasp.config.hand_description import Arm, Carrier, Drive, Fingertip, Mount
from drake_pregrasp.config.yaml_text import dump_yaml
from drake_pregrasp.diagrams.hand_parsing import read_model
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.resources import file_url, resource_folder
from drake_pregrasp.robots.robot_models import robot_model

GRIPPER = Path(__file__).parents[2] / "docs/own_hand/gripper.urdf"
CARRIER = "carrier"


def pose(position: Sequence[float], degrees: Sequence[float] = (0.0, 0.0, 0.0)) -> RigidTransform:
    """Returns a pose from a position in metres, and roll, pitch and yaw in degrees."""
    return RigidTransform(RollPitchYaw(np.radians(degrees)), np.array(position))


@dataclass(frozen=True)
class OwnArm:
    """An arm as somebody has it.

    Attributes:
        model: Its model.
        base: Link that stands on the world.
        flange: Frame on which the hand is welded; its z axis points down.
        like: Shipped description with its joints and drives.
        home: Home positions of its joints, in radians.
        X_FBase: Pose of the base under the flange, with the axes of W and on its ground.
    """

    model: str
    base: str
    flange: str
    like: str
    home: list[float]
    X_FBase: RigidTransform


ARMS = {
    "panda": OwnArm(
        "robots://panda.urdf",
        "panda_link0",
        "panda_link8",
        "five_finger_panda",
        [0.0, -0.02, 0.0, -2.35, 0.0, 2.33, 0.0],
        pose([-0.5, 0.0, 0.0]),
    ),
    "ur5": OwnArm(
        "robots://ur5.urdf",
        "base_link",
        "tool0",
        "allegro_ur5",
        [-0.2, -1.39, 2.02, -2.2, -1.57, -0.2],
        pose([0.0, -0.5, 0.05], [0.0, 0.0, 90.0]),
    ),
    "xarm7": OwnArm(
        "robots://xarm7.urdf",
        "link_base",
        "link_eef",
        "allegro_xarm7",
        [0.0, 0.25, 0.0, 1.0, 0.0, 0.76, 0.0],
        pose([-0.45, 0.0, 0.0]),
    ),
}


@dataclass(frozen=True)
class OwnHand:
    """A hand as somebody has it.

    Attributes:
        model: Its model.
        X_FPalm: Pose of the palm in the frame of the flange.
        on_carrier: Description on a carrier; its mount names the palm.
        on_panda: Description on an arm.
    """

    model: str
    X_FPalm: RigidTransform
    on_carrier: dp.HandDescription
    on_panda: dp.HandDescription


def own_hand(name: str) -> OwnHand:
    """Returns one of the hands of `HANDS`."""

    def shipped(file: str) -> dp.HandDescription:
        return dp.load_hand(f"package://drake_pregrasp/{file}.yaml")

    if name == "allegro":
        on_panda, on_carrier = shipped("allegro_panda"), shipped("allegro_hand")
        X_FPalm = pose([-0.02, 0.0, 0.045], [180.0, -90.0, 0.0])
        return OwnHand(on_carrier.model, X_FPalm, on_carrier, on_panda)
    if name == "shadow":
        on_panda, on_carrier = shipped("shadow_panda"), shipped("shadow_hand")
        X_FPalm = pose([0.0, 0.0, 0.08], [-90.0, 0.0, -107.19])
        return OwnHand(on_carrier.model, X_FPalm, on_carrier, on_panda)
    X_FPalm = pose([0.0, 0.0, 0.04], [180.0, 0.0, 0.0])
    if name == "five_finger":
        model, height = "package://drake_pregrasp/five_finger_palm.sdf", 0.155
        on_panda = shipped("five_finger_panda")
    else:
        model, height = str(GRIPPER), 0.12
        azimuths = [0.5, -0.5, np.pi]
        tips = [
            Fingertip(
                f"tip_{finger}",
                f"distal_{finger}",
                [0.0, 0.0, -0.08],
                radius=0.01,
                home=[0.0, 0.9, 1.35],
                reach=dp.SectorReach(azimuth, half_angle=1.0),
            )
            for finger, azimuth in enumerate(azimuths)
        ]
        palm = Arm("palm", palm_position=[0.0, 0.0, height])
        on_panda = dp.HandDescription(model, palm, tips, [Drive(effort=1.0)])
    on_carrier = replace(
        on_panda,
        model=model,
        base=Carrier(palm_height=height, mount=Mount("palm")),
        drives=on_panda.drives[-1:],
    )
    return OwnHand(model, X_FPalm, on_carrier, on_panda)


HANDS = ("allegro", "shadow", "five_finger", "urdf_gripper")


class OwnObject(NamedTuple):
    """An object as somebody has it: a function that makes its shape, and its mass in kg."""

    make_shape: Callable[[], Shape]
    mass: float


OBJECTS = {
    "box": OwnObject(dp.Box(size=[0.06, 0.07, 0.065]).make_shape, 0.25),
    "cylinder": OwnObject(dp.Cylinder(radius=0.025, length=0.08).make_shape, 0.15),
    "mug": OwnObject(lambda: dp.load_shape(resource_folder("models") / "mug.obj"), 0.25),
    # 120 mm high: over one of 200 mm, an Allegro or a Shadow hand reaches only the neck from above.
    "bottle": OwnObject(
        lambda: dp.load_shape(resource_folder("models") / "bottle.obj", scale=0.6), 0.15
    ),
}


class Base(NamedTuple):
    """Where a robot stands beside a table.

    Attributes:
        X_WB: Pose in W of the ground of the arm, which a carrier takes without its turn.
        table: Height of the top of the table in W, in metres.
    """

    X_WB: RigidTransform
    table: float


BASES = {
    "stands": Base(RigidTransform(), 0.0),
    "moved": Base(pose([0.05, -0.05, 0.4], [0.0, 0.0, 40.0]), 0.4),
}


@dataclass(frozen=True)
class Case:
    """A case of the table: names in `ARMS` or `CARRIER`, `HANDS`, `OBJECTS` and `BASES`."""

    arm: str
    hand: str
    thing: str
    base: str

    def __str__(self) -> str:
        return f"{self.arm}, {self.hand}, {self.thing}, {self.base}"


ALL = [
    Case(arm, hand, thing, base)
    for arm in (*ARMS, CARRIER)
    for hand in HANDS
    for thing in OBJECTS
    for base in BASES
]


class OwnRobot(NamedTuple):
    """A robot that can be added to a plant.

    Attributes:
        description: Its description.
        add: Function that adds it to a plant for a pose X_WB of its ground; returns its instances.
    """

    description: dp.HandDescription
    add: Callable[[MultibodyPlant, RigidTransform], list[ModelInstanceIndex]]


def own_robot(arm: str, hand: str, folder: Path) -> OwnRobot:
    """Returns an arm with a hand, or a hand on a carrier; writes directives into a folder."""
    own = own_hand(hand)
    if arm == CARRIER:

        def mount(plant: MultibodyPlant, X_WB: RigidTransform) -> list[ModelInstanceIndex]:
            robot = parsed(plant, own.model)
            X_WB = RigidTransform(X_WB.translation())
            dp.complete_hand_model(plant, own.on_carrier, robot, X_WB=X_WB)
            return robot

        return OwnRobot(own.on_carrier, mount)
    carrying, like = ARMS[arm], dp.load_hand(f"package://drake_pregrasp/{ARMS[arm].like}.yaml")
    palm = own.on_panda.base
    X_FPalm = RigidTransform(RollPitchYaw(palm.palm_rpy), palm.palm_position)
    x, y, _ = (X_FPalm @ own.X_FPalm.inverse()).translation()
    X_BBase = RigidTransform([x, y, 0.0]) @ carrying.X_FBase
    arm_drives = [drive for drive in like.drives if set(drive.joints) & set(like.base.joints)]
    hand_drives = [
        drive for drive in own.on_panda.drives if not set(drive.joints) & set(palm.joints)
    ]
    description = replace(
        own.on_panda,
        model=_written_directives(folder / f"{arm}_{hand}.dmd.yaml", carrying, own, X_BBase),
        base=replace(palm, joints=like.base.joints, home=carrying.home),
        drives=arm_drives + hand_drives,
    )

    def weld(plant: MultibodyPlant, X_WB: RigidTransform) -> list[ModelInstanceIndex]:
        robot = parsed(plant, own.model) + parsed(plant, carrying.model)
        base, flange = map(plant.GetFrameByName, (carrying.base, carrying.flange))
        plant.WeldFrames(plant.world_frame(), base, X_WB @ X_BBase)
        plant.WeldFrames(flange, plant.GetFrameByName(palm.palm), own.X_FPalm)
        dp.complete_hand_model(plant, description, robot)
        return robot

    return OwnRobot(description, weld)


def parsed(plant: MultibodyPlant, model: str) -> list[ModelInstanceIndex]:
    """Adds a model to a plant as Drake's parser reads it."""
    parser = Parser(plant)
    dp.add_to_package_map(parser)
    if model.startswith("robots://"):
        return parser.AddModels(str(robot_model(model)))
    if model.endswith(".xml"):  # Which includes files of another package, as Drake cannot.
        return parser.AddModelsFromString(read_model(model).text, "xml")
    return parser.AddModelsFromUrl(model if "://" in model else file_url(Path(model)))


def _written_directives(file: Path, arm: OwnArm, hand: OwnHand, X_BBase: RigidTransform) -> str:
    """Writes the directives of an arm with a hand, and returns the name of their file."""
    models = {"arm": arm.model, "hand": hand.model}
    welds = [
        ("world", f"arm::{arm.base}", X_BBase),
        (f"arm::{arm.flange}", f"hand::{hand.on_carrier.base.mount.link}", hand.X_FPalm),
    ]
    directives = [{"add_model": {"name": name, "file": model}} for name, model in models.items()]
    for parent, child, X_PC in welds:
        angles = np.degrees(RollPitchYaw(X_PC.rotation()).vector()).tolist()
        place = {"translation": X_PC.translation().tolist(), "rotation": {"deg": angles}}
        directives.append({"add_weld": {"parent": parent, "child": child, "X_PC": place}})
    file.write_text(dump_yaml({"directives": directives}).replace("rotation:", "rotation: !Rpy"))
    return str(file)


class Outcome(NamedTuple):
    """What has become of a grasp.

    Attributes:
        phase: Phase at the end.
        reason: Why the hand gave up; empty if it did not.
        lift: Height of the object at the end over that at the start, in metres.
        drift: Distance that the object moved in the last second, in metres.
    """

    phase: dp.GraspPhase
    reason: str
    lift: float
    drift: float

    @property
    def is_held(self) -> bool:
        """Whether the hand holds the object in the air, and it does not move."""
        return self.phase is dp.GraspPhase.HOLD and self.lift > 0.09 and self.drift < 1e-3


LIMIT = 12.0
HOLD = 2.0
"""Seconds of a simulation, and of the hold after which it ends before."""


def see_and_close(builder, plant, body, planner, controller):
    """Measures the true pose of a body, and tells the hand to close from the start."""
    camera = builder.AddSystem(dp.BodyPose(body.index()))
    builder.Connect(plant.get_body_poses_output_port(), camera.get_input_port())
    builder.Connect(camera.get_output_port(), planner.GetInputPort("X_WO_measured"))
    close = builder.AddSystem(ConstantVectorSource([1.0]))
    builder.Connect(close.get_output_port(), controller.GetInputPort("close"))


def grasp(
    robot: OwnRobot,
    thing: OwnObject,
    base: Base,
    *,
    friction: float = 0.7,
    planned_friction: float = 0.5,
) -> Outcome:
    """Returns what becomes of a grasp in a plant of one's own.

    Args:
        robot: The robot.
        thing: The object, in the middle of a table.
        base: Where the robot stands.
        friction: Coulomb's coefficient of the object.
        planned_friction: That with which the grasp is planned.

    Raises:
        NoGraspError: If there is no grasp.
    """
    hand, shape, height = robot.description, thing.make_shape(), base.table
    builder, config = DiagramBuilder(), dp.GraspConfig(planned_friction=planned_friction)
    settings = MultibodyPlantConfig(time_step=0.01, use_sampled_output_ports=False)
    plant, scene_graph = AddMultibodyPlant(settings, builder)
    table = ProximityProperties()
    AddRigidHydroelasticProperties(0.1, table)
    table.AddProperty("material", "coulomb_friction", CoulombFriction(0.7, 0.7))
    X_WT = RigidTransform([0.0, 0.0, height - 0.02])
    plant.RegisterCollisionGeometry(plant.world_body(), X_WT, Box(0.4, 0.4, 0.04), "table", table)
    body = dp.add_object(plant, shape, thing.mass, friction=friction)
    instances = robot.add(plant, base.X_WB)
    plant.Finalize()
    X_WO = RigidTransform([0.0, 0.0, height - float(np.min(shape.mesh.vertices[:, 2]))])
    plant.SetDefaultFloatingBaseBodyPose(body, X_WO)
    controller, planner = dp.AddHandController(
        builder,
        hand,
        dp.mesh_surface(shape, spacing=0.006, tip=config.tip_size(hand.fingertips)),
        dp.PlannerConfig(),
        plant=plant,
        robot=instances,
        mass=thing.mass,
        X_WO=X_WO,
        config=config,
        object_solid=shape.solid,
        fixed=[dp.HalfSpace(np.array([0.0, 0.0, height]), np.array([0.0, 0.0, 1.0]))],
        scene_graph=scene_graph,
    )
    see_and_close(builder, plant, body, planner, controller)
    simulator = Simulator(builder.Build())
    port, places, held = controller.GetOutputPort("grasp_report"), [], []

    def observe(context: Context) -> EventStatus:
        report = port.Eval(controller.GetMyContextFromRoot(context))
        X_WO_now = plant.EvalBodyPoseInWorld(plant.GetMyContextFromRoot(context), body)
        places.append((context.get_time(), *X_WO_now.translation()))
        if dp.GraspPhase(int(report[0])) is dp.GraspPhase.HOLD:
            held.append(context.get_time())
        if report[2] or (held and context.get_time() - held[0] > HOLD):
            return EventStatus.ReachedTermination(simulator.get_system(), "")
        return EventStatus.Succeeded()

    simulator.set_monitor(observe)
    simulator.AdvanceTo(LIMIT)
    report = port.Eval(controller.GetMyContextFromRoot(simulator.get_context()))
    times, p_WO = np.split(np.array(places), [1], axis=1)
    last = p_WO[times[:, 0] > times[-1] - 1.0]
    return Outcome(
        dp.GraspPhase(int(report[0])),
        dp.describe_give_up(int(report[2]), report[3]),
        float(p_WO[-1, 2] - X_WO.translation()[2]),
        float(np.max(np.linalg.norm(last - last[-1], axis=1))),
    )
