"""A scenario in, a run folder out."""

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydrake.systems.framework import Diagram

from drake_pregrasp.errors import ScenarioError
from drake_pregrasp.simulation.logged_run import LoggedRun
from drake_pregrasp.simulation.metrics_plot import plot_metrics
from drake_pregrasp.simulation.output import write_text, writing
from drake_pregrasp.simulation.recording import recording_html, start_meshcat
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_check import check_recording
from drake_pregrasp.simulation.scenario_file import check_scenario, dump_scenario
from drake_pregrasp.simulation.summary import summarize, summarize_grasp
from drake_pregrasp.systems.loggers import TickRecord

RUN_FILES = (
    "recording.html",
    "log.csv",
    "grasp.csv",
    "summary.json",
    "metrics.png",
    "diagram.dot",
    "diagram.svg",
    "scenario.yaml",
)
"""What a run folder may hold; a new run into it replaces these and touches nothing else."""


@dataclass(frozen=True)
class RunResult:
    """What a run has left.

    Attributes:
        folder: The run folder.
        summary: The content of its `summary.json`.
    """

    folder: Path
    summary: dict[str, Any]

    @property
    def completed(self) -> bool:
        """Whether the run went on to its end."""
        return bool(self.summary["completed"])


def run(
    scenario: Scenario,
    *,
    name: str,
    out: str | Path = "runs",
    recording: bool = True,
    on_tick: Callable[[TickRecord], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> RunResult:
    """Simulates a scenario and writes the run folder `out/name`.

    Args:
        scenario: What to simulate.
        name: Name of the run folder: letters, digits, `_`, `-` and `.`.
        out: Folder for run folders; made if it isn't there.
        recording: Whether to record `recording.html`.
        on_tick: Called at each planning tick.
        should_stop: Asked after each step; the run ends early once it returns true.

    Raises:
        ScenarioError: If the scenario or its name can't be used.
        OutputError: If the run folder can't be written.
    """
    check_scenario(scenario)
    if recording:
        check_recording("scenario", scenario, scenario.make_surface())
    meshcat = start_meshcat() if recording else None
    logged = LoggedRun(scenario, meshcat=meshcat, on_tick=on_tick)
    folder = _prepare_folder(Path(out), name)  # Not before all else is known to be in order.
    write_text(folder / "scenario.yaml", dump_scenario(name, scenario))
    write_graphviz(logged.diagram, folder / "diagram.dot")
    _draw_graphviz(folder / "diagram.dot")
    logged.simulate(folder, should_stop)
    if meshcat is not None:
        write_text(folder / "recording.html", recording_html(meshcat))
    summary = summarize(
        name,
        scenario,
        logged.surface,
        logged.log,
        wall_seconds=logged.wall_seconds,
        completed=logged.completed,
    )
    if logged.grasp_log is not None:
        summary["grasp"] = summarize_grasp(scenario, logged.grasp_log)
    write_text(folder / "summary.json", json.dumps(summary, indent=2) + "\n")
    with writing(folder):
        plot_metrics(folder / "metrics.png", name, scenario, logged.log, summary)
    return RunResult(folder=folder, summary=summary)


def write_graphviz(diagram: Diagram, path: Path) -> None:
    """Writes a diagram's Graphviz text.

    Raises:
        OutputError: If the file can't be written.
    """
    write_text(path, diagram.GetGraphvizString(max_depth=2))


def _draw_graphviz(path: Path) -> None:
    """Draws a Graphviz file as SVG beside it, where Graphviz is installed."""
    dot = shutil.which("dot")
    if dot is not None:
        command = [dot, "-Tsvg", "-o", str(path.with_suffix(".svg")), str(path)]
        subprocess.run(command, check=False, capture_output=True)


def _prepare_folder(out: Path, name: str) -> Path:
    if not re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*", name):
        raise ScenarioError("", name, "a run's name is made of letters, digits, '_', '-' and '.'")
    folder = out / name
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for file in RUN_FILES:
            (folder / file).unlink(missing_ok=True)
    return folder
