"""Criterion of a held object: how far it moves in each part of a grasp, and how it is shaken.

On the table, an object should stay where it was placed; in the air, where it was in the frame G,
which falls as the object did when the hand met it. In the hand, it should stay where it was at
the start of the lift; in the shake, where it was at the start of the shake. It is held if it is
never farther from there than `LARGEST_MM` and `LARGEST_DEG`, from the start of the simulation until
`HOLD_DURATION` after the lift, and then through the shake.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import TIME_ROUNDING, BoolArray, FloatArray, norms
from drake_pregrasp.grasping.grasp_state import GraspPhase

LARGEST_MM, LARGEST_DEG = 5.0, 5.0
"""Largest distance of the centre of mass, and largest angle, from where a held object should be."""

HOLD_DURATION = 10.0
"""Duration of the hold before the shake, in seconds."""

SHAKE = 0.5
"""Largest force of the shake, as a multiple of the object's weight."""

SHAKE_PERIOD = 1.0
"""Seconds of the shake along each axis of W: one period of a sine, so that it has six directions.

A force that starts with a step would make the hand ring, more or less at other time steps."""

SHAKE_END = HOLD_DURATION + 3 * SHAKE_PERIOD
"""Time from the end of the lift to the end of the shake, in seconds."""

PARTS = ("before", "closing", "squeeze", "lift", "hold", "shake")
"""Parts of a grasp, in their order. Closing is from the command until the squeeze."""

_LEAST_DRIFT = 2.0  # Shortest hold in which a drift can be measured, in seconds.


class GraspTicks(NamedTuple):
    """Control ticks of a hand, from the start of the simulation.

    A pose is a row of position in metres, and quaternion w, x, y, z.

    Attributes:
        time: Time in seconds, shape (k,).
        phase: `GraspPhase`, shape (k,).
        since: Time at which the phase began, in seconds, shape (k,).
        X_WO: Pose of the object, shape (k, 7).
        X_WD: Pose of the turntable that carries the object, or W, shape (k, 7).
        X_WG: Pose of the frame G in which goals are planned, shape (k, 7).
    """

    time: FloatArray
    phase: FloatArray
    since: FloatArray
    X_WO: FloatArray
    X_WD: FloatArray
    X_WG: FloatArray


def shake_force(since_lift: float) -> FloatArray:
    """Returns the force of the shake in W as a multiple of the weight, shape (3,).

    Args:
        since_lift: Seconds since the end of the lift.
    """
    axis, share = divmod((since_lift - HOLD_DURATION) / SHAKE_PERIOD, 1)
    force: FloatArray = SHAKE * math.sin(2 * math.pi * share) * (np.arange(3) == axis)
    return force


def held_measures(
    ticks: GraspTicks,
    p_OCoM: FloatArray,
    close_at: float,
    *,
    is_carried: bool,
    falls: bool,
    shakes: bool,
) -> dict[str, Any]:
    """Returns how far an object moved in each part of a grasp, and whether it was held.

    - `moved_before_mm`, `turned_before_deg`, and the same for `closing`, `squeeze`, `lift`, `hold`
      and `shake` (`PARTS`): largest distance of the centre of mass, and largest angle, in that part
      from where the object should be. On the table this is its first pose relative to the
      turntable; in the air, its pose in G at the meeting; in the hand, its pose in G at the start
      of the lift, or of the shake. None for a part that was not reached.
    - `drift_mm_per_min`: speed at which the object slips in the second half of the hold; None if
      the hold is shorter than two seconds.
    - `slips_after_s`: time in which an object that drifts at that speed slips by 5 mm
      (`LARGEST_MM`); None without a drift.
    - `held`: whether the object was held; None if the ticks end before that is known.

    The part before the command lasts until the hand has met the object. An object that no conveyor
    carries may move in it: nothing is measured there, and it should then stay where it is.

    Args:
        ticks: Control ticks.
        p_OCoM: Centre of mass in O, shape (3,), in metres.
        close_at: Time of the command to close, in seconds.
        is_carried: Whether a conveyor carries the object.
        falls: Whether it is in free flight until the hand has gripped it.
        shakes: Whether the object is shaken after the hold.
    """
    has_met = np.logical_or.accumulate(ticks.phase > GraspPhase.APPROACH)
    is_commanded = has_met & (ticks.time >= close_at - TIME_ROUNDING)
    parts = _parts(ticks, is_commanded, shakes=shakes)
    placed = 0 if is_carried else int(np.argmax(is_commanded))
    on_table = ticks.X_WG if falls else ticks.X_WD, placed
    in_hand, shaken = ((ticks.X_WG, int(np.argmax(parts[p]))) for p in ("lift", "shake"))
    where = on_table, on_table, on_table, in_hand, in_hand, shaken
    found: dict[str, float | None] = {}
    for (part, during), (X_WF, first) in zip(parts.items(), where, strict=True):
        known = np.any(during) and (is_carried or part != "before")
        mm, deg = _displacements(X_WF, ticks.X_WO, p_OCoM, first)
        found[f"moved_{part}_mm"] = float(np.max(mm[during])) if known else None
        found[f"turned_{part}_deg"] = float(np.max(deg[during])) if known else None
    gave_up = bool(np.any(is_commanded & (ticks.phase == GraspPhase.BACK_OFF)))
    lasted = ticks.time[-1] - ticks.since[-1]
    is_over = shakes and ticks.phase[-1] == GraspPhase.HOLD and lasted >= SHAKE_END - TIME_ROUNDING
    held = False if gave_up or part_moved(found) else True if is_over else None
    return {"held": held, **found, **_drift(ticks, p_OCoM, parts["hold"])}


