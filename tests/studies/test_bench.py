"""The benchmark: all implementations do the same work, and times are labelled correctly."""

import json
import os
import subprocess
from functools import partial

import numpy as np
import pytest

from drake_pregrasp import PlannerConfig
from drake_pregrasp.studies.bench import base_case, tick_times
from drake_pregrasp.studies.bench import bench as bench_module
from drake_pregrasp.studies.bench.base_case import RunJob, time_run, time_starts
from drake_pregrasp.studies.bench.bench import BY_SIZE, bench, plan
from drake_pregrasp.studies.bench.soak import drift, soak
from drake_pregrasp.studies.bench.tick_times import (
    MESH,
    NUM_SETS,
    WITHOUT_PORTS,
    Scene,
    TickJob,
    cube,
    implementations,
    make_scene,
    make_tick,
    make_ticks,
    time_ticks,
)

ALL = (*implementations(), WITHOUT_PORTS)
SMALL_MESH = Scene(0.02, forbidden=10, shape=MESH)


@pytest.mark.parametrize("strategy", ["position", "msv", "gii", "vew", "margin"])
@pytest.mark.parametrize("scene", [cube(12), SMALL_MESH], ids=["cube", "mesh"])
def test_all_implementations_plan_the_same(scene, strategy):
    ticks, (_, starts) = make_ticks(TickJob("", scene, strategy)), make_scene(scene)
    assert tuple(ticks) == ALL
    for p_OC in starts[:3]:
        expected = ticks[WITHOUT_PORTS](p_OC)
        assert np.max(np.abs(expected - p_OC)) > 1e-3
        for name in implementations():
            np.testing.assert_allclose(ticks[name](p_OC), expected, atol=1e-10, err_msg=name)


@pytest.mark.parametrize("forbidden", [0, 60])
def test_obstacles_limit_contacts_as_forbidden_points_do(forbidden):
    """Here no ball of a forbidden point contains a candidate, so that both rules agree."""
    scene = cube(4, forbidden=forbidden)
    surface, starts = make_scene(scene)
    assert np.all(surface.is_clear_of_forbidden_points)
    plain, limited = (make_ticks(TickJob("", scene, "gii", obstacles)) for obstacles in (0, 1))
    for p_OC in starts:
        np.testing.assert_allclose(
            limited["reference"](p_OC), plain[WITHOUT_PORTS](p_OC), atol=1e-10
        )


def test_scenes_have_the_numbers_they_are_asked_for():
    for scene in (cube(12, contacts=7, forbidden=300), SMALL_MESH):
        surface, starts = make_scene(scene)
        assert starts.shape == (NUM_SETS, scene.contacts, 3)
        assert len(surface.forbidden) == scene.forbidden
        assert scene.shape == MESH or len(surface.p_OQ) == 4 * 12**2
        np.testing.assert_allclose(surface.distance(starts[0]), 0, atol=1e-12)


@pytest.mark.parametrize("name", implementations())
def test_each_tick_is_of_the_implementation_that_is_named(name, monkeypatch):
    surface, starts = make_scene(cube(8))
    made, own = [], tick_times.chosen
    monkeypatch.setattr(tick_times, "chosen", lambda asked: made.append(asked) or own(asked))
    make_tick(surface, name, starts[0], PlannerConfig())
    assert made == [name]


def test_ticks_are_timed_in_turn_until_time_is_up():
    rows = time_ticks(TickJob(BY_SIZE, cube(4), "position", rounds=12, seconds=60.0))
    assert [row["implementation"] for row in rows] == list(ALL)
    assert [row["ticks"] for row in rows] == [12] * len(ALL)
    assert all(0 < row["median [ms]"] <= row["99 % [ms]"] for row in rows)
    hasty = time_ticks(TickJob(BY_SIZE, cube(4), "position", rounds=12, seconds=0.0))
    assert {row["ticks"] for row in hasty} == {5}


