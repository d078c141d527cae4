"""Nearest points on triangles for numba."""

import numpy as np

from drake_pregrasp.kernels.compiled.compiling import compiled
from drake_pregrasp.kernels.triangles import FLAT


@compiled()
def nearest_on_triangles(points, ends, which, corners):  # type: ignore[no-untyped-def]
    """Returns what `triangles.nearest_on_triangles` does.

    Args:
        points: As there.
        ends: Where each point's triangles end in `which`, shape (k,).
        which: The triangles of all points, one point after another.
        corners: As there.
    """
    nearest = np.full((len(points), 3), np.nan)
    chosen = np.empty(len(points), dtype=np.int64)
    start = 0
    for k in range(len(points)):
        least = np.inf
        chosen[k] = which[start]
        for j in range(start, ends[k]):
            x, y, z = closest(points[k], corners[which[j]])
            dx, dy, dz = x - points[k, 0], y - points[k, 1], z - points[k, 2]
            square = dx * dx + dy * dy + dz * dz
            if square < least:
                least = square
                chosen[k] = which[j]
                nearest[k, 0], nearest[k, 1], nearest[k, 2] = x, y, z
        start = ends[k]
    return nearest, chosen


@compiled()
def closest(p, corners):  # type: ignore[no-untyped-def]
    """Returns a triangle's point nearest to p.

    By the region of the triangle's plane that p is over: at a corner, along an edge, or inside
    (Ericson, "Real-Time Collision Detection", 2004, sec. 5.1.5).
    """
    ax, ay, az = corners[0, 0], corners[0, 1], corners[0, 2]
    bx, by, bz = corners[1, 0] - ax, corners[1, 1] - ay, corners[1, 2] - az
    cx, cy, cz = corners[2, 0] - ax, corners[2, 1] - ay, corners[2, 2] - az
    px, py, pz = p[0] - ax, p[1] - ay, p[2] - az
    # Of p less each corner, the components along the edges from a to b and from a to c.
    bb, cc, bc = (
        bx * bx + by * by + bz * bz,
        cx * cx + cy * cy + cz * cz,
        bx * cx + by * cy + bz * cz,
    )
    if bb * cc - bc * bc <= FLAT * bb * cc:
        return _closest_on_edges(p, corners)
    b_a, c_a = bx * px + by * py + bz * pz, cx * px + cy * py + cz * pz
    b_b, c_b = b_a - bb, c_a - bc
    b_c, c_c = b_a - bc, c_a - cc
    v, w = 0.0, 0.0  # The nearest point is a + v (b - a) + w (c - a).
    over_ab = b_a * c_b - b_b * c_a
    over_ac = b_c * c_a - b_a * c_c
    over_bc = b_b * c_c - b_c * c_b
    if b_a <= 0.0 and c_a <= 0.0:
        pass
    elif b_b >= 0.0 and c_b <= b_b:
        v = 1.0
    elif c_c >= 0.0 and b_c <= c_c:
        w = 1.0
    elif over_ab <= 0.0 and b_a >= 0.0 and b_b <= 0.0:
        v = b_a / bb
    elif over_ac <= 0.0 and c_a >= 0.0 and c_c <= 0.0:
        w = c_a / cc
    elif over_bc <= 0.0 and c_b >= b_b and b_c >= c_c:
        w = (c_b - b_b) / ((c_b - b_b) + (b_c - c_c))
        v = 1.0 - w
    else:
        whole = over_ab + over_ac + over_bc
        v, w = over_ac / whole, over_ab / whole
    return ax + v * bx + w * cx, ay + v * by + w * cy, az + v * bz + w * cz


@compiled()
def _closest_on_edges(p, corners):  # type: ignore[no-untyped-def]
    least = np.inf
    x, y, z = corners[0, 0], corners[0, 1], corners[0, 2]
    for k in range(3):
        start, end = corners[k], corners[(k + 1) % 3]
        wx, wy, wz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
        square = wx * wx + wy * wy + wz * wz
        along = (p[0] - start[0]) * wx + (p[1] - start[1]) * wy + (p[2] - start[2]) * wz
        t = min(max(along / square, 0.0), 1.0) if square > 0.0 else 0.0
        u, v, w = start[0] + t * wx, start[1] + t * wy, start[2] + t * wz
        away = (u - p[0]) ** 2 + (v - p[1]) ** 2 + (w - p[2]) ** 2
        if away < least:
            least, x, y, z = away, u, v, w
    return x, y, z
