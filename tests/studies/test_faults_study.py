"""The study of measurement faults, and the filter's consistency."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from drake_pregrasp.studies.faults import FaultJob, percent
from drake_pregrasp.studies.filter_consistency import FILTERS, TICKS, band
from pydrake.math import RigidTransform, RotationMatrix

from drake_pregrasp import TrackingStatus, load_scenario, resolve
from drake_pregrasp.cli import main
from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.studies import faults, filter_consistency
from drake_pregrasp.systems.loggers import TickRecord

SCENARIO = load_scenario("fault_outliers")
RESOLVED = resolve(SCENARIO)
SURFACE, P_OC = RESOLVED.surface, RESOLVED.start.p_OC


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
        made.append(TickRecord(time, p_WC, active, None, None, None, X_WO, X_WE, 0.0, status))
    return made


def found(**errors):
    return SimpleNamespace(**faults.summarize_faults(RESOLVED, records(**errors)))


def test_a_perfect_run_is_valid_and_has_nothing_to_recover_from():
    run = found()
    assert (run.valid, run.recovery) == (1, 0)
    assert run.position_error == pytest.approx(0, abs=1e-12)
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


@pytest.mark.slow
def test_a_real_run_stays_valid_and_recovers_and_without_a_gate_outliers_do_harm():
    job = FaultJob("fault_outliers", 3)
    gated = faults.run_faults(job)
    assert gated["valid"] == 1
    assert gated["position_error"] < 2e-3
    assert gated["recovery"] <= 0.5
    assert faults.run_faults(job, "{planner: {estimator: {gate: 0.0}}}")["position_error"] > 1e-2


@pytest.mark.slow
def test_the_command_studies_what_it_is_asked_for(tmp_path, capsys, monkeypatch):
    flags = ["--faults", "fault_nan, fault_bias", "--seeds", "1", "--processes", "1"]
    assert main(["study", "faults", "--out", str(tmp_path), *flags]) == 0
    rows = pd.read_csv(tmp_path / "rows.csv")
    assert rows["scenario"].tolist() == ["fault_bias", "fault_nan"]
    report = tmp_path / "faults.md"
    assert capsys.readouterr().out == f"2 of 2 runs are complete\nreport in {report}\n"
    text = report.read_text(encoding="utf-8")
    assert [f"| `{name}`" in text for name in faults.fault_scenarios()].count(True) == 2
    assert "Valid contacts at all ticks: in 2 of 2 runs." in text
    assert "NEES" not in text
    monkeypatch.setattr(faults, "fault_scenarios", lambda: {"fault_nan": "no numbers"})
    report = faults.study_faults(tmp_path / "filter", seeds=1, filter_seeds=2)[1]
    text = report.read_text(encoding="utf-8")
    assert all(f"| {name} " in text for name in FILTERS)


def test_a_table_has_medians_and_the_largest_and_shares_are_not_rounded_up_to_all():
    run = vars(found())
    errors = [1e-3, 2e-3, 9e-3]
    rows = pd.DataFrame(
        [
            {"scenario": "fault_nan", "seed": k, **run, "position_error": e}
            for k, e in enumerate(errors)
        ]
    )
    (line,) = faults.fault_table(rows).to_dict("records")
    assert line["worst position error [mm]"] == "2.0 (9.0)"
    assert (line["runs"], line["contacts valid"]) == (3, "100 %")
    assert percent(0.99999) == "99.999 %"
    assert (percent(0), percent(0.00001), percent(0.5)) == ("0 %", "0.001 %", "50.0 %")


@pytest.mark.slow
@pytest.mark.parametrize("name", list(FILTERS)[:2])
def test_the_filter_is_consistent_over_two_hundred_runs(name):
    """Also under the conveyor's real motion, if even motion is assumed."""
    jobs = [{"filter": name, "seed": seed} for seed in range(200)]
    rows = pd.DataFrame([job | filter_consistency.run_filter(job) for job in jobs])
    for kind, freedom, samples in (("nees", 6, 200), ("nis", 3, 200 * TICKS // 2)):
        low, high = band(freedom, samples)
        means = rows[[f"{kind}_position", f"{kind}_orientation"]].mean()
        assert ((low < means) & (means < high)).all()
    table = filter_consistency.consistency_table(rows)
    assert table["95 % band of NEES"].tolist() == ["5.53 to 6.49"]
    assert table["95 % band of NIS"].tolist() == ["2.952 to 3.048"]


def test_a_filter_that_assumes_too_little_noise_is_not_consistent():
    noise = replace(filter_consistency.DEFAULT_NOISE, acceleration=0.1)
    shaken = filter_consistency.random_motion(noise, np.random.default_rng(0))
    errors = [
        filter_consistency.filter_errors(filter_consistency.EVEN_NOISE, shaken, rng)
        for rng in map(np.random.default_rng, range(10))
    ]
    assert np.mean([error["nees_position"] for error in errors]) > band(6, 10)[1]
