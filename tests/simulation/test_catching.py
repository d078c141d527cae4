"""Hands hold what they meet on a belt, on a table, or in a person's hand."""

import numpy as np
import pytest
from simulation_runs import points, run_log, run_text

from drake_pregrasp import load_scenario
from drake_pregrasp.grasping.grasp_state import GraspPhase

pytestmark = pytest.mark.slow


def held_run(name, until, folder):
    """Returns summary and log of a run with a shake, whose object must be held to the end."""
    result = run_text(name, f"simulation_duration: {until}, grasp: {{shake: true}}", folder)
    grasp = result.summary["grasp"]
    assert grasp["held"] is True
    assert grasp["link_forces"]["object"] == 0.0
    return grasp, run_log(result, "grasp.csv")


def test_a_hand_that_loses_two_fingers_on_its_way_holds_with_three(tmp_path):
    grasp, _ = held_run("catch_lost_fingers", 19.0, tmp_path)
    (event,) = load_scenario("catch_lost_fingers").damage
    assert event.at < grasp["met_at"] - 0.5
    pressing = np.flatnonzero(np.array(grasp["tip_forces"]) > 1.0)
    np.testing.assert_array_equal(pressing, np.setdiff1d(range(5), event.contacts))


def test_a_hand_holds_a_cube_on_a_belt_that_stops_while_it_is_on_its_way(tmp_path):
    grasp, log = held_run("catch_belt_stops", 20.0, tmp_path)
    (began, _, _), (stopped, _, _) = load_scenario("catch_belt_stops").motion.profile[-2:]
    fast, stands = np.searchsorted(log["time"], [began, stopped])
    assert log["phase"][fast] == GraspPhase.APPROACH
    # The meeting that was planned for the moving cube is given up for a later one.
    assert log["meeting_time"][fast] < grasp["met_at"] - 0.1
    still = points(log, "wo")[stands : np.argmax(log["phase"] == GraspPhase.LIFT)]
    assert np.max(np.ptp(still, axis=0)) < 1e-3


def test_a_hand_turns_with_a_cube_that_begins_to_turn_on_a_belt(tmp_path):
    _, log = held_run("catch_belt_turns", 19.0, tmp_path)
    before, closed = np.argmax(log["time"] > 0.8), np.argmax(log["phase"] == GraspPhase.SQUEEZE)
    yaw = 2 * np.arctan2(log["qz_wo"], log["qw_wo"])
    assert yaw[closed] - yaw[before] > 0.5


def test_an_arm_beside_a_belt_goes_along_with_a_cube(allegro_panda, tmp_path):
    _, log = held_run("catch_with_panda", 20.0, tmp_path)
    lifted = log["phase"] == GraspPhase.LIFT
    first = points(log, "wo")[np.argmax(lifted)]
    assert first[0] - points(log, "wo")[0, 0] > 0.5  # The cube went past the arm meanwhile.


def test_a_hand_goes_with_a_rolling_cylinder_and_takes_it_once_it_rests(tmp_path):
    _, log = held_run("catch_rolling", 23.0, tmp_path)
    p_WO, tracked = points(log, "wo"), log["phase"] == GraspPhase.TRACK
    start = points(log, "wo")[0]
    first, last = p_WO[tracked][0], p_WO[tracked][-1]
    assert first[0] - start[0] > 0.2
    assert last[0] - first[0] > 0.1
    # It rolls without slip: a quarter of a turn from the start on takes a quarter of the girth.
    quarter = np.argmax(p_WO[:, 0] - start[0] > 0.035 * np.pi / 2)
    R_zz = 1 - 2 * (log["qx_wo"] ** 2 + log["qy_wo"] ** 2)
    assert abs(R_zz[quarter]) < 0.1
    np.testing.assert_allclose(p_WO[log["phase"] < GraspPhase.LIFT, 2], 0.035, atol=1e-3)


def test_a_hand_takes_a_box_from_a_person_who_then_lets_go(tmp_path):
    _, log = held_run("catch_handed_over", 20.0, tmp_path)
    poses = load_scenario("catch_handed_over").motion.read()
    recorded = np.array([poses.at(time)[0] for time in log["time"]])
    away = np.linalg.norm(points(log, "wo") - recorded, axis=1)
    assert np.max(away[log["phase"] < GraspPhase.LIFT]) < 4e-3
    assert np.min(away[log["phase"] == GraspPhase.HOLD]) > 0.09
