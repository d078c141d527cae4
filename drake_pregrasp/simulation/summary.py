"""Results of a run in `summary.json` and `metrics.png`."""

import importlib.metadata
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.config.object_config import Conveyor, PoseStream, is_free_flight
from drake_pregrasp.contacts.goal_limits import hold_contacts
from drake_pregrasp.contacts.selection_input import (
    ContactStatus,
    SelectionInput,
    describe_status,
    is_active,
)
from drake_pregrasp.errors import printable
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.grasping.catch_limits import describe_catch_limit
from drake_pregrasp.grasping.grasp_state import GraspPhase, describe_give_up
from drake_pregrasp.grasping.held_criterion import GraspTicks, held_measures
from drake_pregrasp.quality.force_closure import ferrari_canny, min_weight_margin
from drake_pregrasp.quality.grasp_quality import (
    QUALITY_MEASURES,
    GraspQuality,
    characteristic_length,
    grasp_quality,
)
from drake_pregrasp.regions.coordinates import QUANTITIES
from drake_pregrasp.regions.independent_regions import force_closed_share, slip_radii_within
from drake_pregrasp.regions.safe_regions import compute_safe_regions
from drake_pregrasp.simulation import run_log
from drake_pregrasp.simulation.output import replacing, writing
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.run_log import GraspLog, RunLog
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.link_contacts import TOUCHED
from drake_pregrasp.systems.loggers import TickRecord
from drake_pregrasp.version import __version__

MARGINS = (
    "force_closure_margin",
    "ferrari_canny",
    "independent_region_share",
    "independent_radius",
)
"""Measures of force closure in the summary."""


def force_closure_summary(
    resolved: ResolvedScenario,
    *,
    static: TickRecord | None,
    final: TickRecord | None,
) -> dict[str, dict[str, Any]]:
    """Returns four measures of the active contacts, with their assumptions, by their names.

    `force_closure_margin` is the min-weight margin, and `ferrari_canny` the radius in newtons.
    `independent_region_share` is the share of force-closed choices of one point in each region, and
    `independent_radius` the smallest of `slip_radii_within` the longest lever arm, in metres.

    Args:
        resolved: Simulated scenario, whose key `measures` configures the measures.
        static: Record of the tick for the values `static`; None for null values.
        final: Record of the tick for the values `final`; None for null values.
    """
    measures = resolved.measures
    model = "hard_finger" if measures.contact_model == "complete" else measures.contact_model
    columns = [_measure(resolved, model, record) for record in (static, final)]
    common = {"friction": measures.friction, "contact_model": model}
    return {
        name: {**common, "static": first, "final": last}
        for name, first, last in zip(MARGINS, *columns, strict=True)
    }


def _measure(
    resolved: ResolvedScenario, model: str, record: TickRecord | None
) -> tuple[float | None, ...]:
    if record is None:
        return (None,) * len(MARGINS)
    scenario, surface = resolved.scenario, resolved.surface
    measures, friction = resolved.measures, resolved.measures.friction
    cone: dict[str, Any] = {"model": model, "torsional_friction": measures.torsional_friction}
    _, p_OC = record.active_contacts()
    r, (_, nhat) = p_OC - surface.p_OCoM, surface.project(p_OC)
    far = surface.longest_lever_arm
    length = characteristic_length(measures.length, model, far)
    generator = np.random.default_rng(scenario.random_seed)
    return (
        min_weight_margin(r, nhat, friction, **cone),
        ferrari_canny(r, nhat, friction, length=length, **cone),
        force_closed_share(surface, record.regions, friction, generator=generator, **cone),
        float(min(slip_radii_within(surface, p_OC, nhat, far, friction, **cone), default=0.0)),
    )


SETTLED = 1.0
"""Start of tracking errors, in seconds; earlier, tips move to their start contacts."""


