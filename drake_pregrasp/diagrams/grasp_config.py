"""What grasps the object, and how: what the key `grasp` of a scenario holds."""

from dataclasses import dataclass, field

from drake_pregrasp.planning.assignment import FREE_TURN
from drake_pregrasp.planning.grasp_state import GraspSettings

_LENGTH = {"above": 0, "at_most": 10}
_TIME = {"above": 0, "at_most": 1e6}
_FORCE = {"above": 0, "at_most": 1e4}


@dataclass
class HandModelConfig:
    """A radial hand on a carrier of four axes."""

    # An SDF or URDF file with one model, all of whose joints are driven: a path from the folder of
    # the scenario's file, or package://drake_pregrasp/..., for the one that is shipped. Empty: no
    # hand, only planning.
    file: str = field(default="", metadata={"path": True})

    # The frames at the fingertips' centres, one for each contact.
    fingertips: list[str] = field(default_factory=list)

    # Radius of the fingertips, in metres.
    tip_radius: float = field(default=0.009, metadata={"above": 0, "at_most": 0.1})

    # The joints that slide along x, y and z of W, and turn about z.
    carrier: list[str] = field(
        default_factory=lambda: ["x", "y", "z", "yaw"], metadata={"length": 4}
    )

    # Height of the carrier over the object's origin, in metres.
    palm_height: float = field(default=0.155, metadata={"at_least": 0, "at_most": 10})

    # Positions of each finger's joints in its home posture, in their order in the model.
    home: list[float] = field(
        default_factory=lambda: [0.0, 0.9, 1.35], metadata={"at_least": -10, "at_most": 10}
    )

    # Angle by which a fingertip may go aside from its finger's azimuth at the start, in radians.
    largest_offset: float = field(default=1.25, metadata={"above": 0, "at_most": 3.2})


@dataclass
class GraspConfig:
    """When and how the hand closes, squeezes and lifts."""

    hand: HandModelConfig = field(default_factory=HandModelConfig)

    # Least and largest angle of the wrist, in radians; empty for those of the model.
    wrist_range: list[float] = field(
        default_factory=list, metadata={"at_least": -100, "at_most": 100}
    )

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

    # How long the hand waits for fingers on their way before it closes, in seconds.
    gate_limit: float = field(default=1.5, metadata={"at_least": 0, "at_most": 1e6})

    # How far it lifts, in metres, and in which time, in seconds.
    lift_height: float = field(default=0.1, metadata=_LENGTH)
    lift_duration: float = field(default=1.0, metadata=_TIME)

    @property
    def has_hand(self) -> bool:
        """Whether there is a hand."""
        return bool(self.hand.file)

    @property
    def yaw_range(self) -> tuple[float, float]:
        """Least and largest angle of the wrist, in radians."""
        low, high = self.wrist_range or FREE_TURN
        return low, high

    def make_settings(self) -> GraspSettings:
        """Returns the settings of the sequencer."""
        return GraspSettings(
            standoff=self.standoff,
            gate_limit=self.gate_limit,
            closing_speed=self.closing_speed,
            touch_force=self.touch_force,
            least_force=self.least_force,
            largest_force=self.largest_force,
            lift_height=self.lift_height,
            lift_duration=self.lift_duration,
        )

    def largest_lift(self, num_fingers: int) -> float:
        """Returns the weight that fingers can hold by friction alone, in newtons."""
        return num_fingers * self.largest_force * self.planned_friction
