"""One table of broken values for each kind of port."""

import numpy as np
from five_finger_hand import RAYS, bus, points_of
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.perception import PointCloud
from pydrake.systems.framework import BusValue

from drake_pregrasp import BallSolid, HalfSpace, Obstacles

NO_POSES = (
    RigidTransform([1e300, 0.0, np.nan]),
    RigidTransform(RotationMatrix.MakeUnchecked(np.full((3, 3), np.nan)), np.zeros(3)),
    RigidTransform(RotationMatrix.MakeUnchecked(1.1 * np.eye(3)), np.zeros(3)),
)
NOT_FINITE = (np.nan, np.inf, -np.inf)
BAD_NUMBERS = (*NOT_FINITE, 1e300, -1e300)


def spoiled_wall(number):
    """A wall whose place is spoilt after it is made, since it is refused otherwise."""
    obstacles = Obstacles((HalfSpace(np.array([9.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0])),))
    obstacles.solids[0].point[0] = number
    return obstacles


def broken_values(sound):
    """Yields broken values of the kind of a port's sound value."""
    if isinstance(sound, RigidTransform):
        yield from NO_POSES
        return
    if isinstance(sound, PointCloud):
        for number in BAD_NUMBERS:
            broken = PointCloud(sound)
            broken.mutable_xyzs()[:, ::3] = np.clip(number, -1e38, 1e38)  # In single precision.
            yield broken
        yield PointCloud(0)
        return
    for number in BAD_NUMBERS:
        if isinstance(sound, SpatialVelocity):
            yield SpatialVelocity(w=[0.0, number, 0.0], v=[number, 0.0, 0.0])
        elif isinstance(sound, BusValue):
            points = points_of(sound)
            points[2, 1] = number
            yield bus(points, RAYS)
        elif isinstance(sound, Obstacles):
            yield spoiled_wall(number)
            ball = BallSolid(np.array([9.0, 0.0, 0.0]), 0.02)
            ball.center[1] = number
            yield Obstacles((ball,))
        else:
            for index in {0, len(sound) // 2, len(sound) - 1}:
                yield np.where(np.arange(len(sound)) == index, number, sound)
            yield np.full(len(sound), number)
    if isinstance(sound, BusValue):
        yield BusValue()
