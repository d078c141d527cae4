"""Obstacles expressed in another frame, with a safe result for invalid numbers."""

import numpy as np

from drake_pregrasp.arrays import FARTHEST, FloatArray, are_valid_points
from drake_pregrasp.geometry.solids import BallSolid, PlacedSolid, moved_rows, nearest_solids
from drake_pregrasp.geometry.surface import ForbiddenPoints
from drake_pregrasp.regions.constraints import Obstacles

ANYWHERE = BallSolid(np.zeros(3), FARTHEST)
"""Replaces an obstacle whose place is unknown: no candidate is clear of it."""


def place_obstacles(
    obstacles: Obstacles, R_GF: FloatArray, p_GF: FloatArray, *, seconds: float = 0.0
) -> Obstacles:
    """Returns obstacles at a later time, expressed in a frame G.

    Obstacles with numbers that are not finite cannot be constructed. If numbers of an obstacle
    become invalid later, `ANYWHERE` replaces it: all regions are then empty, and the status of the
    contacts names the obstacle.

    Args:
        obstacles: Obstacles in a frame F.
        R_GF: Rotation of F in G at the later time, shape (3, 3).
        p_GF: Position of F in G at the later time, shape (3,), in metres.
        seconds: Seconds from now to the later time.
    """
    rows = np.array([solid.rounded_box() for solid in obstacles.solids]).reshape(-1, 19)
    with np.errstate(all="ignore"):  # Results that are not finite are replaced.
        if len(obstacles.velocities):
            rows[:, :3] += seconds * obstacles.velocities
        moved = moved_rows(rows, R_GF, p_GF)
        known = np.isfinite(nearest_solids(moved, np.zeros((1, 3)))[0][:, 0])
        points = _placed_points(obstacles.points, R_GF, p_GF)
    solids = [PlacedSolid(row) if ok else ANYWHERE for row, ok in zip(moved, known, strict=True)]
    return Obstacles(tuple(solids), points)


def _placed_points(points: ForbiddenPoints, R_GF: FloatArray, p_GF: FloatArray) -> ForbiddenPoints:
    places = points.points @ R_GF.T + p_GF
    radii, normals = points.radii, points.normals @ R_GF.T
    known = (radii >= 0) & (radii <= FARTHEST) & np.all(np.isfinite(normals), axis=1)
    unknown = ~(known & are_valid_points(places))
    if np.any(unknown):
        places, radii, normals = places.copy(), radii.copy(), normals.copy()
        places[unknown], radii[unknown], normals[unknown] = 0.0, FARTHEST, 0.0
    return ForbiddenPoints(places, radii, normals)