def part_moved(measures: Mapping[str, float | None]) -> str | None:
    """Returns the first of the `PARTS` in which the object moved too far, or None.

    Args:
        measures: Result of `held_measures`.
    """
    for part in PARTS:
        mm, deg = measures[f"moved_{part}_mm"], measures[f"turned_{part}_deg"]
        if mm is not None and deg is not None and (mm > LARGEST_MM or deg > LARGEST_DEG):
            return part
    return None


def _parts(ticks: GraspTicks, is_commanded: BoolArray, *, shakes: bool) -> dict[str, BoolArray]:
    """Returns which ticks are in each of the `PARTS`, in their order."""
    holds, lasted = ticks.phase == GraspPhase.HOLD, ticks.time - ticks.since
    shaken = holds & (lasted >= HOLD_DURATION - TIME_ROUNDING) & shakes
    return {
        "before": ~is_commanded,
        "closing": is_commanded & (ticks.phase <= GraspPhase.CLOSE),
        "squeeze": ticks.phase == GraspPhase.SQUEEZE,
        "lift": ticks.phase == GraspPhase.LIFT,
        "hold": holds & ~shaken,
        "shake": shaken & (lasted <= SHAKE_END + TIME_ROUNDING),
    }


def _displacements(
    X_WF: FloatArray, X_WO: FloatArray, p_OCoM: FloatArray, first: int
) -> tuple[FloatArray, FloatArray]:
    """Returns how far O is from its pose in F at a first tick: in mm and degrees, shape (k,)."""
    p_FCoM, R_FO = _seen_from(X_WF, X_WO, p_OCoM)
    turned = (R_FO[first].inv() * R_FO).magnitude()
    return 1e3 * norms(p_FCoM - p_FCoM[first]), np.degrees(turned)


def _seen_from(
    X_WF: FloatArray, X_WO: FloatArray, p_OCoM: FloatArray
) -> tuple[FloatArray, Rotation]:
    """Returns the position of the centre of mass, shape (k, 3), and the orientation of O in F."""
    R_WF, R_WO = (Rotation.from_quat(X[:, [4, 5, 6, 3]]) for X in (X_WF, X_WO))
    p_WCoM = X_WO[:, :3] + R_WO.apply(p_OCoM)
    return R_WF.inv().apply(p_WCoM - X_WF[:, :3]), R_WF.inv() * R_WO


def _drift(ticks: GraspTicks, p_OCoM: FloatArray, hold: BoolArray) -> dict[str, float | None]:
    """Returns the drift in the second half of the hold, by a line of least squares."""
    time = ticks.time[hold]
    if not len(time) or time[-1] - time[0] < _LEAST_DRIFT:
        return {"drift_mm_per_min": None, "slips_after_s": None}
    half = time >= (time[0] + time[-1]) / 2
    p_GCoM, _ = _seen_from(ticks.X_WG[hold][half], ticks.X_WO[hold][half], p_OCoM)
    rate = 1e3 * float(np.linalg.norm(np.polyfit(time[half], p_GCoM, 1)[0]))
    return {"drift_mm_per_min": 60 * rate, "slips_after_s": LARGEST_MM / rate if rate else None}