def summarize_grasp(resolved: ResolvedScenario, log: GraspLog) -> dict[str, Any]:
    """Returns the results of a grasp, with `held_measures`; null for phases that were not reached.

    - `tracking_error_mean_mm`, `tracking_error_max_mm`: distance of the fingertips' centres from
      their goals, relative to the estimated object at the same time, while the hand approaches
      and tracks, after the first second (`SETTLED`). Each goal is compared with the fingertip after
      the controller's lead.
    - `lift_height_mm`: distance along `grasp.lift_direction` of the object at the end from its
      place before the lift.
    - `tip_forces`: contact force of each finger at the end, in newtons.
    - `link_forces`: largest force with which a link that is no fingertip touched the object, the
      surroundings, and another finger, in newtons.
    - `phase`, `gave_up`: phase at the end, and reason why the hand opened again, or null.
    - `met_at`: time in seconds at which a hand that waits (`grasp.meeting.wait_at`) met the object,
      or null.
    - `cannot_meet`: reason why it could not meet the object at the end, or null.
    - `palm_from`: unit vector in W from the object towards the palm.
    """
    scenario = resolved.scenario
    names = ("time", "phase", "phase_since", "gave_up", "gave_up_detail", "catch_limit")
    time, phase, since, reason, detail, limit = log.read(*names)
    if not len(time):
        return {"phase": None, "gave_up": None}
    tips, goals, forces = (log.read_points(kind) for kind in ("tip", "goal", "force"))
    object_poses, hand_poses = log.read_pose("wo"), log.read_pose("wg")
    hand = resolved.hand
    lead = scenario.grasp.period + resolved.plant_config.time_step
    carried = seen_from(hand_poses, tips)
    errors = 1e3 * np.linalg.norm(carried - _shifted(time, goals, lead), axis=2)
    tracking = (phase <= GraspPhase.TRACK) & (time > SETTLED)
    is_there = np.isin(phase, (GraspPhase.TRACK, GraspPhase.CLOSE))
    approaches = phase[-1] == GraspPhase.APPROACH
    lifting = np.flatnonzero(phase == GraspPhase.LIFT)
    lifted = (
        object_poses[lifting[0] if len(lifting) else len(time) :, :3] @ scenario.grasp.lift_axis
    )
    ticks = GraspTicks(time, phase, since, object_poses, log.read_pose("wd"), hand_poses)
    return {
        "phase": GraspPhase(int(phase[-1])).name.lower(),
        "gave_up": describe_give_up(int(reason[-1]), detail[-1]),
        "tracking_error_mean_mm": _reduced(np.mean, errors[tracking]),
        "tracking_error_max_mm": _reduced(np.max, errors[tracking]),
        **held_measures(
            ticks,
            resolved.surface.p_OCoM,
            scenario.grasp.close_at,
            is_carried=isinstance(scenario.motion, Conveyor),
            falls=is_free_flight(scenario.motion),
            shakes=scenario.grasp.shake,
        ),
        "lift_height_mm": _reduced(lambda s: 1e3 * (s[-1] - s[0]), lifted),
        "tip_forces": np.linalg.norm(forces[-1], axis=1).tolist(),
        "link_forces": {
            touched: float(np.max(log.read(f"link_force_{touched}"))) for touched in TOUCHED
        },
        "met_at": _reduced(np.min, time[is_there]) if scenario.grasp.meeting.wait_at else None,
        "cannot_meet": describe_catch_limit(int(limit[-1])) if approaches else None,
        "palm_from": None if hand is None else hand.X_LA.rotation().matrix()[:, 2].tolist(),
    }


def _shifted(time: FloatArray, points: FloatArray, lead: float) -> FloatArray:
    """Delays points, shape (ticks, n, 3), by `lead` seconds with linear interpolation."""
    columns = points.reshape(len(time), -1).T
    return np.stack([np.interp(time, time + lead, c) for c in columns], -1).reshape(points.shape)


def seen_from(poses: FloatArray, p_WP: FloatArray) -> FloatArray:
    """Transforms points in W, shape (ticks, k, 3), to the frames of poses, shape (ticks, 7)."""
    R = Rotation.from_quat(poses[:, [4, 5, 6, 3]]).as_matrix()
    return np.asarray(np.einsum("tji,tkj->tki", R, p_WP - poses[:, None, :3]))


def _reduced(reduce: Callable[[Any], Any], values: FloatArray | IntArray) -> float | None:
    """Returns a statistic of values, or None if there are none."""
    return float(reduce(values)) if len(values) else None


def tracking_summary(status: FloatArray, time_since_measurement: FloatArray) -> dict[str, Any]:
    """Summarizes the tracking of the object; null if there is no tick.

    - `share`: share of the ticks with each `TrackingStatus`, by the status's name.
    - `longest_without_measurement`: largest age of an estimate's newest measurement, in seconds.

    Args:
        status: `TrackingStatus` at each tick, shape (k,).
        time_since_measurement: Age of the newest measurement at each tick, shape (k,), in seconds.
    """
    shares = {kind.name.lower(): _reduced(np.mean, status == kind) for kind in TrackingStatus}
    longest = _reduced(np.max, time_since_measurement)
    return {"share": shares, "longest_without_measurement": longest}


