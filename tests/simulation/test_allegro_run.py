"""An Allegro hand on a Panda arm in the complete diagram."""

import numpy as np
import pytest
from hand_files import write_hand
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import EventStatus
from simulation_runs import check_gaps, run_text

from drake_pregrasp import (
    HandModel,
    InvalidArgumentError,
    ScenarioError,
    load_hand,
    load_resolved,
    load_scenario,
    make_diagram,
)
from drake_pregrasp.cli import main
from drake_pregrasp.resources import resource_folder
from drake_pregrasp.robots import robot_data
from drake_pregrasp.systems.palm_frames import pose_error

pytestmark = pytest.mark.slow
NAME = "grasp_allegro_panda"
FILE = "package://drake_pregrasp/allegro_panda.yaml"
FAST = """motion: {linear_velocity: 0.05, angular_velocity: 0.2618},
  grasp: {close_at: 2.5, gate_limit: 0.2}, simulation_duration: 6.5, %s"""
QUIET = "sensor: {position_std: 0.0, orientation_std: 0.0}"


@pytest.fixture(scope="module")
def hand(allegro_panda):
    return load_resolved(NAME).hand


@pytest.fixture(scope="module")
def fast_run(allegro_panda, tmp_path_factory):
    return run_text(NAME, FAST % QUIET, tmp_path_factory.mktemp("allegro"))


def test_it_follows_lifts_and_holds(fast_run):
    grasp = fast_run.summary["grasp"]
    assert (grasp["phase"], grasp["gave_up"], grasp["met_at"]) == ("hold", None, None)
    assert grasp["tracking_error_mean_mm"] < 0.2
    assert 97 < grasp["lift_height_mm"] < 101
    assert max(grasp["moved_lift_mm"], grasp["moved_hold_mm"]) < 1.5  # Drives yield to the weight.
    assert grasp["moved_closing_mm"] < 0.5
    assert 1.0 < min(grasp["tip_forces"]) < max(grasp["tip_forces"]) < 8.0
    check_gaps(fast_run, 0.065, 0.012, 4)


def test_no_swing_of_the_arm_shakes_the_object_in_the_squeeze(allegro_panda, tmp_path):
    grasp = run_text(NAME, "random_seed: 3, simulation_duration: 7.0", tmp_path).summary["grasp"]
    assert grasp["moved_squeeze_mm"] < 0.8
    assert grasp["moved_lift_mm"] < 1.5


def test_two_fingers_and_the_thumb_lift_when_the_third_is_lost(allegro_panda, tmp_path):
    lost = f"damage: [{{at: 2.0, contacts: [0]}}], {QUIET}, simulation_duration: 8.0"
    grasp = run_text(NAME, lost, tmp_path).summary["grasp"]
    assert (grasp["phase"], grasp["gave_up"]) == ("hold", None)
    assert grasp["lift_height_mm"] > 97
    assert grasp["tip_forces"][0] < 0.1 < 1.0 < min(grasp["tip_forces"][1:])


def test_the_arm_holds_the_palm_and_the_hand_is_far_from_its_largest_torques(hand):
    scenario = load_scenario(NAME, text=f"{{{FAST % 'sensor: {}'}}}")
    diagram = make_diagram(scenario)
    station = diagram.GetSubsystemByName("object_plant")
    controller = diagram.GetSubsystemByName("hand_controller")
    plant = hand.kinematics.plant
    own = plant.CreateDefaultContext()
    torques, heights = [], []

    def monitor(context):
        station_context = station.GetMyContextFromRoot(context)
        torques.append(np.array(station.GetOutputPort("net_actuation").Eval(station_context)))
        plant.SetPositions(own, station.GetOutputPort("hand_state").Eval(station_context)[:23])
        X_WG = controller.GetOutputPort("X_WG").Eval(controller.GetMyContextFromRoot(context))
        p_WP = hand.base.palm_pose(own).translation()
        heights.append((context.get_time(), p_WP[2] - X_WG.translation()[2]))
        return EventStatus.DidNothing()

    simulator = Simulator(diagram)
    simulator.set_monitor(monitor)
    simulator.AdvanceTo(5.8)  # Most of the lift is done.
    context = station.GetMyContextFromRoot(simulator.get_context())
    assert station.GetOutputPort("X_WO").Eval(context).translation()[2] > 0.1
    assert np.max(np.abs(np.array(torques)[:, 7:])) < 0.75 * 0.9
    assert np.all(np.max(np.abs(torques), axis=0)[:7] < [87, 87, 87, 87, 12, 12, 12])
    after = np.array([height for time, height in heights if time > 1.6])
    np.testing.assert_allclose(after, hand.base.X_AP.translation()[2], atol=2e-3)