def test_parts_are_what_their_diagrams_take_more(monkeypatch):
    """By a clock that only the simulators advance; a thread works half of the time."""
    costs, now, made = (1.0, 4.0, 2.0, 0.5), [0.0], []

    class Simulator:
        def __init__(self, diagram):
            made.append(self)
            self.seconds, self.ends = sum(costs[: len(made)]), []

        def set_target_realtime_rate(self, rate):
            assert rate == 0

        def AdvanceTo(self, end):
            now[0] += self.seconds * len(self.ends)  # Nothing for the warm-up.
            self.ends.append(end)

    clock = type("Clock", (), {"perf_counter": lambda: now[0], "thread_time": lambda: now[0] / 2})
    monkeypatch.setattr(base_case, "time", clock)
    monkeypatch.setattr(base_case, "Simulator", Simulator)
    monkeypatch.setattr(base_case, "ApplySimulatorConfig", lambda *arguments: None)
    rows = time_run(RunJob("reference", 0.05, 0.2, 3))
    median = 2 / 0.2  # Rounds take once, twice and three times as long.
    for row, cost, whole in zip(rows, costs, np.cumsum(costs), strict=True):
        assert row["x real time"] == pytest.approx(1 / (median * whole))
        assert row["added [ms]"] == pytest.approx(1e3 * median * cost / 2)
    for simulator in made:
        np.testing.assert_allclose(np.diff(simulator.ends), 0.2)


@pytest.mark.slow
def test_a_fresh_process_imports_the_callers_package(monkeypatch):
    monkeypatch.setattr(base_case, "implementations", lambda: ("reference",))
    (row,) = time_starts(1, compiling=False)
    assert min(list(row.values())[1:]) > 0


def test_one_process_compiles_and_the_medians_of_the_others_are_of_each_stage(monkeypatch):
    seen = []

    def run(command, *, env, **others):
        seen.append(env)
        seconds = [[9.0, 9.0], [3.0, 1.0], [1.0, 2.0], [2.0, 9.0]][len(seen) - 1]
        return subprocess.CompletedProcess(command, 0, stdout=json.dumps(seconds))

    monkeypatch.setattr(base_case, "implementations", lambda: ("numba",))
    monkeypatch.setattr(base_case.subprocess, "run", run)
    monkeypatch.setenv("PYTHONPATH", "mine")
    first, later = (list(row.values()) for row in time_starts(3, compiling=True))
    assert first == ["numba, nothing compiled yet", 9, 9]
    assert later == ["numba", 2, 2]
    assert len({environment["NUMBA_CACHE_DIR"] for environment in seen}) == 1
    assert seen[0]["PYTHONPATH"].endswith(f"{os.pathsep}mine")


@pytest.mark.slow
def test_hours_are_means_over_all_their_ticks():
    seen = []
    hours = soak(3, seconds=5.0, on_hour=seen.append)
    assert seen == hours
    assert [hour["ticks"] for hour in hours] == [100, 100, 100]
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


def test_plans_differ_in_size_only():
    quick, full = ([name for name, _ in plan(quick=quick)] for quick in (True, False))
    assert set(full) - set(quick) == {"memory"}
    assert len(quick) < len(full)
    assert full[0] == "memory"


@pytest.mark.slow
def test_writes_its_files(tmp_path, monkeypatch):
    jobs = [
        ("ticks", partial(time_ticks, TickJob(BY_SIZE, cube(4), "vew", rounds=5))),
        ("ticks", partial(time_ticks, TickJob("contacts", cube(4), "gii", rounds=5))),
        ("runs", partial(time_run, RunJob(implementations()[-1], 0.05, 0.1, 1))),
    ]
    monkeypatch.setattr(bench_module, "plan", lambda *, quick: jobs)
    monkeypatch.setattr(bench_module, "_GROWTH", {"contacts": "contacts"})
    steps = []
    path = bench(tmp_path / "b", quick=True, on_progress=lambda *step: steps.append(step))
    assert steps == [(1, 3), (2, 3), (3, 3)]
    pictures = {"ticks.png", "growth.png", "base_case.png"}
    assert {file.name for file in path.parent.iterdir()} == {"bench.md", "bench.json", *pictures}
    content = json.loads((path.parent / "bench.json").read_text())
    assert {row["N"] for row in content["ticks"]} == {64}
    text = path.read_text()
    for shown in ("### vew", "gii, reference", "20 Hz", *pictures):
        assert shown in text
