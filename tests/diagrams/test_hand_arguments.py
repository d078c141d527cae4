"""What makes no sense in a call of `AddHandController`, or in a description, is one clear line."""

import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import lacking_robots
from plants.own_plants import GRIPPER, own_hand, own_robot, parsed
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    AddMultibodyPlantSceneGraph,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import ModelInstanceIndex, RevoluteJoint, SpatialInertia, UnitInertia
from pydrake.systems.framework import DiagramBuilder

import drake_pregrasp as dp

HAND = own_hand("urdf_gripper").on_carrier
SIZE = [0.06, 0.07, 0.065]
WORLD = ModelInstanceIndex(0)


def call(*, completes=True, finalizes=True, change=lambda plant, robot: {}, extend=None):
    """Adds a hand with the arguments of a function in place of sound ones."""
    builder = DiagramBuilder()
    settings = MultibodyPlantConfig(time_step=0.01, use_sampled_output_ports=False)
    plant, scene_graph = AddMultibodyPlant(settings, builder)
    robot = parsed(plant, HAND.model)
    if completes:
        dp.complete_hand_model(plant, HAND, robot)
    if extend:
        extend(plant)
    if finalizes:
        plant.Finalize()
    arguments = {
        "builder": builder,
        "hand": HAND,
        "surface": dp.box_surface(SIZE, spacing=0.01),
        "planner": dp.PlannerConfig(),
        "plant": plant,
        "robot": robot,
        "mass": 0.25,
        "X_WO": RigidTransform([0.0, 0.0, SIZE[2] / 2]),
        "scene_graph": scene_graph,
    }
    dp.AddHandController(**(arguments | change(plant, robot)))


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda plant, robot: {"robot": []}, r"robot: \[\] must be a model instance, or a list"),
        (lambda plant, robot: {"robot": "gripper"}, "robot: 'gripper' must be a model instance"),
        (lambda plant, robot: {"robot": 2 * robot}, "robot: a model instance is listed twice"),
        (lambda plant, robot: {"robot": [WORLD]}, "robot: there is no joint hand::x; there are: "),
        (lambda plant, robot: {"hand": "hand.yaml"}, "hand must be of type HandDescription, not s"),
        (lambda plant, robot: {"planner": dp.GraspConfig()}, "planner must be of type PlannerConf"),
        (lambda plant, robot: {"config": dp.PlannerConfig()}, "config must be of type GraspConfig"),
        (lambda plant, robot: {"surface": SIZE}, "surface must be of type ObjectSurface, not list"),
        (lambda plant, robot: {"mass": 0.0}, "mass must be a number greater than 0, in kg, not 0"),
        (lambda plant, robot: {"mass": np.nan}, "mass must be a number greater than 0, .* not nan"),
        (lambda plant, robot: {"mass": "0.2"}, "mass must be a number greater than 0, .* not '0.2"),
        (lambda plant, robot: {"X_WO": np.eye(4)}, "X_WO must be of type RigidTransform, not ndar"),
        (lambda plant, robot: {"X_WO": RigidTransform()}, "X_WO: the object is 32.5 mm deep in "),
        (
            lambda plant, robot: {"X_WO": RigidTransform([3.0, 0.0, 0.0325])},
            "lack of arm reach: joint x would be at 3 m, its range is -1.5 to 1.5 m",
        ),
        (lambda plant, robot: {"p_OC": np.full((3, 3), np.nan)}, "p_OC must be an array of finite"),
        (lambda plant, robot: {"p_OC": np.zeros((3, 2))}, r"p_OC must be .*, of shape \(n, 3\)"),
        (lambda plant, robot: {"fixed": 0.0}, "fixed must be a list of solids, not 0.0"),
        (lambda plant, robot: {"body": plant.world_body()}, "body: world is the world or of anoth"),
        (lambda plant, robot: {"builder": DiagramBuilder()}, "plant: it is not in this builder"),
        (
            lambda plant, robot: {
                "scene_graph": AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.01)[1]
            },
            "scene_graph: the plant has its geometries in another one",
        ),
    ],
)
def test_arguments_that_make_no_sense_are_named(change, problem):
    with pytest.raises(dp.InvalidArgumentError, match=problem) as error:
        call(change=change)
    assert "\n" not in str(error.value)


