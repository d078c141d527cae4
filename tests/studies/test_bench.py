"""The benchmark: all implementations do the same work, and times are labelled correctly."""

import json
import os
import subprocess
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest

from drake_pregrasp import ScenarioError, shipped_scenarios
from drake_pregrasp.robots import robot_data
from drake_pregrasp.studies.bench import bench as bench_module
from drake_pregrasp.studies.bench import run_times, tick_times
from drake_pregrasp.studies.bench.bench import QUESTIONS, bench, goals_table, plan, report
from drake_pregrasp.studies.bench.run_times import RunJob, time_run, time_starts
from drake_pregrasp.studies.bench.soak import drift, soak
from drake_pregrasp.studies.bench.tick_times import (
    NUM_SETS,
    PLAIN,
    PRINTED,
    Scene,
    TickJob,
    implementations,
    make_scene,
    make_tick,
    make_ticks,
    tick_columns,
    time_ticks,
)
from drake_pregrasp.systems import safe_region_partitioner

ALL = (*implementations(), PRINTED)
BALL = Scene(12, subdivisions=2)


@pytest.mark.parametrize("strategy", ["position", "msv", "gii", "vew", "margin"])
@pytest.mark.parametrize("scene", [Scene(12), BALL], ids=["cube", "ball"])
def test_all_implementations_plan_the_same(scene, strategy):
    ticks, (_, _, starts) = make_ticks(scene, replace(PLAIN, strategy=strategy)), make_scene(scene)
    assert tuple(ticks) == ALL
    for p_OC in starts[:3]:
        expected = ticks[PRINTED](p_OC)
        assert np.max(np.abs(expected - p_OC)) > 1e-3
        for name in implementations():
            np.testing.assert_allclose(ticks[name](p_OC), expected, atol=1e-10, err_msg=name)


@pytest.mark.parametrize("points", [0, 60])
def test_obstacles_limit_contacts_as_forbidden_points_do(points):
    """Here no ball of a forbidden point contains a candidate, so that both rules agree."""
    forbidden, obstacles = (Scene(4, points=points, obstacles=each) for each in (False, True))
    surface, _, starts = make_scene(forbidden)
    assert np.all(surface.is_clear_of_forbidden_points)
    expected = make_ticks(forbidden, PLAIN)[PRINTED]
    limited = make_ticks(obstacles, PLAIN)
    assert tuple(limited) == implementations()
    for p_OC in starts:
        np.testing.assert_allclose(limited["reference"](p_OC), expected(p_OC), atol=1e-10)


def test_scenes_have_the_numbers_they_are_asked_for():
    for scene in (Scene(12, contacts=7, points=300), BALL):
        surface, _, starts = make_scene(scene)
        assert starts.shape == (NUM_SETS, scene.contacts, 3)
        np.testing.assert_allclose(surface.distance(starts[0]), 0, atol=1e-12)
        if scene != BALL:
            assert (len(surface.p_OQ), len(surface.forbidden)) == (4 * 12**2, 300)


@pytest.mark.parametrize("name", implementations())
def test_each_tick_is_of_the_implementation_that_is_named(name, monkeypatch):
    surface, _, starts = make_scene(Scene(8))
    made, own = [], tick_times.PregraspPlanner

    def planner(*arguments, kernels):
        made.append(kernels.name)
        return own(*arguments, kernels=kernels)

    monkeypatch.setattr(tick_times, "PregraspPlanner", planner)
    make_tick(surface, name, starts[0], PLAIN)
    assert made == [{"reference": "numpy", "fast": "numba"}[name]]


def test_ticks_are_timed_in_turn_until_time_is_up():
    job = TickJob("position", 64, Scene(4), PLAIN, seconds=60.0, rounds=12)
    rows = time_ticks(job)
    assert [row["implementation"] for row in rows] == list(ALL)
    assert [row["ticks"] for row in rows] == [12] * len(ALL)
    for row in rows:
        assert row["N"] == 64
        assert 0 < row["median [ms]"] <= row["99 % [ms]"]
        assert row["99 % / median"] == row["99 % [ms]"] / row["median [ms]"]
    assert {row["ticks"] for row in time_ticks(job._replace(seconds=0.0))} == {5}


