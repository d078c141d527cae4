"""Measures of simulated runs, which are the columns of a study's rows."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from drake_pregrasp.arrays import TIME_ROUNDING, BoolArray, FloatArray, first_tick, tick_index
from drake_pregrasp.contacts.goal_limits import ROUNDING, tip_gaps
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.geometry.surface import CONTACT_TOLERANCE
from drake_pregrasp.grasping.held_criterion import LARGEST_MM, PARTS
from drake_pregrasp.quality.grasp_quality import QUALITY_MEASURES
from drake_pregrasp.regions.constraints import OPPOSITE
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.run_log import (
    TickRows,
    adapting_phase,
    log_columns,
    pose_columns,
    tick_table,
)
from drake_pregrasp.simulation.summary import force_closure_summary, seen_from
from drake_pregrasp.studies.grasps.grasp_outcome import Outcome
from drake_pregrasp.systems.loggers import TickRecord

RECOVERED = 4.0
"""Largest error of a recovered estimate, in standard deviations of the sensor."""

DELAYS_MS = (25, 50, 100, 200)
"""Delays of a hand that reaches goals late, in milliseconds."""


class SimulatedRun(NamedTuple):
    """Records of a run, from which its measures are computed.

    Attributes:
        resolved: Scenario of the run.
        ticks: Records of all planning ticks, in the order of time.
        outcome: Outcome of the grasp; None without a hand.
    """

    resolved: ResolvedScenario
    ticks: Sequence[TickRecord]
    outcome: Outcome | None


class MeasureGroup(NamedTuple):
    """Measures that are computed together.

    Attributes:
        labels: Labels of the measures by their names.
        compute: Function that returns the values of a run by the names of the measures. A missing
            value, or None, is nan in the rows.
    """

    labels: Mapping[str, str]
    compute: Callable[[SimulatedRun], Mapping[str, Any]]


_EXTREMES = ("mean", "min", "max")  # Functions of numpy.


def _planning(run: SimulatedRun) -> dict[str, Any]:
    scenario, n = run.resolved.scenario, run.resolved.num_contacts
    columns = _log_columns(run)
    time = columns["time"]
    phase = adapting_phase(scenario, time)
    values: dict[str, Any] = {"ticks": len(time)}
    if len(time):
        values |= {f"{name}_final": columns[name][-1] for name in QUALITY_MEASURES}
    if not len(time[phase]):
        return values
    for name in QUALITY_MEASURES:
        for kind in _EXTREMES:
            values[f"{name}_{kind}"] = getattr(np, kind)(columns[name][phase])
    active = np.stack([columns[f"c{i}_active"] for i in range(n)], axis=1) > 0
    seconds = len(time[phase]) * scenario.planner.period
    error = columns["position_error"][phase]
    return values | {
        "motion_on_object": 1e3 * _motion_on_object(columns, active)[phase].sum() / seconds,
        "displacement": 1e3 * columns["displacement"][phase].sum() / seconds,
        "position_error_mean": 1e3 * np.nanmean(error),
        "position_error_max": 1e3 * np.nanmax(error),
        "active_share": active[phase].mean(),
    }


def _log_columns(run: SimulatedRun) -> dict[str, FloatArray]:
    """Returns the columns of the run's `log.csv`."""
    names = log_columns(run.resolved.num_contacts)
    rows = TickRows(run.resolved.planner.estimator.lookahead)
    parts = [rows.parts(record) for record in run.ticks]
    table = tick_table(*zip(*parts, strict=True)) if parts else np.empty((0, len(names)))
    return dict(zip(names, table.T, strict=True))


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


def _margins(run: SimulatedRun) -> dict[str, Any]:
    final = run.ticks[-1] if run.ticks else None
    summary = force_closure_summary(run.resolved, static=None, final=final)
    return {name: summary[name]["final"] for name in MARGINS.labels}


