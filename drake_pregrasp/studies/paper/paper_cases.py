"""The paper's ten cases: published values, and runs with many seeds."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.quality.grasp_quality import QUALITY_MEASURES, grasp_quality
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.run import run
from drake_pregrasp.simulation.run_log import last_phase, static_phase, ticks_from
from drake_pregrasp.simulation.scenario_file import load_resolved, load_scenario
from drake_pregrasp.simulation.summary import remaining_static_quality
from drake_pregrasp.studies.runner import OnProgress, run_jobs

TRAVEL_TIME = 1.5
"""Time in seconds within which contacts reach a fixed point or a limit cycle."""

RANDOM_SETS = 1000
"""Number of random contact sets of each case."""

SPACINGS = (0.01, 0.005, 0.0025)
"""Compared spacings of candidates, in metres."""

Three = tuple[float | None, float | None, float | None]


class Published(NamedTuple):
    """Row of the paper's Table II or III: (Q_MSV, Q_GII, Q_VEW), None if not printed."""

    static: Three
    dynamic: Three


SCENARIOS = {
    "a": "a_base",
    "b": "b_slower",
    "c": "c_faster",
    "d": "d_smaller",
    "e": "e_bigger",
    "f": "f_damage",
    "g": "g_poor_start",
    "h": "h_msv",
    "i": "i_gii",
    "j": "j_vew",
}
"""Shipped scenario of each case of Tables I and III."""

_STATIC = (2.2089, 0.9749, 125.4176)
_BASE = Published(_STATIC, (2.2307, 0.9941, 125.4403))

TABLE_2 = {
    "a": _BASE,
    "b": Published(_STATIC, (2.2152, 0.9804, 125.4160)),
    "c": Published(_STATIC, (2.2357, 0.9981, 125.4970)),
    "d": Published((2.2161, 0.9818, 125.2092), (2.2356, 0.9989, 125.2405)),
    "e": Published((2.1817, 0.9489, 126.2972), (2.1846, 0.9514, 126.2973)),
    "f": Published((1.6913, 0.9494, 26.8783), (1.7129, 0.9770, 27.0855)),
    "g": Published((1.9508, 0.9512, None), (2.2159, 0.9812, 125.3789)),
}
"""Table II. Row f holds after the damage; the static contacts of g are its poor start."""

TABLE_3 = {
    "a": _BASE,
    "h": Published(_STATIC, (2.2359, 0.9974, 125.7573)),
    "i": Published(_STATIC, (2.2340, 0.9965, 125.8007)),
    "j": Published(_STATIC, (2.2260, 0.9890, 125.7573)),
}
"""Table III."""

LITERAL = {"h": "h, literal", "i": "i, literal", "j": "j, literal"}
"""Labels of the cases with weights as printed: the paper does not state the stretch b - min b."""


@dataclass(frozen=True)
class CaseJob:
    """A run of a case.

    Attributes:
        case: Label of the run's row: a case, one of `LITERAL`, or another name.
        seed: Seed of the measurement noise.
        scenario: Name of the shipped scenario.
        text: YAML that overrides keys of the scenario.
        folder: Name of the run's folder.
    """

    case: str
    seed: int
    scenario: str
    text: str
    folder: str


def case_job(case: str, seed: int, duration: float) -> CaseJob:
    """Returns the job of a case or of one of `LITERAL`, for `duration` seconds."""
    scenario = SCENARIOS[case[0]]
    text = f"{{random_seed: {seed}, simulation_duration: {duration}}}"
    if case in LITERAL.values():
        text = f"{text[:-1]}, planner: {{stretch: false}}}}"
        return CaseJob(case, seed, scenario, text, f"{scenario}_literal_seed_{seed}")
    return CaseJob(case, seed, scenario, text, f"{scenario}_seed_{seed}")


def spacing_job(spacing: float, duration: float) -> CaseJob:
    """Returns the job of the base case without noise, with another spacing in metres."""
    text = (
        f"{{surface: {{spacing: {spacing}}}, sensor: {{position_std: 0, orientation_std: 0}},"
        f" simulation_duration: {duration}}}"
    )
    name = f"spacing_{1e3 * spacing:g}_mm"
    return CaseJob(name, 0, SCENARIOS["a"], text, f"a_base_without_noise_{name}")


def run_cases(
    jobs: Sequence[CaseJob], out: Path, *, on_progress: OnProgress = lambda done, total: None
) -> pd.DataFrame:
    """Makes runs in parallel processes, and returns their rows: the job and its `run_values`.

    Args:
        jobs: Runs to make.
        out: Parent of the run folders.
        on_progress: Called with the number of finished runs and the number of all runs.
    """
    return run_jobs(functools.partial(_run_case, out=out), jobs, on_progress=on_progress).rows


