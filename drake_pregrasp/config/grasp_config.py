"""What a hand asks of the planner."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drake_pregrasp.config.hand_description import Closing, Fingertip, HandDescription
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.grasping.fingertip_paths import OTHER_CLEARANCE
from drake_pregrasp.grasping.grasp_state import GraspSettings

_LENGTH = {"above": 0, "at_most": 10}
_TIME = {"above": 0, "at_most": 1e6}
_FORCE = {"above": 0, "at_most": 1e4}


@dataclass
class GraspConfig:
    """When and how the hand closes, squeezes and lifts."""

    # What grasps: a file with a hand's description, from the folder of the scenario's file, or
    # package://drake_pregrasp/..., for one that is shipped. Empty: no hand, only planning.
    hand: str = field(default="", metadata={"path": True})

    # Least and largest angle of the wrist, in radians, within those of the model. Empty: those of
    # the model, where it can't make a full turn either way; else it turns as far as it likes.
    wrist_range: list[float] = field(
        default_factory=list, metadata={"at_least": -100, "at_most": 100}
    )

    # Whether the planner keeps to what the fingers reach.
    use_reach: bool = True

    # When the hand is asked to close, in seconds.
    close_at: float = field(default=4.0, metadata={"at_least": 0, "at_most": 1e6})

    # Seconds between control ticks.
    period: float = field(default=0.02, metadata={"at_least": 1e-3, "at_most": 0.1})

    # Coulomb's coefficient of the box, for the hand. Drake takes 2 µ1 µ2/(µ1 + µ2) of box and
    # fingertips, which have 0.7: that value, too, if both have it.
    friction: float = field(default=0.7, metadata={"at_least": 0, "at_most": 10})

    # The one that the squeeze is planned with. What it is less than the true one is its margin.
    planned_friction: float = field(default=0.5, metadata={"at_least": 0, "at_most": 10})

    # Largest speed of a fingertip goal over the object, in m/s.
    goal_speed: float = field(default=0.3, metadata=_LENGTH)

    # Gap between fingertips and object while tracking, in metres.
    standoff: float = field(default=0.02, metadata={"at_least": 0.008, "at_most": 1})

    # Speed of closing fingertips, in m/s.
    closing_speed: float = field(default=0.04, metadata=_LENGTH)

    # Force that counts as touch, in newtons.
    touch_force: float = field(default=0.35, metadata=_FORCE)

    # Normal forces of each finger, at least and at most, in newtons.
    least_force: float = field(default=2.5, metadata=_FORCE)
    largest_force: float = field(default=12.0, metadata=_FORCE)

    # How long the hand waits for fingers on their way, and for enough of them whose forces can
    # balance the weight, in seconds. Then it closes with those that are there, or gives up.
    gate_limit: float = field(default=1.5, metadata={"at_least": 0, "at_most": 1e6})

    # How far it lifts, in metres, and in which time, in seconds.
    lift_height: float = field(default=0.1, metadata=_LENGTH)
    lift_duration: float = field(default=1.0, metadata=_TIME)

    @property
    def has_hand(self) -> bool:
        """Whether there is a hand."""
        return bool(self.hand)

    @property
    def yaw_range(self) -> tuple[float, float]:
        """Least and largest angle of the wrist that are asked for, in radians; endless if none are.

        `HandModel.yaw_range` has the model's say in it.

        Raises:
            InvalidArgumentError: If they aren't two in order.
        """
        if not self.wrist_range:
            return FREE_TURN
        if len(self.wrist_range) != 2 or not self.wrist_range[0] <= self.wrist_range[1]:
            raise InvalidArgumentError(
                f"wrist_range must be empty or two angles in order, not {self.wrist_range}"
            )
        low, high = self.wrist_range
        return low, high

    def make_settings(self, fingertips: Sequence[Fingertip] = ()) -> GraspSettings:
        """Returns the settings of the sequencer, within what fingers may do to close."""
        closing = [tip.closing for tip in fingertips] or [Closing()]
        return GraspSettings(
            standoff=self.standoff,
            gate_limit=self.gate_limit,
            closing_speed=np.minimum(self.closing_speed, [c.speed for c in closing]),
            search=np.array([c.depth for c in closing]),
            touch_force=self.touch_force,
            least_force=self.least_force,
            largest_force=np.minimum(self.largest_force, [c.force for c in closing]),
            lift_height=self.lift_height,
            lift_duration=self.lift_duration,
        )

    def closing_duration(self, fingertips: Sequence[Fingertip] = ()) -> float:
        """Returns how long fingers take from their standoff to the end of their search, in seconds.

        They accelerate steadily to their speed v, and then keep it: a way d takes d/v + v/(2 a), if
        it is long enough for v. The slowest finger counts.
        """
        settings = self.make_settings(fingertips)
        ways, acceleration = self.standoff + settings.search, settings.closing_acceleration
        speeds = np.minimum(settings.closing_speed, np.sqrt(2 * acceleration * ways))
        return float(np.max(ways / speeds + speeds / (2 * acceleration)))

    def latest_rest(self, fingertips: Sequence[Fingertip] = ()) -> float:
        """Returns until when the hand follows the object's motion, at most, in seconds.

        For the lift it comes to rest, after it has waited for fingers on their way, closed and
        squeezed.
        """
        settings = self.make_settings(fingertips)
        closing = self.closing_duration(fingertips) + settings.squeeze_duration
        return self.close_at + settings.gate_limit + closing + settings.stop_duration

    def largest_lift(self, fingertips: Sequence[Fingertip]) -> float:
        """Returns the weight that fingers can hold by friction alone, in newtons."""
        forces = [min(self.largest_force, tip.closing.force) for tip in fingertips]
        return sum(forces) * self.planned_friction


def hand_limits(hand: HandDescription, grasp: GraspConfig, *, reach: bool = True) -> LimitsConfig:
    """Returns limits with which goals are those that a hand's fingertips can go to.

    Args:
        hand: The hand.
        grasp: How it grasps.
        reach: Whether to heed what fingers reach.
    """
    tips = hand.fingertips
    return LimitsConfig(
        tip_radii=[tip.radius for tip in tips],
        tip_gap=OTHER_CLEARANCE,
        clearance=OTHER_CLEARANCE,
        standoff=grasp.standoff,
        reach=[tip.reach for tip in tips] if reach else [],
        forbidden_faces=[tip.forbidden_faces for tip in tips],
        recover=True,
    )
