"""Which of a region's planes matter on a patch of the surface, by clipping polygons, for numba."""

import numpy as np

from drake_pregrasp.planning.kernels.compiling import compiled

EMPTY = -1
"""Returned where the planes leave nothing of a patch."""


_USED = -np.inf  # Value of a line that is done with.


@compiled()
def relevant_planes(  # type: ignore[no-untyped-def]
    chosen, count, normals, bounds, slack, frame, span, lines, corners
):
    """Keeps those of some planes that bound what they leave of a patch, and returns how many.

    In each round the lines that don't reach the polygon any more are dropped, and of those whose
    normals are in the same quadrant the one that cuts most is taken.

    Args:
        chosen: Indices of the planes; the first `count` are asked, and overwritten.
        count: How many there are.
        normals: Of planes n·q <= b, coordinate by coordinate, shape (3, k).
        bounds: b, shape (k,).
        slack: By which a plane may be off through rounding, shape (k,).
        frame: Axes u, v, w of the patch, shape (3, 3).
        span: Midpoint along them and half widths, shape (2, 3).
        lines: Scratch, shape (9, k).
        corners: Scratch, shape (2, 3, c), for polygons of up to c/2 corners.

    Returns:
        The number of planes kept, or `EMPTY`.
    """
    _write_lines(chosen, count, normals, bounds, slack, frame, span, lines)
    u, v = corners[0, 0], corners[0, 1]
    half_u, half_v, mid_u, mid_v = span[1, 0], span[1, 1], 0.0, 0.0
    u[0], v[0], u[1], v[1] = -half_u, -half_v, half_u, -half_v
    u[2], v[2], u[3], v[3] = half_u, half_v, -half_u, half_v
    size, taken, here = 4, 0, 0
    best, depth = np.empty(4, dtype=np.int64), np.empty(4)
    while True:
        best[:] = -1
        depth[:] = -np.inf
        waiting = 0
        polygon = corners[here]
        for j in range(count):
            a, b, c, give = lines[0, j], lines[1, j], lines[2, j], lines[3, j]
            middle = c + a * mid_u + b * mid_v
            reach = abs(a) * half_u + abs(b) * half_v
            if middle - reach > give:
                return EMPTY
            if middle + reach <= -give or not _nears(polygon, size, a, b, c, give):
                continue
            quadrant = (a > 0.0) + 2 * (b > 0.0)
            share = middle / reach if reach > 0.0 else 0.0
            if best[quadrant] < 0 or share > depth[quadrant]:
                best[quadrant], depth[quadrant] = waiting, share
            lines[0, waiting], lines[1, waiting] = a, b
            lines[2, waiting], lines[3, waiting] = c, give
            chosen[waiting] = chosen[j]
            waiting += 1
        count = waiting
        if count == 0:
            break
        for quadrant in range(4):
            j = best[quadrant]
            if j < 0:
                continue
            if 2 * size > polygon.shape[1]:  # No room for more corners.
                return _all(chosen, count, lines, taken)
            a, b, c, give = lines[0, j], lines[1, j], lines[2, j], lines[3, j]
            lines[4, taken], lines[5, taken] = a, b
            lines[6, taken], lines[7, taken] = c, give
            lines[8, taken] = chosen[j]
            lines[2, j] = _USED
            taken += 1
            after = _clip(corners[here], size, corners[1 - here], a, b, c, give)
            if after == 0:
                return EMPTY
            if after > 0:
                size, here = after, 1 - here
        polygon = corners[here]
        low_u, high_u, low_v, high_v = np.inf, -np.inf, np.inf, -np.inf
        for k in range(size):
            low_u, high_u = min(low_u, polygon[0, k]), max(high_u, polygon[0, k])
            low_v, high_v = min(low_v, polygon[1, k]), max(high_v, polygon[1, k])
        mid_u, mid_v = 0.5 * (low_u + high_u), 0.5 * (low_v + high_v)
        half_u, half_v = 0.5 * (high_u - low_u), 0.5 * (high_v - low_v)
    # What an early line left may have been taken by later ones.
    kept = 0
    for j in range(taken):
        if _nears(corners[here], size, lines[4, j], lines[5, j], lines[6, j], lines[7, j]):
            chosen[kept] = int(lines[8, j])
            kept += 1
    return kept


@compiled()
def _all(chosen, count, lines, taken):  # type: ignore[no-untyped-def]
    """Keeps planes that have been taken, and those that wait, and returns how many."""
    kept = 0
    for j in range(count):
        if lines[2, j] != _USED:
            chosen[kept] = chosen[j]
            kept += 1
    for j in range(taken):
        chosen[kept + j] = int(lines[8, j])
    return kept + taken


@compiled()
def _write_lines(  # type: ignore[no-untyped-def]
    chosen, count, normals, bounds, slack, frame, span, lines
):
    """Writes n·q - b on the patch as a line a u + b v + c about its middle, and the tolerance."""
    u0, u1, u2 = frame[0, 0], frame[0, 1], frame[0, 2]
    v0, v1, v2 = frame[1, 0], frame[1, 1], frame[1, 2]
    w0, w1, w2 = frame[2, 0], frame[2, 1], frame[2, 2]
    mid_u, mid_v, mid_w, thickness = span[0, 0], span[0, 1], span[0, 2], span[1, 2]
    for p in range(count):
        j = chosen[p]
        x, y, z = normals[0, j], normals[1, j], normals[2, j]
        along_u = x * u0 + y * u1 + z * u2
        along_v = x * v0 + y * v1 + z * v2
        along_w = x * w0 + y * w1 + z * w2
        lines[0, p] = along_u
        lines[1, p] = along_v
        lines[2, p] = along_u * mid_u + along_v * mid_v + along_w * mid_w - bounds[j]
        lines[3, p] = slack[j] + abs(along_w) * thickness


@compiled()
def _clip(from_, size, to, a, b, c, give):  # type: ignore[no-untyped-def]
    """Writes the part of a convex polygon where a u + b v + c <= give.

    Returns the number of its corners: 0 if nothing is left, -1 if nothing was cut off.
    """
    is_cut, after = False, 0
    for k in range(size):
        from_[2, k] = a * from_[0, k] + b * from_[1, k] + c - give
        is_cut |= from_[2, k] > 0.0
    if not is_cut:
        return -1
    last = size - 1
    for k in range(size):
        d, before = from_[2, k], from_[2, last]
        if (d > 0.0) != (before > 0.0):
            t = before / (before - d)
            to[0, after] = from_[0, last] + t * (from_[0, k] - from_[0, last])
            to[1, after] = from_[1, last] + t * (from_[1, k] - from_[1, last])
            after += 1
        if d <= 0.0:
            to[0, after], to[1, after] = from_[0, k], from_[1, k]
            after += 1
        last = k
    return after


@compiled()
def _nears(polygon, size, a, b, c, give):  # type: ignore[no-untyped-def]
    """Returns whether a corner of a polygon is beyond a line, or by less than `give` within."""
    farthest = -np.inf
    for k in range(size):
        farthest = max(farthest, a * polygon[0, k] + b * polygon[1, k])
    return farthest + c > -give
