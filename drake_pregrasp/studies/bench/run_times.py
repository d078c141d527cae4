"""Times of simulated scenarios, and of a fresh process until its first tick."""

import json
import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, EventStatus, LeafSystem

from drake_pregrasp.errors import MissingPackageError, ScenarioError
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.run import LoggedRun
from drake_pregrasp.simulation.scenario_file import load_scenario, resolve
from drake_pregrasp.simulation.simulation_diagram import make_simulator
from drake_pregrasp.studies.bench.tick_times import implementations, kernels_of, tick_columns

_TURN, _WARM_UP = 20, 3  # Planning ticks of a turn, and its first ones, which do not count.

_PROGRAM = """
import json, sys, time
start = time.process_time()
import drake_pregrasp
imported = time.process_time() - start
from drake_pregrasp.studies.bench.tick_times import PLAIN, Scene, make_scene, make_tick
start = time.process_time()
surface, _, starts = make_scene(Scene(24))
make_tick(surface, sys.argv[1], starts[0], PLAIN)(starts[0])
print(json.dumps([imported, time.process_time() - start]))
"""


class RunJob(NamedTuple):
    """A scenario to simulate without a recording.

    Attributes:
        name: Name of the run.
        scenario: Name of a shipped scenario.
        text: YAML that overrides keys of the scenario.
        ticks: Largest number of planning ticks; the scenario's duration is another limit.
    """

    name: str
    scenario: str
    text: str = "{}"
    ticks: int = 200


class _TickTimer(LeafSystem):
    """Asks a simulation's planner for its goals before any other system does, and times it.

    The time of a tick is NaN if a hand holds the contacts, because then nothing is planned.

    Publish events of one time run in the order in which systems were added. Add this system before
    the simulation.
    """

    def __init__(self, simulation: Diagram, period: float) -> None:
        super().__init__()
        self._planner = simulation.GetSubsystemByName("pregrasp_planner")
        self._p_WC = self._planner.GetOutputPort("p_WC")
        self._hold = self._planner.GetInputPort("hold_contacts")
        self.seconds: list[float] = []
        self.root_context: Context | None = None
        self.DeclarePeriodicPublishEvent(period, 0.0, self._time)

    def _time(self, context: Context) -> EventStatus:
        own = self._planner.GetMyContextFromRoot(self.root_context)
        start = time.thread_time()
        self._p_WC.Eval(own)
        seconds = time.thread_time() - start
        is_held = self._hold.HasValue(own) and self._hold.Eval(own)[0] > 0
        self.seconds.append(np.nan if is_held else seconds)
        return EventStatus.Succeeded()


class _TimedRun:
    """Simulation of a scenario that logs as a run does, and advances tick by tick."""

    def __init__(self, resolved: ResolvedScenario, folder: Path, stack: ExitStack) -> None:
        logged, scenario = LoggedRun(resolved, folder), resolved.scenario
        for log in filter(None, (logged.log, logged.grasp_log)):
            stack.enter_context(log)
        builder, self._period = DiagramBuilder(), scenario.planner.period
        self.timer = builder.AddSystem(_TickTimer(logged.diagram, self._period))
        builder.AddSystem(logged.diagram)
        self._simulator = make_simulator(builder.Build(), scenario)
        self._simulator.set_target_realtime_rate(0)
        self.timer.root_context = self._simulator.get_context()
        self.seconds: list[float] = []

    def advance(self) -> None:
        """Simulates until the next planning tick."""
        start = time.thread_time()
        self._simulator.AdvanceTo((len(self.seconds) + 1) * self._period)
        self.seconds.append(time.thread_time() - start)


def time_run(job: RunJob) -> list[dict[str, Any]]:
    """Returns a row for each implementation; all simulations advance in turn, by 20 ticks.

    The first three ticks of a turn do not count: the other simulation has filled the processor's
    caches with its own data. Contacts adapt from the start. All times are processor times of this
    thread, so other processes hardly affect them. If the scenario needs an extra that is not
    installed, the only row says so.
    """
    try:
        scenario = load_scenario(job.scenario, text=job.text)
        scenario.planner.static_duration = 0.0  # Contacts adapt from the start.
        resolved = resolve(scenario)
    except ScenarioError as error:
        if not _lacks_package(error):
            raise
        return [{"run": job.name, "not run": error.problem}]
    period = scenario.planner.period
    ticks = min(job.ticks, int(scenario.simulation_duration / period))
    counts = np.arange(ticks) % _TURN >= _WARM_UP
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        runs = {}
        for name in implementations():
            (Path(folder) / name).mkdir()
            own = replace(resolved, kernels=kernels_of(name))
            runs[name] = _TimedRun(own, Path(folder) / name, stack)
        for begin in range(0, ticks, _TURN):
            for run in runs.values():
                for _ in range(begin, min(begin + _TURN, ticks)):
                    run.advance()
    return [
        {
            "run": job.name,
            "implementation": name,
            **tick_columns(np.array(run.timer.seconds[1:])[counts]),  # The first is at time 0.
            "processor s / s": (load := float(np.mean(np.array(run.seconds)[counts])) / period),
            "x real time": 1 / load,
        }
        for name, run in runs.items()
    ]


def _lacks_package(error: BaseException | None) -> bool:
    """Returns whether a package of an extra is missing, as an error or a cause of it says."""
    while error is not None and not isinstance(error, MissingPackageError):
        error = error.__cause__
    return error is not None


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
            if compiling and implementation == "fast":
                rows.append((implementation, "first", *first))
            later = [_start(implementation, own_cache) for _ in range(processes)]
            rows.append((implementation, "later", *np.median(later, axis=0).tolist()))
    columns = ("implementation", "start", "import [s]", "surface and first tick [s]")
    return [dict(zip(columns, row, strict=True)) for row in rows]


def _start(implementation: str, variables: dict[str, str]) -> list[float]:
    root = str(Path(__file__).parents[3])
    paths = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    # -P: the package comes from the caller's paths, not from the current folder.
    done = subprocess.run(
        [sys.executable, "-P", "-c", _PROGRAM, implementation],
        env={**os.environ, "PYTHONPATH": paths, **variables},
        check=True,
        capture_output=True,
        text=True,
    )
    seconds: list[float] = json.loads(done.stdout)
    return seconds
