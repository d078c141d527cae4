"""Obstacles in the world."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.math import RollPitchYaw

from drake_pregrasp.config.object_config import zeros
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace, Solid
from drake_pregrasp.systems.sources import MovingSolid

_POINT = {"length": 3, "at_least": -100, "at_most": 100}
_SIZE = {"length": 3, "above": 0, "at_most": 100}
_VECTOR = {"length": 3, "at_least": -10, "at_most": 10}


@dataclass
class BallObstacle:
    """A ball with a constant velocity."""

    # Radius, in metres.
    radius: float = field(default=0.0, metadata={"required": True, "above": 0, "at_most": 100})

    # Initial position of the centre in W, in metres.
    center: list[float] = field(default_factory=zeros, metadata=_POINT)

    # Velocity in W, in m/s.
    velocity: list[float] = field(default_factory=zeros, metadata=_VECTOR)

    def make_solid(self) -> Solid:
        """Returns the ball at the start, in W."""
        return BallSolid(np.array(self.center), self.radius)


@dataclass
class BoxObstacle:
    """A box with a constant velocity and orientation."""

    # Edge lengths, in metres.
    size: list[float] = field(default_factory=zeros, metadata={"required": True, **_SIZE})

    # Initial position of the centre in W, in metres.
    center: list[float] = field(default_factory=zeros, metadata=_POINT)

    # Orientation in W, as roll, pitch and yaw, in radians.
    rpy: list[float] = field(default_factory=zeros, metadata=_VECTOR)

    # Velocity in W, in m/s.
    velocity: list[float] = field(default_factory=zeros, metadata=_VECTOR)

    def make_solid(self) -> Solid:
        """Returns the box at the start, in W."""
        R_WB = RollPitchYaw(self.rpy).ToRotationMatrix().matrix()
        return BoxSolid(np.array(self.center), R_WB, np.array(self.size))


@dataclass
class PlaneObstacle:
    """The half-space behind a plane, for example a table or a wall."""

    # Initial position of a point of the plane in W, in metres.
    point: list[float] = field(default_factory=zeros, metadata=_POINT)

    # Normal of the plane in W; it points away from the obstacle.
    normal: list[float] = field(default_factory=zeros, metadata={"required": True, **_POINT})

    # Velocity in W, in m/s.
    velocity: list[float] = field(default_factory=zeros, metadata=_VECTOR)

    def make_solid(self) -> Solid:
        """Returns the half-space at the start, in W."""
        return HalfSpace(np.array(self.point), np.array(self.normal))


ObstacleConfig = BallObstacle | BoxObstacle | PlaneObstacle


def moving_solid(config: ObstacleConfig) -> MovingSolid:
    """Returns an obstacle with its velocity."""
    return MovingSolid(config.make_solid(), np.array(config.velocity))
