"""`summary.json`: what a run comes to."""

import importlib.metadata
import platform
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.contacts.selection_input import ContactStatus, describe_status, is_active
from drake_pregrasp.estimation.tracking_status import TrackingStatus
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.grasping.grasp_state import GraspPhase, describe_give_up
from drake_pregrasp.kernels import numba_is_installed
from drake_pregrasp.quality.force_closure import ferrari_canny, min_weight_margin
from drake_pregrasp.regions.independent_regions import force_closed_share
from drake_pregrasp.simulation.phases import (
    adapting_phase,
    last_phase,
    remaining_static_quality,
    static_phase,
)
from drake_pregrasp.simulation.run_log import GraspLog, RunLog
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.loggers import TickRecord
from drake_pregrasp.version import __version__

_MEASURES = ("force_closure_margin", "ferrari_canny", "independent_region_share")


def force_closure_summary(
    scenario: Scenario,
    surface: ObjectSurface,
    *,
    static: TickRecord | None,
    final: TickRecord | None,
) -> dict[str, dict[str, Any]]:
    """Returns three measures of the active contacts, with what they assume, by their names.

    `force_closure_margin` is the min-weight margin, `ferrari_canny` the radius in newtons, and
    `independent_region_share` says how many choices of one point a safe region of these contacts
    are force-closed.

    Args:
        scenario: What was simulated; `measures` says how to measure.
        surface: The object's surface.
        static: The tick to measure as `static`; if None, its values are null.
        final: The same as `final`.
    """
    measures = scenario.measures
    model = "hard_finger" if measures.contact_model == "complete" else measures.contact_model
    columns = [_measure(scenario, surface, model, record) for record in (static, final)]
    return {
        name: {
            "friction": measures.friction,
            "contact_model": model,
            "static": columns[0][index],
            "final": columns[1][index],
        }
        for index, name in enumerate(_MEASURES)
    }


def _measure(
    scenario: Scenario, surface: ObjectSurface, model: str, record: TickRecord | None
) -> tuple[float | None, ...]:
    if record is None:
        return (None,) * len(_MEASURES)
    measures = scenario.measures
    p_OC: FloatArray = (record.X_WO_estimated.inverse() @ record.p_WC.T).T
    p_OC = p_OC[is_active(record.contact_status)]
    _, nhat = surface.project(p_OC)
    cone: dict[str, Any] = {"model": model, "torsional_friction": measures.torsional_friction}
    return (
        min_weight_margin(p_OC - surface.p_OCoM, nhat, measures.friction, **cone),
        ferrari_canny(
            p_OC - surface.p_OCoM,
            nhat,
            measures.friction,
            length=measures.length or surface.longest_lever_arm,
            **cone,
        ),
        force_closed_share(
            surface,
            record.regions,
            measures.friction,
            generator=np.random.default_rng(scenario.random_seed),
            **cone,
        ),
    )


SETTLED = 1.0
"""From when on tracking errors count, in seconds: before that tips go to their first contacts."""


def summarize_grasp(scenario: Scenario, log: GraspLog) -> dict[str, Any]:
    """Returns how the hand fared; null for a phase that it didn't come to.

    - `tracking_error_mean_mm`, `tracking_error_max_mm`: of the fingertips' centres from their goals
      over the object as it is estimated at the same time, while the hand approaches and tracks,
      after `SETTLED`. A goal that moves over the object is followed the controller's lead later.
    - `closing_motion_mm`, `squeeze_motion_mm`: how far the object's origin moved on the turntable
      while fingers closed until touch, and then while forces came up.
    - `lift_height_mm`: how far the object is above where it was before the lift, at the end.
    - `slip_lift_mm`, `slip_hold_mm`: how far a fingertip that pressed when the lift began moved
      over the object, at most.
    - `tip_forces`: what each finger presses with at the end, in newtons.
    - `gave_up`: why the hand opened again, or null.
    """
    time, phase, reason, detail = log.read("time", "phase", "gave_up", "gave_up_detail")
    if not len(time):
        return {"phase": None, "gave_up": None}
    tips, goals, forces = (log.read_points(kind) for kind in ("tip", "goal", "force"))
    object_poses, table_poses = log.read_pose("wo"), log.read_pose("wd")
    lead = scenario.grasp.period + scenario.plant_config.time_step
    carried = _seen_from(log.read_pose("wg"), tips)
    errors = 1e3 * np.linalg.norm(carried - _shifted(time, goals, lead), axis=2)
    tracking = (phase <= GraspPhase.TRACK) & (time > SETTLED)
    on_table = 1e3 * _seen_from(table_poses, object_poses[:, None, :3])
    on_object = 1e3 * _seen_from(object_poses, tips)
    lifted = np.flatnonzero(phase == GraspPhase.LIFT)
    if len(lifted):
        presses = np.linalg.norm(forces[lifted[0]], axis=1) >= scenario.grasp.touch_force / 2
        on_object = on_object[:, presses]
    return {
        "phase": GraspPhase(int(phase[-1])).name.lower(),
        "gave_up": describe_give_up(int(reason[-1]), detail[-1]),
        "tracking_error_mean_mm": float(np.mean(errors[tracking])) if tracking.any() else None,
        "tracking_error_max_mm": float(np.max(errors[tracking])) if tracking.any() else None,
        "closing_motion_mm": _largest_motion(on_table, phase == GraspPhase.CLOSE),
        "squeeze_motion_mm": _largest_motion(on_table, phase == GraspPhase.SQUEEZE),
        "lift_height_mm": float(1e3 * (object_poses[-1, 2] - object_poses[lifted[0], 2]))
        if len(lifted)
        else None,
        "slip_lift_mm": _largest_motion(on_object, phase == GraspPhase.LIFT),
        "slip_hold_mm": _largest_motion(on_object, phase == GraspPhase.HOLD),
        "tip_forces": np.linalg.norm(forces[-1], axis=1).tolist(),
    }