def _run_case(job: CaseJob, out: Path) -> dict[str, Any]:
    scenario = load_scenario(job.scenario, text=job.text)
    result = run(scenario, name=job.folder, out=out, recording=False, overwrite=True)
    return run_values(CaseLog(result.folder)) | {"tick_ms": result.summary["tick_time_p50_ms"]}


class CaseLog:
    """Scenario and `log.csv` of a run, the source of all tables, claims and figures.

    Attributes:
        folder: Folder of the run.
        scenario: Scenario of the run.
        table: Rows of `log.csv`.
        static: Ticks at which all initial contacts are held.
        last_phase: Ticks of the paper's tables: after the static phase and after any damage.
        settled: Ticks of the last phase without its first `TRAVEL_TIME`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.resolved = load_resolved(file=folder / "scenario.yaml")
        self.scenario = self.resolved.scenario
        self.table = pd.DataFrame(np.genfromtxt(folder / "log.csv", delimiter=",", names=True))
        time = self.table["time"].to_numpy()
        self.static = static_phase(self.scenario, time)
        self.last_phase = last_phase(self.scenario, time)
        start = time[self.last_phase][0] + TRAVEL_TIME
        self.settled = slice(ticks_from(self.scenario, time, start), None)

    def active(self, tick: int) -> list[int]:
        """Returns the indices of the active contacts at a tick."""
        row = self.table.iloc[tick]
        return [i for i in range(self.resolved.num_contacts) if row[f"c{i}_active"]]

    def p_OC(self, tick: int) -> FloatArray:
        """Returns the active contacts' goals at a tick, in the estimated O, shape (k, 3), in m."""
        row = self.table.iloc[tick]
        p_WC = np.array([[row[f"c{i}_{axis}"] for axis in "xyz"] for i in self.active(tick)])
        p_WO = np.array([row[f"{axis}_wo_estimated"] for axis in "xyz"])
        R_WO = Rotation.from_quat([row[f"q{axis}_wo_estimated"] for axis in "xyzw"])
        p_OC: FloatArray = R_WO.inv().apply(p_WC - p_WO)
        return p_OC


def run_values(log: CaseLog) -> dict[str, float]:
    """Returns the values of a run for tables and claims.

    `best` is the maximum of a measure over the last phase, reached `at` a time in seconds, and
    `settled` is its mean and `later` its maximum over the settled ticks. `static` is the mean over
    the static phase; with damage, it is the measure of the remaining initial contacts.
    """
    quality = None
    if log.scenario.damage:
        quality = remaining_static_quality(log.resolved)
    values: dict[str, float] = {}
    for name in QUALITY_MEASURES:
        column = log.table[name].to_numpy()
        best = int(np.argmax(column[log.last_phase])) + log.last_phase.start
        static = np.mean(column[log.static]) if quality is None else getattr(quality, name)
        values |= {
            f"static {name}": float(static),
            f"best {name}": float(column[best]),
            f"at {name}": float(log.table["time"][best]),
            f"settled {name}": float(np.mean(column[log.settled])),
            f"later {name}": float(np.max(column[log.settled])),
        }
    half, p_OC = log.resolved.shape.mesh.extents / 2, log.p_OC(-1)
    axes = np.argmax(np.abs(p_OC / half), axis=1)
    signs = np.sign(np.take_along_axis(p_OC, axes[:, None], axis=1))[:, 0]
    to_edges = np.sort(half - np.abs(p_OC), axis=1)[:, 1]  # [:, 0]: to the contact's own face.
    q_gii = log.table["q_gii"].to_numpy()[log.settled]
    return values | {
        "mm_per_tick": float(1e3 * log.table["displacement"][log.settled].mean()),
        "faces": float(len({*zip(axes.tolist(), signs.tolist(), strict=True)})),
        "mm_to_edge": float(1e3 * np.mean(to_edges)),
        "largest_drop": float(max(0.0, -np.min(np.diff(q_gii)))),
    }


def random_quality(resolved: ResolvedScenario) -> dict[str, float]:
    """Returns the medians of the measures over `RANDOM_SETS` contact sets drawn with seed 0.

    Each set has as many contacts as the scenario has at its end, at different candidates of the
    allowed surface, all equally probable.

    Args:
        resolved: Scenario of a case.
    """
    surface, generator = resolved.surface, np.random.default_rng(0)
    count = len(resolved.remaining_contacts())
    sets = [
        generator.choice(surface.p_OQ, count, replace=False) - surface.p_OCoM
        for _ in range(RANDOM_SETS)
    ]
    qualities = [grasp_quality(p_CoMC) for p_CoMC in sets]
    return {
        name: float(np.median([getattr(q, name) for q in qualities])) for name in QUALITY_MEASURES
    }
