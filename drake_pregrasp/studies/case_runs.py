"""Runs of the paper's cases, many seeds each, in parallel processes."""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.simulation.phases import last_phase, static_phase, ticks_from
from drake_pregrasp.simulation.run import run
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_scenario
from drake_pregrasp.studies.processes import in_processes
from drake_pregrasp.studies.published import SCENARIOS

TRAVEL_TIME = 1.5
"""Seconds within which contacts have come to their places, or into the cycle they stay in."""


class CaseRun(NamedTuple):
    """One run of a case: which, with which seed, and the folder it has left."""

    case: str
    seed: int
    folder: Path


class Job(NamedTuple):
    """A run to make: a case, a seed, what to override in its scenario, and the folder's name."""

    case: str
    seed: int
    text: str
    name: str


def case_job(case: str, seed: int, duration: float) -> Job:
    """Returns the job of a case as it is, with a seed and a duration."""
    text = f"{{random_seed: {seed}, simulation_duration: {duration}}}"
    return Job(case, seed, text, f"{SCENARIOS[case]}_seed_{seed}")


def run_jobs(
    jobs: Sequence[Job], out: Path, *, on_done: Callable[[], None] = lambda: None
) -> list[CaseRun]:
    """Makes runs, as many at a time as there are processors.

    Args:
        jobs: What to run.
        out: Where the run folders go.
        on_done: Called after each run.
    """
    return in_processes(functools.partial(_run_one, out=out), jobs, on_done=on_done)


def _run_one(job: Job, out: Path) -> CaseRun:
    scenario = load_scenario(SCENARIOS[job.case], text=job.text)
    result = run(scenario, name=job.name, out=out, recording=False)
    return CaseRun(job.case, job.seed, result.folder)


class CaseLog:
    """A run's scenario and its `log.csv`: all that tables, claims and figures are made from."""

    def __init__(self, run_of: CaseRun) -> None:
        self.case, self.seed, self.folder = run_of
        self.scenario: Scenario = load_scenario(file=self.folder / "scenario.yaml")
        table = np.genfromtxt(self.folder / "log.csv", delimiter=",", names=True)
        self.columns: dict[str, FloatArray] = {
            name: table[name] for name in table.dtype.names or ()
        }

    @property
    def time(self) -> FloatArray:
        """Times of the ticks, in seconds."""
        return self.columns["time"]

    @property
    def static(self) -> slice:
        """The ticks at which all initial contacts are held."""
        return static_phase(self.scenario, self.time)

    @property
    def last_phase(self) -> slice:
        """The ticks that the tables are about: after the static phase, and after any damage."""
        return last_phase(self.scenario, self.time)

    @property
    def settled(self) -> slice:
        """That phase without its first seconds, in which contacts travel to their places."""
        start = self.time[self.last_phase][0] + TRAVEL_TIME
        return slice(ticks_from(self.scenario, self.time, start), None)

    def p_OC(self, tick: int) -> FloatArray:
        """Returns the active contacts' goals at a tick, in O as it is estimated, shape (k, 3)."""
        count = self.scenario.num_contacts
        active = [i for i in range(count) if self.columns[f"c{i}_active"][tick]]
        p_WC = np.array([[self.columns[f"c{i}_{a}"][tick] for a in "xyz"] for i in active])
        p_WO = np.array([self.columns[f"{a}_wo_estimated"][tick] for a in "xyz"])
        R_WO = Rotation.from_quat([self.columns[f"q{c}_wo_estimated"][tick] for c in "xyzw"])
        p_OC: FloatArray = R_WO.inv().apply(p_WC - p_WO)
        return p_OC