def summarize(
    name: str,
    resolved: ResolvedScenario,
    log: RunLog,
    *,
    wall_seconds: float,
    completed: bool,
) -> dict[str, Any]:
    """Returns the content of `summary.json`; null for a measure of no tick.

    Ticks after the object has left the table or is lost for good count only for `final`.

    - `scenario`, `seed`, `completed`, `versions`: what was run, whether it reached its end, and the
      versions of the libraries.
    - `kernels`: library that computed the ticks, numba or numpy.
    - `static`: means of the measures while the initial contacts are held.
    - `max`, `mean`: measures while the contacts adapt, before the first damage.
    - `final`: measures at the last tick.
    - `after_damage`: only with damage: static measures of the initial contacts whose fingers are
      not lost at the end, and the largest ones after the last loss or return of a finger.
    - `coordinates`: only with `planner.coordinates`: what fingers offer and what their last goals
      demand, by name.
    - `contact_model`: contact model of the measures.
    - `force_closure_margin`, `ferrari_canny`, `independent_region_share`, `independent_radius`:
      measures of force closure at the last tick of the static phase, and of the run.
    - `inactive_contacts`: contacts without a goal at the last tick, and why.
    - `tracking`: share of the ticks with each tracking status, and the longest time without a
      measurement.
    - `grasp`: only with a hand: the results below.
    - `ticks`, `simulated_seconds`, `real_time_factor`: length and speed of the run.
    - `tick_time_p50_ms`, `tick_time_p99_ms`, `deadline_overruns`: computing times of ticks, and
      number of those that took longer than the planning period.
    """
    scenario = resolved.scenario
    time, *values = log.read("time", *QUALITY_MEASURES)
    measured = dict(zip(QUALITY_MEASURES, values, strict=True))
    seconds, end = np.array(log.tick_seconds), float(time[-1]) if len(time) else 0.0
    fate = object_fate(resolved, log)
    gone = min((at for at in fate.values() if at is not None), default=np.inf)
    present = slice(run_log.ticks_from(scenario, time, gone))
    final = _measures(measured, slice(-1, None), np.mean)
    measured = {name: column[present] for name, column in measured.items()}
    static, adapting = run_log.static_phase(scenario, time), run_log.adapting_phase(scenario, time)
    return {
        "scenario": name,
        "seed": scenario.random_seed,
        "completed": completed,
        "kernels": (kernels := resolved.kernels.name),
        "versions": _versions(kernels),
        "static": _measures(measured, static, np.mean),
        "max": _measures(measured, adapting, np.max),
        "mean": _measures(measured, adapting, np.mean),
        "final": final,
        **fate,
        "contact_model": resolved.measures.contact_model,
        **force_closure_summary(resolved, static=log.last_static, final=log.last),
        **_after_damage(resolved, measured, time),
        **_coordinates(resolved, log.last),
        "inactive_contacts": inactive_contacts(resolved, log),
        "tracking": tracking_summary(*log.read("tracking_status", "time_since_measurement")),
        "ticks": log.num_rows,
        "simulated_seconds": end,
        "tick_time_p50_ms": _reduced(lambda t: 1e3 * np.percentile(t, 50), seconds),
        "tick_time_p99_ms": _reduced(lambda t: 1e3 * np.percentile(t, 99), seconds),
        "deadline_overruns": int(np.sum(seconds > scenario.planner.period)),
        "real_time_factor": end / wall_seconds if len(time) else 0.0,
    }


def object_fate(resolved: ResolvedScenario, log: RunLog) -> dict[str, float | None]:
    """Returns the times in seconds at which the object left or was lost; null if never.

    - `object_left_at`: first time at which the centre of mass was below the top of the table.
    - `object_lost_at`: time from which the estimator has lost the object until the end.
    """
    names = ("time", "tracking_status", *run_log.pose_columns("wo"))
    time, status, _, _, z, qw, qx, qy, qz = log.read(*names)
    motion, surface = resolved.scenario.motion, resolved.surface
    has_table = not (isinstance(motion, PoseStream) or is_free_flight(motion))
    z_of_R = 2 * np.stack([qx * qz - qw * qy, qy * qz + qw * qx, 0.5 - qx**2 - qy**2])
    left = time[(z + surface.p_OCoM @ z_of_R < 0) & has_table]
    found = np.flatnonzero(status != TrackingStatus.LOST)
    lost = time[found[-1] + 1 if len(found) else 0 :]
    return {"object_left_at": _reduced(np.min, left), "object_lost_at": _reduced(np.min, lost)}


def inactive_contacts(resolved: ResolvedScenario, log: RunLog) -> dict[str, str]:
    """Returns the reasons why remaining contacts are inactive at the last tick, by index."""
    if log.last is None:
        return {}
    status, causes = log.last.contact_status, log.last.contact_causes
    return {
        str(contact): describe_status(status[contact], causes[contact], resolved.obstacle_names)
        for contact in np.flatnonzero(~is_active(status) & (status != ContactStatus.LOST))
    }


