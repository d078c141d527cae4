"""Arms, hands and objects in a plant of one's own, with the base moved and turned."""

import numpy as np
import pytest
from conftest import LACKING_HANDS
from pydrake.geometry import AddRigidHydroelasticProperties, Box, ProximityProperties
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

import drake_pregrasp as dp
from drake_pregrasp.errors import Lack
from drake_pregrasp.geometry.solids import HalfSpace
from drake_pregrasp.resources import resource_folder
from drake_pregrasp.robots.robot_models import robot_model

PLANNING = dp.PlannerConfig(static_duration=0.0)
STANDS = RigidTransform()
HANGS = RigidTransform(RollPitchYaw(np.pi, 0.0, 0.0), [0.0, 0.0, 0.85])
SHAPES = {
    "box": (lambda: dp.Box(size=[0.06, 0.07, 0.065]).make_shape(), 0.25),
    "cylinder": (lambda: dp.Cylinder(radius=0.025, length=0.08).make_shape(), 0.15),
    "mug": (lambda: dp.load_shape(resource_folder("models") / "mug.obj"), 0.25),
    "bottle": (lambda: dp.load_shape(resource_folder("models") / "bottle.obj"), 0.25),
}


def model_of(hand):
    if lack := LACKING_HANDS.get(hand, ""):
        pytest.skip(lack)
    return dp.load_hand(f"package://drake_pregrasp/{hand}.yaml")


def two_instances(X_WB):
    """Adds a Panda and an Allegro hand as somebody would who does not know this package."""

    def add(plant, hand):
        parser, world = Parser(plant), plant.world_frame()
        robot = [
            *parser.AddModels(str(robot_model("robots://allegro_hand.urdf"))),
            *parser.AddModels(str(robot_model("robots://panda.urdf"))),
        ]
        base, flange, palm = map(plant.GetFrameByName, ("panda_link0", "panda_link8", "palm_link"))
        plant.WeldFrames(world, base, X_WB @ RigidTransform([-0.55, 0.0, 0.0]))
        X_FP = RigidTransform(RollPitchYaw(np.pi, -np.pi / 2, 0.0), [-0.02, 0.0, 0.045])
        plant.WeldFrames(flange, palm, X_FP)
        dp.complete_hand_model(plant, hand, robot)
        return robot

    return add


def described(X_WB):
    return lambda plant, hand: dp.add_hand_model(plant, hand, X_WB=X_WB)


def final_phase(name, add_robot, kind, height=0.0):
    """Returns the phase of a grasp at its end, and how far the object was lifted, in metres."""
    hand, (make_shape, mass) = model_of(name), SHAPES[kind]
    builder, shape = DiagramBuilder(), make_shape()
    settings = MultibodyPlantConfig(time_step=0.01, use_sampled_output_ports=False)
    plant, scene_graph = AddMultibodyPlant(settings, builder)
    table = ProximityProperties()
    AddRigidHydroelasticProperties(0.1, table)
    table.AddProperty("material", "coulomb_friction", CoulombFriction(0.7, 0.7))
    X_WT = RigidTransform([0.0, 0.0, height - 0.05])
    plant.RegisterCollisionGeometry(plant.world_body(), X_WT, Box(1, 1, 0.1), "table", table)
    body = dp.add_object(plant, shape, mass, friction=0.7)
    robot = add_robot(plant, hand)
    plant.Finalize()
    low = float(np.min(shape.mesh.vertices[:, 2]))
    X_WO = RigidTransform([0.0, 0.0, height - low])
    plant.SetDefaultFloatingBaseBodyPose(body, X_WO)
    surface = dp.mesh_surface(shape, spacing=0.006, tip=dp.GraspConfig().tip_size(hand.fingertips))
    controller, planner = dp.AddHandController(
        builder,
        hand,
        surface,
        PLANNING,
        plant=plant,
        robot=robot,
        mass=mass,
        X_WO=X_WO,
        object_solid=shape.solid,
        fixed=[HalfSpace(np.array([0.0, 0.0, height]), np.array([0.0, 0.0, 1.0]))],
        scene_graph=scene_graph,
    )
    camera = builder.AddSystem(dp.BodyPose(body.index()))
    builder.Connect(plant.get_body_poses_output_port(), camera.get_input_port())
    builder.Connect(camera.get_output_port(), planner.GetInputPort("X_WO_measured"))
    close = builder.AddSystem(ConstantVectorSource([1.0]))
    builder.Connect(close.get_output_port(), controller.GetInputPort("close"))
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(6.5)
    context = simulator.get_context()
    report = controller.GetOutputPort("grasp_report").Eval(controller.GetMyContextFromRoot(context))
    lifted = plant.EvalBodyPoseInWorld(plant.GetMyContextFromRoot(context), body)
    return dp.GraspPhase(int(report[0])), float((lifted.translation() - X_WO.translation())[2])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hand", "add_robot", "kind", "height"),
    [
        ("allegro_panda", two_instances(RigidTransform([0.1, 0.1, 0.05])), "box", 0.0),
        ("allegro_panda", two_instances(HANGS), "box", 0.0),
        (
            "allegro_panda",
            two_instances(RigidTransform(RollPitchYaw(0.0, 0.0, 2.8), [0.0, 0.0, 0.7])),
            "cylinder",
            0.7,
        ),
        ("allegro_ur5", described(RigidTransform(RollPitchYaw(0, 0, 1.0), [0, 0, 0])), "box", 0.0),
        ("allegro_xarm7", described(RigidTransform([0.0, 0.1, 0.3])), "box", 0.3),
        ("five_finger_panda", described(RigidTransform([0.1, 0.1, 0.0])), "bottle", 0.0),
        ("five_finger_panda", described(STANDS), "mug", 0.0),
        ("five_finger_hand", described(RigidTransform([0.2, -0.3, 0.4])), "mug", 0.4),
    ],
)
def test_arms_and_hands_hold_objects_wherever_they_stand(hand, add_robot, kind, height):
    phase, lift = final_phase(hand, add_robot, kind, height)
    assert phase is dp.GraspPhase.HOLD
    assert lift > 0.09


@pytest.mark.slow
def test_an_object_out_of_the_arms_reach_is_refused_for_that_until_the_base_comes_nearer():
    hand = model_of("allegro_panda")
    surface = dp.box_surface([0.06, 0.07, 0.065], spacing=0.005, forbidden_faces=["+z", "-z"])
    place = {"mass": 0.25, "X_WO": RigidTransform([0.35, 0.0, 0.0325])}
    with pytest.raises(
        dp.NoGraspError, match=r"lack of arm reach: .* it stays \d+\.?\d* mm"
    ) as error:
        dp.choose_approach(hand, surface, PLANNING, **place)
    assert error.value.lack is Lack.ARM
    nearer = RigidTransform([0.35, 0.0, 0.0])
    assert dp.choose_approach(hand, surface, PLANNING, **place, X_WB=nearer).start.margin > 0
