import json
import os
import subprocess
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from drake_pregrasp import box_surface, load_scenario
from drake_pregrasp.geometry.mesh_surface import EDGE
from drake_pregrasp.geometry.sampling import split_triangles
from drake_pregrasp.studies.bench import base_case, global_times, scene, startup
from drake_pregrasp.studies.bench import bench as bench_module
from drake_pregrasp.studies.bench.base_case import PARTS, RunJob, time_run
from drake_pregrasp.studies.bench.bench import bench
from drake_pregrasp.studies.bench.direct_tick import STRATEGIES
from drake_pregrasp.studies.bench.global_times import PLANNERS, GlobalJob, compare_choices
from drake_pregrasp.studies.bench.implemented_surface import implemented
from drake_pregrasp.studies.bench.memory import WARM_UP, MemoryJob, slope
from drake_pregrasp.studies.bench.outcome import Outcome
from drake_pregrasp.studies.bench.plan import MESH_SPACINGS, Plan, full_plan, quick_plan
from drake_pregrasp.studies.bench.report import report
from drake_pregrasp.studies.bench.scene import (
    MESH,
    NUM_SETS,
    SceneSpec,
    cube,
    implementations,
    make_scene,
)
from drake_pregrasp.studies.bench.shares import REST, STAGES, ShareJob, profile_ticks
from drake_pregrasp.studies.bench.startup import StartJob, time_starts
from drake_pregrasp.studies.bench.targets import targets
from drake_pregrasp.studies.bench.tick_times import BY_SIZE, TickJob, TickTimes, time_ticks
from drake_pregrasp.studies.bench.ways import AS_OBSTACLES, all_ways, make_ticks

FASTEST = implementations()[-1]


def test_the_finest_mesh_of_the_plan_is_within_the_limits():
    finest = min(MESH_SPACINGS)
    shape = load_scenario(MESH).object.make_shape()
    pieces = split_triangles(
        np.array(shape.mesh.triangles), np.array(shape.mesh.face_normals), EDGE * finest
    )
    assert len(pieces.corners) > 1_000_000


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_all_ways_plan_the_same(strategy):
    scene = make_scene(cube(12))
    ticks = make_ticks(scene, strategy, all_ways(strategy))
    for p_OC in scene.starts[:4]:
        measures = {way: tick(p_OC) for way, tick in ticks.items()}
        for way, found in measures.items():
            # These weights are all one: stretched, a decomposition leaves rounding of them.
            blurred = (strategy, way) == ("vew of the contact", "direct")
            tolerance = 1e-3 if blurred else 1e-9
            np.testing.assert_allclose(found, measures["BLAS"], rtol=tolerance, err_msg=way)


@pytest.mark.parametrize("forbidden", [0, 60])
def test_obstacles_fence_contacts_in_as_forbidden_points_do(forbidden):
    """Balls of obstacles are closed to all contacts; here none of them holds a candidate."""
    scene = make_scene(cube(4, forbidden=forbidden))
    assert np.all(scene.surface.is_clear_of_forbidden_points)
    ticks = make_ticks(scene, "gii", ("BLAS", AS_OBSTACLES))
    for p_OC in scene.starts:
        plain, as_obstacles = (tick(p_OC) for tick in ticks.values())
        np.testing.assert_allclose(as_obstacles, plain, rtol=1e-9)


@pytest.mark.parametrize("spec", [cube(12, contacts=7, forbidden=300), cube(12, forbidden=20)])
def test_scenes_have_the_numbers_they_are_asked_for(spec):
    scene = make_scene(spec)
    assert scene.starts.shape == (NUM_SETS, spec.contacts, 3)
    assert len(scene.surface.forbidden) == spec.forbidden
    assert len(scene.surface.p_OQ) == 4 * 12**2
    np.testing.assert_allclose(scene.surface.distance(scene.starts[0]), 0, atol=1e-12)