def _shifted(time: FloatArray, points: FloatArray, lead: float) -> FloatArray:
    """Returns points that are given ahead of time, at the time itself."""
    flat = points.reshape(len(time), -1)
    columns = [np.interp(time, time + lead, column) for column in flat.T]
    return np.stack(columns, axis=-1).reshape(points.shape)


def _seen_from(poses: FloatArray, p_WP: FloatArray) -> FloatArray:
    """Returns points in W, shape (ticks, k, 3), in the frames of poses, shape (ticks, 7)."""
    R = Rotation.from_quat(poses[:, [4, 5, 6, 3]]).as_matrix()
    seen: FloatArray = np.einsum("tji,tkj->tki", R, p_WP - poses[:, None, :3])
    return seen


def _largest_motion(points: FloatArray, during: BoolArray) -> float | None:
    """Returns how far any point got from where it was at first, shape (ticks, k, 3)."""
    chosen = points[during]
    return float(np.max(np.linalg.norm(chosen - chosen[0], axis=2))) if len(chosen) else None


def tracking_summary(status: FloatArray, time_since_measurement: FloatArray) -> dict[str, Any]:
    """Returns how well the object was tracked; null where there is no tick.

    - `share`: of the ticks, for each `TrackingStatus` by its name.
    - `longest_without_measurement`: age of the newest measurement in an estimate, at most, in
      seconds.

    Args:
        status: A `TrackingStatus` a tick, shape (k,).
        time_since_measurement: Shape (k,), in seconds.
    """
    there = len(status) > 0
    return {
        "share": {
            kind.name.lower(): float(np.mean(status == kind)) if there else None
            for kind in TrackingStatus
        },
        "longest_without_measurement": float(np.max(time_since_measurement)) if there else None,
    }


MEASURES = ("q_msv", "q_gii", "q_vew")
"""The measures of Table II, by their columns in `log.csv`."""


def summarize(
    name: str,
    scenario: Scenario,
    surface: ObjectSurface,
    log: RunLog,
    *,
    wall_seconds: float,
    completed: bool,
) -> dict[str, Any]:
    """Returns the content of `summary.json`.

    `static` holds means over the phase in which the initial contacts are held, `max` and `mean` are
    over the phase in which they adapt, and `final` is the last tick; null where there is no tick.
    `inactive_contacts` says which have no place at the last tick, and why. `tracking` is of all
    ticks, and `deadline_overruns` are those that took longer to compute than the planning period.
    With damage, `max` and `mean` end before the first loss, and `after_damage` follows the last.
    """
    time, *values = log.read("time", *MEASURES)
    measured = dict(zip(MEASURES, values, strict=True))
    static, adapting = static_phase(scenario, time), adapting_phase(scenario, time)
    return {
        "scenario": name,
        "seed": scenario.random_seed,
        "completed": completed,
        "versions": _versions(),
        "static": _measures(measured, static, np.mean),
        "max": _measures(measured, adapting, np.max),
        "mean": _measures(measured, adapting, np.mean),
        "final": _measures(measured, slice(-1, None), np.mean),
        "contact_model": scenario.measures.contact_model,
        **force_closure_summary(scenario, surface, static=log.last_static, final=log.last),
        **_after_damage(scenario, surface, measured, time),
        "inactive_contacts": inactive_contacts(scenario, log),
        "tracking": tracking_summary(*log.read("tracking_status", "time_since_measurement")),
        "ticks": log.num_ticks,
        "simulated_seconds": float(time[-1]) if len(time) else 0.0,
        "tick_time_p50_ms": log.tick_times.percentile_ms(50),
        "tick_time_p99_ms": log.tick_times.percentile_ms(99),
        "deadline_overruns": log.tick_times.overruns,
        "real_time_factor": float(time[-1]) / wall_seconds if len(time) else 0.0,
    }


def inactive_contacts(scenario: Scenario, log: RunLog) -> dict[str, str]:
    """Returns the contacts that are there at the last tick, but have nowhere to be, and why."""
    record = log.last
    if record is None:
        return {}
    without = ~is_active(record.contact_status) & (record.contact_status != ContactStatus.LOST)
    return {
        str(contact): describe_status(
            record.contact_status[contact],
            record.contact_causes[contact],
            scenario.obstacle_names,
        )
        for contact in np.flatnonzero(without).tolist()
    }


def _after_damage(
    scenario: Scenario,
    surface: ObjectSurface,
    measured: dict[str, FloatArray],
    time: FloatArray,
) -> dict[str, dict[str, dict[str, float | None]]]:
    """Returns the measures after the last loss: of the static contacts left, and the best."""
    if not scenario.damage:
        return {}
    static = remaining_static_quality(scenario, surface)
    return {
        "after_damage": {
            "static": {name: getattr(static, name) for name in MEASURES},
            "max": _measures(measured, last_phase(scenario, time), np.max),
        }
    }


def _measures(
    measured: dict[str, FloatArray], ticks: slice, reduce: Any
) -> dict[str, float | None]:
    chosen = {name: values[ticks] for name, values in measured.items()}
    return {name: float(reduce(v)) if len(v) else None for name, v in chosen.items()}


def _versions() -> dict[str, str]:
    # Kernels differ in last digits, so that a log is the same with the same kernel only.
    packages = ("drake", "numpy", "scipy", "trimesh", *(["numba"] if numba_is_installed() else []))
    return {
        "drake_pregrasp": __version__,
        "python": platform.python_version(),
        **{package: importlib.metadata.version(package) for package in packages},
    }