def _validity(run: SimulatedRun) -> dict[str, Any]:
    surface, radii = run.resolved.surface, run.resolved.planner.limits.tip_radii
    valid, overlaps, crossings = [], 0, 0
    last_normals: dict[int, FloatArray] = {}
    for record in run.ticks:
        contacts, p_OC = record.active_contacts()
        is_finite = bool(np.all(np.isfinite(record.p_WC)) and len(p_OC))
        valid.append(is_finite)
        if not is_finite:
            continue
        nearest, normals = surface.project(p_OC)
        valid[-1] = bool(np.all(np.linalg.norm(nearest - p_OC, axis=1) <= CONTACT_TOLERANCE))
        if radii:
            gaps = tip_gaps(p_OC, normals, np.array(radii)[contacts])
            overlaps += bool(np.any(gaps < -2 * ROUNDING))
        now = dict(zip(contacts.tolist(), normals, strict=True))
        crossings += any(now[i] @ last_normals[i] < OPPOSITE for i in now.keys() & last_normals)
        last_normals |= now
    return {"valid_share": np.mean(valid), "overlaps": overlaps, "crossings": crossings}


def _faults(run: SimulatedRun) -> dict[str, Any]:
    scenario = run.resolved.scenario
    faults, sensor = scenario.sensor.faults, scenario.sensor
    time = np.array([record.time for record in run.ticks])
    period = scenario.planner.period
    ticks = [tick_index(at, period) for at in time.tolist()]
    acting = np.array([faults.act_at(tick, period) for tick in ticks])
    after = np.flatnonzero(np.array(ticks) >= first_tick(faults.end, period))
    if not np.any(acting):
        return {}
    position, orientation = np.array([_pose_error(record) for record in run.ticks]).T
    is_off = (position > RECOVERED * sensor.position_std) | (
        orientation > RECOVERED * sensor.orientation_std
    )
    recovery = 0.0 if len(after) else np.nan
    if len(off := after[is_off[after]]):
        is_over = off[-1] + 1 < len(time)
        recovery = float(time[off[-1] + 1] - faults.end) if is_over else np.inf
    status = np.array([record.tracking_status for record in run.ticks])[acting]
    return {
        "fault_position_error": 1e3 * np.max(position[acting]),
        "fault_orientation_error": np.degrees(np.max(orientation[acting])),
        "fault_recovery": recovery,
        "fault_tracked_share": np.mean(status == TrackingStatus.TRACKING),
        "fault_lost_share": np.mean(status == TrackingStatus.LOST),
    }


def _pose_error(record: TickRecord) -> tuple[float, float]:
    """Returns the errors of the estimated position and orientation, in metres and radians."""
    offset = record.X_WO_estimated.translation() - record.X_WO.translation()
    turn = record.X_WO.rotation().InvertAndCompose(record.X_WO_estimated.rotation())
    return float(np.linalg.norm(offset)), abs(turn.ToAngleAxis().angle())


def _late_goals(run: SimulatedRun) -> dict[str, Any]:
    time = np.array([record.time for record in run.ticks])
    ticks = run.ticks[adapting_phase(run.resolved.scenario, time)]
    period = run.resolved.planner.period
    found = {}
    for ms in DELAYS_MS:
        delay = round(1e-3 * ms / period)
        at_tick = abs(delay * period - 1e-3 * ms) < TIME_ROUNDING
        if at_tick and len(errors := goal_errors(ticks, delay)):
            found[f"late_goal_error_{ms}ms"] = 1e3 * np.median(errors)
    return found


def goal_errors(ticks: Sequence[TickRecord], delay: int) -> FloatArray:
    """Returns the errors of goals at the time when a delayed hand reaches them.

    The hand reaches the goal of tick k at tick k + delay. The goal's point of the object, from
    the estimated pose of tick k, is then at the true pose of tick k + delay.

    Args:
        ticks: Records of the ticks.
        delay: Delay of the hand, in planning periods.

    Returns:
        Distance between goal and point in metres, for each tick and active contact.
    """
    errors = [np.empty(0)]
    for record, later in zip(ticks, ticks[delay:], strict=False):
        p_WC = record.p_WC[is_active(record.contact_status)]
        moved = later.X_WO @ record.X_WO_estimated.inverse()
        errors.append(np.linalg.norm((moved @ p_WC.T).T - p_WC, axis=1))
    return np.concatenate(errors)


def _grasp(run: SimulatedRun) -> dict[str, Any]:
    outcome = run.outcome
    if outcome is None:
        return {}
    return {**asdict(outcome), **outcome.motion, "clean": outcome.clean}


PLANNING = MeasureGroup(
    {
        **{
            f"{name}_{kind}": f"{name.upper()}, {kind}"
            for name in QUALITY_MEASURES
            for kind in (*_EXTREMES, "final")
        },
        "motion_on_object": "motion over the object [mm/s]",
        "displacement": "motion in the world [mm/s]",
        "position_error_mean": "position error, mean [mm]",
        "position_error_max": "position error, maximum [mm]",
        "active_share": "share of active contacts",
        "ticks": "planning ticks",
    },
    _planning,
)

