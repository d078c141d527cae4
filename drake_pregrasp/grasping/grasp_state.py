"""What a hand that grasps goes through: its phases, its settings, what it remembers and sees."""

from dataclasses import astuple, dataclass
from enum import IntEnum

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.geometry.motion_profiles import Ramp


class GraspPhase(IntEnum):
    """What the hand is doing."""

    APPROACH = 0
    TRACK = 1
    CLOSE = 2
    SQUEEZE = 3
    LIFT = 4
    HOLD = 5
    BACK_OFF = 6


class GiveUp(IntEnum):
    """Why the hand has opened again, or waits to close."""

    NONE = 0
    TOLD_TO_OPEN = 1
    TOO_FEW_FINGERS = 2
    MET_NOTHING = 3
    PRESSED_TOO_HARD = 4
    OUT_OF_BALANCE = 5
    LOST_TOUCH = 6
    OBJECT_UNSEEN = 7


_REASONS = {
    GiveUp.TOLD_TO_OPEN: "told to open",
    GiveUp.TOO_FEW_FINGERS: "only {:.0f} active fingers",
    GiveUp.MET_NOTHING: "finger {:.0f} met nothing",
    GiveUp.PRESSED_TOO_HARD: "finger {:.0f} pressed too hard",
    GiveUp.OUT_OF_BALANCE: "no squeeze balances the weight: {:.2f} N are left",
    GiveUp.LOST_TOUCH: "finger {:.0f} lost touch",
    GiveUp.OBJECT_UNSEEN: "the object is lost from sight",
}


def describe_give_up(reason: int, detail: float) -> str | None:
    """Returns why the hand has opened, or waits to close, in words, or None if it doesn't.

    Args:
        reason: A `GiveUp`, of the last time it did, until it closes again.
        detail: The finger, the number or the force that goes with it.
    """
    return None if reason == GiveUp.NONE else _REASONS[GiveUp(reason)].format(detail)


