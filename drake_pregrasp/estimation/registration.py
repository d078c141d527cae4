"""First pose of an object from points that a camera sees, without any estimate before."""

from collections.abc import Callable
from operator import itemgetter

import numpy as np
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.estimation.surface_alignment import (
    SCALES,
    Alignment,
    SurfacePoints,
    align_pose,
)
from drake_pregrasp.geometry.distance_grid import DistanceGrid
from drake_pregrasp.geometry.rotations import rotation_matrix

STARTS = 512
"""Number of orientations to start from: each rotation is within about 30 degrees of one."""

AS_WELL = 0.002
"""Share of the points by which poses that fit as well differ."""

_FEW = 80  # Points of the first steps.
_COARSE = (0.03, 0.03, 0.02, 0.02, 0.015)  # Scales of the first steps, in metres.
_FINALISTS, _DIFFERING = 24, 12  # Best starts, and further ones, that are aligned to all points.
_APART = np.radians(18)  # Least turn between those further ones.
_YAWS, _UPRIGHT = 24, 6  # Turns about one axis, and finalists of the upright ones.
_ALIKE = 0.003  # Largest distance of a surface from the same one, in metres.
_SAMPLES = 500  # Points of the surface.
_LIFTED = 3.0  # Standard deviations of a height that the table hardly contradicts.
_SHIFTED = 8  # Best ends that are shifted.
_ENDS = 2  # Passes over the scales of an alignment.
_WALL = 0.005  # Shift by which points come to the other side of a thin wall, in metres.
_UP = np.array([0.0, 0.0, 1.0])
_GOLDEN = (np.sqrt(2.0), 1.533751168755204)  # Ratios of a super-Fibonacci spiral.


