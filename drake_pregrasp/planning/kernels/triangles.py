"""Nearest points on triangles (numpy)."""

from collections.abc import Sequence

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray, IntArray

FLAT = 1e-12
"""Square of the sine at a corner below which a triangle is taken for its edges: rounding would
decide on which side of them a point is."""


def closest_points(triangles: FloatArray, points: FloatArray) -> FloatArray:
    """Returns the point of each triangle, shape (k, 3, 3), nearest to its point, shape (k, 3).

    By the region of the triangle's plane that the point is over: at a corner, along an edge, or
    inside (Ericson, "Real-Time Collision Detection", 2004, sec. 5.1.5). There are no tolerances:
    trimesh's are absolute, in the fourth power of a length, and take triangles of millimetres for
    points.
    """
    a = triangles[:, 0]
    edges = triangles[:, 1:] - a[:, None]
    gram = edges @ edges.transpose(0, 2, 1)
    bb, bc, cc = gram[:, 0, 0], gram[:, 0, 1], gram[:, 1, 1]
    # Of p less each corner, the components along the edges from a to b and from a to c.
    b_a, c_a = (edges @ (points - a)[:, :, None])[:, :, 0].T
    b_b, c_b = b_a - bb, c_a - bc
    b_c, c_c = b_a - bc, c_a - cc
    over_ab, over_ac = b_a * c_b - b_b * c_a, b_c * c_a - b_a * c_c
    over_bc = b_b * c_c - b_c * c_b
    to_b, to_c = c_b - b_b, b_c - c_c
    with np.errstate(divide="ignore", invalid="ignore"):  # Of cases that aren't chosen.
        along_bc, whole = to_b / (to_b + to_c), over_ab + over_ac + over_bc
        cases = (
            ((b_a <= 0) & (c_a <= 0), 0.0, 0.0),
            ((b_b >= 0) & (to_b <= 0), 1.0, 0.0),
            ((c_c >= 0) & (to_c <= 0), 0.0, 1.0),
            ((over_ab <= 0) & (b_a >= 0) & (b_b <= 0), b_a / bb, 0.0),
            ((over_ac <= 0) & (c_a >= 0) & (c_c <= 0), 0.0, c_a / cc),
            ((over_bc <= 0) & (to_b >= 0) & (to_c >= 0), 1 - along_bc, along_bc),
        )
        v, w = over_ac / whole, over_ab / whole
    for holds, v_there, w_there in cases[::-1]:  # The first that holds counts.
        v, w = np.where(holds, v_there, v), np.where(holds, w_there, w)
    closest: FloatArray = a + v[:, None] * edges[:, 0] + w[:, None] * edges[:, 1]
    flat = bb * cc - bc * bc <= FLAT * bb * cc
    if flat.any():
        closest[flat] = _closest_on_edges(triangles[flat], points[flat])
    return closest


def _closest_on_edges(triangles: FloatArray, points: FloatArray) -> FloatArray:
    ways = np.roll(triangles, -1, axis=1) - triangles
    squares = np.maximum(np.einsum("kij,kij->ki", ways, ways), np.finfo(float).tiny)
    along = np.einsum("kij,kij->ki", points[:, None] - triangles, ways) / squares
    closest = triangles + np.clip(along, 0, 1)[:, :, None] * ways
    nearest = np.argmin(np.linalg.norm(closest - points[:, None], axis=2), axis=1)
    chosen: FloatArray = closest[np.arange(len(points)), nearest]
    return chosen


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
