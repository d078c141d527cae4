"""Cause of a failed grasp, from the records of its ticks and the state at its end."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.grasping.catch_limits import describe_catch_limit
from drake_pregrasp.grasping.grasp_state import GiveUp, GraspPhase, GraspState
from drake_pregrasp.grasping.held_criterion import part_moved
from drake_pregrasp.systems.loggers import GraspRecord

TOPPLED_DEG = 20.0
"""Tilt of an object on the table, compared with its start, from which it counts as knocked over."""

TIMED_OUT = "timed out"
"""Cause if the hand neither lifted the object nor gave up in time."""

_CAUSES = {
    GiveUp.NONE: TIMED_OUT,
    GiveUp.TOLD_TO_OPEN: "told to open",
    GiveUp.MET_NOTHING: "missed",
    GiveUp.PRESSED_TOO_HARD: "pressed too hard",
    GiveUp.OUT_OF_BALANCE: "no balance",
    GiveUp.LOST_TOUCH: "slipped",
    GiveUp.OBJECT_UNSEEN: "lost from sight",
    GiveUp.OFF_GOAL: "not at its goals",
    GiveUp.NEEDS_FORCE: "no balance",
    GiveUp.NEEDS_TORQUE: "no balance",
    GiveUp.NEEDS_FRICTION: "no balance",
    GiveUp.BLOCKED: "links blocked",
}
_LIMITS = {
    ContactStatus.OUT_OF_REACH: "no reach",
    ContactStatus.CROWDED_OUT: "crowded",
    ContactStatus.OBSTRUCTED: "obstructed",
    ContactStatus.NO_ALLOWED_SURFACE: "no allowed surface",
    ContactStatus.BEHIND_WALL: "no allowed surface",
    ContactStatus.TOO_LATE: "fingers too late",
    ContactStatus.LOST: "no reach",  # Fingers without a place stay away from the start.
}


_MOVED = {
    "before": "moved before closing",
    "closing": "moved in closing",
    "squeeze": "moved in the squeeze",
    "lift": "moved in the lift",
    "hold": "moved in the hold",
    "shake": "moved in the shake",
}


def failure_cause(
    records: Sequence[GraspRecord],
    motion: Mapping[str, float | None],
    statuses: Sequence[Sequence[int]],
    state: GraspState,
) -> str:
    """Returns the cause of a grasp that failed to hold the object, in a few words.

    What happened to the object comes before what the hand says of it: an object that the hand has
    knocked over is out of reach afterwards.

    Args:
        records: Records of all control ticks until the end of the grasp.
        motion: Motion of the object, as `held_measures` returns it.
        statuses: `ContactStatus` of each finger at the last tick before the command to close; empty
            if they are unknown.
        state: State of the grasp at its end.
    """
    phases = np.array([record.report[0] for record in records])
    if not phases.any():
        limit = records[-1].catch_certificate[0]
        return f"not met: {describe_catch_limit(limit)}" if limit > 0 else TIMED_OUT
    was_lifted = np.isin(phases, (GraspPhase.LIFT, GraspPhase.HOLD))
    lifting = int(np.argmax(was_lifted)) if np.any(was_lifted) else len(records)
    if max(map(tilt_deg, records[:lifting])) - tilt_deg(records[0]) > TOPPLED_DEG:
        return "knocked over"
    if state.reason == GiveUp.NONE and (part := part_moved(motion)):
        return _MOVED[part]
    if np.any(was_lifted):
        return "pressed too hard" if state.reason == GiveUp.PRESSED_TOO_HARD else "slipped"
    if state.reason == GiveUp.TOO_FEW_FINGERS:
        limits = Counter(s for status in statuses for s in status if s <= 0)
        worst = max(limits, key=limits.__getitem__, default=ContactStatus.OUT_OF_REACH)
        return _LIMITS.get(ContactStatus(worst), "no reach")
    return _CAUSES[GiveUp(state.reason)]


def tilt_deg(record: GraspRecord) -> float:
    """Returns the angle between z of the object O and z of W, in degrees."""
    cosine = record.X_WO.rotation().matrix()[2, 2]
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
