"""Outcome of one simulated grasp: measures computed from the records of its ticks."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.grasping.grasp_state import GraspPhase, GraspState, describe_give_up
from drake_pregrasp.studies.grasps.failure_cause import failure_cause, tilt_deg
from drake_pregrasp.systems.loggers import GraspRecord

LIFTED_ABOVE_MM = 80.0
"""Height that a lifted object exceeds, in millimetres."""

LEVEL_BELOW_DEG = 20.0
"""Bound of the tilt of a level object, in degrees."""

TOUCHING_N = GraspConfig.touch_force
"""Least force of a link that counts as touch, in newtons, the same as that of a fingertip.

To slide the object of the study over the turntable takes some six times as much.
"""

CLEAN_BELOW = {
    "link_on_object_n": TOUCHING_N,
    "link_on_surroundings_n": TOUCHING_N,
    "link_on_hand_n": TOUCHING_N,
    "pushed_before_mm": 5.0,
    "turned_before_deg": 5.0,
    "pushed_closing_mm": 5.0,
    "slip_mm": 5.0,
}
"""Bounds of a clean grasp on measures of an `Outcome`."""

HELD_IN_WORDS = (
    f"An object is held if it was lifted by more than {LIFTED_ABOVE_MM:g} mm and is still there"
    " after a second. Refused objects were not simulated, and count as not held."
)
"""Definition of a held object for the report."""

CLEAN_IN_WORDS = (
    f"A grasp is clean if the object is lifted by more than {LIFTED_ABOVE_MM:g} mm and tilted by"
    f" less than {LEVEL_BELOW_DEG:g}°, slips by less than {CLEAN_BELOW['slip_mm']:g} mm, and was"
    f" moved by less than {CLEAN_BELOW['pushed_before_mm']:g} mm and turned by less than"
    f" {CLEAN_BELOW['turned_before_deg']:g}° before the hand closed, and moved by less than"
    f" {CLEAN_BELOW['pushed_closing_mm']:g} mm in closing; and if no link other than a fingertip"
    f" ever touched anything with {TOUCHING_N:g} N or more."
)
"""Definition of a clean grasp for the report."""

Status = tuple[int, ...]
"""`ContactStatus` of each finger at one tick of the planner."""


@dataclass(frozen=True)
class Outcome:
    """Measures of one grasp of a trial, from the first tick to the end of the hold.

    They are columns of the study's rows.

    Attributes:
        close_at: Time at which the hand was commanded to close, in seconds.
        held: Whether the object was lifted, and was still raised at the end of the hold.
        level: Whether the object was level at the end of the hold.
        pushed_before_mm: Distance by which the hand moved the object before the command to close,
            in millimetres.
        turned_before_deg: Angle by which the hand turned the object before the command to close,
            in degrees.
        pushed_closing_mm: Distance by which the hand moved the object during closing, in
            millimetres.
        slip_mm: Slip of the object in the hand, in millimetres; nan if the object was never lifted.
        tilt_deg: Tilt of the object at the end of the hold, in degrees.
        fingers: Number of fingers that took part.
        waited_s: Time for which the gate delayed the command to close, in seconds.
        withdrawn: Number of fingers that were not lost but had no goal, because it was out of reach
            or too near to an obstacle; mean over the planner's ticks before closing.
        link_on_object_n: Largest force between the object and a link that is no fingertip, in
            newtons.
        link_on_surroundings_n: Largest force between such a link and the table or a wall, in
            newtons.
        link_on_hand_n: Largest force between such a link and another finger, in newtons.
        gave_up: Reason why the hand gave up; empty if it did not.
        pushed_before_squeeze_mm: Distance by which the hand moved the object before the squeeze, in
            millimetres; up to the end of a grasp without a squeeze.
        cause: Cause of a grasp that failed to lift and hold the object, see `failure_cause`.
    """

    close_at: float
    held: bool
    level: bool
    pushed_before_mm: float
    turned_before_deg: float
    pushed_closing_mm: float
    slip_mm: float
    tilt_deg: float
    fingers: int
    waited_s: float
    withdrawn: float
    link_on_object_n: float
    link_on_surroundings_n: float
    link_on_hand_n: float
    gave_up: str
    pushed_before_squeeze_mm: float
    cause: str

    @property
    def clean(self) -> bool:
        """Whether the grasp is clean by `CLEAN_IN_WORDS`; nan violates every bound."""
        within = all(getattr(self, name) < bound for name, bound in CLEAN_BELOW.items())
        return self.held and self.level and within


def grasp_outcome(
    close_at: float,
    records: Sequence[GraspRecord],
    statuses: Sequence[Status],
    state: GraspState,
) -> Outcome:
    """Computes the outcome of a grasp.

    Args:
        close_at: Time at which the hand was commanded to close, in seconds.
        records: Records of all control ticks until the end of the grasp.
        statuses: Status of the fingers at the planner's ticks of the tracking run.
        state: State of the grasp at its end.
    """
    told = [r.time >= close_at - 1e-9 for r in records].index(True)
    phases = np.array([r.report[0] for r in records])
    closing = _first(phases, told, GraspPhase.CLOSE)
    lifting = _first(phases, told, GraspPhase.LIFT)
    squeezing = _first(phases, told, GraspPhase.SQUEEZE)
    first, end = records[0], records[-1]
    before_squeeze = end if squeezing is None else records[squeezing]
    on_table = end if lifting is None else records[lifting]
    raised = 1e3 * (end.X_WO.translation()[2] - on_table.X_WO.translation()[2])
    held = bool(phases[-1] == GraspPhase.HOLD and raised > LIFTED_ABOVE_MM)
    tilt = tilt_deg(end)
    on_object, on_surroundings, on_hand = np.max([r.link_forces for r in records], axis=0).tolist()
    return Outcome(
        close_at=close_at,
        held=held,
        level=bool(tilt < LEVEL_BELOW_DEG),
        pushed_before_mm=_moved_mm(first, records[told]),
        turned_before_deg=_turned_deg(first, records[told]),
        pushed_closing_mm=_moved_mm(records[told], on_table),
        slip_mm=np.nan if lifting is None else _slip_mm(records[lifting:], state.active),
        tilt_deg=tilt,
        fingers=int(np.sum(state.active)),
        waited_s=float((end if closing is None else records[closing]).time - close_at),
        withdrawn=_mean(
            [sum(s <= 0 and s != ContactStatus.LOST for s in each) for each in statuses]
        ),
        link_on_object_n=on_object,
        link_on_surroundings_n=on_surroundings,
        link_on_hand_n=on_hand,
        gave_up=describe_give_up(state.reason, state.detail) or "",
        pushed_before_squeeze_mm=_moved_mm(first, before_squeeze),
        cause="" if held else failure_cause(records, statuses[-1:], state),
    )


def _first(phases: FloatArray, start: int, phase: GraspPhase) -> int | None:
    """Returns the index of the first record of a phase at or after `start`, or None."""
    found = np.flatnonzero(phases[start:] == phase)
    return start + int(found[0]) if len(found) else None


def _X_DO(record: GraspRecord) -> RigidTransform:
    """Returns the pose of the object O on the turntable D."""
    return record.X_WD.inverse() @ record.X_WO


def _moved_mm(before: GraspRecord, after: GraspRecord) -> float:
    moved = _X_DO(after).translation() - _X_DO(before).translation()
    return 1e3 * float(np.linalg.norm(moved))


def _turned_deg(before: GraspRecord, after: GraspRecord) -> float:
    R = _X_DO(before).rotation().inverse() @ _X_DO(after).rotation()
    return float(np.degrees(Rotation.from_matrix(R.matrix()).magnitude()))


def _slip_mm(records: Sequence[GraspRecord], active: BoolArray) -> float:
    """Returns the largest distance by which a fingertip moved over the object, in mm."""
    p_OT = np.array([(r.X_WO.inverse() @ r.p_WT[active].T).T for r in records])
    return 1e3 * float(np.max(np.linalg.norm(p_OT - p_OT[0], axis=2)))


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else np.nan