@dataclass(frozen=True)
class GraspSettings:
    """Settings of a grasp: lengths in metres, times in seconds, forces in newtons.

    `GraspConfig.make_settings` combines a configuration with the limits of a hand's fingers. The
    closing speed, the search and the largest force may be those of each finger, shape (n,).

    Attributes:
        standoff: Gap between fingertips and object while tracking.
        gate_limit: Longest time for which the hand waits until all active fingers are at their
            goals and enough of them can balance the weight.
        closing_speed: Speed of closing fingertips along the normals.
        search: Largest distance from the estimated surface at which a fingertip may touch the
            object. A force that is felt farther outside is inertia; farther inside is nothing.
        touch_force: Smallest force that counts as touch.
        least_force: Smallest normal force of each finger in the squeeze.
        largest_force: Largest normal force of each finger.
        lift_height: Height of the lift.
        lift_duration: Duration of the lift.
        approach_height: Height above the tracking height at which the approach starts.
        approach_duration: Duration of the approach.
        gate_distance: Largest distance of a fingertip from its goal at which it has arrived.
        closing_acceleration: Acceleration of closing fingertips, in m/s², which is small enough
            that fingertips do not feel their own inertia as touch.
        least_fingers: Smallest number of fingers that close.
        squeeze_duration: Time in which the forces of the squeeze increase.
        imbalance: Largest force that a squeeze may leave unbalanced.
        stop_duration: Time in which the hand stops before it lifts.
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
    approach_height: float = 0.15
    approach_duration: float = 1.5
    gate_distance: float = 0.004
    closing_acceleration: float = 0.4
    least_fingers: int = 3
    squeeze_duration: float = 0.5
    imbalance: float = 0.2
    stop_duration: float = 0.3


@dataclass(frozen=True, eq=False)
class GraspState:
    """What the hand remembers from tick to tick.

    Attributes:
        phase: A `GraspPhase`.
        since: When it began, in seconds.
        asked: Since when the hand is asked to close, in seconds; infinite if it isn't.
        reason: A `GiveUp`.
        detail: What goes with it.
        gripped: When all had touched, and the hand began to go its own way; infinite before.
        height: Of the hand above where it tracks.
        force: Share of the squeeze that is applied, from 0 to 1.
        standoffs: Gap of each fingertip that is commanded, shape (n,), in metres.
        active: Which fingers take part, shape (n,), fixed once the hand closes.
        touched: Which of them have met the object, shape (n,).
        forces: The squeeze on the object, in O, shape (n, 3), in newtons.
    """

    phase: int
    since: float
    asked: float
    reason: int
    detail: float
    gripped: float
    height: Ramp
    force: Ramp
    standoffs: FloatArray
    active: BoolArray
    touched: BoolArray
    forces: FloatArray

    @staticmethod
    def first(num_fingers: int, settings: GraspSettings) -> "GraspState":
        """Returns the state in which it starts at time 0."""
        return GraspState(
            phase=GraspPhase.APPROACH,
            since=0.0,
            asked=np.inf,
            reason=GiveUp.NONE,
            detail=0.0,
            gripped=np.inf,
            height=Ramp(0.0, settings.approach_duration, settings.approach_height, 0.0),
            force=Ramp.at_rest(0.0),
            standoffs=np.full(num_fingers, settings.standoff),
            active=np.zeros(num_fingers, dtype=bool),
            touched=np.zeros(num_fingers, dtype=bool),
            forces=np.zeros((num_fingers, 3)),
        )

    @property
    def holds_contacts(self) -> bool:
        """Whether contacts stay where they are on the object."""
        return self.phase >= GraspPhase.CLOSE

    def fingers_hold(self, time: float) -> BoolArray:
        """Returns which fingers hold their contacts, or close on them, shape (n,).

        A hand that backs off holds as long as it has not let go: with the fingers that still touch,
        or with all while forces go down.

        Args:
            time: In seconds.
        """
        if not self.holds_contacts:
            return np.zeros_like(self.active)
        if self.phase < GraspPhase.BACK_OFF or self.force.value(time) > 0:
            return self.active
        return self.active & self.touched

    def to_vector(self) -> FloatArray:
        """Returns everything in one vector."""
        numbers = [self.phase, self.since, self.asked, self.reason, self.detail, self.gripped]
        return np.concatenate(
            [
                numbers,
                astuple(self.height),
                astuple(self.force),
                self.standoffs,
                self.active,
                self.touched,
                self.forces.ravel(),
            ]
        )

    @staticmethod
    def from_vector(vector: FloatArray) -> "GraspState":
        """Returns the state that `to_vector` made a vector of."""
        phase, since, asked, reason, detail, gripped = vector[:6].tolist()
        n = (len(vector) - 14) // 6
        standoffs, active, touched = vector[14 : 14 + 3 * n].reshape(3, n).copy()
        return GraspState(
            phase=int(phase),
            since=since,
            asked=asked,
            reason=int(reason),
            detail=detail,
            gripped=gripped,
            height=Ramp(*vector[6:10].tolist()),
            force=Ramp(*vector[10:14].tolist()),
            standoffs=standoffs,
            active=active > 0,
            touched=touched > 0,
            forces=vector[14 + 3 * n :].reshape(n, 3).copy(),
        )


@dataclass(frozen=True, eq=False)
class GraspView:
    """What the hand sees at a tick; NaN stands for what is not known of a finger.

    Attributes:
        time: In seconds.
        close: Whether it is asked to close.
        active: Which fingers have a contact to go to, shape (n,).
        distances: How far each fingertip is on its way to its goal, shape (n,), in metres.
        gaps: Between each fingertip and the surface at its contact, shape (n,), in metres.
        presses: Normal force of each fingertip on the object, shape (n,), in newtons. Until the
            hand closes they are not looked at.
        sees: Whether the object is tracked.
    """

    time: float
    close: bool
    active: BoolArray
    distances: FloatArray
    gaps: FloatArray
    presses: FloatArray
    sees: bool = True
