"""Simulation of one run of a sweep, and the measures in its row."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario, resolve_scenario
from drake_pregrasp.simulation.run import LoggedRun
from drake_pregrasp.simulation.run_log import adapting_phase, pose_columns
from drake_pregrasp.simulation.scenario_file import read_mapping, scenario_from_data
from drake_pregrasp.simulation.summary import force_closure_summary, seen_from, summarize_grasp
from drake_pregrasp.studies.sweep.field_path import with_fields
from drake_pregrasp.studies.sweep.sweep_plan import SEED_FIELD, SweepPlan

_QUALITIES = {"q_msv": "Q_MSV", "q_gii": "Q_GII", "q_vew": "Q_VEW"}
_EXTREMES = ("mean", "min", "max")  # Functions of numpy.
LABELS = read_mapping(Path(__file__).with_name("measures.yaml"))
"""Labels of measures by their names, in groups, and the fields of scenarios by their `units`."""

_MOTION, _MARGINS, _GRASP = (LABELS[group] for group in ("motion", "margins", "grasp"))

MEASURES: Mapping[str, str] = {
    **{
        f"{name}_{kind}": f"{label}, {kind}"
        for name, label in _QUALITIES.items()
        for kind in (*_EXTREMES, "final")
    },
    **_MOTION,
    **_MARGINS,
    "grasp_holds": "object held at the end (0 or 1)",
    "grasp_link_force": "largest force of a link that touches something [N]",
    **{f"grasp_{name}": label for name, label in _GRASP.items()},
}
"""Labels of all measures by their names. Means, extremes and shares are over the phase in which
all contacts adapt."""

DEFAULT_MEASURES = (*(f"{q}_{kind}" for q in _QUALITIES for kind in ("mean", "final")), *_MOTION)
"""Default measures of a study."""


@dataclass(frozen=True)
class SweepRun:
    """Simulates and measures runs of a sweep, without leaving files.

    Attributes:
        plan: Plan of the runs.
        scenario: Common scenario of all runs, as `scenario_data` returns it.
        source: File of the study, for messages.
        folder: Folder at which relative paths in swept values start.
        folders: Further folders that may hold named files.
        measures: Names of the measures to return.
    """

    plan: SweepPlan
    scenario: Mapping[str, Any]
    source: str
    folder: Path
    folders: tuple[str, ...]
    measures: tuple[str, ...]

    def __call__(self, job: Mapping[str, Any]) -> dict[str, float]:
        """Returns the measures of a job's run, nan where there is nothing to measure."""
        changes = self.plan.changes(job["index"]) | {SEED_FIELD: job["seed"]}
        data = with_fields(self.scenario, changes, self.source)
        scenario = scenario_from_data(
            data, source=self.source, folder=self.folder, folders=self.folders
        )
        with TemporaryDirectory(prefix="drake_pregrasp_") as folder:
            resolved = resolve_scenario(scenario, self.source)
            logged = LoggedRun(resolved, Path(folder))
            logged.simulate()
            return measure(resolved, logged, self.measures)


def measure(
    resolved: ResolvedScenario, logged: LoggedRun, names: Sequence[str]
) -> dict[str, float]:
    """Returns measures of a run, nan where there is nothing to measure.

    Args:
        resolved: Scenario of the run.
        logged: Simulated run, whose log files still exist.
        names: Names of the measures, keys of `MEASURES`.
    """
    log = logged.log
    columns = dict(zip(log.columns, log.read(*log.columns), strict=True))
    values: dict[str, Any] = _of_log(resolved, columns)
    if any(name in _MARGINS for name in names):  # Margins are as slow as seconds of simulation.
        margins = force_closure_summary(resolved, static=None, final=log.last)
        values |= {name: margins[name]["final"] for name in _MARGINS}
    if logged.grasp_log is not None:
        grasp = summarize_grasp(resolved, logged.grasp_log)
        values |= {f"grasp_{name}": grasp[f"{name}_mm"] for name in _GRASP}
        values["grasp_holds"] = grasp["phase"] == "hold"
        values["grasp_link_force"] = max(grasp["link_forces"].values())
    found = {name: values.get(name) for name in names}
    return {name: np.nan if value is None else float(value) for name, value in found.items()}


def _of_log(resolved: ResolvedScenario, columns: Mapping[str, FloatArray]) -> dict[str, Any]:
    scenario, time = resolved.scenario, columns["time"]
    phase = adapting_phase(scenario, time)
    values: dict[str, Any] = {"ticks": len(time)}
    if len(time):
        values |= {f"{name}_final": columns[name][-1] for name in _QUALITIES}
    if not len(time[phase]):
        return values
    for name in _QUALITIES:
        for kind in _EXTREMES:
            values[f"{name}_{kind}"] = getattr(np, kind)(columns[name][phase])
    contacts = range(resolved.num_contacts)
    active = np.stack([columns[f"c{i}_active"] for i in contacts], axis=1) > 0
    seconds = len(time[phase]) * scenario.planner.period
    error = columns["position_error"][phase]
    return values | {
        "motion_on_object": 1e3 * _motion_on_object(columns, active)[phase].sum() / seconds,
        "displacement": 1e3 * columns["displacement"][phase].sum() / seconds,
        "position_error_mean": 1e3 * np.nanmean(error),
        "position_error_max": 1e3 * np.nanmax(error),
        "active_share": active[phase].mean(),
    }


def _motion_on_object(columns: Mapping[str, FloatArray], active: BoolArray) -> FloatArray:
    """Returns the summed motion of contacts over the object since the previous tick, in metres.

    Positions are in the estimated object frame; contacts that are inactive at either
    tick do not count. Shape (ticks,), 0 at the first tick.
    """
    names = [f"c{i}_{axis}" for i in range(active.shape[1]) for axis in "xyz"]
    p_WC = np.stack([columns[name] for name in names], axis=1).reshape(len(active), -1, 3)
    poses = np.stack([columns[name] for name in pose_columns("wo_estimated")], axis=1)
    p_OC = seen_from(poses, p_WC)
    steps = np.linalg.norm(np.diff(p_OC, axis=0), axis=2)
    both = active[1:] & active[:-1]
    return np.concatenate([[0.0], np.where(both, steps, 0.0).sum(axis=1)])
