"""Runs of the paper's cases, many seeds each, in parallel processes."""

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.simulation.run import run
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_scenario
from drake_pregrasp.studies.published import SCENARIOS


class CaseRun(NamedTuple):
    """One run of a case: which, with which seed, and the folder it has left."""

    case: str
    seed: int
    folder: Path


def run_cases(
    cases: Sequence[str],
    seeds: Sequence[int],
    out: Path,
    *,
    duration: float,
    on_done: Callable[[], None] = lambda: None,
) -> list[CaseRun]:
    """Runs each case with each seed, as many at a time as there are processors.

    Args:
        cases: Keys of `SCENARIOS`.
        seeds: Random seeds.
        out: Where the run folders go.
        duration: Seconds to simulate.
        on_done: Called after each run.
    """
    jobs = [(case, seed, out, duration) for seed in seeds for case in cases]
    # Fresh processes: Drake's systems in Python outlive their diagram, and threads don't survive a
    # fork.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(os.cpu_count(), mp_context=context) as pool:
        futures = [pool.submit(_run_one, *job) for job in jobs]
        for future in as_completed(futures):
            future.result()
            on_done()
        return [future.result() for future in futures]


def _run_one(case: str, seed: int, out: Path, duration: float) -> CaseRun:
    scenario = load_scenario(SCENARIOS[case])
    scenario.random_seed = seed
    scenario.simulation_duration = duration
    name = f"{SCENARIOS[case]}_seed_{seed}"
    result = run(scenario, name=name, out=out, recording=False)
    return CaseRun(case, seed, result.folder)


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

    def after(self, time: float) -> slice:
        """Returns the ticks from that time on."""
        return slice(int(np.searchsorted(self.time, time - 1e-9)), None)

    @property
    def static(self) -> slice:
        """The ticks at which the initial contacts are held."""
        return slice(0, self.adapting.start)

    @property
    def adapting(self) -> slice:
        """The ticks that the tables are about: after the static phase, and after any damage."""
        damage = [event.at for event in self.scenario.damage]
        return self.after(max([self.scenario.planner.static_duration, *damage]))

    def p_OC(self, tick: int) -> FloatArray:
        """Returns the active contacts' goals at a tick, in O as it is estimated, shape (k, 3)."""
        count = len(self.scenario.initial_contacts)
        active = [i for i in range(count) if self.columns[f"c{i}_active"][tick]]
        p_WC = np.array([[self.columns[f"c{i}_{a}"][tick] for a in "xyz"] for i in active])
        w, x, y, z = (self.columns[f"q{c}_wo_estimated"][tick] for c in "wxyz")
        p_WO = np.array([self.columns[f"{a}_wo_estimated"][tick] for a in "xyz"])
        R_OW = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
                [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
                [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        p_OC: FloatArray = (p_WC - p_WO) @ R_OW.T
        return p_OC
