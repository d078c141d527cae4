"""An arm and a hand as two model instances in a plant of one's own, wherever the arm stands."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia

from drake_pregrasp import HandModel, InvalidArgumentError, complete_hand_model, load_hand
from drake_pregrasp.diagrams.hand_instances import HandInstances
from drake_pregrasp.diagrams.plant_match import base_pose, matching_joints
from drake_pregrasp.robots.robot_models import robot_model

pytestmark = pytest.mark.usefixtures("allegro_panda")

X_FH = RigidTransform(RollPitchYaw(np.pi, -np.pi / 2, 0.0), [-0.02, 0.0, 0.045])
BASES = [
    RigidTransform(),
    RigidTransform([0.1, 0.1, 0.05]),
    RigidTransform(RollPitchYaw(np.pi, 0.0, 0.0), [0.0, 0.0, 1.0]),
    RigidTransform(RollPitchYaw(0.6, 0.3, -1.2), [0.3, -2.0, 0.1]),
]


@pytest.fixture(scope="module")
def model(allegro_panda):
    """The model of the description."""
    return HandModel(description())


def description():
    return load_hand("package://drake_pregrasp/allegro_panda.yaml")


def added(X_WB=BASES[0], X_FH=X_FH, hand=None, change=None, complete=True, tip_mass="0.0168"):
    """The arm and the hand in a plant beside a free body, the hand before the arm."""
    plant = MultibodyPlant(0.01)
    parser = Parser(plant)
    plant.AddRigidBody("box", SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1))
    robot = []
    for name in ("allegro_hand", "panda"):
        file = robot_model(f"robots://{name}.urdf")
        text = file.read_text().replace('filename="', f'filename="{file.parent.as_uri()}/')
        robot += parser.AddModelsFromString(text.replace('"0.0168"', f'"{tip_mass}"'), "urdf")
        plant.RenameModelInstance(robot[-1], f"my_{name}")
    frames = [plant.GetFrameByName(n) for n in ("panda_link0", "panda_link8", "palm_link")]
    plant.WeldFrames(plant.world_frame(), frames[0], X_WB @ RigidTransform([-0.55, 0.0, 0.0]))
    plant.WeldFrames(*frames[1:], X_FH)
    if complete:
        complete_hand_model(plant, hand or description(), robot)
    if change:
        change(plant)
    plant.Finalize()
    return HandInstances(plant, robot)


@pytest.mark.slow
@pytest.mark.parametrize("X_WB", BASES)
def test_the_internal_model_has_the_kinematics_of_the_plant(model, X_WB):
    robot = added(X_WB)
    found = base_pose(model, robot)
    np.testing.assert_allclose(found.GetAsMatrix4(), X_WB.GetAsMatrix4(), atol=1e-9)
    model, random = HandModel(description(), X_WB=found), np.random.default_rng(1)
    joints, plant = matching_joints(model, robot), robot.plant
    context = plant.CreateDefaultContext()
    for _ in range(20):
        q = random.uniform(model.kinematics.lower, model.kinematics.upper)
        for joint, position in zip(joints, q, strict=True):
            joint.set_angle(context, position)
        frames = [robot.frame(tip.frame, "") for tip in model.description.fingertips]
        p_WT = [frame.CalcPoseInWorld(context).translation() for frame in frames]
        np.testing.assert_allclose(model.tips_at(q), p_WT, atol=1e-9)


def softer():
    first, *others = description().drives
    return replace(description(), drives=[replace(first, stiffness=1000.0), *others])


def limit(plant):
    plant.GetMutableJointByName("panda_joint4").set_position_limits([-2.0], [-1.0])


def fall(plant):
    plant.set_gravity_enabled(plant.GetModelInstanceByName("my_panda"), True)


def float_all(plant):
    for name in ("my_panda", "my_allegro_hand"):
        plant.set_gravity_enabled(plant.GetModelInstanceByName(name), False)


def free(plant):
    plant.RemoveJoint(plant.GetMutableJointByName("world_welds_to_panda_link0"))


def slide(plant):
    free(plant)
    rail = plant.AddRigidBody(
        "rail", plant.AddModelInstance("rail"), SpatialInertia.SolidSphereWithMass(1.0, 0.1)
    )
    ends = plant.world_frame(), rail.body_frame()
    plant.AddJoint(PrismaticJoint("along_rail", *ends, [0.0, 1.0, 0.0]))
    plant.WeldFrames(rail.body_frame(), plant.GetFrameByName("panda_link0"))


@pytest.mark.parametrize(
    ("plant", "problem"),
    [
        ({"change": limit}, "panda_joint4: positions are from -2 to -1 in the plant, and from -3"),
        ({"change": fall}, "gravity acts on my_panda in the plant"),
        ({"change": free}, "panda_link0 of the plant moves, but not in the hand's model"),
        ({"change": slide}, "along_rail moves the base in the plant"),
        (
            {"complete": False, "change": float_all},
            "joint1 has no drive with gains in the plant; call complete_hand",
        ),
        ({"hand": softer()}, "joint1: the stiffness is 1000 in the plant, and 9000 in the model"),
        ({"tip_mass": "0.05"}, "a mass of 0.05 kg in the plant, and a mass of 0.0168 kg in the"),
        (
            {"X_FH": RigidTransform([0.0, 0.0, 0.05])},
            r"palm_link in panda_link8 is at \(0, 0, 0.05\) m",
        ),
    ],
)
def test_what_the_plant_contradicts_is_said_with_both_values(model, plant, problem):
    with pytest.raises(InvalidArgumentError, match=problem):
        base_pose(model, added(**plant))


def test_a_name_that_two_models_have_needs_its_model():
    plant = MultibodyPlant(0.01)
    models = [plant.AddModelInstance(name) for name in ("left", "right")]
    for model in models:
        plant.AddRigidBody("palm", model)
    hand = HandInstances(plant, models)
    assert hand.body("right::palm", "key").model_instance() == models[1]
    with pytest.raises(InvalidArgumentError, match="ambiguous; write left::palm or right::palm"):
        hand.body("palm", "key")
    with pytest.raises(InvalidArgumentError, match="key: there is no link thumb; there are: palm"):
        hand.body("thumb", "key")
