"""Nearest points on triangles (numpy)."""

from collections.abc import Sequence

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray

FLAT = 1e-12
"""Square of the sine at a corner below which a triangle is taken for its edges: rounding would
decide on which side of them a point is."""


def closest_points(triangles: FloatArray, points: FloatArray) -> FloatArray:
    """Returns the point of each triangle, shape (k, 3, 3), nearest to its point, shape (k, 3).

    It is below the point, if the foot is inside the triangle, or else on the nearest edge. There
    are no tolerances: trimesh's are absolute, in the fourth power of a length, and take triangles
    of millimetres for points.
    """
    away = points[:, None] - triangles
    ways = triangles.take((1, 2, 0), axis=1) - triangles
    squares = np.einsum("kij,kij->ki", ways, ways)
    along = np.einsum("kij,kij->ki", away, ways)
    shares = np.clip(along / np.maximum(squares, np.finfo(float).tiny), 0, 1)
    offsets = shares[:, :, None] * ways - away
    nearest_edge = np.einsum("kij,kij->ki", offsets, offsets).argmin(axis=1)
    closest: FloatArray = points + offsets[np.arange(len(points)), nearest_edge]
    # The foot is a + (v ab + w ac)/whole.
    b_a, c_a = along[:, 0], -np.einsum("ki,ki->k", away[:, 0], ways[:, 2])
    bb, bc, cc = squares[:, 0], -np.einsum("ki,ki->k", ways[:, 0], ways[:, 2]), squares[:, 2]
    whole = bb * cc - bc * bc
    v, w = b_a * cc - c_a * bc, c_a * bb - b_a * bc
    inside = np.flatnonzero((v > 0) & (w > 0) & (v + w < whole) & (whole > FLAT * bb * cc))
    if len(inside):
        ab, ac = ways[inside, 0], -ways[inside, 2]
        foot = (v[inside, None] * ab + w[inside, None] * ac) / whole[inside, None]
        closest[inside] = triangles[inside, 0] + foot
    return closest


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
    repeated = points.repeat(counts, axis=0)
    nearest = closest_points(corners.take(which, axis=0), repeated)
    away = nearest - repeated
    squares = np.einsum("ij,ij->i", away, away)
    best, start = [], 0
    for count in counts:
        best.append(start + int(squares[start : start + count].argmin()))
        start += count
    return nearest[best], which[best]
