"""Measurement faults, each over many seeds: a study with a table."""

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_pregrasp.config.planner_config import EstimatorConfig, filter_noise
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.simulation.output import write_text, writing
from drake_pregrasp.simulation.scenario_file import shipped_scenarios
from drake_pregrasp.studies.bench.markdown import table
from drake_pregrasp.studies.faults.consistency import (
    CONFIDENCE,
    Consistency,
    consistency,
    conveyor_motion,
    even_noise,
    random_motion,
)
from drake_pregrasp.studies.faults.fault_run import RECOVERED, FaultJob, FaultRun, run_faults
from drake_pregrasp.studies.processes import in_processes

SEEDS = 50
"""Seeds for each fault."""

FILTER_SEEDS = 200
"""Seeds of the filter's consistency."""

GOAL_RECOVERY = 0.5
"""Seconds after a fault within which the estimate should have recovered."""

PREFIX = "fault_"
"""What the names of the scenarios begin with."""

_FILTERS = 3  # Pairs of assumptions and motion whose consistency is measured.
_Runs = Mapping[str, Sequence[FaultRun]]


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
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Runs each fault with each seed, and returns the path of the report.

    Args:
        out: Folder of the report.
        faults: Names of their scenarios; all if not set.
        seeds: How many for each fault.
        filter_seeds: How many for the filter's consistency; 0 to leave it out.
        processes: How many runs at a time.
        on_progress: Called with how many runs are done, and how many there are.

    Raises:
        InvalidArgumentError: If there is no such fault.
        OutputError: If the folder can't be written to.
    """
    known = fault_scenarios()
    names = list(known) if faults is None else list(dict.fromkeys(faults))
    for name in names:
        if name not in known:
            problem = f"faults: {name!r} is no scenario with faults; there are: {', '.join(known)}"
            raise InvalidArgumentError(problem)
    folder = Path(out)
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    jobs = [FaultJob(name, seed) for seed in range(seeds) for name in names]
    steps = len(jobs) + (_FILTERS if filter_seeds else 0)
    done = 0

    def on_done() -> None:
        nonlocal done
        done += 1
        on_progress(done, steps)

    found = in_processes(run_faults, jobs, processes=processes, on_done=on_done)
    runs: dict[str, list[FaultRun]] = {}
    for job, result in zip(jobs, found, strict=True):
        runs.setdefault(job.scenario, []).append(result)
    write_text(folder / "faults.csv", _csv(jobs, found))
    report = folder / "faults.md"
    lines = fault_lines(runs)
    write_text(report, "\n".join(lines))  # What comes now must not cost what is there.
    if filter_seeds:
        lines += consistency_lines(filter_consistency(filter_seeds, on_done))
        write_text(report, "\n".join(lines))
    return report


def fault_lines(runs: _Runs) -> list[str]:
    """Returns the table of faults, and the goals."""
    rows = []
    descriptions = fault_scenarios()
    for name, of_fault in runs.items():
        text = descriptions[name]
        recovery = [run.recovery for run in of_fault]
        position = 1e3 * np.array([run.position_error for run in of_fault])
        turn = np.rad2deg([run.orientation_error for run in of_fault])
        rows.append(
            (
                f"`{name}`",
                text.removeprefix("for six seconds, "),
                _percent(np.mean([run.valid for run in of_fault])),
                f"{np.median(position):.1f} ({np.max(position):.1f})",
                f"{np.median(turn):.2f} ({np.max(turn):.2f})",
                f"{np.median(recovery):.2f} ({np.max(recovery):.2f})",
                _percent(np.mean([run.tracked for run in of_fault])),
                _percent(np.mean([run.lost for run in of_fault])),
            )
        )
    every = [run for of_fault in runs.values() for run in of_fault]
    in_time = sum(run.recovery <= GOAL_RECOVERY for run in every)
    head = (
        "scenario",
        "for six seconds",
        "contacts valid",
        "worst position error [mm]",
        "worst orientation error [°]",
        "recovered after [s]",
        "tracked",
        "lost",
    )
    return [
        f"{len(every)} runs, {len(every) // len(runs)} seeds a fault. Medians over seeds, and the"
        " largest in brackets; shares are of ticks, of all for contacts, of those with the fault"
        f" for the status. An estimate has recovered when it stays within {RECOVERED:g} standard"
        " deviations of the sensor.",
        *table(head, rows),
        f"Valid contacts at all ticks: in {sum(run.valid == 1 for run in every)} of {len(every)}"
        f" runs. Recovered within {GOAL_RECOVERY:g} s: in {in_time} of {len(every)}.",
        "",
    ]


def filter_consistency(
    seeds: int, on_done: Callable[[], None] = lambda: None
) -> dict[str, Consistency]:
    """Returns how consistent the filter is, by what it assumes and what moves.

    Args:
        seeds: How many runs.
        on_done: Called after each of the `_FILTERS`.
    """
    assumed, carried = filter_noise(EstimatorConfig()), conveyor_motion()
    found = {}
    for name, noise, motion in (
        (
            "default assumptions, motion drawn from them",
            assumed,
            lambda rng: random_motion(assumed, rng),
        ),
        ("even motion assumed, conveyor", even_noise(), lambda rng: carried),
        ("default assumptions, conveyor", assumed, lambda rng: carried),
    ):
        found[name] = consistency(noise, motion, seeds)
        on_done()
    return found


def consistency_lines(found: Mapping[str, Consistency]) -> list[str]:
    """Returns the table of the filter's consistency."""
    rows = [
        (
            name,
            f"{c.nees[0]:.2f}, {c.nees[1]:.2f}",
            f"{c.nees_band[0]:.2f} to {c.nees_band[1]:.2f}",
            f"{c.nis[0]:.3f}, {c.nis[1]:.3f}",
            f"{c.nis_band[0]:.3f} to {c.nis_band[1]:.3f}",
        )
        for name, c in found.items()
    ]
    runs = next(iter(found.values())).runs
    band = f"{100 * CONFIDENCE:g} % band"
    return [
        f"{runs} runs each; position, orientation. 6 and 3 are expected.",
        *table(("filter and motion", "NEES", band, "NIS", band), rows),
    ]


def _percent(share: "float | np.floating[Any]") -> str:
    # Nothing is rounded up to all, or down to none.
    digits = 0 if share in (0, 1) else 1 if 1e-3 <= share <= 1 - 1e-3 else 3
    return f"{100 * share:.{digits}f} %"


def _csv(jobs: Sequence[FaultJob], found: Sequence[FaultRun]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow((*FaultJob._fields, *FaultRun._fields))
    writer.writerows((*job, *run) for job, run in zip(jobs, found, strict=True))
    return text.getvalue()