@pytest.mark.parametrize("yaw", [1.0, np.pi / 2, -2.0])
def test_an_arm_that_is_turned_with_the_cube_takes_it_alike(allegro_panda, yaw):
    text = f"initial_contacts: [], hand: {{file: {FILE}, rpy: [0, 0, %g]}}, motion: {{yaw: %g}}"
    before, turned = (load_resolved(NAME, text=f"{{{text % (a, a)}}}") for a in (0.0, yaw))
    np.testing.assert_allclose(turned.start.p_OC, before.start.p_OC, atol=1e-12)
    assert turned.start.yaw == pytest.approx(before.start.yaw + yaw, abs=1e-5)
    assert turned.hand.home_yaw == pytest.approx(before.hand.home_yaw + yaw, abs=1e-5)


@pytest.mark.parametrize("yaw", [-1.0, 0.0, 1.2])
@pytest.mark.parametrize("p_WO", [[0.0, 0.0, 0.0325], [0.2, 0.0, 0.0325], [0.1, 0.1, 0.15]])
def test_the_arm_brings_the_palm_and_the_tips_over_the_object(hand, p_WO, yaw):
    q = hand.home(np.array(p_WO), yaw)
    kinematics = hand.kinematics
    assert np.all((kinematics.lower <= q) & (q <= kinematics.upper))
    p_WT = hand.tips_at(q)
    azimuths = np.arctan2(*(p_WT - p_WO)[:, [1, 0]].T)
    turned = (azimuths - hand.azimuths - yaw + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(turned, 0, atol=1e-3)
    np.testing.assert_allclose(p_WT[:, 2], p_WO[2] + 0.0325 - 0.023, atol=0.006)  # Below the top.


def test_steps_of_an_arm_converge_quadratically(hand):
    base, plant = hand.base, hand.kinematics.plant
    context = plant.CreateDefaultContext()
    q = home = hand.home(np.array([0.1, 0.0, 0.05]), 0.3)
    plant.SetPositions(context, q)
    X_WP = base.palm_pose(context)
    q = q.copy()
    q[base.joints] += 0.02 * np.cos(np.arange(7))
    errors = []
    for _ in range(3):
        plant.SetPositions(context, q)
        errors.append(np.linalg.norm(pose_error(base.palm_pose(context), X_WP)))
        q = base.step_to(context, q, X_WP, home)
    assert errors[1] < 2 * errors[0] ** 2
    assert errors[2] < 0.1 * errors[1]


def test_where_the_arm_does_not_reach_is_said_before_it_moves(hand):
    with pytest.raises(InvalidArgumentError, match=r"cannot hold the palm at \(0.9\d+, ") as error:
        hand.home(np.array([1.0, 0.0, 0.0]), 0.0)
    assert "\n" not in str(error.value)
    with pytest.raises(ScenarioError, match=r"motion: at \S+ s the object is out of the arm's re"):
        load_resolved(NAME, text="{motion: {linear_velocity: 0.2}}")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("link_3.0_tip", "tip", r"there is no frame tip; there are: panda_link0, [^_]*(?!_parent)"),
        ("palm: palm_link", "palm: hand", r"base.palm: there is no frame hand; there are: panda_"),
        ("panda_joint7]", "panda_joint8]", r"base.joints: panda_joint8 is weld; it must"),
        ("home: [0.0, -0.3,", "home: [9.0, -0.3,", r"base.home: 9 of panda_joint1 must be from"),
        (
            "home: [0.0, -0.3,",
            "home: [-0.3,",
            r"base.home: 6 positions must be 7, one for each of its",
        ),
    ],
)
def test_an_arm_that_is_not_as_described_is_refused(allegro_panda, tmp_path, old, new, message):
    text = (resource_folder("models") / "allegro_panda.yaml").read_text()
    path = write_hand(tmp_path, old, new, text=text)
    with pytest.raises(InvalidArgumentError, match=message) as error:
        HandModel(load_hand(path))
    assert "_parent" not in str(error.value)
    assert "\n" not in str(error.value)