def register_pose(
    grid: DistanceGrid,
    corners: FloatArray,
    p_WQ: FloatArray,
    std: FloatArray,
    *,
    point_std: float,
    table: bool = True,
    offset_std: float = 0.0,
    align: Callable[..., Alignment] = align_pose,
) -> Alignment:
    """Returns the pose that fits points best, out of alignments from many orientations.

    The middle of the object's bounding box starts at that of the points. On a table, the object
    starts on it, and what the pose leaves between them counts as misfit: little within three
    standard deviations of the height, to which an offset of the points contributes. From the best
    poses, further ones start: shifted so far that points of one side of a wall reach the other, and
    turned about the axis about which the points tell least. The pose with the least misfit is
    returned. If others that fit as well have the same surface, as those of a symmetric object, it
    is the one that is turned least from the axes of W.

    Args:
        grid: Signed distances of the object in O.
        corners: Vertices of its convex hull in O, shape (k, 3), in metres.
        p_WQ: Points of the object in W, shape (N, 3), in metres.
        std: Assumed standard deviations of a measured pose (theta, p), shape (6,).
        point_std: Standard deviation of a point's distance from the surface, in metres.
        table: Whether the object stands on the plane z = 0 of W.
        offset_std: Standard deviation of an offset that all points share, in metres.
        align: Implementation of `align_pose`.
    """
    few = SurfacePoints.seen(p_WQ[:: max(1, len(p_WQ) // _FEW)], point_std)
    middle, found = (p_WQ.min(axis=0) + p_WQ.max(axis=0)) / 2, []
    for R_WO in np.concatenate([_turns(_UP), _lattice(STARTS)]):
        turned = corners @ R_WO.T
        low, high = turned.min(axis=0), turned.max(axis=0)
        p_WO = middle - (low + high) / 2
        if table:
            p_WO[2] = -low[2]
        found.append(align(grid, few, R_WO, p_WO, std, _COARSE))
    slack = _LIFTED * float(np.hypot(offset_std, std[5])) if table else np.inf
    misfits = [_misfit(start, corners, len(few.radius), slack) for start in found]
    points = SurfacePoints.seen(p_WQ, point_std)
    ends: list[tuple[float, Alignment]] = []  # With their misfits.

    def add(R_WO: FloatArray, p_WO: FloatArray) -> None:
        for _ in range(_ENDS):
            R_WO, p_WO, *_ = end = align(grid, points, R_WO, p_WO, std, SCALES)
        ends.append((_misfit(end, corners, len(p_WQ), slack), end))

    def best(number: int) -> list[Alignment]:
        return [end for _, end in sorted(ends, key=itemgetter(0))[:number]]

    def shift(number: int) -> None:
        for end in best(number):
            for step in _WALL * np.vstack([np.eye(3), -np.eye(3)]):
                add(end.R_WO, end.p_WO + step)

    # The first start is not turned: of the poses of a symmetric object, it finds the least turned.
    best_upright = np.argsort(misfits[:_YAWS])[:_UPRIGHT]
    ranks = np.argsort(misfits)
    differing = _differing([found[k] for k in ranks])
    chosen = [found[k] for k in {0, *ranks[:_FINALISTS].tolist(), *best_upright.tolist()}]
    for start in [*chosen, *differing]:
        add(start.R_WO, start.p_WO)
    shift(_SHIFTED)
    (end,) = best(1)
    axis, p_WA = _hidden_axis(end)
    for turn in _turns(axis):
        add(turn @ end.R_WO, p_WA + turn @ (end.p_WO - p_WA))
    shift(1)
    least, (first,) = min(misfit for misfit, _ in ends) + AS_WELL, best(1)
    p_WS = _surface(grid) @ first.R_WO.T + first.p_WO
    equal = [
        end
        for misfit, end in ends
        if misfit <= least and np.abs(grid.distances((p_WS - end.p_WO) @ end.R_WO)).max() < _ALIKE
    ]
    return max(equal, key=lambda end: float(np.trace(end.R_WO)))


def _surface(grid: DistanceGrid) -> FloatArray:
    """Returns points on the surface in O, shape (k, 3), in metres."""
    near = np.flatnonzero(np.abs(grid.nodes[:, 0]) < grid.cell)
    near = near[:: max(1, len(near) // _SAMPLES)]
    p_ON = grid.low + grid.cell * np.column_stack(np.unravel_index(near, grid.counts))
    p_OS: FloatArray = p_ON - grid.nodes[near, :1] * grid.nodes[near, 1:]
    return p_OS


def _hidden_axis(found: Alignment) -> tuple[FloatArray, FloatArray]:
    """Returns the axis in W about which points tell least of a turn, and a point on it, shape (3,).

    A mug that is well aligned but for its handle has to turn about its own axis.
    """
    A, B, C = (found.information[i] for i in (np.s_[:3, :3], np.s_[:3, 3:], np.s_[3:, 3:]))
    slide = -np.linalg.pinv(C, hermitian=True) @ B.T  # Of the origin, for each unit turn.
    axis: FloatArray = np.linalg.eigh(A + B @ slide)[1][:, 0]
    return axis, found.p_WO + np.cross(axis, slide @ axis)


def _differing(starts: list[Alignment]) -> list[Alignment]:
    """Returns the first starts of which no two are alike.

    The best starts alone may all have a mug upright that stands upside down.
    """
    chosen: list[Alignment] = []
    for start in starts:
        cosines = [(np.trace(start.R_WO @ other.R_WO.T) - 1) / 2 for other in chosen]
        if max(cosines, default=-1.0) < np.cos(_APART):
            chosen.append(start)
        if len(chosen) == _DIFFERING:
            break
    return chosen


def _misfit(found: Alignment, corners: FloatArray, count: int, slack: float) -> float:
    """Returns the share of points that do not fit, and what the table adds, little within slack."""
    height = abs(float(np.min(corners @ found.R_WO[2])) + found.p_WO[2])
    scale, beyond, share = SCALES[-1], max(0.0, height - slack), min(1.0, height / slack)
    on_table = (scale**2 / (scale**2 + beyond**2)) ** 2 - AS_WELL * share**2
    return float(2 - found.fits / count - on_table)


def _turns(axis: FloatArray) -> FloatArray:
    """Returns evenly spread turns about an axis, shape (k, 3, 3)."""
    return rotation_matrix(np.outer(np.arange(_YAWS) * 2 * np.pi / _YAWS, axis))


def _lattice(count: int) -> FloatArray:
    """Returns evenly spread rotations, shape (count, 3, 3): a super-Fibonacci spiral.

    See Alexa, "Super-Fibonacci spirals: fast, low-discrepancy sampling of SO(3)", 2022.
    """
    s = np.arange(count) + 0.5
    inner, outer = np.sqrt(s / count), np.sqrt(1 - s / count)
    a, b = (2 * np.pi * s / ratio for ratio in _GOLDEN)
    halves = [inner * np.sin(a), inner * np.cos(a), outer * np.sin(b), outer * np.cos(b)]
    rotations: FloatArray = Rotation.from_quat(np.column_stack(halves)).as_matrix()
    return rotations