def test_the_time_of_a_tick_is_that_of_planning_it(monkeypatch):
    """By a clock that only safe regions advance; logs would ask for them, too."""
    now, compute = [0.0], safe_region_partitioner.compute_safe_regions

    def slow(*arguments, **options):
        now[0] += 2**-6
        return compute(*arguments, **options)

    clock = type("Clock", (), {"thread_time": lambda: now[0]})
    monkeypatch.setattr(run_times, "time", clock)
    monkeypatch.setattr(safe_region_partitioner, "compute_safe_regions", slow)
    rows = time_run(RunJob("base", "a_base", "{planner: {period: 0.02}}", 25))
    assert [row["implementation"] for row in rows] == list(implementations())
    for row in rows:
        assert (row["run"], row["ticks"]) == ("base", 17 + 2)  # Of the ticks of two turns.
        assert row["median [ms]"] == row["99 % [ms]"] == 1e3 * 2**-6
        assert row["x real time"] == 1 / row["processor s / s"] == pytest.approx(0.02 / 2**-6)


@pytest.mark.slow
def test_ticks_at_which_a_hand_holds_contacts_do_not_count(monkeypatch):
    monkeypatch.setattr(run_times, "implementations", lambda: ("reference",))
    text = "{planner: {period: 0.05}, grasp: {close_at: 0.5}}"
    # Contacts are held from 0.3 s on: before the meeting at 1 s, as long as closing takes.
    (row,) = time_run(RunJob("hand", "grasp_five_finger", text, 24))
    assert 0 < row["ticks"] <= 6
    assert row["99 % [ms]"] > 0


def test_only_scenarios_that_lack_an_extra_are_left_out(monkeypatch):
    monkeypatch.setattr(robot_data, "PACKAGE", "not-installed")
    (row,) = time_run(RunJob("arm", "grasp_allegro_panda"))
    assert row["run"] == "arm"
    assert "drake_pregrasp[robots]" in row["not run"]
    base = {"run": "base", "implementation": "reference", **tick_columns([1.0])}
    *_, table, note = report("", {"hand": pd.DataFrame([row, base])})
    assert table.data["candidates"].tolist() == ["base"]
    assert note == f"Not run: arm: {row['not run']}"
    with pytest.raises(ScenarioError, match="period"):
        time_run(RunJob("base", "a_base", "{planner: {period: -1}}"))


@pytest.mark.slow
def test_a_fresh_process_imports_the_callers_package(monkeypatch):
    monkeypatch.setattr(run_times, "implementations", lambda: ("reference",))
    (row,) = time_starts(1, compiling=False)
    assert min(list(row.values())[2:]) > 0


def test_one_process_compiles_and_the_medians_of_the_others_are_of_each_stage(monkeypatch):
    seen = []

    def run(command, *, env, **others):
        seen.append(env)
        seconds = [[9.0, 9.0], [3.0, 1.0], [1.0, 2.0], [2.0, 9.0]][len(seen) - 1]
        return subprocess.CompletedProcess(command, 0, stdout=json.dumps(seconds))

    monkeypatch.setattr(run_times, "implementations", lambda: ("fast",))
    monkeypatch.setattr(run_times.subprocess, "run", run)
    monkeypatch.setenv("PYTHONPATH", "mine")
    first, later = (list(row.values()) for row in time_starts(3, compiling=True))
    assert first == ["fast", "first", 9, 9]
    assert later == ["fast", "later", 2, 2]
    assert len({environment["NUMBA_CACHE_DIR"] for environment in seen}) == 1
    assert seen[0]["PYTHONPATH"].endswith(f"{os.pathsep}mine")


@pytest.mark.slow
def test_hours_are_means_over_all_their_ticks():
    seen = []
    hours = soak(3, seconds=4.0, on_hour=seen.append)
    assert seen == hours
    assert [hour["ticks"] for hour in hours] == [80, 80, 80]
    static, later, last = hours
    assert static["q_gii"] < later["q_gii"] == pytest.approx(last["q_gii"], rel=1e-3)
    assert 0 < last["position_error"] < 2e-3
    assert last["active"] == 1
    assert last["resident"] > 0
    assert [hour["ticks"] for hour in soak(2, seconds=0.1, period=0.01)] == [10, 10]


