"""Obstacles seen from another frame, whatever their numbers are."""

import numpy as np

from drake_pregrasp.arrays import FARTHEST, FloatArray, are_valid_points
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.solids import BallSolid, Solid
from drake_pregrasp.geometry.surface import ForbiddenPoints
from drake_pregrasp.regions.constraints import Obstacles

ANYWHERE = BallSolid(np.zeros(3), FARTHEST)
"""Stands for an obstacle that nobody knows the place of: no ground is clear of it."""


def place_obstacles(
    obstacles: Obstacles, R_GF: FloatArray, p_GF: FloatArray, *, seconds: float = 0.0
) -> Obstacles:
    """Returns where obstacles are in a frame G some time later, in which F has that pose then.

    Solids and points are refused when they are made of numbers that aren't finite. Where they
    became so later, each such one is `ANYWHERE`, so that contacts keep off it and their status
    says which one it is.

    Args:
        obstacles: In F.
        R_GF: Shape (3, 3).
        p_GF: Shape (3,), in metres.
        seconds: From now.
    """
    solids = []
    with np.errstate(all="ignore"):  # What comes of such numbers is looked at below.
        ways = seconds * obstacles.velocities
        for index, solid in enumerate(obstacles.solids):
            way = ways[index] if np.any(ways) else None
            solids.append(_placed(solid, R_GF, p_GF, way))
        points = _placed_points(obstacles.points, R_GF, p_GF)
    return Obstacles(tuple(solids), points)


def all_are_known(obstacles: Obstacles) -> bool:
    """Returns whether of all placed obstacles the places are known."""
    return ANYWHERE not in obstacles.solids and bool(np.all(obstacles.points.radii < FARTHEST))


def _placed(solid: Solid, R_GF: FloatArray, p_GF: FloatArray, way: FloatArray | None) -> Solid:
    try:
        moved = solid if way is None else solid.moved(np.eye(3), way)
        moved = moved.moved(R_GF, p_GF)
    except InvalidArgumentError:
        return ANYWHERE
    distance, gradient = moved.distance_and_gradient(np.zeros((1, 3)))
    return moved if np.isfinite(distance[0]) and np.all(np.isfinite(gradient)) else ANYWHERE


def _placed_points(points: ForbiddenPoints, R_GF: FloatArray, p_GF: FloatArray) -> ForbiddenPoints:
    places = points.points @ R_GF.T + p_GF
    radii, normals = points.radii, points.normals @ R_GF.T
    known = (radii >= 0) & (radii <= FARTHEST) & np.all(np.isfinite(normals), axis=1)
    unknown = ~(known & are_valid_points(places))
    if np.any(unknown):
        places, radii, normals = places.copy(), radii.copy(), normals.copy()
        places[unknown], radii[unknown], normals[unknown] = 0.0, FARTHEST, 0.0
    return ForbiddenPoints(places, radii, normals)
