"""Nearest points on triangles (numpy)."""

from collections.abc import Sequence

import numpy as np
import trimesh

from drake_pregrasp.planning.arrays import FloatArray, IntArray

_UNITS = 1e4  # In a metre: tenths of millimetres.


def closest_points(triangles: FloatArray, points: FloatArray) -> FloatArray:
    """Returns the point of each triangle, shape (k, 3, 3), nearest to its point, shape (k, 3)."""
    # The tolerances of trimesh are absolute, and in the fourth power of a length: they would count
    # triangles of millimetres as points.
    closest: FloatArray = trimesh.triangles.closest_point(_UNITS * triangles, _UNITS * points)
    return closest / _UNITS


def nearest_on_triangles(
    points: FloatArray, triangles: Sequence[IntArray], corners: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Returns the nearest point to each of some points on its own triangles, and which that is on.

    Args:
        points: Shape (k, 3), k >= 1, in metres.
        triangles: For each point the indices of one triangle or more; of equals the first counts.
        corners: Of all triangles, shape (T, 3, 3), in metres.
    """
    counts = [len(t) for t in triangles]
    which = np.concatenate(triangles)
    repeated = np.repeat(points, counts, axis=0)
    nearest = closest_points(corners[which], repeated)
    away = nearest - repeated
    squares = np.einsum("ij,ij->i", away, away)
    best, start = [], 0
    for count in counts:
        best.append(start + int(np.argmin(squares[start : start + count])))
        start += count
    return nearest[best], which[best]
