"""Times of the simulated base case, and of a fresh process until its first tick."""

import json
import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator

from drake_pregrasp.diagrams.object_plant import ObjectPlant
from drake_pregrasp.simulation.recording import start_meshcat
from drake_pregrasp.simulation.run_log import RunLog
from drake_pregrasp.simulation.scenario_file import load_scenario
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.studies.bench.tick_times import chosen, implementations

PARTS = ("physics", "sensor and planner", "measures and log.csv", "recording")
"""Parts of a simulation, in the order in which they are added to the timed diagrams."""

_WARM_UP = 10  # Number of planning ticks before the measurement.

_FIRST_TICK = """
import json, sys, time
start = time.perf_counter()
import drake_pregrasp
imported = time.perf_counter() - start
from drake_pregrasp import PlannerConfig
from drake_pregrasp.studies.bench.tick_times import cube, make_scene, make_tick
start = time.perf_counter()
surface, starts = make_scene(cube(24))
make_tick(surface, sys.argv[1], starts[0], PlannerConfig(strategy="gii"))(starts[0])
print(json.dumps([imported, time.perf_counter() - start]))
"""


class RunJob(NamedTuple):
    """Simulations of the base case to time.

    Attributes:
        implementation: Name of the planner's implementation.
        period: Planning period in seconds.
        duration: Simulated time of each round in seconds.
        rounds: Number of rounds, in each of which all diagrams advance in turn.
    """

    implementation: str
    period: float
    duration: float
    rounds: int


def time_run(job: RunJob) -> list[dict[str, Any]]:
    """Returns a row for each of `PARTS`: the real-time factor with it, and its processor time.

    Each diagram has one part more than the previous one. Contacts adapt from the start. The added
    time of a part is processor time of this thread, so other processes do not affect it.
    """
    scenario = load_scenario("a_base")
    scenario.planner.period, scenario.planner.static_duration = job.period, 0.0
    surface = scenario.make_surface()
    times: list[list[tuple[float, float]]] = []
    with ExitStack() as stack:
        stack.enter_context(chosen(job.implementation))
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        log, recorded = (
            stack.enter_context(RunLog(Path(folder) / name, scenario.num_contacts)).append
            for name in ("log.csv", "recorded.csv")
        )
        diagrams = (
            ObjectPlant(scenario.object, scenario.motion, scenario.plant_config),
            make_diagram(scenario, surface),
            make_diagram(scenario, surface, sink=log),
            make_diagram(scenario, surface, sink=recorded, meshcat=start_meshcat(), record=True),
        )
        simulators = [Simulator(diagram) for diagram in diagrams]
        for simulator in simulators:
            ApplySimulatorConfig(scenario.simulator_config, simulator)
            simulator.set_target_realtime_rate(0)
            simulator.AdvanceTo(_WARM_UP * job.period)
        for round_ in range(job.rounds):
            end = _WARM_UP * job.period + (round_ + 1) * job.duration
            times.append([])
            for simulator in simulators:
                start, own_start = time.perf_counter(), time.thread_time()
                simulator.AdvanceTo(end)
                passed = time.perf_counter() - start, time.thread_time() - own_start
                times[-1].append(passed)
    seconds, own = np.moveaxis(np.array(times) / job.duration, 2, 0)
    added = np.median(np.diff(own, axis=1, prepend=0), axis=0)
    return [
        {
            "planning": f"{1 / job.period:,.0f} Hz",
            "implementation": job.implementation,
            "part": part,
            "x real time": 1 / float(whole),
            "added [ms]": 1e3 * float(add),
        }
        for part, whole, add in zip(PARTS, np.median(seconds, axis=0), added, strict=True)
    ]


def time_starts(processes: int, *, compiling: bool) -> list[dict[str, Any]]:
    """Returns rows with the times of the import and of the first tick in fresh processes.

    Args:
        processes: Number of processes for each implementation; rows have their medians.
        compiling: Whether to start with an empty cache of compiled code, and to time the
            compilation too.
    """
    rows = []
    with tempfile.TemporaryDirectory() as cache:
        own_cache = {"NUMBA_CACHE_DIR": cache} if compiling else {}
        for implementation in implementations():
            first = _start(implementation, own_cache)
            if compiling and implementation == "numba":
                rows.append(("numba, nothing compiled yet", *first))
            later = [_start(implementation, own_cache) for _ in range(processes)]
            rows.append((implementation, *np.median(later, axis=0).tolist()))
    columns = ("implementation", "import [s]", "surface and first tick [s]")
    return [dict(zip(columns, row, strict=True)) for row in rows]


def _start(implementation: str, variables: dict[str, str]) -> list[float]:
    root = str(Path(__file__).parents[3])
    paths = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    # -P: the package comes from the caller's paths, not from the current folder.
    done = subprocess.run(
        [sys.executable, "-P", "-c", _FIRST_TICK, implementation],
        env={**os.environ, "PYTHONPATH": paths, **variables},
        check=True,
        capture_output=True,
        text=True,
    )
    seconds: list[float] = json.loads(done.stdout)
    return seconds
