"""A hand catches what is tossed to it, if its certificate says so."""

import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from simulation_runs import points, run_log, run_text

from drake_pregrasp import load_resolved
from drake_pregrasp.grasping.catch_limits import CatchLimit
from drake_pregrasp.grasping.grasp_state import GraspPhase
from drake_pregrasp.grasping.held_criterion import LARGEST_DEG, LARGEST_MM

pytestmark = pytest.mark.slow


def caught(name, folder):
    """Returns the log of a run of 1.4 s, whose object must be caught, and held while it stops."""
    result = run_text(name, "simulation_duration: 1.4", folder)
    grasp = result.summary["grasp"]
    assert (grasp["phase"], grasp["gave_up"]) == ("lift", None)
    assert grasp["link_forces"]["object"] == 0.0
    parts = "closing", "squeeze", "lift"
    assert max(grasp[f"moved_{part}_mm"] for part in parts) < LARGEST_MM / 2
    assert max(grasp[f"turned_{part}_deg"] for part in parts) < LARGEST_DEG / 2
    return run_log(result, "grasp.csv")


def test_a_tossed_ball_is_caught_and_comes_to_rest_within_the_travel(tmp_path):
    log = caught("catch_toss", tmp_path)
    phase, time, p_WO = log["phase"], log["time"], points(log, "wo")
    assert np.sum(phase == GraspPhase.CLOSE) * 0.002 == pytest.approx(0.1, abs=0.03)
    # Until the touch it falls freely; then it stops along its velocity, within v²/2a = v T/2.
    touched = np.argmax(phase == GraspPhase.SQUEEZE) - 5
    fallen = 0.4 + 4.005 * time[touched] - 9.81 / 2 * time[touched] ** 2
    flown = [1.786 * time[touched] - 1.0, fallen]
    np.testing.assert_allclose(p_WO[touched, [0, 2]], flown, atol=2e-3)
    gripped = np.argmax(phase == GraspPhase.LIFT)
    v = (p_WO[gripped] - p_WO[gripped - 5]) / (time[gripped] - time[gripped - 5])
    stopped = np.argmin(np.abs(time - time[gripped] - 0.2))
    assert np.linalg.norm(v) > 2.5
    np.testing.assert_allclose(p_WO[stopped] - p_WO[gripped], 0.1 * v, atol=0.03)
    still = np.linalg.norm(np.diff(p_WO[stopped + 25 :], axis=0), axis=1) / 0.002
    assert np.max(still) < 0.2  # The lift moves it by at most 0.15 m/s.


@pytest.mark.parametrize("thing", ["box", "bottle"])
def test_a_tossed_thing_is_caught_and_brought_to_rest(thing, tmp_path):
    p_WO = points(caught(f"catch_toss_{thing}", tmp_path), "wo")
    last = np.linalg.norm(np.diff(p_WO[-100:], axis=0), axis=1) / 0.002
    assert np.max(last) < 0.2  # The lift moves it by at most 0.15 m/s.


@pytest.mark.parametrize("yaw", [0.5, 2.0])
def test_a_turned_cube_passes_between_the_fingertips(yaw):
    motion = f"!Toss {{position: [-1, 0, 0.4], velocity: [1.786, 0, 4.005], rpy: [0, 0, {yaw}]}}"
    cube = "!Box {size: [0.06, 0.06, 0.06], mass: 0.2}"
    resolved = load_resolved("catch_toss", text=f"{{object: {cube}, motion: {motion}}}")
    has, radius = resolved.start.has_contact, resolved.hand.tip_radii[0]
    standoff = resolved.scenario.grasp.standoff
    p_OC, nhat = resolved.surface.project(resolved.start.p_OC[has])
    R_OW = RollPitchYaw(0, 0, yaw).ToRotationMatrix().matrix().T
    to_palm = R_OW @ resolved.hand.X_LA.rotation().matrix()[:, 2]
    assert np.sum(has) >= 3
    for ahead in np.linspace(0.0, 0.1, 21):
        beside = p_OC + (radius + standoff) * nhat + ahead * to_palm
        assert np.min(resolved.shape.solid.distance(beside)) >= radius


def test_what_the_certificate_refuses_the_hand_does_not_try(tmp_path):
    text = "motion: !Toss {position: [-1.0, 0.0, 0.4], velocity: [3.2, 0.0, 3.0]}"
    result = run_text("catch_toss", f"{text}, simulation_duration: 0.5", tmp_path)
    grasp, log = result.summary["grasp"], run_log(result, "grasp.csv")
    assert grasp["cannot_meet"] == "the palm is too slow"
    assert np.all(log["phase"] == GraspPhase.APPROACH)
    assert CatchLimit.NONE not in log["catch_limit"]
    assert np.max(np.ptp(points(log, "wg"), axis=0)) < 0.02  # The frame that goes with the palm.
    assert set(grasp["link_forces"].values()) == {0.0}
