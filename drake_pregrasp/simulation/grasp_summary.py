"""What a grasp comes to: the entry `grasp` of `summary.json`."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from drake_pregrasp.planning.arrays import BoolArray, FloatArray
from drake_pregrasp.planning.grasp_state import GraspPhase, describe_give_up
from drake_pregrasp.simulation.grasp_log import GraspLog
from drake_pregrasp.simulation.scenario import Scenario

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