MARGINS = MeasureGroup(
    {
        "force_closure_margin": "min-weight margin at the end",
        "ferrari_canny": "Ferrari and Canny's radius at the end [N]",
        "independent_region_share": "share of force-closed choices at the end",
        "independent_radius": "slip that force closure survives at the end [m]",
    },
    _margins,
)

FAULTS = MeasureGroup(
    {
        "fault_position_error": "position error during the faults, maximum [mm]",
        "fault_orientation_error": "orientation error during the faults, maximum [°]",
        "fault_recovery": "recovered after [s]",
        "fault_tracked_share": "share of the faults' ticks: tracking",
        "fault_lost_share": "share of the faults' ticks: lost",
    },
    _faults,
)

_WHERE = {"before": "before the command", "closing": "in closing"}
_MOTION = {
    f"{verb}_{part}_{unit}": f"object {verb} {_WHERE.get(part, f'in the {part}')} [{shown}]"
    for part in PARTS
    for verb, unit, shown in (("moved", "mm", "mm"), ("turned", "deg", "°"))
}

GRASP = MeasureGroup(
    {
        "held": "object held",
        "clean": "clean grasp",
        "fingers": "fingers that took part",
        "catchable": "share of the wait in which a meeting is possible",
        "waited_s": "waited before closing [s]",
        "withdrawn": "withdrawn fingers, mean",
        **_MOTION,
        "drift_mm_per_min": "drift in the hold [mm/min]",
        "slips_after_s": f"would slip {LARGEST_MM:g} mm after [s]",
        "link_on_object_n": "largest force of a link on the object [N]",
        "link_on_surroundings_n": "largest force of a link on table and walls [N]",
        "link_on_hand_n": "largest force of a link on another finger [N]",
    },
    _grasp,
)

MEASURE_GROUPS = [
    PLANNING,
    MARGINS,
    MeasureGroup(
        {
            "valid_share": "share of ticks with valid contacts",
            "overlaps": "ticks with overlapping fingertips",
            "crossings": "ticks with a contact that crossed a wall",
        },
        _validity,
    ),
    FAULTS,
    MeasureGroup(
        {
            f"late_goal_error_{ms}ms": f"goal error {ms} ms later, if at a tick, median [mm]"
            for ms in DELAYS_MS
        },
        _late_goals,
    ),
    GRASP,
]
"""All measures. Means, extremes and shares of `PLANNING` are over the phase in which all contacts
adapt."""

MEASURES: Mapping[str, str] = {n: s for group in MEASURE_GROUPS for n, s in group.labels.items()}
"""Labels of all measures by their names."""

_NOT_OF_CONTACTS = {"position_error_mean", "position_error_max", "ticks"}
PLANNED_CONTACTS = frozenset(
    name
    for group in MEASURE_GROUPS
    if group not in (FAULTS, GRASP)
    for name in group.labels.keys() - _NOT_OF_CONTACTS
)
"""Measures of the planner's contacts, which a hand with another source of goals does not follow."""

DEFAULT_MEASURES = (
    *(f"{q}_{kind}" for q in QUALITY_MEASURES for kind in ("mean", "final")),
    *("motion_on_object", "displacement", "position_error_mean", "position_error_max"),
    *("active_share", "ticks"),
)
"""Default measures of a study."""

REASONS = ("close_at", "cause", "gave_up")
"""Columns of a grasp besides its measures: time of the command, and why it failed."""


def measure(run: SimulatedRun, names: Sequence[str]) -> dict[str, Any]:
    """Returns measures of a run, nan where there is nothing to measure.

    Args:
        run: The run.
        names: Names of the measures, keys of `MEASURES`.
    """
    values: dict[str, Any] = {}
    for group in MEASURE_GROUPS:
        if group is GRASP or any(name in group.labels for name in names):  # GRASP has `REASONS`.
            values |= group.compute(run)
    if run.outcome is not None:
        names = [*REASONS, *names]
    found = {name: values.get(name) for name in names}
    return {name: np.nan if value is None else _plain(value) for name, value in found.items()}


def _plain(value: Any) -> Any:
    return value if isinstance(value, bool | str) else float(value)
