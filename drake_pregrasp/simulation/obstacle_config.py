"""Schema of obstacles in the world W: bodies, and no-touch volumes."""

from dataclasses import dataclass, field

import numpy as np

from drake_pregrasp.config.object_config import POINT, BoxFields, zeros
from drake_pregrasp.geometry.solids import BallSolid, HalfSpace, Solid
from drake_pregrasp.systems.sources import MovingSolid

_POINT = {"length": 3, "at_least": -100, "at_most": 100}
_SIZE = {"length": 3, "above": 0, "at_most": 100}


@dataclass(kw_only=True)
class _Obstacle:
    # Whether it is a body, which collides with the object and the hand. If not, it is a no-touch
    # volume: contacts and hand keep clear of it, but it has no body.
    body: bool = True


@dataclass
class BallObstacle(_Obstacle):
    """A ball with constant velocity."""

    # Radius of the ball, in metres.
    radius: float = field(default=0.0, metadata={"required": True, "above": 0, "at_most": 100})

    # Centre of the ball at the start in W, in metres.
    center: list[float] = field(default_factory=zeros, metadata=_POINT)

    # Velocity of the ball in W, in m/s.
    velocity: list[float] = field(default_factory=zeros, metadata=POINT)

    def make_solid(self) -> Solid:
        """Returns the ball at the start, in W."""
        return BallSolid(np.array(self.center), self.radius)


@dataclass
class BoxObstacle(BoxFields, _Obstacle):
    """A box with constant velocity and orientation."""

    # Edge lengths of the box, in metres.
    size: list[float] = field(default_factory=zeros, metadata={"required": True, **_SIZE})

    # Centre of the box at the start in W, in metres.
    center: list[float] = field(default_factory=zeros, metadata=_POINT)

    # Orientation of the box in W, as roll, pitch and yaw, in radians.
    rpy: list[float] = field(default_factory=zeros, metadata=POINT)

    # Velocity of the box in W, in m/s.
    velocity: list[float] = field(default_factory=zeros, metadata=POINT)


@dataclass
class PlaneObstacle(_Obstacle):
    """Half-space behind a plane, such as a wall."""

    # Point of the plane at the start in W, in metres.
    point: list[float] = field(default_factory=zeros, metadata=_POINT)

    # Normal of the plane in W, which points away from the obstacle.
    normal: list[float] = field(default_factory=zeros, metadata={"required": True, **_POINT})

    # Velocity of the plane in W, in m/s.
    velocity: list[float] = field(default_factory=zeros, metadata=POINT)

    def make_solid(self) -> Solid:
        """Returns the half-space at the start, in W."""
        return HalfSpace(np.array(self.point), np.array(self.normal))


ObstacleConfig = BallObstacle | BoxObstacle | PlaneObstacle


def moving_solid(config: ObstacleConfig) -> MovingSolid:
    """Returns the solid of an obstacle at the start, in W, with its velocity."""
    return MovingSolid(config.make_solid(), np.array(config.velocity))
