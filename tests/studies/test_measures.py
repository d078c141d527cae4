"""Measures of runs: faults, validity of contacts, and goals that are reached late."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from pydrake.math import RigidTransform, RotationMatrix

from drake_pregrasp import TrackingStatus, load_scenario, resolve
from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.studies.measures import MEASURE_GROUPS, SimulatedRun, goal_errors, measure
from drake_pregrasp.studies.study_file import load_study
from drake_pregrasp.studies.study_run import StudyRun
from drake_pregrasp.systems.loggers import TickRecord

SCENARIO = load_scenario("fault_outliers")
RESOLVED = resolve(SCENARIO)
P_OC = RESOLVED.start.p_OC


def records(offset=lambda time: 0.0, turn=lambda time: 0.0, off_surface=lambda time: 0.0):
    """Ticks of a cube that stands still, with errors of our own making."""
    made = []
    for k in range(401):
        time = 0.05 * k
        X_WO = RigidTransform([0.1, 0.2, 0.3])
        p_WE = X_WO.translation() + np.array([offset(time), 0, 0])
        X_WE = RigidTransform(RotationMatrix.MakeZRotation(turn(time)), p_WE)
        p_WC = np.array((X_WE @ P_OC.T).T) + np.array([0, off_surface(time), 0])
        status = TrackingStatus.LOST if 8 < time < 9.01 else TrackingStatus.TRACKING
        active = np.full(5, float(ContactStatus.ACTIVE))
        made.append(TickRecord(time, p_WC, active, None, None, None, X_WO, X_WE, 0.0, status, 0.0))
    return made


NAMES = ("valid_share", *MEASURE_GROUPS[3].labels)


def found(**errors):
    values = measure(SimulatedRun(RESOLVED, records(**errors), None), NAMES)
    return SimpleNamespace(**{name.removeprefix("fault_"): v for name, v in values.items()})


def test_a_perfect_run_is_valid_and_has_nothing_to_recover_from():
    run = found()
    assert (run.valid_share, run.recovery) == (1, 0)
    assert run.position_error == pytest.approx(0, abs=1e-9)
    assert run.lost_share == pytest.approx(20 / 120, abs=1e-9)
    assert run.tracked_share == pytest.approx(100 / 120, abs=1e-9)


def test_errors_count_while_the_fault_acts_and_recovery_after_it():
    run = found(offset=lambda t: 0.05 * (7 < t < 12.71), turn=lambda t: 0.3 * (6 < t < 7))
    assert run.position_error == pytest.approx(50)
    assert run.orientation_error == pytest.approx(np.degrees(0.3))
    assert run.recovery == pytest.approx(0.75)
    assert found(offset=lambda t: 0.05 * (t < 5)).position_error < 1e-9
    assert found(turn=lambda t: 0.1 * (t > 12)).recovery == math.inf
    # Small errors are no reason to call it unrecovered.
    assert found(offset=lambda t: 3.9 * SCENARIO.sensor.position_std).recovery == 0


def test_a_fault_acts_at_the_ticks_at_which_the_sensor_has_it():
    """It starts and ends between ticks."""
    scenario, ticks = SCENARIO, records(offset=lambda t: 0.05 * (t > 12.001))
    faults = replace(scenario.sensor.faults, start=6.02, end=12.02)
    sensor = replace(scenario.sensor, faults=faults)
    resolved = replace(RESOLVED, scenario=replace(scenario, sensor=sensor))
    values = measure(SimulatedRun(resolved, ticks, None), NAMES)
    period = scenario.planner.period
    acting = [r for k, r in enumerate(ticks) if faults.act_at(k, period)]
    assert acting[0].time == pytest.approx(6.05)
    assert acting[-1].time == pytest.approx(12.0)
    assert values["fault_position_error"] < 1e-9
    assert values["fault_recovery"] == math.inf


def test_a_run_that_ends_with_the_fault_has_no_recovery():
    ticks = [record for record in records() if record.time < SCENARIO.sensor.faults.end - 0.01]
    values = measure(SimulatedRun(RESOLVED, ticks, None), NAMES)
    assert values["fault_position_error"] < 1e-9
    assert math.isnan(values["fault_recovery"])


def test_contacts_off_the_estimated_object_are_not_valid():
    assert found(off_surface=lambda t: 0.001 * (t > 15)).valid_share == pytest.approx(301 / 401)
    lost = found(off_surface=lambda t: np.nan if t > 15 else 0)
    assert lost.valid_share == pytest.approx(301 / 401)


def test_overlaps_and_crossings_are_counted_by_their_ticks():
    scenario = load_scenario(
        "a_base", text="{planner: {limits: {tip_radii: [0.01, 0.01, 0.01, 0.01, 0.01]}}}"
    )
    resolved, ticks = resolve(scenario), records()
    for tick in ticks[5:8]:
        tick.p_WC[1] = tick.p_WC[0] + [0.005, 0, 0]
    values = measure(SimulatedRun(resolved, ticks, None), ["overlaps", "crossings"])
    assert values == {"overlaps": 3, "crossings": 0}
    for tick in ticks[100:]:  # From the face +y to the opposite one.
        tick.p_WC[0, 1] -= 0.1
    assert measure(SimulatedRun(resolved, ticks, None), ["crossings"]) == {"crossings": 1}


def test_errors_of_late_goals_are_those_of_the_same_point_of_the_object_later():
    """The object moves by 1 m along x and turns by a right angle a tick."""
    turn = RotationMatrix.MakeZRotation(np.pi / 2)
    X_WO = [RigidTransform([k, 0, 0]) for k in range(4)]
    for k in range(1, 4):
        X_WO[k].set_rotation(turn @ X_WO[k - 1].rotation())
    ticks = [
        SimpleNamespace(
            p_WC=np.array([X @ [0.1, 0, 0]]),
            contact_status=np.array([float(ContactStatus.ACTIVE)]),
            X_WO=X,
            X_WO_estimated=X,
        )
        for X in X_WO
    ]
    np.testing.assert_allclose(goal_errors(ticks, 0), 0, atol=1e-15)
    late = goal_errors(ticks, 1)
    np.testing.assert_allclose(late[0], np.hypot(0.9, 0.1))  # (1, 0.1) instead of (0.1, 0).
    assert len(late) == 3
    ticks[1].contact_status[:] = ContactStatus.LOST
    assert len(goal_errors(ticks, 1)) == 2


def test_an_error_after_a_time_that_is_not_at_a_tick_is_not_given():
    names = [f"late_goal_error_{ms}ms" for ms in (25, 50, 100)]
    values = measure(SimulatedRun(RESOLVED, records(), None), names)
    assert RESOLVED.planner.period == 0.05
    assert [math.isnan(values[name]) for name in names] == [True, False, False]


@pytest.mark.slow
@pytest.mark.parametrize("condition", ["conveyor", "toss"])
def test_look_ahead_leaves_at_most_a_third_of_the_error(condition):
    study = load_study("lookahead", conditions=[condition], seeds=1, first_seed=3)
    jobs = {job["planner.estimator.lookahead"]: job for job in study.jobs()}
    errors = [
        StudyRun(study, {})(jobs[lookahead])[0]["late_goal_error_100ms"] for lookahead in (0.0, 0.1)
    ]
    assert errors[1] < errors[0] / 3


@pytest.mark.slow
def test_outliers_do_harm_without_a_gate_only():
    text = "{overrides: {planner: {estimator: {gate: 0.0}}}}"
    options = {"conditions": ["outliers"], "seeds": 1, "first_seed": 3}
    gated, open_ = (load_study("faults", text=each, **options) for each in ("{}", text))
    (row,) = StudyRun(gated, {})(gated.jobs()[0])
    assert row["valid_share"] == 1
    assert row["fault_position_error"] < 2
    assert row["fault_recovery"] <= 0.5
    (row,) = StudyRun(open_, {})(open_.jobs()[0])
    assert row["fault_position_error"] > 10


def test_measures_of_contacts_that_a_hand_does_not_follow_have_no_value(tmp_path):
    methods = {"planned": {}, "still": {"goals": "stationary"}}
    names = ["valid_share", "fault_position_error"]
    data = {"scenario": "grasp_five_finger", "methods": methods, "measures": names, "seeds": 1}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(data))
    study = load_study(str(tmp_path / "mine.yaml"))
    run = SimulatedRun(RESOLVED, records(), None)
    rows = [StudyRun(study, {})._measured(run, job) for job in study.jobs()]
    assert [row["valid_share"] for row in rows] == [1.0, pytest.approx(math.nan, nan_ok=True)]
    assert all(np.isfinite(row["fault_position_error"]) for row in rows)
