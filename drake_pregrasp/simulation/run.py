"""Simulates a scenario and writes its run folder."""

import contextlib
import json
import os
import re
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, Diagram, EventStatus

from drake_pregrasp.config.yaml_text import MAX_BYTES
from drake_pregrasp.errors import InvalidArgumentError, OutputError, ScenarioError
from drake_pregrasp.interfaces import PACKAGES
from drake_pregrasp.interfaces.mcap_log import McapLog
from drake_pregrasp.resources import read_bounded_text, require_packages
from drake_pregrasp.simulation import output
from drake_pregrasp.simulation.recording import (
    camera_view,
    make_timeline,
    recording_html,
    start_meshcat,
)
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.run_log import GraspLog, RunLog, static_end, tick_table
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_check import check_recording
from drake_pregrasp.simulation.scenario_file import dump_scenario, resolve
from drake_pregrasp.simulation.simulation_diagram import make_diagram, make_simulator
from drake_pregrasp.simulation.summary import plot_metrics, summarize, summarize_grasp
from drake_pregrasp.systems.loggers import GraspRecord, TickRecord
from drake_pregrasp.visualization.drawing import contact_color

MCAP_FILE = "run.mcap"
"""Name of the log for Foxglove, which is made on demand."""

EXPORT_FILE = "grasp.npz"
"""Name of the arrays of `drake-pregrasp export`, which a new run deletes."""

_INPUT_FILES = ("scenario.yaml", "diagram.dot", "diagram.svg")
_LOGS = ("log.csv", "grasp.csv", MCAP_FILE)
_RESULTS = (*_LOGS, "summary.json", "metrics.png", "recording.html", EXPORT_FILE)

RUN_FILES = (*_INPUT_FILES, *_RESULTS)
"""Names of the files of a run folder. A new run replaces these and no other files."""


_DRAWING = 10.0  # Longest time for which Graphviz may draw, in seconds.


@dataclass(frozen=True)
class RunResult:
    """Result of a run.

    Attributes:
        folder: Run folder; or the folder in it with the files of this run, if it was stopped early
            and an earlier run is there.
        summary: Content of the folder's `summary.json`.
        replaced: Whether an earlier run in the folder was replaced.
    """

    folder: Path
    summary: dict[str, Any]
    replaced: bool = False

    @property
    def completed(self) -> bool:
        """Whether the run reached its end."""
        return bool(self.summary["completed"])


def check_name(name: str) -> None:
    """Checks the name of a run, which its folder and files have.

    Raises:
        ScenarioError: If it has other characters than letters, digits, `_`, `-` and `.`, or begins
            with `_` or `.`.
    """
    if not re.fullmatch(r"[A-Za-z0-9-][A-Za-z0-9_.-]*", name):
        problem = "a run's name must have only letters, digits, '_', '-', '.'"
        raise ScenarioError("", name, f"{problem}, and not begin with '_' or '.'")


def valid_name(text: str) -> str:
    """Returns a text with `_` in place of characters that `check_name` refuses."""
    return re.sub(r"[^A-Za-z0-9_.-]", "_", text).lstrip("_.")


