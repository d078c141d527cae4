"""Study of measurement faults over many seeds, and of the pose filter's consistency."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.geometry.surface import CONTACT_TOLERANCE, ObjectSurface
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.scenario_file import load_resolved, shipped_scenarios
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.studies import study_options
from drake_pregrasp.studies.filter_consistency import FILTERS, consistency_table, run_filter
from drake_pregrasp.studies.report_page import Part, Table, write_report
from drake_pregrasp.studies.runner import OnProgress, StudyRows, run_jobs
from drake_pregrasp.systems.loggers import TickRecord

SEEDS = 50
"""Default number of seeds for each fault."""

FILTER_SEEDS = 200
"""Number of seeds for the filter's consistency."""

GOAL_RECOVERY = 0.5
"""Time after a fault within which the estimate should recover, in seconds."""

RECOVERED = 4.0
"""Largest error of a recovered estimate, in standard deviations of the sensor."""

PREFIX = "fault_"
"""Prefix of the names of shipped scenarios with faults."""


class FaultJob(NamedTuple):
    """A shipped scenario and a seed."""

    scenario: str
    seed: int


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `drake-pregrasp study faults`."""
    parser.set_defaults(command=_command)
    study_options.add_out_option(parser, "study_faults")
    parser.add_argument(
        "--faults",
        type=study_options.names,
        metavar="a,b,...",
        help=f"names of shipped {PREFIX}... scenarios; if not set, all of them, and the"
        " consistency of the filter",
    )
    parser.add_argument(
        "--seeds",
        type=study_options.whole_number(1, study_options.MOST_SEEDS),
        default=SEEDS,
        metavar="N",
        help="number of seeds for each fault; %(default)s if not set",
    )
    study_options.add_processes_option(parser)


def _command(options: argparse.Namespace) -> int:
    return study_options.make_rows_and_report(
        lambda on_progress: study_faults(
            options.out,
            faults=options.faults,
            seeds=options.seeds,
            filter_seeds=0 if options.faults else FILTER_SEEDS,
            processes=options.processes,
            on_progress=on_progress,
        ),
        folder=Path(options.out),
    )


def fault_scenarios() -> dict[str, str]:
    """Returns the names of the shipped scenarios with faults, and their descriptions."""
    return {n: text for n, (_, text) in shipped_scenarios().items() if n.startswith(PREFIX)}


def study_faults(
    out: str | Path,
    *,
    faults: Sequence[str] | None = None,
    seeds: int = SEEDS,
    filter_seeds: int = FILTER_SEEDS,
    processes: int | None = None,
    on_progress: OnProgress = lambda done, total: None,
) -> tuple[StudyRows, Path]:
    """Runs each fault with each seed.

    Args:
        out: Folder of the rows and the report.
        faults: Names of the scenarios; all if not set.
        seeds: Number of seeds for each fault.
        filter_seeds: Number of seeds for the filter's consistency; 0 to leave it out.
        processes: Number of runs at a time.
        on_progress: Called with the number of finished runs and the number of runs to do.

    Returns:
        The rows of the runs, and the path of `faults.md`.

    Raises:
        InvalidArgumentError: If a name is not that of a shipped scenario with faults.
        OutputError: If the folder cannot be used.
    """
    known = fault_scenarios()
    chosen = list(known) if faults is None else list(dict.fromkeys(faults))
    for name in chosen:
        if name not in known:
            problem = f"faults: {name!r} is no scenario with faults; there are: {', '.join(known)}"
            raise InvalidArgumentError(problem)
    folder = Path(out)
    jobs = [FaultJob(name, seed) for seed in range(seeds) for name in chosen]
    found = run_jobs(run_faults, jobs, folder=folder, processes=processes, on_progress=on_progress)
    parts: list[Part] = [
        "Medians over seeds, and the largest value in brackets. Shares are of ticks: of all for"
        " contacts, of those with the fault for the status. An estimate has recovered when its"
        f" errors stay within {RECOVERED:g} standard deviations of the sensor.",
        Table(fault_table(found.rows)),
        f"Valid contacts at all ticks: in {(found.rows.valid == 1).sum()} of {len(found.rows)}"
        f" runs. Recovered within {GOAL_RECOVERY:g} s: in"
        f" {(found.rows.recovery <= GOAL_RECOVERY).sum()} of {len(found.rows)}.",
    ]
    if filter_seeds:
        filters = run_jobs(
            run_filter,
            [{"filter": name, "seed": seed} for name in FILTERS for seed in range(filter_seeds)],
            folder=folder / "filter",
            processes=processes,
            on_progress=on_progress,
        )
        parts += [
            f"{filter_seeds} runs each; position, orientation. 6 and 3 are expected.",
            Table(consistency_table(filters.rows)),
        ]
    return found, write_report(folder, "", parts, name="faults", formats=("md",))


def run_faults(job: FaultJob, text: str | None = None) -> dict[str, float]:
    """Simulates a job, and returns its summary by `summarize_faults`.

    Args:
        job: The scenario and the seed.
        text: YAML that overrides single keys of the scenario.
    """
    resolved = load_resolved(job.scenario, text=text)
    scenario = resolved.scenario
    scenario.random_seed = job.seed
    records: list[TickRecord] = []
    simulator = Simulator(make_diagram(resolved, sink=records.append))
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    simulator.AdvanceTo(scenario.simulation_duration)
    return summarize_faults(resolved, records)


def summarize_faults(resolved: ResolvedScenario, records: list[TickRecord]) -> dict[str, float]:
    """Summarizes a run from the records of its ticks.

    Returns:
        `valid`: Share of all ticks at which each active contact was on the allowed surface of the
            estimated object, all outputs were finite, and at least one contact was active.
        `position_error`, `orientation_error`: Largest errors of the estimated pose during the
            faults, in metres and radians.
        `recovery`: Seconds from the end of the faults until the errors stayed within `RECOVERED`
            standard deviations of the sensor; inf if they never did.
        `tracked`, `lost`: Shares of the ticks during the faults with that tracking status.
    """
    scenario, surface = resolved.scenario, resolved.surface
    faults, sensor = scenario.sensor.faults, scenario.sensor
    time = np.array([record.time for record in records])
    slack = scenario.planner.period / 2  # Times of ticks are rounded.
    acting = (time > faults.start - slack) & (time < faults.end - slack)
    after = np.flatnonzero(time > faults.end - slack)
    position, orientation = np.array([_errors(record) for record in records]).T
    is_off = (position > RECOVERED * sensor.position_std) | (
        orientation > RECOVERED * sensor.orientation_std
    )
    recovery = 0.0
    if len(off := after[is_off[after]]):
        is_over = off[-1] + 1 < len(time)
        recovery = float(time[off[-1] + 1] - faults.end) if is_over else math.inf
    status = np.array([record.tracking_status for record in records])[acting]
    return {
        "valid": float(np.mean([_is_valid(record, surface) for record in records])),
        "position_error": float(np.max(position[acting])),
        "orientation_error": float(np.max(orientation[acting])),
        "recovery": recovery,
        "tracked": float(np.mean(status == TrackingStatus.TRACKING)),
        "lost": float(np.mean(status == TrackingStatus.LOST)),
    }


def _errors(record: TickRecord) -> tuple[float, float]:
    """Returns the errors of the estimated position and orientation, in metres and radians."""
    offset = record.X_WO_estimated.translation() - record.X_WO.translation()
    turn = record.X_WO.rotation().InvertAndCompose(record.X_WO_estimated.rotation())
    return float(np.linalg.norm(offset)), abs(turn.ToAngleAxis().angle())


def _is_valid(record: TickRecord, surface: ObjectSurface) -> bool:
    _, p_OC = record.active_contacts()
    if not (np.all(np.isfinite(record.p_WC)) and len(p_OC)):
        return False
    nearest, _ = surface.project(p_OC)
    return bool(np.all(np.linalg.norm(nearest - p_OC, axis=1) <= CONTACT_TOLERANCE))


def fault_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns a table with one line for each fault.

    Args:
        rows: Rows of `run_faults`, with the columns of their jobs.
    """
    texts = fault_scenarios()
    groups = rows.groupby(pd.Categorical(rows["scenario"], list(texts)), observed=True)
    median, most, mean = (getattr(groups, n)(numeric_only=True) for n in ("median", "max", "mean"))
    table = pd.DataFrame({"scenario": "`" + mean.index.astype(str) + "`"}, index=mean.index)
    table["for six seconds"] = [texts[n].removeprefix("for six seconds, ") for n in mean.index]
    table["runs"] = groups.size()
    table["contacts valid"] = mean["valid"].map(percent)
    for column, label, scale, digits in (
        ("position_error", "worst position error [mm]", 1e3, 1),
        ("orientation_error", "worst orientation error [°]", 180 / math.pi, 2),
        ("recovery", "recovered after [s]", 1.0, 2),
    ):
        middle, worst = (
            (scale * part[column]).map(f"{{:.{digits}f}}".format) for part in (median, most)
        )
        table[label] = middle + " (" + worst + ")"
    for column in ("tracked", "lost"):
        table[column] = mean[column].map(percent)
    return table


def percent(share: float) -> str:
    """Formats a share in percent; only exactly 1 and 0 become 100 % and 0 %."""
    digits = 0 if share in (0, 1) else 1 if 1e-3 <= share <= 1 - 1e-3 else 3
    return f"{100 * share:.{digits}f} %"