def test_the_mesh_is_a_scene_as_the_cube_is():
    scene = make_scene(SceneSpec(MESH, 0.02, forbidden=10))
    assert len(scene.surface.forbidden) == 10
    ticks = make_ticks(scene, "vew", (*implementations(), "BLAS"))
    measures = [tick(scene.starts[0]) for tick in ticks.values()]
    for found in measures:
        np.testing.assert_allclose(found, measures[-1], rtol=1e-9)


@pytest.mark.parametrize("name", implementations())
def test_surfaces_have_the_kernel_they_are_asked_for(name):
    plain = box_surface([0.1] * 3, spacing=0.02)
    own = implemented(plain, name)
    assert type(own.kernel).__name__.lower() == f"{name}kernel"
    assert own.kernel is own.kernel
    assert own.p_OQ is plain.p_OQ
    assert own.mesh is plain.mesh
    p_OP = np.random.default_rng(0).normal(0, 0.05, (5, 3))
    for found, expected in zip(own.project(p_OP), plain.project(p_OP), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_ticks_are_timed_in_every_way_until_time_is_up():
    spec = cube(4)
    rows = time_ticks(
        TickJob(BY_SIZE, spec, "position", ("numpy", "numpy in Drake", "BLAS"), 12, 60.0)
    )
    assert [row.ticks for row in rows] == [12, 12, 2]
    assert all(0 < row.p50 <= row.p99 for row in rows)
    assert all(0 < row.own_p50 <= 1.05 * row.p50 for row in rows)
    assert [row.ports != 0 for row in rows] == [False, True, False]
    (hasty,) = time_ticks(TickJob(BY_SIZE, spec, "position", ("numpy",), 12, 0.0))
    assert hasty.ticks == 5


def test_all_methods_are_compared_out_of_forbidden_balls(monkeypatch):
    seen = []
    reached = global_times._reached

    def spy(surface, p_OC):
        seen.append((surface, p_OC))
        return reached(surface, p_OC)

    for module in (scene, global_times):  # Balls so large that they reach all heights.
        monkeypatch.setattr(module, "LARGEST_RADIUS", 0.04)
    monkeypatch.setattr(global_times, "PER_EDGE", 8)
    monkeypatch.setattr(global_times, "SETTLING", 3)
    monkeypatch.setattr(global_times, "LAST", 1)
    monkeypatch.setattr(global_times, "TIMED", 2)
    monkeypatch.setattr(global_times, "_reached", spy)
    choices = compare_choices(GlobalJob(0, False))
    assert sum(choice.is_planner for choice in choices) == len(PLANNERS)
    for choice, (surface, p_OC) in zip(choices, seen, strict=True):
        away = np.linalg.norm(p_OC[:, None] - surface.forbidden.points, axis=2)
        assert np.all(away >= surface.forbidden.radii - 1e-9), choice.method
        np.testing.assert_allclose(surface.distance(p_OC), 0, atol=1e-9, err_msg=choice.method)
        assert 0 <= choice.margin <= 1
        assert 0 < choice.q_msv <= np.sqrt(5)
        assert choice.seconds > 0


def test_timed_ticks_divide_the_surface_though_contacts_rest(monkeypatch):
    count = 7
    monkeypatch.setattr(global_times, "TIMED", count)
    base = make_scene(cube(8))
    surface, p_OC = base.surface, base.starts[0]
    weigh, in_turns = PLANNERS["position"]
    divided = []
    own = type(surface.kernel)._partition

    def spy(kernel, r, *others):
        divided.append(r)
        return own(kernel, r, *others)

    monkeypatch.setattr(type(surface.kernel), "_partition", spy)
    for _ in range(2):  # As of contacts at rest: the second tick finds the first's regions.
        global_times._planned(surface, p_OC, weigh, in_turns)
    assert len(divided) == 1
    assert global_times.seconds_a_tick(surface, p_OC, weigh, in_turns=in_turns) > 0
    assert len(divided) == 1 + count
    np.testing.assert_allclose(divided, [p_OC - surface.p_OCoM] * (1 + count), atol=1e-8)


def test_parts_of_a_simulation_add_up():
    run = time_run(RunJob("numpy", 0.05, 0.2, 1))
    assert list(run.parts) == list(run.seconds) == list(PARTS)
    assert min(run.seconds.values()) > 0
    # Its own time is part of what has passed; what it waits for is little.
    assert 0 < sum(run.parts.values()) <= 1.05 * run.seconds[PARTS[-1]]


def test_parts_are_what_their_diagrams_take_more(monkeypatch):
    """By a clock that only the simulators advance; a thread works half of the time."""
    costs = np.random.default_rng(0).uniform(0.1, 10, len(PARTS)).tolist()
    now, ends = [0.0], {}
    duration, rounds = 0.2, 3

    class Simulator:
        def __init__(self, part, seconds):
            self.part, self.seconds = part, seconds

        def AdvanceTo(self, end):
            ends.setdefault(self.part, []).append(end)
            now[0] += self.seconds * (len(ends[self.part]) - 1)  # Nothing for the warm-up.

    takes = dict(zip(PARTS, np.cumsum(costs).tolist(), strict=True))
    clock = SimpleNamespace(perf_counter=lambda: now[0], thread_time=lambda: now[0] / 2)
    monkeypatch.setattr(base_case, "time", clock)
    monkeypatch.setattr(base_case, "implemented", lambda surface, name: surface)
    monkeypatch.setattr(base_case, "_diagrams", lambda *args: {part: part for part in PARTS})
    monkeypatch.setattr(base_case, "_simulator", lambda _, part: Simulator(part, takes[part]))
    run = time_run(RunJob("numpy", 0.05, duration, rounds))
    middle = 2 / duration  # The rounds take once, twice and three times as long.
    assert run.rate == pytest.approx(20)
    for part, cost in zip(PARTS, costs, strict=True):
        assert run.seconds[part] == pytest.approx(middle * takes[part], rel=1e-6)
        assert run.factor(part) == pytest.approx(1 / (middle * takes[part]), rel=1e-6)
        assert run.parts[part] == pytest.approx(middle * cost / 2, rel=1e-6, abs=1e-6)
        np.testing.assert_allclose(np.diff(ends[part]), duration)
    factors = [run.factor(part) for part in PARTS]
    assert factors == sorted(factors, reverse=True)


def test_fresh_processes_are_timed(monkeypatch):
    monkeypatch.setattr(startup, "implementations", lambda: ("numpy",))
    (row,) = time_starts(StartJob(1, False))
    assert min(row.imports, row.makes, row.ticks) > 0


def test_fresh_processes_find_what_the_caller_does(tmp_path, monkeypatch):
    """One process for each row; the medians are of each stage by itself."""
    seen = []

    def run(command, *, env, **others):
        seen.append(env)
        seconds = [[3.0, 1.0, 2.0], [1.0, 2.0, 0.0], [2.0, 9.0, 1.0]][len(seen) - 1]
        return subprocess.CompletedProcess(command, 0, stdout=json.dumps(seconds))

    monkeypatch.setattr(startup, "implementations", lambda: ("numpy",))
    monkeypatch.setattr(startup.subprocess, "run", run)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (row,) = time_starts(StartJob(3, False))
    assert (row.imports, row.makes, row.ticks) == (2, 2, 1)
    for environment in seen:
        first, *others = environment["PYTHONPATH"].split(os.pathsep)
        assert (Path(first) / "drake_pregrasp").is_dir()
        assert others == [str(tmp_path)]
    seen.clear()
    monkeypatch.delenv("PYTHONPATH")
    time_starts(StartJob(1, False))
    assert seen[0]["PYTHONPATH"] == first


def test_the_slope_of_memory_leaves_the_warm_up_out():
    ticks = list(range(WARM_UP // 2, 4 * WARM_UP, WARM_UP // 2))
    steady = [10**8 + 3 * count + (10**6 if count < WARM_UP else 0) for count in ticks]
    assert slope(ticks, steady) == pytest.approx(3)


def test_plans_differ_in_size_only():
    quick, full = quick_plan(), full_plan()
    assert {job.ways for job in quick.ticks} <= {job.ways for job in full.ticks}
    assert {job.strategy for job in full.ticks} == set(STRATEGIES)
    assert len(quick.ticks) < len(full.ticks)


def test_writes_its_files(tmp_path, monkeypatch):
    plan = Plan(
        memory=[MemoryJob(300)],
        ticks=[TickJob(BY_SIZE, cube(4), "vew", all_ways("vew"), 12, 60.0)],
        choices=[],
        runs=[RunJob(FASTEST, 0.05, 0.1, 1)],
        starts=[],
        shares=[],
    )
    monkeypatch.setattr(bench_module, "quick_plan", lambda: plan)
    before = dict(os.environ)
    steps = []
    path = bench(tmp_path / "b", quick=True, on_progress=lambda *step: steps.append(step))
    assert steps == [(1, 3), (2, 3), (3, 3)]
    assert dict(os.environ) == before
    names = {file.name for file in path.parent.iterdir()}
    assert names == {"bench.md", "bench.json", "ticks.png", "growth.png", "base_case.png"}
    content = json.loads((path.parent / "bench.json").read_text())
    assert {row["size"] for row in content["ticks"]} == {64}
    assert len(content["memory"][0]["ticks"]) == len(content["memory"][0]["resident"])
    text = path.read_text()
    assert "### vew" in text
    assert "20 Hz" in text
    for name in ("ticks.png", "growth.png", "base_case.png"):
        assert f"]({name})" in text


def row(size, way, p50, *, strategy="position", scaled=1.0, ports=0.0):
    return TickTimes(
        BY_SIZE, size, 5, 200, strategy, way, 10, p50, 2 * p50, scaled, ports, p50, 3 * p50
    )


def test_says_what_was_scaled_and_how_much_faster():
    rows = [
        row(5000, way, p50, strategy="msv", scaled=scaled)
        for way, p50, scaled in (("numpy", 1e-3, 1), ("BLAS", 8e-3, 1), ("direct", 0.3, 2.5))
    ]
    text = report(Outcome("here", ticks=rows))
    line = next(x for x in text.splitlines() if x.startswith("| 5,000"))
    assert line == "| 5,000 | 10 | 1 / 2 | 8 / 16 | 300 / 600* | 8 | 300 |"


def test_targets_are_computed_from_what_was_measured():
    fast = [
        row(99_856, FASTEST, 1e-4),
        row(99_856, "BLAS", 1e-3),
        row(99_856, "direct", 1e-2),
        row(99_856, f"{FASTEST} in Drake", 1e-4, ports=7e-5),
    ]
    found = {target.what: target for target in targets(Outcome("here", ticks=fast))}

    def verdict(start):
        (target,) = [t for what, t in found.items() if what.startswith(start)]
        return target.reached, target.met

    assert verdict("times faster than BLAS") == ("10", True)
    assert verdict("times faster than direct") == ("100", False)
    assert verdict("what Drake's ports add") == ("70 µs (median over sizes and strategies)", False)
    assert verdict(f"ticks with {FASTEST}") == ("1 of 1", True)
    assert verdict("99th percentile") == ("2.0 mostly, 2.0 at worst", True)
    assert verdict("the same of processor time") == ("3.0 mostly, 3.0 at worst", False)
    assert verdict("import") == ("not measured", False)


@pytest.mark.parametrize("way", implementations())
def test_shares_of_a_tick_are_a_whole(way):
    row = profile_ticks(ShareJob(cube(16), "gii", way, 20))
    assert row.size == 1024
    assert set(row.shares) == {*STAGES, REST}
    assert sum(row.shares.values()) == pytest.approx(1)
    # All of them were met, and none of them holds another.
    assert all(share > 0 for share in row.shares.values())
