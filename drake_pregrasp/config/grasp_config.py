"""Configuration of the grasp, and the limits that a hand adds to those of the planner."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.hand_description import (
    Closing,
    Fingertip,
    HandDescription,
    least_fingers,
)
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.config.object_config import POINT
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.mesh_surface import TipSize
from drake_pregrasp.grasping.fingertip_paths import MOVING_CLEARANCE, OTHER_CLEARANCE
from drake_pregrasp.grasping.grasp_state import GraspSettings

ABOVE, SIDE = "above", "side"
"""Values of `GraspConfig.approaches`."""

_LENGTH = {"above": 0, "at_most": 10}
_TIME = {"above": 0, "at_most": 1e6}
_FORCE = {"above": 0, "at_most": 1e4}


@dataclass
class MeetingConfig:
    """Configuration of a hand that waits for an object and meets it."""

    # Point in W over which the hand waits, in metres: where an object's centre of mass would be.
    # Empty: the hand starts over the object. Only carriers wait elsewhere, within their travel.
    wait_at: list[float] = field(
        default_factory=list, metadata={"at_least": -100, "at_most": 100, "max_length": 3}
    )

    # Least time until a meeting that is planned, in seconds.
    earliest: float = field(default=0.0, metadata={"at_least": 0, "at_most": 100})

    # Largest time until a meeting that is planned, in seconds. Descents take 0.035 to 0.4 of it.
    latest: float = field(default=3.0, metadata={"above": 0, "at_most": 100})

    # Whether the motion of the object is predicted until the meeting; else it counts as resting.
    predicts: bool = True

    # Cost of a second until the meeting, in units of the square of a share of a limit. If it is
    # negative, later meetings cost less.
    lateness: float = field(default=0.3, metadata={"at_least": -1e6, "at_most": 1e6})


@dataclass
class GraspConfig:
    """Configuration of a hand that closes, squeezes and lifts."""

    # Smallest and largest angle of the wrist, in radians, within those of the model. Empty: those
    # of the model if its wrist cannot make a full turn either way, else no limits.
    wrist_range: list[float] = field(
        default_factory=list, metadata={"at_least": -100, "at_most": 100}
    )

    # Whether the planner is limited to what the fingers reach.
    use_reach: bool = True

    # How the hand waits for the object and meets it.
    meeting: MeetingConfig = field(default_factory=MeetingConfig)

    # Time at which the hand is commanded to close, in seconds. 0: it closes as soon as it is at the
    # object. The default leaves contacts two seconds to adapt after the default
    # `planner.static_duration`.
    close_at: float = field(default=6.0, metadata={"at_least": 0, "at_most": 1e6})

    # Seconds between control ticks.
    period: float = field(default=0.02, metadata={"at_least": 1e-3, "at_most": 0.1})

    # Coulomb's coefficient of the object. Drake combines the coefficients of two bodies to
    # 2 µ1 µ2/(µ1 + µ2); fingertips have 0.7 (the Shadow hand's: 1), and the turntable has 0.8.
    friction: float = field(default=0.7, metadata={"at_least": 0, "at_most": 10})

    # Coulomb's coefficient with which the squeeze is planned: the true one less a margin.
    planned_friction: float = field(default=0.5, metadata={"at_least": 0, "at_most": 10})

    # Largest speed of a fingertip goal over the object, in m/s.
    goal_speed: float = field(default=0.3, metadata=_LENGTH)

    # Largest acceleration of fingertips relative to their goals, in m/s², which accelerate by at
    # most 60 % of it on the way to a meeting: half of what the axes of the five-finger hand's
    # carrier allow, so that the palm can follow.
    tip_acceleration: float = field(default=5.0, metadata={"above": 0, "at_most": 100})

    # Gap between fingertips and object while tracking, in metres.
    standoff: float = field(default=0.02, metadata={"at_least": MOVING_CLEARANCE, "at_most": 1})

    # Speed of closing fingertips, in m/s.
    closing_speed: float = field(default=0.04, metadata=_LENGTH)

    # Acceleration of closing fingertips, in m/s². Closing takes as long as distance, speed and
    # acceleration require.
    closing_acceleration: float = field(default=0.2, metadata={"above": 0, "at_most": 100})

    # Smallest force that counts as touch, in newtons.
    touch_force: float = field(default=0.2, metadata=_FORCE)

    # Smallest force with which a fingertip moves a hand, before it closes, off what it touches, in
    # newtons; 0: none does. It must be more than a moving hand feels without a touch.
    bump_force: float = field(default=0.2, metadata={"at_least": 0, "at_most": 1e4})

    # Smallest normal force of each finger in the squeeze, in newtons.
    least_force: float = field(default=2.5, metadata=_FORCE)

    # Largest normal force of each finger, in newtons; that of the hand's description
    # (`closing.force`) counts if it is smaller.
    largest_force: float = field(default=12.0, metadata=_FORCE)

    # Shortest duration of the increase of the forces from touch to squeeze, in seconds.
    squeeze_duration: float = field(default=0.5, metadata=_TIME)

    # Duration of the hand's constant deceleration to rest once it has gripped the object, in
    # seconds: from the speed v it takes v/2 times as many metres.
    stop_duration: float = field(default=0.3, metadata=_TIME)

    # Seconds for which the hand waits until enough fingers are active, all of these have arrived at
    # their goals, and can balance the weight. Then it closes without those that have not arrived,
    # or gives up if the others cannot hold the object.
    gate_limit: float = field(default=1.5, metadata={"at_least": 0, "at_most": 1e6})

    # Largest distance of each finger from its goal when the hand closes, in metres.
    gate_distance: float = field(default=0.004, metadata=_LENGTH)

    # Height of the lift, in metres.
    lift_height: float = field(default=0.1, metadata=_LENGTH)

    # Duration of the lift, in seconds.
    lift_duration: float = field(default=1.0, metadata=_TIME)

    # Direction of the lift in W, of any length, not into the table.
    lift_direction: list[float] = field(default_factory=lambda: [0.0, 0.0, 1.0], metadata=POINT)

    # Whether the object is shaken once it has been held for ten seconds: in each of six directions,
    # for half a second, by a sinusoidal force of at most half its weight. Studies of grasps always
    # do this.
    shake: bool = False

    # Directions from which the palm may come: the one with the best start contacts is chosen.
    approaches: list[str] = field(
        default_factory=lambda: [ABOVE], metadata={"min_length": 1, "one_of": (ABOVE, SIDE)}
    )

    # Shifts of the palm along its axis, away from the object, in metres: they are tried in this
    # order until there is a grasp. None of them lowers the palm to less than 10 mm over the top of
    # the object.
    palm_shifts: list[float] = field(
        default_factory=lambda: [0.0, -0.01, -0.02, 0.01, 0.02],
        metadata={"min_length": 1, "at_least": -1, "at_most": 1},
    )

    # Height of the palm's axis over the table, if it comes from the side, in metres. 0: that of the
    # object's centre of mass, or more if the hand at home would not clear the table there.
    side_height: float = field(default=0.0, metadata={"at_least": 0, "at_most": 10})

    @property
    def lift_axis(self) -> FloatArray:
        """Unit vector of the lift in W, shape (3,).

        Raises:
            InvalidArgumentError: If the lift has no direction, or pushes into the table.
        """
        direction = np.array(self.lift_direction)
        length = float(np.linalg.norm(direction))
        if not length > 0 or direction[2] < 0:
            raise InvalidArgumentError(
                f"lift_direction must not be zero, nor point into the table: {self.lift_direction}"
            )
        return direction / length

    @property
    def yaw_range(self) -> tuple[float, float]:
        """Smallest and largest angle of the wrist, in radians; infinite if `wrist_range` is empty.

        `HandModel.yaw_range` combines it with the limits of the model.

        Raises:
            InvalidArgumentError: If `wrist_range` is not two angles in order.
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
        """Returns the settings of the grasp's phases, within what each finger may do to close."""
        closing = [tip.closing for tip in fingertips] or [Closing()]
        return GraspSettings(
            standoff=self.standoff,
            gate_limit=self.gate_limit,
            closing_speed=np.minimum(self.closing_speed, [c.speed for c in closing]),
            search=np.array([c.depth for c in closing]),
            touch_force=self.touch_force,
            bump_force=self.bump_force or np.inf,
            least_force=self.least_force,
            largest_force=np.minimum(self.largest_force, [c.force for c in closing]),
            lift_height=self.lift_height,
            lift_duration=self.lift_duration,
            closing_acceleration=self.closing_acceleration,
            squeeze_duration=self.squeeze_duration,
            stop_duration=self.stop_duration,
            gate_distance=self.gate_distance,
            least_fingers=least_fingers(fingertips),
        )

    def tip_size(self, fingertips: Sequence[Fingertip]) -> TipSize:
        """Returns the size of the largest fingertip, which needs a place on the object."""
        return TipSize(max(tip.radius for tip in fingertips), self.standoff, MOVING_CLEARANCE)

    def earliest_rest(self, fingertips: Sequence[Fingertip] = ()) -> float:
        """Returns the least time until which the hand has to follow the object, in seconds.

        It waits for no finger and touches at the standoff. While it stops for the lift, it moves
        half as far as the object would.
        """
        settings = replace(self.make_settings(fingertips), search=np.zeros(1))
        closing = settings.closing_duration + settings.squeeze_duration
        return self.close_at + closing + settings.stop_duration / 2

    def latest_rest(self, fingertips: Sequence[Fingertip] = ()) -> float:
        """Returns the time until which the hand follows the object's motion, in seconds.

        The hand stops for the lift after it has waited for its fingers, closed and squeezed. An
        object that is not where it is estimated delays this.
        """
        settings = self.make_settings(fingertips)
        closing = settings.closing_duration + settings.squeeze_duration
        return self.close_at + settings.gate_limit + closing + settings.stop_duration

    def largest_forces(self, fingertips: Sequence[Fingertip]) -> list[float]:
        """Returns the largest normal force of each finger, in newtons."""
        return [min(self.largest_force, tip.closing.force) for tip in fingertips]

    def largest_lift(self, fingertips: Sequence[Fingertip]) -> float:
        """Returns the largest weight that fingers can hold by friction alone, in newtons."""
        return sum(self.largest_forces(fingertips)) * self.planned_friction


def hand_limits(hand: HandDescription, grasp: GraspConfig, *, reach: bool = True) -> LimitsConfig:
    """Returns the limits with which a hand's fingertips can follow the contact goals.

    Args:
        hand: Description of the hand.
        grasp: Configuration of the grasp.
        reach: Whether goals are limited to what the fingers reach.
    """
    tips = hand.fingertips
    return LimitsConfig(
        tip_radii=[tip.radius for tip in tips],
        tip_gap=OTHER_CLEARANCE,
        clearance=OTHER_CLEARANCE,
        standoff=grasp.standoff,
        reach=[tip.reach for tip in tips] if reach else [],
        forbidden_faces=[tip.forbidden_faces for tip in tips],
        pairs=hand.jaws,
        recover=True,
    )