def run(
    scenario: Scenario | ResolvedScenario,
    *,
    name: str,
    out: str | Path = "runs",
    recording: bool = True,
    mcap: bool = False,
    overwrite: bool = False,
    on_tick: Callable[[TickRecord], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> RunResult:
    """Simulates a scenario and writes the run folder `out/name`.

    An earlier run of the same scenario in that folder is replaced at the end. A run that fails
    leaves it, and its own files so far in the folder `partial-1` or with the next free number.

    Args:
        scenario: Scenario to simulate.
        name: Name of the run folder; see `check_name`.
        out: Parent of the run folders, made if it does not exist.
        recording: Whether to write `recording.html`.
        mcap: Whether to write `run.mcap`, which Foxglove shows; it needs the extra `interfaces`.
        overwrite: Whether to replace even a run of another scenario.
        on_tick: Function that is called with each planning tick, which it must not change.
        should_stop: Function that is called after each step; if it returns true, the run ends
            early.

    Raises:
        ScenarioError: If the scenario or the name is invalid.
        InvalidArgumentError: If a package of the extra `interfaces` is needed and not installed.
        OutputError: If the run folder cannot be written, has a run of another scenario, or is in
            use by another run.
    """
    check_name(name)
    resolved = resolve(scenario)
    if recording:
        check_recording("scenario", resolved.scenario, resolved.surface)
    if mcap:
        require_packages(*PACKAGES, extra="interfaces", purpose=MCAP_FILE)
    folder, text = Path(out) / name, dump_scenario(name, resolved.scenario)
    output.make_folder(folder)
    if folder.is_symlink():
        raise OutputError(f"{folder}: is a link, which is not followed; choose another --out")
    with output.claimed(folder):
        earlier = [file for file in RUN_FILES if os.path.lexists(folder / file)]
        if earlier and not overwrite and not _holds(folder / "scenario.yaml", text):
            raise OutputError(
                f"{folder}: holds a run of another scenario or with other settings; choose another"
                " folder with --out, or replace it with --overwrite (in Python: out, overwrite)"
            )
        # Nobody has prepared this folder, and what goes wrong in it leaves the earlier run alone.
        partial = output.make_numbered_folder(folder / "partial")
        try:
            meshcat = start_meshcat() if recording else None
            logged = LoggedRun(
                resolved, partial, name=name, meshcat=meshcat, mcap=mcap, on_tick=on_tick
            )
            output.write_text(partial / "scenario.yaml", text)
            write_graphviz(logged.diagram, partial / "diagram.dot")
            _draw_graphviz(partial / "diagram.dot")
            logged.simulate(should_stop)
            summary = _write_results(partial, name, resolved, logged)
            if meshcat is not None:
                page = recording_html(meshcat, logged.timeline)
                output.write_text(partial / "recording.html", page)
            replaces = bool(earlier) and logged.completed
            if logged.completed or not earlier:
                output.swap_in(partial, folder, RUN_FILES)
                partial = folder
        finally:
            with contextlib.suppress(OSError):
                partial.rmdir()  # If nothing was written.
    return RunResult(folder=partial, summary=summary, replaced=replaces)


def _write_results(
    folder: Path, name: str, resolved: ResolvedScenario, logged: "LoggedRun"
) -> dict[str, Any]:
    """Writes summary and metrics of a simulated run, and returns the summary."""
    summary = summarize(
        name,
        resolved,
        logged.log,
        wall_seconds=logged.wall_seconds,
        completed=logged.completed,
    )
    if logged.grasp_log is not None:
        summary["grasp"] = summarize_grasp(resolved, logged.grasp_log)
    output.write_text(folder / "summary.json", json.dumps(summary, indent=2) + "\n")
    plot_metrics(folder / "metrics.png", name, resolved.scenario, logged.log, summary)
    return summary


def _holds(file: Path, text: str) -> bool:
    with contextlib.suppress(InvalidArgumentError):
        return not file.is_symlink() and read_bounded_text(file, MAX_BYTES) == text
    return False


class LoggedRun:
    """A scenario's diagram with the logs of its simulation.

    Args:
        resolved: Scenario to simulate.
        folder: Folder for `log.csv` and, with a hand, `grasp.csv`.
        name: Name of the run, for the title of its timeline.
        meshcat: Viewer that records the simulation; None for no recording.
        mcap: Whether to write `run.mcap`.
        on_tick: Function that is called with each planning tick, which it must not change.

    Attributes:
        timeline: Timeline of the run, for its recording.
        log: Log of the planning ticks.
        grasp_log: Log of the control ticks; None without a hand.
        diagram: Diagram of the simulation.
        completed: Whether the simulation reached its end.
        wall_seconds: Computing time of the simulation, in seconds.
    """

    def __init__(
        self,
        resolved: ResolvedScenario,
        folder: Path,
        *,
        name: str = "",
        meshcat: Meshcat | None = None,
        mcap: bool = False,
        on_tick: Callable[[TickRecord], None] | None = None,
    ) -> None:
        n, lookahead = resolved.num_contacts, resolved.planner.estimator.lookahead
        end, has_hand = static_end(resolved.scenario), resolved.hand is not None
        colors = np.array([contact_color(i).rgba[:3] for i in range(n)])
        mcap_log = McapLog(folder / MCAP_FILE, resolved.surface, colors) if mcap else None
        self.log = log = RunLog(folder / "log.csv", n, static_end=end, lookahead=lookahead)
        self._mcap = mcap_log
        self.grasp_log = grasp_log = GraspLog(folder / "grasp.csv", n) if has_hand else None
        camera = None if meshcat is None else camera_view(resolved)
        timeline = self.timeline = make_timeline(resolved, name, camera)
        self._scenario = resolved.scenario
        self.completed, self.wall_seconds = False, 0.0

        def add_tick(record: TickRecord) -> None:
            # A reference to the diagram from here would be a cycle that keeps it alive.
            parts = log.append(record)
            if mcap_log is not None:
                row = tick_table(*([part] for part in parts))[0]
                named = dict(zip(log.columns, row.tolist(), strict=True))
                with output.writing(mcap_log.path):
                    mcap_log.append(named, record.regions.labels)
            if meshcat is not None:
                timeline.add_tick(record)
            if on_tick is not None:
                on_tick(record)

        def add_grasp(record: GraspRecord) -> None:
            assert grasp_log is not None
            grasp_log.append(record)
            if meshcat is not None:
                timeline.add_grasp(record)

        self.diagram = make_diagram(
            resolved,
            sink=add_tick,
            grasp_sink=None if grasp_log is None else add_grasp,
            picture_sink=None if meshcat is None else timeline.add_picture,
            meshcat=meshcat,
            record=True,
            camera=camera,
        )

    def simulate(self, should_stop: Callable[[], bool] | None = None) -> None:
        """Simulates the scenario; called at most once.

        Args:
            should_stop: Function that is called after each step; if it returns true, the
                simulation ends early.

        Raises:
            OutputError: If a log cannot be written.
        """
        simulator = make_simulator(self.diagram, self._scenario)
        stopped = False

        def monitor(context: Context) -> EventStatus:
            nonlocal stopped
            stopped = should_stop is not None and should_stop()
            if stopped:
                return EventStatus.ReachedTermination(self.diagram, "stopped on request")
            return EventStatus.DidNothing()

        simulator.set_monitor(monitor)
        with contextlib.ExitStack() as logs:
            logs.enter_context(self.log)
            if self._mcap is not None:
                logs.enter_context(_opened(self._mcap))
            if self.grasp_log is not None:
                logs.enter_context(self.grasp_log)
            start = time.perf_counter()
            simulator.Initialize()
            simulator.AdvanceTo(self._scenario.simulation_duration)
            self.wall_seconds = time.perf_counter() - start
        self.completed = not stopped


@contextlib.contextmanager
def _opened(log: McapLog) -> Iterator[None]:
    """Opens a log for the block. Only errors of the log itself name its file."""
    with output.writing(log.path):
        log.open()
    try:
        yield
    finally:
        with output.writing(log.path):
            log.close()


def write_graphviz(diagram: Diagram, path: Path) -> None:
    """Writes a diagram as Graphviz text.

    Raises:
        OutputError: If the file cannot be written.
    """
    output.write_named_text(path, diagram.GetGraphvizString(max_depth=2))


def _draw_graphviz(path: Path) -> None:
    """Draws a Graphviz file as SVG beside it, if Graphviz is installed."""
    if dot := shutil.which("dot"):
        # A picture is no reason to fail: dot may be broken, or stuck.
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            drawn = subprocess.run(
                [dot, "-Tsvg", str(path)], check=True, capture_output=True, timeout=_DRAWING
            )
            output.write_text(path.with_suffix(".svg"), drawn.stdout.decode())
