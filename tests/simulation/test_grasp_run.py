"""A hand in the complete diagram: it follows, closes, lifts and holds, or gives up and says why."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from conftest import slow
from pydrake.systems.analysis import Simulator
from simulation_runs import check_gaps, points, run_log, run_text

from drake_pregrasp import (
    HalfSpace,
    ScenarioError,
    load_resolved,
    load_scenario,
    make_diagram,
    resolve,
    run,
)
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.estimation.pose_track import FOLLOWED, TrackingStatus
from drake_pregrasp.grasping.grasp_state import GraspPhase
from drake_pregrasp.grasping.held_criterion import HOLD_DURATION
from drake_pregrasp.simulation.summary import inactive_contacts

HAND = "package://drake_pregrasp/five_finger_hand.yaml"
NAME = "grasp_five_finger"
QUIET = "sensor: {position_std: 0.0, orientation_std: 0.0}"
FAST = f"motion: {{linear_velocity: 0.05, angular_velocity: 0.5236}}, {QUIET}"


@pytest.fixture(scope="module")
def noisy_run(tmp_path_factory):
    return run_text(NAME, "", tmp_path_factory.mktemp("noisy"))


@pytest.mark.slow
def test_fingertips_follow_and_take_a_fast_object_and_nothing_is_printed(tmp_path, capfd):
    check_grasp(run_text(NAME, FAST, tmp_path), 0.1)
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_they_do_so_by_noisy_poses(noisy_run):
    check_grasp(noisy_run, 0.3)


def check_grasp(result, largest_error):
    grasp = result.summary["grasp"]
    assert (grasp["phase"], grasp["gave_up"]) == ("hold", None)
    assert grasp["tracking_error_mean_mm"] < largest_error
    assert grasp["moved_closing_mm"] < 0.1
    assert 98 < grasp["lift_height_mm"] < 101
    assert max(grasp["moved_lift_mm"], grasp["moved_hold_mm"]) < 1
    assert 2.0 < min(grasp["tip_forces"]) < max(grasp["tip_forces"]) < 10.0
    check_gaps(result, 0.1, 0.009, 5)
    assert set(grasp["link_forces"].values()) == {0.0}
    log = run_log(result, "grasp.csv")
    tips = np.stack([points(log, f"tip{finger}") for finger in range(5)], axis=1)
    accelerations = np.diff(tips, n=2, axis=0) / GraspConfig.period**2
    # Shares of fingertips relative to their goals, and of the goals, which go with the palm. Drives
    # overshoot a little as the hand starts from rest, over an object that moves.
    most = 1.05 * (0.75 + 0.6) * GraspConfig.tip_acceleration
    assert np.max(np.linalg.norm(accelerations, axis=2)) < most


@pytest.mark.slow
def test_a_hand_from_the_side_lifts_along_a_direction_without_touching_anything_else(tmp_path):
    text = "grasp: {approaches: [side], lift_direction: [0.3, -0.2, 1.0]}"
    result = run_text("grasp_from_side", text, tmp_path)
    grasp, log = result.summary["grasp"], run_log(result, "grasp.csv")
    assert (grasp["phase"], grasp["gave_up"]) == ("hold", None)
    assert set(grasp["link_forces"].values()) == {0.0}
    assert grasp["moved_closing_mm"] < 1
    assert grasp["moved_squeeze_mm"] < 6
    lifting, places = log["phase"] >= GraspPhase.LIFT, points(log, "wo")
    moved = places[-1] - places[lifting][0]
    expected = 0.1 * np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
    np.testing.assert_allclose(moved, expected, atol=0.01)
    assert grasp["lift_height_mm"] == pytest.approx(1e3 * moved @ expected / 0.1, abs=0.1)
    assert abs(grasp["palm_from"][2]) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(("start", "change"), [(3.0, -0.3), (5.25, 0.3)])
def test_a_belt_that_accelerates_neither_shoves_nor_slides_the_object(start, change, tmp_path):
    profile = [[0, 0, 0], [start, 0, 0], [start + 0.2, change, 0]]  # 1.5 m/s^2.
    text = f"motion: {{profile: {profile}}}, simulation_duration: 7.5"
    result = run_text(NAME, text, tmp_path)
    grasp, log = result.summary["grasp"], run_log(result)
    assert grasp["phase"] == "hold"
    assert grasp["moved_closing_mm"] < 3
    # The hand follows the belt with a delay. How far it is off depends on the moment.
    assert grasp["moved_squeeze_mm"] < 6
    phases = run_log(result, "grasp.csv")
    lift = phases["time"][phases["phase"] == GraspPhase.LIFT][0]
    # Two further measurements confirm the first one, and those of a sudden motion are held back.
    status = log["tracking_status"][3:]
    assert np.sum(status != TrackingStatus.TRACKING) <= 4
    assert np.all(np.isin(status, FOLLOWED))
    assert np.max(log["position_error"][log["time"] >= lift]) < 2e-3


@pytest.mark.slow
def test_an_object_and_a_hand_are_all_that_a_scenario_needs(tmp_path):
    (tmp_path / "mine.yaml").write_text(f"mine: {{object: !Cylinder {{}}, hand: {{file: {HAND}}}}}")
    scenario = load_scenario(file=tmp_path / "mine.yaml", text="{simulation_duration: 9.5}")
    result = run(scenario, name="mine", out=tmp_path, recording=False)
    grasp = result.summary["grasp"]
    assert (grasp["phase"], grasp["lift_height_mm"]) == ("hold", pytest.approx(100, abs=2))
    assert grasp["moved_before_mm"] < 1.0


@pytest.mark.slow
def test_a_cube_is_held_for_ten_seconds_and_through_a_shake(tmp_path):
    shaken = "simulation_duration: 21.5, grasp: {shake: true}"
    result = run_text(NAME, shaken, tmp_path)
    grasp, log = result.summary["grasp"], run_log(result, "grasp.csv")
    assert (grasp["held"], grasp["phase"], grasp["gave_up"]) == (True, "hold", None)
    assert grasp["moved_hold_mm"] < 2
    assert 0.2 < grasp["moved_shake_mm"] < 2
    assert 60 * 5 / grasp["drift_mm_per_min"] == pytest.approx(grasp["slips_after_s"])
    # Fingertips press against the shake with half the weight, along one axis after the other.
    pressed = sum(points(log, f"force{i}") for i in range(5))
    since_lift = log["time"] - log["time"][log["phase"] == GraspPhase.HOLD][0]
    for axis in range(3):
        during = (since_lift > HOLD_DURATION + axis) & (since_lift < HOLD_DURATION + axis + 1)
        assert np.ptp(pressed[during, axis]) == pytest.approx(0.4 * 9.81, rel=0.2)


@pytest.mark.slow
def test_a_hand_that_waits_says_when_it_has_met_the_object(tmp_path):
    waits = "wait_at: [0.02, 0.0, 0.06], earliest: 0.6"
    text = f"grasp: {{close_at: 100.0, meeting: {{{waits}}}}}, simulation_duration: 2.0"
    grasp = run_text(NAME, f"motion: {{}}, {text}", tmp_path).summary["grasp"]
    assert 0.6 < grasp["met_at"] < 2.0


@pytest.mark.slow
def test_a_context_can_be_cloned_in_the_middle_of_a_run():
    scenario = load_scenario(NAME)
    diagram = make_diagram(scenario)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.5)
    other = Simulator(diagram, simulator.get_context().Clone())
    controller = diagram.GetSubsystemByName("hand_controller")
    tips = []
    for one in (simulator, other):
        one.AdvanceTo(1.0)
        context = controller.GetMyContextFromRoot(one.get_context())
        tips.append(controller.GetOutputPort("p_WT").Eval(context))
    np.testing.assert_array_equal(*tips)


@pytest.mark.slow
def test_the_log_shows_all_phases_in_their_order(noisy_run):
    log = run_log(noisy_run, "grasp.csv")
    names = [GraspPhase(phase).name for phase in dict.fromkeys(log["phase"])]
    assert names == ["APPROACH", "TRACK", "CLOSE", "SQUEEZE", "LIFT", "HOLD"]
    held = sum(points(log, f"force{i}") for i in range(5))[log["phase"] == GraspPhase.HOLD]
    # They carry the object's weight together, and push it nowhere. Torques tell it to some 5 %,
    # for tips touch beside their centres.
    np.testing.assert_allclose(np.mean(held, axis=0), [0, 0, 0.4 * 9.81], atol=0.3)


@pytest.mark.slow
def test_the_same_scenario_gives_the_same_log(noisy_run, tmp_path):
    scenario = load_scenario(file=noisy_run.folder / "scenario.yaml")
    again = run(scenario, name="again", out=tmp_path, recording=False)
    for file in ("log.csv", "grasp.csv"):
        assert (again.folder / file).read_bytes() == (noisy_run.folder / file).read_bytes()


@pytest.mark.slow
def test_a_hand_that_cannot_grasp_opens_and_says_why(tmp_path):
    lost = "damage: [{at: 3.0, contacts: [1, 3, 4]}], simulation_duration: 8.0"
    result = run_text(NAME, lost, tmp_path)
    written = json.loads((result.folder / "summary.json").read_text())
    assert written["grasp"]["gave_up"] == "only 2 active fingers"
    assert written["grasp"]["phase"] == "back_off"
    assert written["grasp"]["moved_lift_mm"] is None


@pytest.mark.slow
def test_a_hand_gives_up_on_a_slippery_object_and_does_not_lift_it(tmp_path):
    soft = "grasp: {touch_force: 0.05, least_force: 0.1, planned_friction: 0.7, friction: 0.1}"
    grasp = run_text(NAME, soft, tmp_path).summary["grasp"]
    # It slips away when the fingers touch it, press it, or lift it.
    assert any(why in grasp["gave_up"] for why in ("did not arrive", "met nothing", "lost touch"))
    assert grasp["phase"] == "back_off"
    assert (grasp["lift_height_mm"] or 0.0) < 5


@pytest.mark.slow
def test_an_obstacle_over_the_table_keeps_its_distance_from_fingertips(tmp_path):
    obstacle = "obstacles: [!BallObstacle {radius: 0.03, center: [0.12, 0.0, 0.05]}]"
    still = "motion: {linear_velocity: 0.0, angular_velocity: 0.3}, simulation_duration: 4.0"
    log = run_log(run_text(NAME, f"{obstacle}, {still}", tmp_path), "grasp.csv")
    for finger in range(5):
        distances = np.linalg.norm(points(log, f"tip{finger}") - [0.12, 0.0, 0.05], axis=1)
        assert np.min(distances) > 0.03 + 0.009


@pytest.mark.slow
@pytest.mark.parametrize("own", ["[]", "[!BallObstacle {radius: 0.03, center: [0.3, 0.0, 0.05]}]"])
def test_the_table_is_the_last_obstacle_of_the_planner_and_none_of_the_controller(own):
    scenario = load_scenario(NAME, text=f"{{obstacles: {own}}}")
    diagram = make_diagram(scenario)
    root = diagram.CreateDefaultContext()
    given = []
    for name in ("pregrasp_planner", "hand_controller"):
        system = diagram.GetSubsystemByName(name)
        port, context = system.GetInputPort("obstacles"), system.GetMyContextFromRoot(root)
        given.append(port.Eval(context).solids if port.HasValue(context) else ())
    (*solids, table), applied = given
    count = len(scenario.obstacles)
    assert len(solids) == len(applied) == count
    assert isinstance(table, HalfSpace)
    assert resolve(scenario).obstacle_names == {count: "the table"}
    assert load_resolved("a_base").obstacle_names == {}


def test_the_closing_words_call_the_table_by_its_name():
    status = np.array([ContactStatus.OBSTRUCTED, ContactStatus.OBSTRUCTED, ContactStatus.ACTIVE])
    record = SimpleNamespace(contact_status=status, contact_causes=np.array([1.0, 0.0, -1.0]))
    resolved = load_resolved(NAME, text="{obstacles: [!BallObstacle {radius: 0.01, body: false}]}")
    assert inactive_contacts(resolved, SimpleNamespace(last=record)) == {
        "0": "obstructed by the table",
        "1": "obstructed by obstacle 0",
    }


BAD = yaml.safe_load((Path(__file__).parent / "bad_grasps.yaml").read_text())
FREE = "{initial_contacts: [], object:"
"""Start of the texts whose contacts are searched, which takes long."""


@pytest.mark.parametrize(
    ("text", "message"),
    [slow(*case) if case[0].startswith(FREE) else case for case in BAD],
    ids=[case[0] for case in BAD],
)
def test_what_a_hand_cannot_do_is_refused_in_one_line(text, message):
    with pytest.raises(ScenarioError, match=message) as error:
        load_resolved(NAME, text=text)
    assert "\n" not in str(error.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    "fine",
    [
        "simulation_duration: 5.0, motion: {linear_velocity: 0.3, angular_velocity: 1.57}",
        "motion: {linear_velocity: 0.3, angular_velocity: 0.0}, grasp: {close_at: 3.75}",
        "motion: {linear_velocity: 0.0, angular_velocity: 4.0}",
        "motion: {linear_velocity: 0.0, angular_velocity: 6.28}, grasp: {wrist_range: [-1, 1]}",
        "initial_contacts: [], object: !Cylinder {mass: 1.4}",
    ],
)
def test_an_object_that_a_hand_can_follow_until_it_is_gripped_and_lift_is_accepted(fine):
    assert load_resolved(NAME, text=f"{{{fine}}}").hand is not None
