import csv
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from drake_pregrasp import TrackingStatus, load_scenario
from drake_pregrasp.cli import main
from drake_pregrasp.config.planner_config import EstimatorConfig, filter_noise
from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.studies.faults import command
from drake_pregrasp.studies.faults.consistency import (
    consistency,
    conveyor_motion,
    even_noise,
    random_motion,
)
from drake_pregrasp.studies.faults.fault_run import FaultJob, run_faults, summarize_faults
from drake_pregrasp.studies.faults.study import fault_lines, fault_scenarios, study_faults

SCENARIO = load_scenario("fault_outliers")
SURFACE = SCENARIO.make_surface()
P_OC = SCENARIO.initial_p_OC(SURFACE)


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
        made.append(
            SimpleNamespace(
                time=time,
                X_WO=X_WO,
                X_WO_estimated=X_WE,
                p_WC=p_WC,
                contact_status=np.full(5, float(ContactStatus.ACTIVE)),
                tracking_status=status,
            )
        )
    return made


def found(**errors):
    return summarize_faults(SCENARIO, SURFACE, records(**errors))


def test_a_perfect_run_is_valid_and_has_nothing_to_recover_from():
    run = found()
    assert run.valid == 1
    assert run.position_error == pytest.approx(0, abs=1e-12)
    assert run.recovery == 0
    assert run.lost == pytest.approx(20 / 120, abs=1e-9)
    assert run.tracked == pytest.approx(100 / 120, abs=1e-9)


def test_errors_count_while_the_fault_acts_and_recovery_after_it():
    run = found(offset=lambda t: 0.05 * (7 < t < 12.71), turn=lambda t: 0.3 * (6 < t < 7))
    assert run.position_error == pytest.approx(0.05)
    assert run.orientation_error == pytest.approx(0.3)
    assert run.recovery == pytest.approx(0.75)
    assert found(offset=lambda t: 0.05 * (t < 5)).position_error < 1e-12
    assert found(turn=lambda t: 0.1 * (t > 12)).recovery == math.inf
    # Small errors are no reason to call it unrecovered.
    assert found(offset=lambda t: 3.9 * SCENARIO.sensor.position_std).recovery == 0


def test_contacts_off_the_estimated_object_are_not_valid():
    assert found(off_surface=lambda t: 0.001 * (t > 15)).valid == pytest.approx(301 / 401)
    assert found(off_surface=lambda t: np.nan if t > 15 else 0).valid == pytest.approx(301 / 401)


def test_a_real_run_stays_valid_and_recovers():
    run = run_faults(FaultJob("fault_outliers", 3))
    assert run.valid == 1
    assert run.position_error < 2e-3
    assert run.recovery <= 0.5


def test_without_a_gate_outliers_do_harm():
    gated = run_faults(FaultJob("fault_outliers", 3))
    assert gated.position_error < 2e-3
    text = "{random_seed: 3, planner: {estimator: {gate: 0.0}}}"
    naive = load_scenario("fault_outliers", text=text)
    assert naive.planner.estimator.gate == 0
    assert run_faults(FaultJob("fault_outliers", 3), text).position_error > 1e-2


def test_each_fault_has_a_row_in_the_report(tmp_path):
    faults = list(fault_scenarios())[-2:]
    steps = []
    report = study_faults(
        tmp_path, faults=faults, seeds=2, filter_seeds=2, on_progress=lambda *s: steps.append(s)
    )
    assert steps == [(done, 7) for done in range(1, 8)]
    text = report.read_text(encoding="utf-8")
    assert [f"| `{name}` |" in text for name in fault_scenarios()][-3:] == [False, True, True]
    rows = list(csv.DictReader((tmp_path / "faults.csv").read_text().splitlines()))
    assert {(row["scenario"], row["seed"]) for row in rows} == {
        (f, s) for f in faults for s in "01"
    }
    assert all(float(row["valid"]) == 1 for row in rows)


@pytest.mark.parametrize(
    ("option", "problem"),
    [
        (
            ["--faults", "fault_nan,nan"],
            "faults: 'nan' is no scenario with faults; there are: fault_white_noise, ",
        ),
        (["--seeds", "0"], "--seeds: 0 must be 1 or more"),
        (["--seeds", "1000000000"], "--seeds: 1000000000 must be 10000 or less"),
        (["--processes", "-1"], "--processes: -1 must be 1 or more"),
    ],
)
def test_options_that_cannot_be_used_are_said_in_one_line(option, problem, tmp_path, capsys):
    assert main(["study", "faults", "--out", str(tmp_path / "out"), *option]) == 2
    said = capsys.readouterr().err
    assert problem in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_the_command_studies_what_it_is_asked_for(monkeypatch, capsys):
    asked = {}

    def study(out, *, on_progress, **options):
        asked.update(options, out=out)
        return out

    monkeypatch.setattr(command, "study_faults", study)
    flags = ["--faults", "fault_nan, fault_bias", "--seeds", "3", "--processes", "1"]
    assert main(["study", "faults", "--out", "here", *flags]) == 0
    faults = ["fault_nan", "fault_bias"]
    options = {"faults": faults, "seeds": 3, "filter_seeds": 0, "processes": 1}
    assert asked == {"out": "here", **options}
    assert capsys.readouterr().out == "report in here\n"


def test_shares_are_not_rounded_up_to_all():
    run = found()
    runs = {name: [run] * 3 for name in fault_scenarios()}
    assert "| 100 % |" in "\n".join(fault_lines(runs))
    runs = {name: [run._replace(valid=0.99999)] * 3 for name in fault_scenarios()}
    assert "| 100 % |" not in "\n".join(fault_lines(runs))


@pytest.mark.parametrize("kind", ["assumed", "conveyor"])
def test_the_filter_is_consistent_over_two_hundred_runs(kind):
    """Also under the conveyor's real motion, if even motion is assumed."""
    if kind == "assumed":
        noise = filter_noise(EstimatorConfig())
        result = consistency(noise, lambda rng: random_motion(noise, rng), 200)
    else:
        motion = conveyor_motion()
        result = consistency(even_noise(), lambda rng: motion, 200)
    for value, (low, high) in ((result.nees, result.nees_band), (result.nis, result.nis_band)):
        assert np.all((low < value) & (value < high))


def test_a_filter_that_assumes_too_little_noise_is_not_consistent():
    noise = filter_noise(EstimatorConfig())
    motion = conveyor_motion()
    wrong = replace(noise, acceleration=1e-6, angular_acceleration=1e-6)
    shaken = random_motion(replace(noise, acceleration=0.1), np.random.default_rng(0))
    result = consistency(wrong, lambda rng: shaken, 10)
    assert result.nees[0] > result.nees_band[1]
    careful = consistency(noise, lambda rng: motion, 40)
    assert np.all(careful.nees < careful.nees_band[1])  # More noise than there is does no harm.
