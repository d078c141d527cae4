"""The numbers that a run of a sweep comes to."""

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.simulation.logged_run import LoggedRun
from drake_pregrasp.simulation.phases import adapting_phase
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.summary import force_closure_summary, summarize_grasp

_MM = 1e3


class Ran:
    """A run that is measured; what is asked for more than once is computed once.

    Args:
        scenario: What was simulated.
        logged: The run, simulated.
    """

    def __init__(self, scenario: Scenario, logged: LoggedRun) -> None:
        self.scenario = scenario
        self.logged = logged
        self.time = self.column("time")
        self.adapting = adapting_phase(scenario, self.time)

    def column(self, name: str) -> FloatArray:
        """Returns a column of `log.csv`."""
        return self._columns[name]

    def adapting_column(self, name: str) -> FloatArray:
        """Returns the part of a column in the phase in which all contacts adapt."""
        return self.column(name)[self.adapting]

    @cached_property
    def active(self) -> BoolArray:
        """Whether contacts are active, shape (ticks, n)."""
        columns = [self.column(f"c{i}_active") for i in range(self.scenario.num_contacts)]
        return np.stack(columns, axis=1) > 0

    @cached_property
    def motion_on_object(self) -> FloatArray:
        """How far contacts move from the tick before over the object, summed up, in metres.

        Positions are in the object's frame as it is estimated; contacts that are inactive at either
        tick don't count. Shape (ticks,), 0 at the first.
        """
        contacts = range(self.scenario.num_contacts)
        p_WC = np.stack([[self.column(f"c{i}_{a}") for a in "xyz"] for i in contacts])
        p_WO = np.stack([self.column(f"{a}_wo_estimated") for a in "xyz"])
        quaternions = np.stack([self.column(f"q{c}_wo_estimated") for c in "xyzw"], axis=1)
        R_WO = Rotation.from_quat(quaternions).as_matrix()
        p_OC = np.einsum("tji,kjt->tki", R_WO, p_WC - p_WO)
        steps = np.linalg.norm(np.diff(p_OC, axis=0), axis=2)
        both = self.active[1:] & self.active[:-1]
        return np.concatenate([[0.0], np.where(both, steps, 0.0).sum(axis=1)])

    @cached_property
    def force_closure(self) -> dict[str, dict[str, Any]]:
        """The margins of the last tick, as `summary.json` has them."""
        log = self.logged.log
        return force_closure_summary(
            self.scenario, self.logged.surface, static=None, final=log.last
        )

    @cached_property
    def grasp(self) -> dict[str, Any]:
        """What `summary.json` says of the hand; nothing without one."""
        log = self.logged.grasp_log
        return {} if log is None else summarize_grasp(self.scenario, log)

    @cached_property
    def _columns(self) -> dict[str, FloatArray]:
        log = self.logged.log
        return dict(zip(log.columns, log.read(*log.columns), strict=True))


class Measure(NamedTuple):
    """A number of a run.

    Attributes:
        label: What figures and tables call it, with its unit.
        of: Computes it; nan where the run has nothing to measure.
    """

    label: str
    of: Callable[[Ran], float]


def _reduced(column: str, reduce: Callable[[FloatArray], Any]) -> Callable[[Ran], float]:
    def measure(ran: Ran) -> float:
        values = ran.adapting_column(column)
        return float(reduce(values)) if len(values) else np.nan

    return measure


def _final(column: str) -> Callable[[Ran], float]:
    return lambda ran: float(ran.column(column)[-1]) if len(ran.time) else np.nan


def _a_second(moved: Callable[[Ran], FloatArray]) -> Callable[[Ran], float]:
    def measure(ran: Ran) -> float:
        steps = moved(ran)[ran.adapting]
        seconds = len(steps) * ran.scenario.planner.period
        return float(_MM * steps.sum() / seconds) if len(steps) else np.nan

    return measure


def _active_share(ran: Ran) -> float:
    active = ran.active[ran.adapting]
    return float(active.mean()) if len(active) else np.nan


def _of_grasp(key: str) -> Callable[[Ran], float]:
    def measure(ran: Ran) -> float:
        value = ran.grasp.get(key)
        return np.nan if value is None else float(value)

    return measure


def _of_margin(key: str) -> Callable[[Ran], float]:
    def measure(ran: Ran) -> float:
        value = ran.force_closure[key]["final"]
        return np.nan if value is None else float(value)

    return measure


def _in_phase(phase: str) -> Callable[[Ran], float]:
    return lambda ran: float(ran.grasp["phase"] == phase) if ran.grasp else np.nan


_QUALITIES = {"q_msv": "Q_MSV", "q_gii": "Q_GII", "q_vew": "Q_VEW"}

MEASURES = {
    **{
        f"{name}_{kind}": Measure(f"{label}, {kind}", measure)
        for name, label in _QUALITIES.items()
        for kind, measure in (
            ("mean", _reduced(name, np.mean)),
            ("min", _reduced(name, np.min)),
            ("max", _reduced(name, np.max)),
            ("final", _final(name)),
        )
    },
    "motion_on_object": Measure(
        "motion over the object [mm/s]", _a_second(lambda ran: ran.motion_on_object)
    ),
    "displacement": Measure(
        "motion in the world [mm/s]",
        _a_second(lambda ran: ran.column("displacement")),
    ),
    "position_error_mean": Measure(
        "position error, mean [mm]", _reduced("position_error", lambda e: _MM * np.mean(e))
    ),
    "position_error_max": Measure(
        "position error, maximum [mm]", _reduced("position_error", lambda e: _MM * np.max(e))
    ),
    "active_share": Measure("share of active contacts", _active_share),
    "ticks": Measure("planning ticks", lambda ran: float(len(ran.time))),
    "force_closure_margin": Measure(
        "min-weight margin at the end", _of_margin("force_closure_margin")
    ),
    "ferrari_canny": Measure(
        "Ferrari and Canny's radius at the end [N]", _of_margin("ferrari_canny")
    ),
    "independent_region_share": Measure(
        "share of force-closed choices at the end", _of_margin("independent_region_share")
    ),
    "grasp_holds": Measure("object held at the end (0 or 1)", _in_phase("hold")),
    "grasp_lift_height": Measure("lift height [mm]", _of_grasp("lift_height_mm")),
    "grasp_closing_motion": Measure(
        "motion of the object in closing [mm]", _of_grasp("closing_motion_mm")
    ),
    "grasp_slip_hold": Measure("slip in the hold [mm]", _of_grasp("slip_hold_mm")),
    "grasp_tracking_error_mean": Measure(
        "fingertips off their goals, mean [mm]", _of_grasp("tracking_error_mean_mm")
    ),
}
"""All measures. Means, extremes and shares are over the phase in which all contacts adapt."""

DEFAULT_MEASURES = (
    *(f"{name}_{kind}" for name in _QUALITIES for kind in ("mean", "final")),
    "motion_on_object",
    "displacement",
    "position_error_mean",
    "position_error_max",
    "active_share",
    "ticks",
)
"""The measures of a study that names none."""