def _after_damage(
    resolved: ResolvedScenario, measured: dict[str, FloatArray], time: FloatArray
) -> dict[str, Any]:
    """Returns the best measures after the last loss or return of a finger, and static ones.

    The static measures are those of the initial contacts that are not lost then.
    """
    if not resolved.scenario.damage:
        return {}
    quality = remaining_static_quality(resolved)
    static = {name: getattr(quality, name) for name in QUALITY_MEASURES}
    best = _measures(measured, run_log.last_phase(resolved.scenario, time), np.max)
    return {"after_damage": {"static": static, "max": best}}


def remaining_static_quality(resolved: ResolvedScenario) -> GraspQuality:
    """Returns the measures of the active initial contacts that are not lost at the end."""
    p_OC, surface = resolved.start.p_OC, resolved.surface
    weights = np.full(len(p_OC), -np.inf)
    weights[resolved.remaining_contacts()] = 0.0
    regions = compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden)
    held = hold_contacts(SelectionInput(surface, p_OC, regions, np.eye(3)))
    return grasp_quality(p_OC[held.active] - surface.p_OCoM)


def _coordinates(resolved: ResolvedScenario, final: TickRecord | None) -> dict[str, Any]:
    """Returns what fingers offer, and what their last goals demand, for further coordinates."""
    axes, surface = resolved.planner.coordinates, resolved.surface
    if final is None or not axes:
        return {}
    nearest = surface.nearest_candidates((final.X_WO_estimated.inverse() @ final.p_WC.T).T)
    demands = [QUANTITIES[axis.candidates](surface)[nearest].tolist() for axis in axes]
    return {
        "coordinates": {
            axis.label: {"fingers": axis.fingers, "goals": demand}
            for axis, demand in zip(axes, demands, strict=True)
        }
    }


def _measures(measured: dict[str, FloatArray], ticks: slice, reduce: Any) -> dict[str, Any]:
    return {name: _reduced(reduce, values[ticks]) for name, values in measured.items()}


def _versions(kernels: str) -> dict[str, str]:
    # A log's last digits depend on the library of the kernels.
    packages = dict.fromkeys(("drake", "numpy", "scipy", "trimesh", kernels))
    own = {"drake_pregrasp": __version__, "python": platform.python_version()}
    return own | {package: importlib.metadata.version(package) for package in packages}


# Colours of Okabe and Ito's colour-blind-safe set.
_COLORS = ("#0072B2", "#D55E00", "#009E73")


def plot_metrics(path: Path, name: str, scenario: Scenario, log: RunLog, summary: Any) -> None:
    """Plots the three measures and the contacts' displacement over time.

    Raises:
        OutputError: If the file cannot be written.
    """
    # Imported here because the import takes a fifth of a second.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(4, 1, sharex=True)
    time, displacement, *measured = log.read("time", "displacement", *QUALITY_MEASURES)
    losses = [event.at for event in scenario.damage]
    returns = [event.until for event in scenario.damage if event.until]
    for axis, measure, color, values in zip(
        axes, QUALITY_MEASURES, _COLORS, measured, strict=False
    ):
        axis.plot(time, values, color=color, linewidth=1.2)
        if (static := summary["static"][measure]) is not None:
            axis.axhline(static, color="0.35", linestyle="--", linewidth=1, label="static mean")
        axis.set_ylabel(f"$Q_{{{measure[2:].upper()}}}$")
        axis.ticklabel_format(axis="y", useOffset=False)
    axes[3].plot(time, 1e3 * displacement, color="#56B4E9", linewidth=1.0)
    axes[3].set(ylabel="displacement,\nsum [mm per tick]", xlabel="time [s]")
    for axis in axes:
        if scenario.planner.static_duration > 0:
            axis.axvspan(0, scenario.planner.static_duration, color="0.92", label="static phase")
        for style, label, times in ((":", "fingers lost", losses), ("-.", "fingers back", returns)):
            for index, at in enumerate(times):
                once = None if index else label
                axis.axvline(at, color="#CC79A7", linestyle=style, linewidth=1.5, label=once)
        axis.set(xlim=(0, max(time[-1], scenario.planner.period)), axisbelow=True)
        axis.grid(True, color="0.9", linewidth=0.6)
        axis.spines[["top", "right"]].set_visible(False)
    if axes[0].get_legend_handles_labels()[1]:
        axes[0].legend(loc="lower right", frameon=False)
    figure.align_ylabels(axes)
    title = f"{name}: {scenario.description}" if scenario.description else name
    figure.suptitle(printable(title), parse_math=False)
    with writing(path), replacing(path) as partial:
        figure.savefig(partial, dpi=130)