def outcome(size, folder, more=QUIET):
    box = f"object: !Box {{size: {list(size)}, mass: 0.25}}, {more}"
    return run_text(NAME, box, folder).summary["grasp"]


@pytest.mark.parametrize(
    "size",
    [
        [0.0691, 0.0581, 0.0512],  # Too narrow for three fingers side by side.
        [0.05, 0.05, 0.05],
        [0.08, 0.08, 0.08],
    ],
)
def test_boxes_of_all_sizes_within_the_opening_are_held(allegro_panda, tmp_path, size):
    shaken = f"{QUIET}, grasp: {{shake: true}}, simulation_duration: 21.0"
    grasp = outcome(size, tmp_path, shaken)
    assert grasp["held"]
    assert grasp["lift_height_mm"] > 95
    assert grasp["moved_closing_mm"] < 1.0
    assert grasp["turned_shake_deg"] < 1.1  # Without forces against it, up to 1.5°.
    assert max(grasp["tip_forces"]) < 12.0


def test_a_finger_whose_place_gets_free_comes_back_and_takes_part(allegro_panda, tmp_path):
    passing = "!BallObstacle {center: [0.075, 0, 0.05], radius: 0.02, velocity: [0.035, 0, 0]}"
    grasp = outcome([0.065, 0.08, 0.065], tmp_path, f"obstacles: [{passing}], {QUIET}")
    assert (grasp["phase"], grasp["gave_up"]) == ("hold", None)
    assert min(grasp["tip_forces"]) > 1.0


def test_the_palm_starts_at_the_yaw_to_which_it_turns(allegro_panda):
    """A finger that stays away must not turn it later: contacts could then leave the reach."""
    text = """{hand: !HandFile {file: "package://drake_pregrasp/allegro_hand.yaml"},
      object: !Box {size: [0.04, 0.03, 0.04], mass: 0.1}, motion: {angular_velocity: 0.0},
      surface: {spacing: 0.004, forbidden_faces: ["+z", "-z"]}, planner: {static_duration: 5.0},
      initial_contacts: []}"""
    resolved = load_resolved("grasp_five_finger", text=text)
    assert not resolved.start.has_contact.all()
    diagram = make_diagram(resolved)
    simulator, controller = Simulator(diagram), diagram.GetSubsystemByName("hand_controller")
    context, X_WU = simulator.get_context(), controller.GetOutputPort("X_WU")
    for time in (0.0, 1.0, 2.0):
        simulator.AdvanceTo(time)
        x, y = X_WU.Eval(controller.GetMyContextFromRoot(context)).rotation().matrix()[:2, 0]
        assert np.arctan2(y, x) == pytest.approx(resolved.start.yaw, abs=0.02)


def test_a_box_that_is_too_long_for_the_opening_is_refused(allegro_panda):
    with pytest.raises(ScenarioError, match=r"contacts: only 1 fingers reach .* place for link_3"):
        load_resolved(NAME, text="{object: !Box {size: [0.12, 0.065, 0.065], mass: 0.25}}")


def test_without_the_extra_a_line_says_what_to_install(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(robot_data, "PACKAGE", "example-robot-data-that-is-not-there")
    assert main(["run", NAME]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "hand.file" in line
    assert "pip install 'drake_pregrasp[robots]'" in line
    assert not (tmp_path / "runs").exists()


def test_an_arm_brings_the_hand_from_the_side(allegro_panda, tmp_path):
    tall = "object: !Cylinder {radius: 0.03, length: 0.2, mass: 0.25}, surface: {spacing: 0.012}"
    slow = "motion: {linear_velocity: 0.01, angular_velocity: 0.05}, simulation_duration: 6.5"
    text = f"initial_contacts: [], {tall}, {slow}, grasp: {{approaches: [side], close_at: 3.0}}"
    grasp = run_text(NAME, text, tmp_path).summary["grasp"]
    assert (grasp["phase"], grasp["gave_up"]) == ("hold", None)
    assert grasp["palm_from"][2] == pytest.approx(0, abs=1e-9)
    assert max(grasp["moved_closing_mm"], grasp["moved_squeeze_mm"]) < 4
    assert set(grasp["link_forces"].values()) == {0.0}
