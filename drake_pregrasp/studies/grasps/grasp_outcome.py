"""Outcome of one simulated grasp: measures computed from the records of its ticks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import TIME_ROUNDING
from drake_pregrasp.config.object_config import Conveyor, is_free_flight
from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.grasping.catch_limits import CatchLimit
from drake_pregrasp.grasping.grasp_state import GraspPhase, GraspState, describe_give_up
from drake_pregrasp.grasping.held_criterion import (
    HOLD_DURATION,
    LARGEST_DEG,
    LARGEST_MM,
    SHAKE,
    GraspTicks,
    held_measures,
)
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.run_log import pose_values
from drake_pregrasp.studies.grasps.failure_cause import failure_cause
from drake_pregrasp.systems.loggers import GraspRecord

TOUCHING_N = 0.35
"""Least force of a link that counts as touch, in newtons.

To slide the object of the study over the turntable takes some six times as much.
"""

HELD_IN_WORDS = (
    f"An object is held if it is never more than {LARGEST_MM:g} mm or {LARGEST_DEG:g}° away from"
    " where it should be. On the table, that is where it was placed at the start, or at the meeting"
    " with the hand if no conveyor carries it; in the hand,"
    f" until {HOLD_DURATION:g} s after the lift, where it was in the frame G of the command at the"
    f" start of the lift; and in the shake that follows, by at most {SHAKE:g} times its weight in"
    " six directions, where it was before."
    " Refused objects were not simulated, and count as not held."
)
"""Definition of a held object for the report."""

CLEAN_IN_WORDS = (
    "A grasp is clean if the object is held, and no link other than a fingertip ever touched"
    f" anything with {TOUCHING_N:g} N or more."
)
"""Definition of a clean grasp for the report."""

Status = tuple[int, ...]
"""`ContactStatus` of each finger at one tick of the planner."""


@dataclass(frozen=True)
class Outcome:
    """Measures of one grasp of a trial, from the first tick to the end of the shake.

    They are columns of the study's rows.

    Attributes:
        close_at: Time at which the hand was commanded to close, in seconds.
        held: Whether the object was held, by `HELD_IN_WORDS`.
        motion: Motion of the object, as `held_measures` returns it.
        fingers: Number of fingers that took part.
        catchable: Share of the control ticks before the hand follows the object at which the
            certificate says that it can be met; NaN without such a tick.
        waited_s: Time for which the gate delayed the command to close, in seconds.
        withdrawn: Number of fingers that were not lost but had no goal, because it was out of reach
            or too near to an obstacle; mean over the planner's ticks before closing.
        link_on_object_n: Largest force between the object and a link that is no fingertip, in
            newtons.
        link_on_surroundings_n: Largest force between such a link and the table or a wall, in
            newtons.
        link_on_hand_n: Largest force between such a link and another finger, in newtons.
        gave_up: Reason why the hand gave up; empty if it did not.
        cause: Cause of a grasp that failed to hold the object, see `failure_cause`.
    """

    close_at: float
    held: bool
    motion: Mapping[str, float | None]
    fingers: int
    catchable: float
    waited_s: float
    withdrawn: float
    link_on_object_n: float
    link_on_surroundings_n: float
    link_on_hand_n: float
    gave_up: str
    cause: str

    @property
    def clean(self) -> bool:
        """Whether the grasp is clean by `CLEAN_IN_WORDS`."""
        forces = self.link_on_object_n, self.link_on_surroundings_n, self.link_on_hand_n
        return self.held and max(forces) < TOUCHING_N


def grasp_outcome(
    resolved: ResolvedScenario,
    close_at: float,
    records: Sequence[GraspRecord],
    statuses: Sequence[Status],
    state: GraspState,
) -> Outcome:
    """Computes the outcome of a grasp.

    Args:
        resolved: Scenario of the grasp.
        close_at: Time at which the hand was commanded to close, in seconds.
        records: Records of all control ticks until the end of the grasp.
        statuses: Status of the fingers at the planner's ticks of the tracking run.
        state: State of the grasp at its end.
    """
    time, phases, since = np.array([[r.time, *r.report[:2]] for r in records]).T
    poses = [[pose_values(X) for X in (r.X_WO, r.X_WD, r.X_WG)] for r in records]
    motion = held_measures(
        GraspTicks(time, phases, since, *np.array(poses).swapaxes(0, 1)),
        resolved.surface.p_OCoM,
        close_at,
        is_carried=isinstance(resolved.scenario.motion, Conveyor),
        falls=is_free_flight(resolved.scenario.motion),
        shakes=resolved.scenario.grasp.shake,
    )
    held = motion.pop("held") is True
    closing = np.flatnonzero((time >= close_at - TIME_ROUNDING) & (phases == GraspPhase.CLOSE))
    begun = time[closing[0]] if len(closing) else time[-1]
    on_object, on_surroundings, on_hand = np.max([r.link_forces for r in records], axis=0).tolist()
    withdrawn = [sum(s <= 0 and s != ContactStatus.LOST for s in each) for each in statuses]
    limits = [r.catch_certificate[0] for r in records if r.report[0] == GraspPhase.APPROACH]
    return Outcome(
        close_at=close_at,
        held=held,
        motion=motion,
        fingers=int(np.sum(state.active)),
        catchable=float(np.mean(np.equal(limits, CatchLimit.NONE))) if limits else np.nan,
        waited_s=float(begun - close_at),
        withdrawn=float(np.mean(withdrawn)) if withdrawn else np.nan,
        link_on_object_n=on_object,
        link_on_surroundings_n=on_surroundings,
        link_on_hand_n=on_hand,
        gave_up=describe_give_up(state.reason, state.detail) or "",
        cause="" if held else failure_cause(records, motion, statuses[-1:], state),
    )