def test_a_hand_is_completed_before_the_plant_is_finalized_and_added_after():
    with pytest.raises(dp.InvalidArgumentError, match=r"plant: it is not finalized; call plant.Fi"):
        call(finalizes=False)

    def complete(plant, robot):
        dp.complete_hand_model(plant, HAND, robot)

    with pytest.raises(dp.InvalidArgumentError, match="plant: it is finalized already; complete "):
        call(completes=False, change=complete)


def add_lamp(plant, inertia, *, is_free):
    lamp = plant.AddRigidBody("lamp", plant.AddModelInstance("lamp"), inertia)
    if not is_free:
        ends = plant.world_frame(), lamp.body_frame()
        plant.AddJoint(RevoluteJoint("swing", *ends, np.array([1.0, 0.0, 0.0])))


@pytest.mark.parametrize("is_free", [True, False])
@pytest.mark.parametrize(
    ("inertia", "mass"),
    [(SpatialInertia.Zero(), 0), (SpatialInertia(0.2, np.zeros(3), UnitInertia(0, 0, 0)), 0.2)],
)
def test_a_link_without_inertia_is_named(inertia, mass, is_free):
    problem = f"plant: lamp and what it carries have a mass of {mass} kg, .*; give link lamp a mass"
    with pytest.raises(dp.InvalidArgumentError, match=problem) as error:
        call(extend=lambda plant: add_lamp(plant, inertia, is_free=is_free))
    assert ("joint swing a rotor_inertia" in str(error.value)) == (not is_free)


@pytest.mark.parametrize("rotor_inertia", [5e-4, 0.0])
def test_the_rotor_of_a_drive_moves_a_finger_without_mass(rotor_inertia, tmp_path):
    model = tmp_path / "gripper.urdf"
    model.write_text(re.sub("<inertial>.*</inertial>", "", GRIPPER.read_text()))
    drives = [replace(HAND.drives[0], rotor_inertia=rotor_inertia)]
    hand = replace(HAND, model=str(model), drives=drives)
    if rotor_inertia:
        assert len(dp.HandModel(hand).p_HT) == 3
    else:
        with pytest.raises(dp.InvalidArgumentError, match=r"of 0 kg, .* joint \w+ a rotor_inertia"):
            dp.HandModel(hand)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('lower="0" upper="2.4"', 'lower="2.4" upper="0"', "must be at most its upper one"),
        ('velocity="5.0"', 'velocity="0"', "the speed limit of swing_0, pitch_0, .* is 0"),
    ],
)
def test_limits_of_joints_that_make_no_sense_are_refused(tmp_path, old, new, problem):
    model = tmp_path / "gripper.urdf"
    model.write_text(GRIPPER.read_text().replace(old, new))
    with pytest.raises(dp.InvalidArgumentError, match=problem):
        dp.HandModel(replace(HAND, model=str(model)))


@pytest.mark.slow
@pytest.mark.skipif(bool(lacking_robots()), reason=lacking_robots())
def test_an_arm_has_the_joints_that_move_the_palm_and_no_others(tmp_path):
    hand = own_robot("ur5", "urdf_gripper", tmp_path).description
    joints, home = hand.base.joints, hand.base.home

    def refused(problem, **changes):
        with pytest.raises(dp.InvalidArgumentError, match=problem):
            dp.HandModel(replace(hand, base=replace(hand.base, **changes)))

    refused("joints: wrist_2_joint is listed twice", joints=[*joints[:5], joints[4]])
    refused("joints: curl_0 does not move the palm", joints=[*joints, "curl_0"], home=[*home, 0.5])
    refused("palm: swing_0 moves distal_0, and is not one of base.joints", palm="distal_0")
    text = (tmp_path / "ur5_urdf_gripper.dmd.yaml").read_text()
    (tmp_path / "ur5_urdf_gripper.dmd.yaml").write_text(text[: text.rindex("- add_weld")])
    refused("joints: shoulder_pan_joint does not move the palm palm; is the hand welded to the arm")
