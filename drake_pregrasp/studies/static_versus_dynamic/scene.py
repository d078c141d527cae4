"""What happens under each condition: how the object moves, what is in the way, what goes wrong."""

from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.object_config import Box, Conveyor
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.diagrams.hand_station import TABLE
from drake_pregrasp.geometry.solids import BallSolid, HalfSpace, Solid
from drake_pregrasp.systems.sources import MovingSolid

BOX = Box(size=[0.1, 0.1, 0.1], mass=0.4)
"""The object."""

SPACING = 0.005
"""Of its surface's candidates, in metres."""

HAND = "package://drake_pregrasp/five_finger_hand.yaml"
"""The hand."""

FINGERS = 5
"""How many it has."""

LIMITED_WRIST = (-float(np.radians(30)), float(np.radians(30)))
"""Range of a wrist that turns little, in radians."""

_WALL = HalfSpace(np.array([0.0, 0.04, 0.0]), np.array([0.0, -1.0, 0.0]))
_CROSSING_TIME = 6.0  # When the sphere is nearest to the object, in seconds.
_SPHERE_RADIUS, _SPHERE_GAP, _SPHERE_SPEED = 0.07, 0.02, 0.03


@dataclass(frozen=True)
class Scene:
    """One condition.

    Attributes:
        linear_velocity: Of the conveyor, in m/s.
        angular_velocity: Of the turntable, in rad/s.
        yaw_range: Of the wrist, in radians.
        area: What is not to be touched, nor passed through; in W.
        lost_fingers: How many fingers are lost.
        lost_at: When, in seconds.
        position_std: Noise of the measured position, in metres.
        orientation_std: Noise of the measured orientation, in radians.
    """

    linear_velocity: float = 0.005
    angular_velocity: float = 0.0
    yaw_range: tuple[float, float] = FREE_TURN
    area: tuple[MovingSolid, ...] = ()
    lost_fingers: int = 0
    lost_at: float = 2.0
    position_std: float = 0.001
    orientation_std: float = float(np.radians(0.5))

    def conveyor(self) -> Conveyor:
        """Returns what carries the object."""
        return Conveyor(
            linear_velocity=self.linear_velocity, angular_velocity=self.angular_velocity
        )

    def grasp(self) -> GraspConfig:
        """Returns how the hand grasps."""
        free = self.yaw_range == FREE_TURN
        return GraspConfig(hand=HAND, wrist_range=[] if free else list(self.yaw_range))

    def area_at(self, time: float) -> list[Solid]:
        """Returns the no-touch area at a time, in W."""
        return [moving.solid.moved(np.eye(3), time * moving.velocity) for moving in self.area]

    def obstacles(self) -> list[MovingSolid]:
        """Returns the no-touch area and the table."""
        return [*self.area, TABLE]


def _sphere() -> MovingSolid:
    velocity = np.array([Scene.linear_velocity, _SPHERE_SPEED, 0.0])
    beside = BOX.size[0] / 2 + _SPHERE_GAP + _SPHERE_RADIUS
    nearest = np.array([beside + _CROSSING_TIME * velocity[0], 0.0, BOX.size[2] / 2])
    return MovingSolid(BallSolid(nearest - _CROSSING_TIME * velocity, _SPHERE_RADIUS), velocity)


_BESIDE_WALL = (MovingSolid(_WALL, np.zeros(3)),)
_MOVING = Scene(linear_velocity=0.01, angular_velocity=float(np.radians(10)))
_FAST = float(np.radians(20))

SCENES = {
    "nominal": _MOVING,
    "one_lost": replace(_MOVING, lost_fingers=1),
    "two_lost": replace(_MOVING, lost_fingers=2),
    "turning": Scene(angular_velocity=_FAST, yaw_range=LIMITED_WRIST),
    "wall": Scene(angular_velocity=float(np.radians(10)), area=_BESIDE_WALL),
    "headline": Scene(angular_velocity=_FAST, yaw_range=LIMITED_WRIST, area=_BESIDE_WALL),
    "sphere": Scene(angular_velocity=float(np.radians(5)), area=(_sphere(),)),
    "noise": replace(_MOVING, position_std=0.004, orientation_std=float(np.radians(2))),
}
"""The scenes by the keys of `CONDITIONS`."""
