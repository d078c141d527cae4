"""Phases, settings, state and forces of a grasp."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import TIME_ROUNDING, BoolArray, FloatArray, norms, pack, unpacker

BASE = -1
"""Value in place of a finger's index for the palm with its carrier or arm."""

NOT_BLOCKED = -2
"""Value in place of a finger's index while nothing blocks the hand."""

RELEASE_SHARE = 0.2
"""Share of the touch force below which a finger no longer touches: its force varies."""

NO_LIMIT = 1e6
"""Force that replaces an infinite limit, in newtons."""

GENTLE = 1.5
"""Factor of the touch force: the largest force of a finger that touches."""

HOLDING = 4.0
"""Factor of the limit across the normals in the squeeze, where fingers hold the object in place."""

WEIGHT_DURATION = 0.1
"""Time in which fingers take over the weight at the start of the lift, in seconds."""


class GraspPhase(IntEnum):
    """Phases of a grasp.

    Attributes:
        APPROACH: The hand waits for the object, and moves to the meeting.
        TRACK: The hand follows the object, fingertips at their standoff.
        CLOSE: The fingertips move along the normals until they touch.
        SQUEEZE: The normal forces increase.
        LIFT: The hand stops, and moves up.
        HOLD: The hand holds the object at the height of the lift.
        BACK_OFF: The hand opens and rises.
    """

    APPROACH = 0
    TRACK = 1
    CLOSE = 2
    SQUEEZE = 3
    LIFT = 4
    HOLD = 5
    BACK_OFF = 6


class GiveUp(IntEnum):
    """Reasons why the hand has opened again, or waits before closing.

    Attributes:
        NONE: The hand has not given up.
        TOLD_TO_OPEN: The command to close was withdrawn.
        TOO_FEW_FINGERS: Fewer fingers are active than a grasp needs.
        MET_NOTHING: A finger has found no surface within its search distance.
        PRESSED_TOO_HARD: A finger pressed with more than the largest force.
        OUT_OF_BALANCE: No squeeze of these contacts balances the weight.
        LOST_TOUCH: A finger did not follow the squeeze, or lost touch in the lift or after it.
        OBJECT_UNSEEN: The estimator lost the object before the squeeze began.
        OFF_GOAL: A finger did not arrive at its goal.
        NEEDS_FORCE: A squeeze would balance the weight only above the largest force.
        NEEDS_TORQUE: A squeeze would balance the weight only above the torques of the joints, and
            perhaps above the largest force too.
        NEEDS_FRICTION: A squeeze would balance the weight only with more friction.
        BLOCKED: No motion keeps all links clear; the hand stands still until there is one.
    """

    NONE = 0
    TOLD_TO_OPEN = 1
    TOO_FEW_FINGERS = 2
    MET_NOTHING = 3
    PRESSED_TOO_HARD = 4
    OUT_OF_BALANCE = 5
    LOST_TOUCH = 6
    OBJECT_UNSEEN = 7
    OFF_GOAL = 8
    NEEDS_FORCE = 9
    NEEDS_TORQUE = 10
    NEEDS_FRICTION = 11
    BLOCKED = 12


_IMBALANCE = "no squeeze balances the weight: {:.2f} N are left"

_REASONS = {
    GiveUp.TOLD_TO_OPEN: "told to open",
    GiveUp.TOO_FEW_FINGERS: "only {:.0f} active fingers",
    GiveUp.MET_NOTHING: "finger {:.0f} met nothing",
    GiveUp.PRESSED_TOO_HARD: "finger {:.0f} pressed too hard",
    GiveUp.OUT_OF_BALANCE: _IMBALANCE,
    GiveUp.LOST_TOUCH: "finger {:.0f} lost touch",
    GiveUp.OBJECT_UNSEEN: "the object is lost from sight",
    GiveUp.OFF_GOAL: "finger {:.0f} did not arrive at its goal",
    GiveUp.NEEDS_FORCE: f"{_IMBALANCE} at the largest force",
    GiveUp.NEEDS_TORQUE: f"{_IMBALANCE} at the largest torque of a joint",
    GiveUp.NEEDS_FRICTION: f"{_IMBALANCE} for lack of friction",
    GiveUp.BLOCKED: "no way is clear for the links of finger {:.0f}",
}


