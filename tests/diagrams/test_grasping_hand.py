"""A hand in a plant of one's own, its start contacts, and the choice among approaches."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import lacking_shadow, slow
from five_finger_hand import HAND, X_WO
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

import drake_pregrasp as dp
from drake_pregrasp.config.hand_description import Carrier, Closing, Drive, HandDescription, Mount
from drake_pregrasp.diagrams.approaches import best_approach
from drake_pregrasp.errors import Lack, NoGraspError
from drake_pregrasp.geometry.solids import HalfSpace
from drake_pregrasp.grasping.clearances import LINK_CLEARANCE, TIP_LEAD
from drake_pregrasp.quality.grasp_stiffness import turn_by_force
from drake_pregrasp.systems.palm_frames import FROM_ABOVE

SIZE = [0.1, 0.1, 0.1]
SURFACE = dp.box_surface(SIZE, spacing=0.01, forbidden_faces=["+z", "-z"])
GROUND = HalfSpace([0, 0, 0], [0, 0, 1])
PLANNING = dp.PlannerConfig(static_duration=0.0)


def add(
    p_OC=None,
    mass=0.4,
    surface=SURFACE,
    pose=X_WO,
    X_WB=FROM_ABOVE,
    hand=HAND.description,
    robot=None,
    is_sampled=False,
    fixed=(GROUND,),
    **config,
):
    builder = DiagramBuilder()
    settings = MultibodyPlantConfig(time_step=0.01, use_sampled_output_ports=is_sampled)
    plant, _ = AddMultibodyPlant(settings, builder)
    models = dp.add_hand_model(plant, hand, X_WB=X_WB)
    plant.Finalize()
    robot = models if robot is None else robot
    added = dp.AddHandController(
        builder,
        hand,
        surface,
        PLANNING,
        plant=plant,
        robot=robot,
        mass=mass,
        X_WO=pose,
        p_OC=p_OC,
        fixed=fixed,
        config=dp.GraspConfig(**config),
    )
    return builder, plant, robot, added


@pytest.mark.slow
def test_the_robot_starts_where_its_controller_starts():
    builder, plant, robot, added = add()
    context = builder.Build().CreateDefaultContext()
    q = plant.GetPositions(plant.GetMyContextFromRoot(context), *robot)
    np.testing.assert_array_equal(q, added.controller.initial)
    p_WC = added.planner.GetOutputPort("p_WC")
    planning = added.planner.GetMyMutableContextFromRoot(context)
    added.planner.GetInputPort("X_WO_measured").FixValue(planning, X_WO)
    contacts = p_WC.Eval(planning).reshape(-1, 3)
    assert np.max(SURFACE.distance(contacts - X_WO.translation())) < 1e-6


@pytest.mark.slow
def test_the_palm_keeps_the_slack_of_its_start():
    still = "{motion: {linear_velocity: 0, angular_velocity: 0}, simulation_duration: 1.0}"
    resolved = dp.load_resolved("grasp_five_finger", text=still)
    start = replace(resolved.start, yaw=resolved.start.yaw + 0.2, yaw_slack=0.3)
    diagram = dp.make_diagram(replace(resolved, start=start))
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.0)
    controller = diagram.GetSubsystemByName("hand_controller")
    context = controller.GetMyContextFromRoot(simulator.get_context())
    X_WU = controller.GetOutputPort("X_WU").Eval(context)
    assert RollPitchYaw(X_WU.rotation()).yaw_angle() == pytest.approx(start.yaw, abs=0.03)


BESIDE = [[1, -0.6, 0], [1, -0.3, 0], [1, 0, 0], [1, 0.3, 0], [1, 0.6, 0]]


@pytest.mark.parametrize("contacts", [slow(BESIDE), slow(BESIDE[:4])])
def test_given_contacts_are_checked_as_on_the_command_line(contacts):
    with pytest.raises(dp.ScenarioError) as of_a_file:
        dp.load_resolved("grasp_five_finger", text=f"{{initial_contacts: {contacts}}}")
    with pytest.raises(dp.InvalidArgumentError) as in_python:
        add(np.array(contacts) * 0.05)
    assert str(of_a_file.value).endswith(str(in_python.value))


@pytest.mark.parametrize(
    ("text", "python"),
    [
        ("{object: {mass: 9}}", {"mass": 9.0}),
        ("{grasp: {touch_force: 3}}", {"touch_force": 3.0}),
        ("{grasp: {least_force: 20}}", {"least_force": 20.0}),
        ("{grasp: {period: 0.002}, plant_config: {time_step: 0.01}}", {"period": 0.002}),
    ],
)
def test_settings_are_checked_as_on_the_command_line(text, python):
    with pytest.raises(dp.ScenarioError) as of_a_file:
        dp.load_resolved("grasp_five_finger", text=text)
    with pytest.raises(dp.InvalidArgumentError) as in_python:
        add(**python)
    assert str(of_a_file.value).endswith(str(in_python.value))


@pytest.mark.slow
def test_a_grasp_that_the_torques_of_the_joints_do_not_hold_is_refused_with_both_forces():
    tips = [replace(tip, closing=Closing(force=100.0)) for tip in HAND.description.fingertips]
    strong = replace(HAND.description, fingertips=tips)
    with pytest.raises(dp.NoGraspError, match=r"hold [\d.]+ N at .* weigh 98.1 N") as error:
        add(mass=10.0, largest_force=100.0, hand=strong)
    assert error.value.lack is Lack.TORQUE


def test_a_robot_that_is_not_in_the_plant_is_refused():
    with pytest.raises(dp.InvalidArgumentError, match=r"robot: .* 7.*; there are: .*2 hand"):
        add(robot=ModelInstanceIndex(7))


@pytest.mark.slow
def test_an_object_in_the_table_and_late_joints_are_said_at_once():
    with pytest.raises(
        dp.InvalidArgumentError, match="X_WO: the object is 20 mm deep in the table"
    ):
        add(pose=RigidTransform([0.0, 0.0, 0.03]))
    too_few = np.zeros((4, 3))
    with (
        pytest.raises(dp.InvalidArgumentError, match="5 fingertips must be 4"),
        pytest.warns(UserWarning, match="use_sampled_output_ports is set: .* one time step late"),
    ):
        add(too_few, pose=RigidTransform([0.0, 0.0, 0.0495]), is_sampled=True)


@pytest.mark.slow
def test_a_link_that_starts_inside_of_a_fixed_solid_is_named_with_its_depth():
    table, top = HalfSpace([0, 0, 0], [0, 0, 1]), 0.355 + 0.022  # Of the raised palm's disc.
    shelf = dp.BoxSolid([0, 0, top + 0.5 - 0.01], np.eye(3), [1, 1, 1])
    with pytest.raises(
        dp.InvalidArgumentError, match=r"link hand::palm starts 10 mm deep in fixed\[1\]"
    ):
        add(fixed=[table, shelf])


@pytest.mark.slow
def test_without_a_grasp_python_says_what_is_missing():
    with pytest.raises(dp.NoGraspError, match="for lack of friction"):
        add(mass=0.1, planned_friction=0.02, largest_force=100.0)


@pytest.mark.parametrize(
    ("problems", "nearest"),
    [
        ([NoGraspError(Lack.ARM, "far", 0.2), NoGraspError(Lack.ARM, "near", 0.01)], "near"),
        ([NoGraspError(Lack.ARM, "near", 0.01), NoGraspError(Lack.ROOM, "there")], "there"),
        ([dp.InvalidArgumentError("first"), dp.InvalidArgumentError("second")], "first"),
    ],
)
def test_of_approaches_without_a_grasp_the_nearest_is_named(problems, nearest):
    def start_of(index):
        raise problems[index]

    with pytest.raises(dp.InvalidArgumentError, match=nearest):
        best_approach([range(len(problems))], start_of)


TALL = dp.box_surface([0.06, 0.07, 0.2], spacing=0.012, forbidden_faces=["+z", "-z"])


@pytest.mark.slow
def test_a_carrier_that_stands_so_comes_from_the_side_with_chosen_and_with_given_contacts():
    pose, config = RigidTransform([0.0, 0.0, 0.1]), dp.GraspConfig(approaches=["side"])
    there = {"mass": 0.3, "X_WO": pose, "config": config}
    hand, start = dp.choose_approach(HAND.description, TALL, PLANNING, **there)
    axis, given = hand.X_LA.rotation().matrix()[:, 2], start.p_OC[::-1]
    assert axis[2] == pytest.approx(0, abs=1e-9)
    own = {"mass": 0.3, "surface": TALL, "pose": pose, "approaches": ["side"]}
    for p_OC in (None, given):
        _, plant, robot, added = add(p_OC, **own, X_WB=hand.X_WB)
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, *robot, added.controller.initial)
        palm = plant.GetFrameByName("palm", *robot).CalcPoseInWorld(context).translation()
        assert (palm - pose.translation()) @ axis > 0.15
    with pytest.raises(
        dp.InvalidArgumentError, match="the carrier in the plant is turned for none"
    ):
        add(given, **own)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["above", "side"])
def test_start_contacts_score_lower_by_the_turn_of_the_object_with_its_load(kind):
    """The turn is computed in L. The hands differ only in the stiffness of their drives."""
    pose = RigidTransform(RollPitchYaw(0.0, 0.0, 0.4), [0.0, 0.0, 0.1])
    config, R_WO = dp.GraspConfig(approaches=[kind]), pose.rotation().matrix()
    surface = replace(TALL, p_OCoM=np.array([0.008, -0.004, 0.01]))
    starts, turns = [], []
    for softer in (1.0, 1.02):
        there = {"mass": 0.3, "X_WO": pose, "config": config}
        description = replace(HAND.description, drives=[Drive(stiffness=4.0 / softer)])
        hand, start = dp.choose_approach(description, surface, PLANNING, **there)
        R_WU = hand.X_LA.rotation().matrix() @ RotationMatrix.MakeZRotation(start.yaw).matrix()
        nhat_W = surface.project(start.p_OC)[1] @ R_WO.T
        p_LC = (start.p_OC - surface.p_OCoM) @ R_WO.T
        p_LT = p_LC + hand.tip_radii[:, None] * nhat_W
        p_UT = (p_LT - hand.X_LA.translation()) @ R_WU
        compliances = [
            R_WU @ hand.fingers.compliance(finger, p) @ R_WU.T for finger, p in enumerate(p_UT)
        ]
        on = start.has_contact
        turns.append(
            turn_by_force(
                *(p_LC[on], nhat_W[on], np.array(compliances)[on]),
                torsional_arms=np.zeros(np.sum(on)),
                force=0.5 * 9.81 * 0.3,
            )
        )
        starts.append(start)
    np.testing.assert_array_equal(starts[0].p_OC, starts[1].p_OC)
    assert turns[1] == pytest.approx(1.02 * turns[0], rel=1e-3)
    assert starts[0].score - starts[1].score == pytest.approx(6.0 * (turns[1] - turns[0]), rel=1e-4)


MUG = """
object: !Mesh {file: "package://drake_pregrasp/mug.obj", mass: 0.3}
initial_contacts: []
grasp: {approaches: [above]}
"""


@pytest.mark.slow
def test_links_are_clear_of_the_object_at_start_contacts_and_their_standoffs():
    """Other contacts on this mug have a margin as large, and a link too near at a standoff."""
    if lacking_shadow():
        pytest.skip(lacking_shadow())
    resolved = dp.load_resolved("grasp_shadow", text=MUG)
    hand, surface, start = resolved.hand, resolved.surface, resolved.start
    X_OU = resolved.X_WO.inverse() @ RigidTransform(resolved.X_WO @ surface.p_OCoM)
    X_OU = X_OU @ RigidTransform(RotationMatrix.MakeZRotation(start.yaw), np.zeros(3))
    nhat = surface.project(start.p_OC)[1]
    gaps = {}
    for standoff in (0.0, resolved.scenario.grasp.standoff):
        p_OT = start.p_OC + (hand.tip_radii[:, None] + standoff) * nhat
        gaps[standoff] = [
            hand.fingers.link_gaps(
                finger,
                (X_OU.inverse() @ p_OT[[finger]].T).T,
                lambda p: resolved.shape.solid.distance((X_OU @ p.T).T),
            )[0]
            for finger in np.flatnonzero(start.has_contact).tolist()
        ]
    touching, standing_off = gaps.values()
    assert np.min(touching) >= TIP_LEAD
    assert np.min(np.where(np.isneginf(standing_off), np.inf, standing_off)) >= LINK_CLEARANCE


@pytest.mark.slow
def test_a_palm_from_the_side_clears_a_table_at_any_height():
    config, found = dp.GraspConfig(approaches=["side"]), []
    for height in (0.0, 0.7):
        p_WT = np.array([0.0, 0.0, height])
        pose = RigidTransform([0.0, 0.0, height + 0.1])
        place = {"X_WO": pose, "fixed": [HalfSpace(p_WT, np.array([0.0, 0.0, 1.0]))]}
        found.append(
            dp.choose_approach(HAND.description, TALL, PLANNING, mass=0.3, config=config, **place)
        )
    poses = [hand.X_LA.GetAsMatrix4() for hand, _ in found]
    np.testing.assert_allclose(poses[1], poses[0], atol=1e-9)
    np.testing.assert_allclose(found[1].start.p_OC, found[0].start.p_OC, atol=1e-9)


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
    return dp.load_resolved("grasp_five_finger", text=f"{{{text}, motion: {{{motion}}}, {grasp}}}")


def axis_of(scenario):
    return scenario.hand.X_LA.rotation().matrix()[:, 2]


@pytest.mark.slow
def test_the_palm_comes_from_the_side_where_it_cannot_from_above():
    scenario = scenario_of(LOWER_HALF, "above, side")
    assert axis_of(scenario)[2] == pytest.approx(0)
    start = scenario.start
    assert start.margin > 0
    assert np.all(start.p_OC[:, 2] < 0)
    # At home, the fingers clear the table.
    height = (scenario.X_WO @ scenario.hand.X_LA.translation())[2]
    assert height > scenario.hand.fingers.depth(start.yaw)


@pytest.mark.slow
@pytest.mark.parametrize("yaw", [0.0, 2.8])
def test_no_link_of_a_palm_from_the_side_starts_in_the_table(yaw):
    """Nor the forearm of a hand, which is longer than its fingers."""
    if lacking_shadow():
        pytest.skip(lacking_shadow())
    bottle = "object: !Mesh {file: 'package://drake_pregrasp/bottle.obj', mass: 0.3}"
    hand = "hand: {file: 'package://drake_pregrasp/shadow_hand.yaml'}"
    resolved = scenario_of(f"{bottle}, {hand}, {COARSE}", "side", f"yaw: {yaw}")
    assert np.all(resolved.start.has_contact)
    dp.make_diagram(resolved)  # It refuses links that start in the table.


@pytest.mark.slow
def test_given_contacts_choose_the_side_as_well_and_are_refused_where_no_palm_fits():
    at = [[-1, 0, -0.1], [-1, 0, -0.4], [0, 1, -0.02], [1, 0, -0.1], [1, 0, -0.4]]
    given = f"{{initial_contacts: {at}, grasp: {{approaches: [above, side], side_height: 0.13}}}}"
    scenario = dp.load_resolved("grasp_from_side", text=given)
    assert axis_of(scenario)[2] == pytest.approx(0)
    start = scenario.start
    assert np.all(start.p_OC[start.has_contact, 2] < 0)
    assert np.sum(start.has_contact) >= 4
    with pytest.raises(
        dp.ScenarioError, match=r"initial_contacts: from the side.*no finger reaches contact"
    ):
        dp.load_resolved("grasp_from_side", text="{ring_contacts: 5, grasp: {approaches: [side]}}")


@pytest.mark.slow
def test_a_palm_from_the_side_stays_before_the_side_of_an_object_that_turns():
    box = f"object: !Box {{size: [0.05, 0.08, 0.24], mass: 0.3}}, {COARSE}"
    resolved = scenario_of(box, "side", "linear_velocity: 0.02, angular_velocity: 0.5")
    diagram = dp.make_diagram(resolved)
    simulator = Simulator(diagram)
    planner = diagram.GetSubsystemByName("pregrasp_planner")
    plant, palms = diagram.GetSubsystemByName("object_plant").GetSubsystemByName("plant"), []
    for time in (1.5, 3.0):
        simulator.AdvanceTo(time)
        context = plant.GetMyContextFromRoot(simulator.get_context())
        X_WO = plant.GetBodyByName("object").EvalPoseInWorld(context)
        palms.append(X_WO.inverse() @ plant.GetBodyByName("palm").EvalPoseInWorld(context))
    assert RollPitchYaw(X_WO.rotation()).yaw_angle() == pytest.approx(1.5, abs=0.05)
    assert palms[1].IsNearlyEqualTo(palms[0], 0.03)
    controller = diagram.GetSubsystemByName("hand_controller")
    controlling = controller.GetMyContextFromRoot(simulator.get_context())
    X_WU, X_WP = controller.GetOutputPort("X_WU").Eval(controlling), X_WO @ palms[1]
    assert X_WP.rotation().col(2) @ X_WU.rotation().col(2) > np.cos(0.03)
    planning = planner.GetMyContextFromRoot(simulator.get_context())
    status = planner.GetOutputPort("contact_status").Eval(planning)
    assert np.all(status[resolved.start.has_contact] > 0)


@pytest.mark.slow
def test_it_comes_from_above_where_that_is_better():
    assert scenario_of(COARSE, "side, above").hand.X_LA.IsExactlyIdentity()


@pytest.mark.slow
def test_an_object_that_is_turned_about_the_vertical_is_grasped_from_the_same_side_of_its_own():
    box = f"object: !Box {{size: [0.05, 0.08, 0.24], mass: 0.3}}, {COARSE}"
    still = "linear_velocity: 0, angular_velocity: 0"
    turn, starts, sides = 1.1, [], []
    for yaw in (0.0, turn):
        scenario = scenario_of(box, "side", f"{still}, yaw: {yaw}")
        starts.append(scenario.start)
        sides.append(RotationMatrix.MakeZRotation(-yaw) @ scenario.hand.X_LA.rotation())
    np.testing.assert_allclose(sides[1].matrix(), sides[0].matrix(), atol=1e-9)
    np.testing.assert_allclose(starts[1].p_OC, starts[0].p_OC, atol=1e-9)
    assert starts[1].yaw == pytest.approx(starts[0].yaw)


@pytest.mark.parametrize(("kind", "link"), [*((kind, "") for kind in MODELS), ("sdf", "palm")])
def test_the_model_of_a_carrier_stands_where_its_base_does(kind, link, tmp_path):
    file = tmp_path / f"own.{kind}"
    file.write_text(MODELS[kind])
    X_WB = RigidTransform(RollPitchYaw(0.4, 1.2, -0.7), [0.3, -0.2, 0.5])
    poses = []
    for pose in (FROM_ABOVE, X_WB):
        plant = MultibodyPlant(0.01)
        dp.add_hand_model(
            plant, HandDescription(str(file), Carrier(mount=Mount(link=link))), X_WB=pose
        )
        plant.Finalize()
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, np.full(plant.num_positions(), 0.3))
        poses.append(plant.GetFrameByName("palm").CalcPoseInWorld(context))
    upright, turned = poses
    expected = X_WB @ upright
    np.testing.assert_allclose(turned.GetAsMatrix4(), expected.GetAsMatrix4(), atol=1e-9)
    assert np.linalg.norm(upright.translation()) > 0.1
