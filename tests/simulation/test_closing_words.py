"""Final output of a run, `summary.json` and `position_error` report the events of the run."""

import dataclasses
import re

import numpy as np
import pytest
from conftest import slow
from simulation_runs import closing_words, points, run_log, run_text

from drake_pregrasp import load_resolved
from drake_pregrasp.cli.run_command import run_bar


@pytest.mark.slow
def test_an_object_that_falls_off_the_table_is_noticed(tmp_path, capsys):
    text = """simulation_duration: 4.0, motion: {angular_velocity: 20},
        planner: {static_duration: 1.0}"""
    result = run_text("a_base", text, tmp_path)
    log = run_log(result)
    left = result.summary["object_left_at"]
    assert left == log["time"][np.argmax(log["z_wo"] < 0)]
    assert log["z_wo"][log["time"] < left].min() > 0
    before = (log["time"] > 0.99) & (log["time"] < left)
    assert result.summary["max"]["q_msv"] == log["q_msv"][before].max()
    assert result.summary["object_lost_at"] is None
    assert closing_words(result, capsys)["object"].startswith(f"left the table at {left:g} s")


@pytest.mark.slow
def test_an_object_that_is_lost_for_good_is_noticed(tmp_path, capsys):
    text = """simulation_duration: 4.0, planner: {static_duration: 1.0},
        sensor: {faults: {nan_probability: 1.0, start: 2.0}}"""
    result = run_text("a_base", text, tmp_path)
    assert result.summary["object_left_at"] is None
    lost = result.summary["object_lost_at"]
    assert 2.9 < lost < 3.2
    log = run_log(result)
    before = (log["time"] > 0.99) & (log["time"] < lost)
    assert result.summary["mean"]["q_vew"] == pytest.approx(log["q_vew"][before].mean())
    assert closing_words(result, capsys)["object"].startswith(f"was lost for good at {lost:g} s")


NEVER = "was never tracked"


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        slow("nan_probability: 1.0", NEVER),
        slow("outlier_probability: 1.0, outlier_position: 1.0", NEVER),
        ("nan_probability: 1.0, start: 0.2", "was tracked at 21 % of the ticks"),
        slow("outlier_probability: 0.1", None),
    ],
)
def test_an_object_that_is_not_tracked_is_noticed(fault, words, tmp_path, capsys):
    text = f"simulation_duration: 0.95, sensor: {{faults: {{{fault}}}}}"
    said = closing_words(run_text("a_base", text, tmp_path), capsys)
    assert words is None or said["tracking"].startswith(f"the object {words}")
    assert words is not None or "tracking" not in said


@pytest.mark.slow
def test_a_sound_run_lost_nothing_and_a_best_value_below_static_is_said(base_run, capsys):
    assert base_run.summary["object_left_at"] is base_run.summary["object_lost_at"] is None
    static, best = base_run.summary["static"], base_run.summary["max"]
    assert best["q_msv"] > static["q_msv"]
    assert best["q_vew"] < static["q_vew"]
    said = closing_words(base_run, capsys)
    assert "object" not in said
    assert said["worse"] == f"best Q_VEW is {static['q_vew'] - best['q_vew']:.2g} below static"


@pytest.mark.slow
@pytest.mark.parametrize("lookahead", [0.05, 0.03, 0.17])
def test_position_error_compares_poses_of_the_same_time(lookahead, tmp_path):
    log = run_log(run_text("toss", f"planner: {{estimator: {{lookahead: {lookahead}}}}}", tmp_path))
    time, error = log["time"], log["position_error"]
    assert np.all(np.isnan(error) == (time < lookahead - 1e-9))
    true, predicted = points(log, "wo"), points(log, "wo_estimated")
    earlier = [np.interp(time, time + lookahead, column) for column in predicted.T]
    expected = np.linalg.norm(np.stack(earlier, axis=-1) - true, axis=1)[time >= lookahead - 1e-9]
    np.testing.assert_allclose(error[time >= lookahead - 1e-9], expected, atol=1e-12)
    assert np.max(error[time > 0.3]) < 0.012  # In flight at 3 m/s.


@pytest.mark.slow
def test_the_bar_shows_the_time_of_the_last_tick(tmp_path, capsys, monkeypatch):
    ticks = []
    run_text("a_base", "simulation_duration: 0.05", tmp_path, on_tick=ticks.append)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "120")
    resolved = load_resolved("a_base")
    with run_bar(resolved) as on_tick:
        on_tick(dataclasses.replace(ticks[-1], time=59.96))
    shown = capsys.readouterr()
    assert re.findall(r"([\d.]+) s of 60 s", shown.err)[-1] == "60.0"
    assert shown.out == f"kernels     {resolved.kernels.name}\n"