def describe_give_up(reason: int, detail: float) -> str | None:
    """Describes the reason why the hand has opened or waits; None if there is no reason.

    Args:
        reason: Value of `GiveUp`.
        detail: Index of a finger, number of fingers or force in newtons, for the text.
    """
    if reason == GiveUp.BLOCKED and detail == BASE:
        return "no way is clear for the base of the hand"
    return None if reason == GiveUp.NONE else _REASONS[GiveUp(reason)].format(detail)


@dataclass(frozen=True)
class GraspSettings:
    """Settings of a grasp; lengths in metres, times in seconds, forces in newtons.

    The closing speed, the search and the largest force are scalars, or of shape (n,) by finger.

    Attributes:
        approach_height: Height above the tracking height at which the hand starts, and to which it
            backs off.
        rise_duration: Duration of the motion up to this height.
        standoff: Gap between fingertips and object while tracking.
        gate_distance: Largest distance of each active finger from its goal when the hand closes.
        gate_limit: Longest time for which the hand waits for the fingers to be at their goals, and
            for enough fingers whose forces can balance the weight. After it, fingers that are off
            their goals take no part.
        closing_speed: Speed of the fingertips along the normals.
        closing_acceleration: Acceleration of the fingertips, in m/s².
        correction_limit: Longest time by which an object that is not where it is estimated may
            delay the touch of all fingers.
        search: Depth below the surface to which a fingertip searches for the object, and the
            largest distance from the surface at which fingers that touch may start to squeeze. A
            finger that does not press in the squeeze, and is farther away, has lost the object.
        touch_force: Least normal force that counts as touch.
        bump_force: Least force of a fingertip that moves a hand which is not closing yet.
        least_fingers: Least number of active fingers before closing.
        least_force: Least normal force of each finger in the squeeze.
        largest_force: Largest normal force of any finger.
        squeeze_duration: Shortest duration of the increase of forces.
        squeeze_limit: Longest time by which fingers that press too little may delay the squeeze.
        imbalance: Largest residual of a squeeze's balance of forces.
        stop_duration: Duration of the hand's deceleration to rest when it lifts.
        lift_height: Height of the lift.
        lift_duration: Duration of the lift.
    """

    standoff: float
    gate_limit: float
    closing_speed: float | FloatArray
    search: float | FloatArray
    touch_force: float
    least_force: float
    largest_force: float | FloatArray
    lift_height: float
    lift_duration: float
    closing_acceleration: float
    squeeze_duration: float
    stop_duration: float
    gate_distance: float
    bump_force: float = np.inf
    approach_height: float = 0.15
    rise_duration: float = 1.5
    correction_limit: float = 2.3
    least_fingers: int = 3
    squeeze_limit: float = 2.0
    imbalance: float = 0.2

    @property
    def lift_acceleration(self) -> float:
        """Largest acceleration of a ramp of height h and duration T, 6 h/T², in m/s²."""
        return 6 * self.lift_height / self.lift_duration**2

    @property
    def closing_duration(self) -> float:
        """Duration of closing from the standoff to the end of the search, in seconds.

        Fingertips accelerate with a constant a to their speed v and then keep it: a distance d
        takes d/v + v/(2 a) if it is long enough to reach v. The slowest one decides.
        """
        distances, acceleration = self.standoff + np.asarray(self.search), self.closing_acceleration
        speeds = np.minimum(self.closing_speed, np.sqrt(2 * acceleration * distances))
        return float(np.max(distances / speeds + speeds / (2 * acceleration)))


