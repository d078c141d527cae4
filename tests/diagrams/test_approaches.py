"""Approaches of a palm: the choice among them, and carriers that stand as they ask."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from drake_pregrasp import load_scenario
from drake_pregrasp.config.hand_description import Carrier, HandDescription, Mount
from drake_pregrasp.diagrams.expected_path import initial_pose
from drake_pregrasp.diagrams.hand_parsing import add_hand_model
from drake_pregrasp.simulation.scenario import chosen_contacts

# Fingers from above reach 0.15 m below the top.
LOWER_HALF = """object: !Cylinder {radius: 0.03, length: 0.32, mass: 0.4},
    surface: {spacing: 0.02, no_touch: [!BehindPlane {point: [0, 0, 0], normal: [0, 0, -1]}]}"""
COARSE = "surface: {spacing: 0.015}"
MODELS = {
    "sdf": """<sdf version="1.9"><model name="h"><pose>0.1 0 0 0.3 0 0</pose><link name="palm">
        <pose>0 0.2 0 0 0 0</pose></link><joint name="x" type="prismatic"><parent>world</parent>
        <child>palm</child><axis><xyz>0 0 1</xyz></axis></joint></model></sdf>""",
    "urdf": """<robot name="h"><link name="world"/><link name="palm"/><joint name="x"
        type="prismatic"><parent link="world"/><child link="palm"/><origin xyz="0.1 0.2 0"
        rpy="0.3 0 0"/><axis xyz="0 0 1"/><limit effort="1"/></joint></robot>""",
    "xml": """<mujoco model="h"><worldbody><body name="palm" pos="0.1 0.2 0" euler="17.2 0 0">
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint name="x" type="slide"
        axis="0 0 1"/></body></worldbody></mujoco>""",
}


def scenario_of(text, approaches, motion="linear_velocity: 0, angular_velocity: 0"):
    grasp = f"initial_contacts: [], grasp: {{approaches: [{approaches}]}}"
    return load_scenario("grasp_five_finger", text=f"{{{text}, motion: {{{motion}}}, {grasp}}}")


def axis_of(scenario):
    return scenario.approach.rotation().matrix()[:, 2]


@pytest.mark.slow
def test_the_palm_comes_from_the_side_where_it_cannot_from_above():
    scenario = scenario_of(LOWER_HALF, "above, side")
    assert axis_of(scenario)[2] == pytest.approx(0)
    start = chosen_contacts(scenario, scenario.make_surface())
    assert start.margin > 0
    assert np.all(start.p_OC[:, 2] < 0)
    # At home, the fingers clear the table.
    model, X_WO = scenario.load_hand_model(), initial_pose(scenario.motion, scenario.object)
    assert (X_WO @ scenario.approach.translation())[2] > model.side_depth(start.yaw)


@pytest.mark.slow
def test_it_comes_from_above_where_that_is_better():
    assert scenario_of(COARSE, "side, above").approach.IsExactlyIdentity()


@pytest.mark.slow
def test_an_object_that_is_turned_about_the_vertical_is_grasped_from_the_same_side_of_its_own():
    box = f"object: !Box {{size: [0.05, 0.08, 0.24], mass: 0.3}}, {COARSE}"
    still = "linear_velocity: 0, angular_velocity: 0"
    turn, starts, sides = 1.1, [], []
    for yaw in (0.0, turn):
        scenario = scenario_of(box, "side", f"{still}, yaw: {yaw}")
        starts.append(chosen_contacts(scenario, scenario.make_surface()))
        sides.append(RotationMatrix.MakeZRotation(-yaw) @ scenario.approach.rotation())
    np.testing.assert_allclose(sides[1].matrix(), sides[0].matrix(), atol=1e-9)
    np.testing.assert_allclose(starts[1].p_OC, starts[0].p_OC, atol=1e-9)
    assert starts[1].yaw == pytest.approx(starts[0].yaw)


@pytest.mark.parametrize(("kind", "link"), [*((kind, "") for kind in MODELS), ("sdf", "palm")])
def test_the_model_of_a_carrier_stands_as_the_approach_asks(kind, link, tmp_path):
    file = tmp_path / f"own.{kind}"
    file.write_text(MODELS[kind])
    R_WA = RollPitchYaw(0.4, 1.2, -0.7).ToRotationMatrix()
    poses = []
    for turn in (None, R_WA):
        plant = MultibodyPlant(0.01)
        add_hand_model(
            plant, HandDescription(str(file), Carrier(mount=Mount(link=link))), R_WA=turn
        )
        plant.Finalize()
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, np.full(plant.num_positions(), 0.3))
        poses.append(plant.GetFrameByName("palm").CalcPoseInWorld(context))
    upright, turned = poses
    expected = RigidTransform(R_WA) @ upright
    np.testing.assert_allclose(turned.GetAsMatrix4(), expected.GetAsMatrix4(), atol=1e-9)
    assert np.linalg.norm(upright.translation()) > 0.1
