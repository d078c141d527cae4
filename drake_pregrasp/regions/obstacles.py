"""Obstacles expressed in another frame, with a safe result for invalid numbers."""

import numpy as np

from drake_pregrasp.arrays import FARTHEST, BoolArray, FloatArray, are_valid_points
from drake_pregrasp.geometry.solids import BallSolid, PlacedSolid, moved_rows
from drake_pregrasp.geometry.surface import ForbiddenPoints
from drake_pregrasp.regions.constraints import Obstacles

ANYWHERE = BallSolid(np.zeros(3), FARTHEST)
"""Replaces an obstacle whose place is unknown: no candidate is clear of it."""


def place_obstacles(obstacles: Obstacles, R_GF: FloatArray, p_GF: FloatArray) -> Obstacles:
    """Returns obstacles expressed in a frame G; see `obstacles_at_times`.

    Args:
        obstacles: Obstacles in a frame F.
        R_GF: Rotation of F in G, shape (3, 3).
        p_GF: Position of F in G, shape (3,), in metres.
    """
    return obstacles_at_times(obstacles, R_GF[None], p_GF[None], np.zeros(1))[0]


def obstacles_at_times(
    obstacles: Obstacles, R_GF: FloatArray, p_GF: FloatArray, seconds: FloatArray
) -> list[Obstacles]:
    """Returns obstacles at several times, expressed in a frame G that may move.

    Obstacles with numbers that are not finite cannot be constructed. If numbers of an obstacle
    become invalid later, `ANYWHERE` replaces it: all regions are then empty, and the status of the
    contacts names the obstacle.

    Args:
        obstacles: Obstacles in a frame F.
        R_GF: Rotation of F in G at each time, shape (t, 3, 3).
        p_GF: Position of F in G at each time, shape (t, 3), in metres.
        seconds: Seconds from now to each time, shape (t,).
    """
    rows, points = np.repeat(obstacles.rows[None], len(seconds), axis=0), obstacles.points
    with np.errstate(all="ignore"):  # Results that are not finite are replaced.
        if len(obstacles.velocities):
            rows[:, :, :3] += seconds[:, None, None] * obstacles.velocities
        rows = moved_rows(rows, R_GF, p_GF)
        numbers_are_known = ~np.isnan(rows)  # Bounds may be infinite.
        numbers_are_known[:, :, :12] = np.abs(rows[:, :, :12]) <= FARTHEST
        known: BoolArray = np.logical_and.reduce(numbers_are_known, axis=2)
        if not known.all():
            rows[~known] = ANYWHERE.rounded_box()
        at_times = [_placed_points(points, *pose) for pose in zip(R_GF, p_GF, strict=True)]
    placed = []
    for own, sound, at_time in zip(rows, known.tolist(), at_times, strict=True):
        pairs = zip(own, sound, strict=True)
        solids = tuple(PlacedSolid(row) if is_known else ANYWHERE for row, is_known in pairs)
        placed.append(Obstacles(solids, at_time))
    return placed


def _placed_points(points: ForbiddenPoints, R_GF: FloatArray, p_GF: FloatArray) -> ForbiddenPoints:
    if len(points) == 0:
        return points
    places = points.points @ R_GF.T + p_GF
    radii, normals = points.radii, points.normals @ R_GF.T
    known = (radii >= 0) & (radii <= FARTHEST) & np.all(np.isfinite(normals), axis=1)
    unknown = ~(known & are_valid_points(places))
    if np.any(unknown):
        places, radii, normals = places.copy(), radii.copy(), normals.copy()
        places[unknown], radii[unknown], normals[unknown] = 0.0, FARTHEST, 0.0
    return ForbiddenPoints(places, radii, normals)