@dataclass(frozen=True)
class Ramp:
    """A cubic change of a value over time from rest to rest, 3 s² - 2 s³.

    Attributes:
        start: Time at which the change starts, in seconds.
        duration: Duration of the change, in seconds, at least 0.
        first: Value before the change.
        last: Value after the change.
    """

    start: float
    duration: float
    first: float
    last: float

    @staticmethod
    def at_rest(value: float) -> "Ramp":
        """Returns a ramp of constant value."""
        return Ramp(0.0, 0.0, value, value)

    def value(self, time: float) -> float:
        """Returns the value at a time in seconds."""
        if time >= self.start + self.duration:
            return self.last
        s = max(0.0, (time - self.start) / self.duration)
        return self.first + (self.last - self.first) * s * s * (3 - 2 * s)

    def rate(self, time: float) -> float:
        """Returns the rate of change per second at a time in seconds."""
        if not self.start < time < self.start + self.duration:
            return 0.0
        s = (time - self.start) / self.duration
        return 6 * s * (1 - s) * (self.last - self.first) / self.duration

    def is_over(self, time: float) -> bool:
        """Returns whether the change is over at a time in seconds, up to rounding."""
        return time >= self.start + self.duration - TIME_ROUNDING


@dataclass(frozen=True, eq=False)
class GraspState:
    """State of a grasp.

    Attributes:
        phase: Phase of the grasp, a `GraspPhase`.
        since: Time at which the phase began, in seconds.
        asked: Time of the command to close, in seconds; infinite without a command.
        reason: Reason for opening or waiting, a `GiveUp`.
        detail: Index of a finger, number of fingers or force in newtons of the reason.
        gripped: Time in seconds at which the squeeze began, after which the hand no longer
            follows the estimate; infinite before.
        height: Height of the hand above the tracking height, in metres over time.
        share: Applied share of the squeeze, from 0 to 1.
        offset: Correction of the estimated object by touch: horizontal displacement of its centre
            of mass in W in metres, and turn about the vertical in radians, shape (3,).
        yielded: Its value when the hand began to close: what touch had found before, shape (3,).
        standoffs: Commanded gap between each fingertip and the object, shape (n,), in metres.
        active: Whether each finger takes part, shape (n,), fixed when the hand closes.
        touched: Whether each finger touches the object, shape (n,), until the squeeze begins.
        pressed: Time in seconds at which each finger pressed last, or felt a force near the
            surface, from the lift on, shape (n,).
        forces: Planned forces of the fingers on the object, in G, shape (n, 3), in newtons.
        internal: Their internal part, which exerts no wrench, shape (n, 3), in newtons.
        stopping: Part of them that stops the object, shape (n, 3), in newtons.
    """

    phase: int
    since: float
    asked: float
    reason: int
    detail: float
    gripped: float
    height: Ramp
    share: float
    offset: FloatArray
    yielded: FloatArray
    standoffs: FloatArray
    active: BoolArray
    touched: BoolArray
    pressed: FloatArray
    forces: FloatArray
    internal: FloatArray
    stopping: FloatArray

    @staticmethod
    def first(num_fingers: int, settings: GraspSettings) -> "GraspState":
        """Returns the state of n fingers at time 0."""
        return GraspState(
            phase=GraspPhase.APPROACH,
            since=0.0,
            asked=np.inf,
            reason=GiveUp.NONE,
            detail=0.0,
            gripped=np.inf,
            height=Ramp.at_rest(settings.approach_height),
            share=0.0,
            offset=np.zeros(3),
            yielded=np.zeros(3),
            standoffs=np.full(num_fingers, settings.standoff, dtype=float),
            active=np.zeros(num_fingers, dtype=bool),
            touched=np.zeros(num_fingers, dtype=bool),
            pressed=np.zeros(num_fingers),
            forces=np.zeros((num_fingers, 3)),
            internal=np.zeros((num_fingers, 3)),
            stopping=np.zeros((num_fingers, 3)),
        )

    @property
    def holds_contacts(self) -> bool:
        """Whether contacts are fixed on the object."""
        return self.phase >= GraspPhase.CLOSE

    @property
    def fingers_hold(self) -> BoolArray:
        """Whether each finger holds its contact, or closes on it, shape (n,).

        A hand that backs off holds with all active fingers while forces decrease, and then with
        the fingers that still touch.
        """
        if not self.holds_contacts:
            return np.zeros_like(self.active)
        if self.phase < GraspPhase.BACK_OFF or self.share > 0:
            return self.active
        return self.active & self.touched

    def force_limits(self, touch_force: float) -> FloatArray:
        """Returns the largest force of each finger against and across its normal, (n, 2), in N.

        Until the squeeze is complete, and while a hand that has not gripped backs off, fingers
        press with at most half the touch force more than they should. The limit across the normal
        is as large, or `HOLDING` times that in the squeeze. Without a touch, there is none.

        Args:
            touch_force: Least normal force that counts as touch.
        """
        has_let_go = self.phase == GraspPhase.BACK_OFF and np.isinf(self.gripped)
        if self.phase not in (GraspPhase.CLOSE, GraspPhase.SQUEEZE) and not has_let_go:
            return np.full((len(self.active), 2), NO_LIMIT)
        planned = self.applied_share(touch_force) * norms(self.internal)
        limits = np.maximum(planned + (GENTLE - 1) * touch_force, GENTLE * touch_force)
        is_limited = np.stack([self.active, self.active & self.touched], axis=1)
        across = HOLDING if self.phase == GraspPhase.SQUEEZE else 1.0
        return np.where(is_limited, limits[:, None] * [1.0, across], NO_LIMIT)

    def applied_share(self, touch_force: float) -> float:
        """Returns the share of the planned forces with which fingers press.

        While they touch, it is at least the one with which each presses with the touch force: the
        forces of the touch, in balance.

        Args:
            touch_force: Least normal force that counts as touch.
        """
        least, share = np.min(norms(self.internal), where=self.active, initial=np.inf), self.share
        if not self.touched.any() or not 0 < least < np.inf:
            return share
        return share + (1 - share) * min(1.0, touch_force / float(least))

    def touch_forces(self, nhat: FloatArray, touch_force: float) -> FloatArray:
        """Returns the forces with which fingertips that touch do not bounce off, in G, (n, 3).

        Args:
            nhat: Outward unit normals at the contacts in G, shape (n, 3).
            touch_force: Least normal force that counts as touch.
        """
        touching = self.touched[:, None] & np.isfinite(nhat)
        return np.asarray(-touch_force * np.where(touching, nhat, 0.0))

    def planned_forces(self, since: float, settings: GraspSettings) -> FloatArray:
        """Returns the forces with which the fingertips should press, in G, shape (n, 3).

        On the table they balance each other; for the lift they take over the weight, and at the end
        of the stop they no longer decelerate the object.

        Args:
            since: Time since the object began to stop, in seconds; 0 before.
            settings: Settings of the grasp.
        """
        stopped = min(1.0, max(0.0, since - settings.stop_duration) / WEIGHT_DURATION)
        external = self.forces - self.internal - stopped * self.stopping
        forces = self.internal + min(1.0, since / WEIGHT_DURATION) * external
        return np.asarray(self.applied_share(settings.touch_force) * forces)

    def to_vector(self) -> FloatArray:
        """Returns the state as one vector."""
        return pack(self)


def state_unpacker(num_fingers: int) -> Callable[[FloatArray], GraspState]:
    """Returns the inverse of `GraspState.to_vector` for n fingers."""
    # Only types and shapes matter: integer settings would round the unpacked values.
    any_settings = GraspSettings(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return unpacker(GraspState.first(num_fingers, any_settings))


class Squeeze(NamedTuple):
    """Forces of fingertips on an object.

    Attributes:
        forces: Forces on the object in the frame of the contacts, shape (n, 3), in newtons.
        residual: Norm of the unbalanced wrench, in newtons, with torques divided by the longest
            lever arm.
        internal: Their internal part, which exerts no wrench, shape (n, 3), in newtons.
        stopping: Part of them that stops the object, shape (n, 3), in newtons.
        lack: Reason of an imbalance: the limit without which the forces would balance,
            `NEEDS_TORQUE` if those of forces and of torques prevent it together, or
            `OUT_OF_BALANCE` if there is no such limit.
    """

    forces: FloatArray
    residual: float
    internal: FloatArray
    stopping: FloatArray
    lack: GiveUp = GiveUp.OUT_OF_BALANCE
