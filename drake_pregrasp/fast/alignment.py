"""Compiled Gauss-Newton steps of a pose to points on the surface of an object."""

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.estimation.surface_alignment import (
    SCALES,
    Alignment,
    SurfacePoints,
    observed_step,
)
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.fast.distances import write_distance
from drake_pregrasp.fast.pose_steps import multiply, rotate
from drake_pregrasp.geometry.distance_grid import DistanceGrid

step_observed = compiled()(observed_step)


@compiled()
def write_information(  # type: ignore[no-untyped-def]
    nodes, counts, low, cell, p_WQ, radius, std, is_bound, R, p, scale, information, slope
):
    """Writes the sums of Gauss-Newton's normal equations, and returns that of the weights.

    Args:
        nodes: As in `write_distance`, here and in the next three.
        counts: Numbers of nodes.
        low: First node.
        cell: Edge length of a cell.
        p_WQ: As in `SurfacePoints`, here and in the next three.
        radius: Distances from the surface.
        std: Standard deviations of these.
        is_bound: Whether these are bounds.
        R: Orientation, shape (3, 3).
        p: Position, shape (3,), in metres.
        scale: Scale of the weights, in metres.
        information: Result: Hᵀ w H, shape (6, 6).
        slope: Result: Hᵀ w e, shape (6,).
    """
    a, q, h, share = np.empty(3), np.empty(3), np.empty(6), np.empty(3)
    first, found, fits = np.empty(3, dtype=np.int64), np.empty(4), 0.0
    information[:, :] = 0.0
    slope[:] = 0.0
    for point in range(len(p_WQ)):
        for axis in range(3):
            a[axis] = p_WQ[point, axis] - p[axis]
        for axis in range(3):
            q[axis] = R[0, axis] * a[0] + R[1, axis] * a[1] + R[2, axis] * a[2]
        write_distance(nodes, counts, low, cell, q, first, share, found)
        e = found[0] - radius[point]
        if is_bound[point] and e > 0:
            continue
        for axis in range(3):
            h[3 + axis] = -(R[axis, 0] * found[1] + R[axis, 1] * found[2] + R[axis, 2] * found[3])
        h[0] = h[5] * a[1] - h[4] * a[2]
        h[1] = h[3] * a[2] - h[5] * a[0]
        h[2] = h[4] * a[0] - h[3] * a[1]
        weight = (scale * scale / (scale * scale + e * e)) ** 2
        fits += weight
        weight /= std[point] * std[point]
        for i in range(6):
            slope[i] += weight * h[i] * e
            for j in range(i + 1):
                information[i, j] += weight * h[i] * h[j]
    for i in range(6):
        for j in range(i):
            information[j, i] = information[i, j]
    return fits


@compiled(
    "f8(f8[:,::1], i8[::1], f8[::1], f8, f8[:,::1], f8[::1], f8[::1], b1[::1], f8[::1], f8[::1],"
    " f8[:,::1], f8[::1], f8[:,::1])"
)
def write_alignment(  # type: ignore[no-untyped-def]
    nodes, counts, low, cell, p_WQ, radius, std, is_bound, units, scales, R, p, information
):
    """Moves a pose to points on a surface, as `align_pose`, and returns the sum of the weights.

    Args:
        nodes: As in `write_information`, here and in the next seven.
        counts: Numbers of nodes.
        low: First node.
        cell: Edge length of a cell.
        p_WQ: Points.
        radius: Distances from the surface.
        std: Standard deviations of these.
        is_bound: Whether these are bounds.
        units: Assumed standard deviations of a measured pose (theta, p), shape (6,).
        scales: Scale of the weights in each step, shape (k,), in metres.
        R: Orientation, changed in its place, shape (3, 3).
        p: Position, changed in its place, shape (3,), in metres.
        information: Result, shape (6, 6).
    """
    slope, turn, before = np.empty(6), np.empty((3, 3)), np.empty((3, 3))
    for step in range(len(scales)):
        own = p_WQ, radius, std, is_bound, R, p, scales[step], information, slope
        write_information(nodes, counts, low, cell, *own)
        x = step_observed(information, slope, units)
        rotate(x, 0, turn)
        before[:, :] = R
        multiply(turn, before, R)
        for axis in range(3):
            p[axis] += x[3 + axis]
    own = p_WQ, radius, std, is_bound, R, p, scales[-1], information, slope
    return write_information(nodes, counts, low, cell, *own)


def compiled_align_pose(
    grid: DistanceGrid,
    points: SurfacePoints,
    R_WO: FloatArray,
    p_WO: FloatArray,
    std: FloatArray,
    scales: tuple[float, ...] = SCALES,
) -> Alignment:
    """See `align_pose`."""
    R, p, information = np.array(R_WO, order="C"), np.array(p_WO), np.empty((6, 6))
    fits = write_alignment(
        *(grid.nodes, grid.counts, grid.low, grid.cell),
        *(np.ascontiguousarray(points.p_WQ), points.radius, points.std, points.is_bound),
        *(std, np.array(scales), R, p, information),
    )
    return Alignment(R, p, information, fits)