def test_drift_is_the_slope_of_all_hours_but_the_first_quarter():
    slope, error = drift([{"x": value} for value in (100.0, 1.0, 3.0, 5.0, 7.0)], "x")
    assert slope == pytest.approx(2)
    assert error == pytest.approx(0, abs=1e-9)


def planned(*, quick):
    """A table for each section with the cases of its jobs."""
    rows = {}
    for section, measure in plan(quick=quick):
        job = measure.args[0] if getattr(measure, "args", ()) else None
        if isinstance(job, RunJob):
            row = {"run": job.name, "scenario": job.scenario, "ticks": job.ticks}
        elif isinstance(job, TickJob):
            N = 4 * job.scene.per_length**2
            row = {"series": job.series, "size": job.size, "N": N, "ticks": job.rounds}
        else:
            row = {"start": "first", "ticks": 1}
        rows.setdefault(section, []).append(row)
    return {section: pd.DataFrame(own) for section, own in rows.items()}


def test_the_plan_has_all_scenarios_and_a_case_for_each_goal():
    quick, full = planned(quick=True), planned(quick=False)
    assert next(iter(full)) == "memory"  # Other measurements would hide growth.
    assert set(full) == set(QUESTIONS) == {*quick, "memory"}
    assert set(full["scenarios"]["run"]) >= set(shipped_scenarios())
    for section, question in QUESTIONS.items():
        assert len(quick.get(section, [])) <= len(full[section])
        for goal in question["goals"]:
            assert len(full[section].query(goal["rows"])), goal["what"]
    files = {shipped_scenarios()[name][0] for name in quick["scenarios"]["scenario"]}
    assert files == {file for file, _ in shipped_scenarios().values()}


def test_goals_are_met_by_the_worst_case_of_fast_only():
    rows = [
        {"run": "a_base", "implementation": "reference", "x real time": 1, "99 % / median": 9},
        {"run": "a_base", "implementation": "fast", "x real time": 60, "99 % / median": 2},
        {"run": "box", "implementation": "fast", "x real time": 5, "99 % / median": 2.5},
    ]
    table = goals_table({"scenarios": pd.DataFrame(rows).assign(ticks=1)}).set_index("goal")
    assert len(table) == sum(len(question["goals"]) for question in QUESTIONS.values())
    base = table.loc["base case, planning at 20 Hz: x real time"]
    assert tuple(base) == ("≥ 60", "60", "yes")
    spread = table.loc["shipped scenarios: 99th percentile over median"]
    assert tuple(spread) == ("≤ 2", "2.5 (box)", "no")
    assert tuple(table.iloc[-1])[1:] == ("not measured", "–")


@pytest.mark.slow
def test_writes_its_files(tmp_path, monkeypatch):
    jobs = [
        ("strategies", partial(time_ticks, TickJob("vew", 64, Scene(4), PLAIN, rounds=5))),
        ("growth", partial(time_ticks, TickJob("contacts", 5, Scene(4), PLAIN, rounds=5))),
        ("rates", partial(time_run, RunJob("base", "a_base", ticks=5))),
        ("starts", partial(time_starts, 1, compiling=False)),
    ]
    monkeypatch.setattr(bench_module, "plan", lambda *, quick: jobs)
    steps = []
    path = bench(tmp_path / "b", quick=True, on_progress=lambda *step: steps.append(step))
    assert steps == [(k, 4) for k in (1, 2, 3, 4)]
    assert {file.name for file in path.parent.iterdir()} == {"bench.md", "bench.json"}
    content = json.loads((path.parent / "bench.json").read_text())
    assert [row["implementation"] for row in content["growth"]] == list(ALL)
    text = path.read_text()
    measured = {section for section, _ in jobs}
    for section, question in QUESTIONS.items():
        assert (f"## {question['title']}" in text) == (section in measured)
        assert all(goal["what"] in text for goal in question["goals"])
    for shown in ("reference, x real time", "printed, ms", "| vew ", "| base "):
        assert shown in text
