"""Compiled steps of fingertips that move straight to their goals."""

import math

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.fast.predicates import distance_to
from drake_pregrasp.geometry.mesh_surface import INTRUSION
from drake_pregrasp.geometry.solids import PlacedSolid
from drake_pregrasp.grasping.fingertip_paths import (
    GRAZE,
    PATH_PARTS,
    ROUNDING,
    Pace,
    TipRoom,
    straight_step,
)


@compiled()
def is_clear_path(row, p, goal, least):  # type: ignore[no-untyped-def]
    """Returns whether points of a straight path keep a least distance from a solid.

    Args:
        row: The solid, as for `distance_to`.
        p: Start of the path, shape (3,), in metres.
        goal: End of the path, shape (3,), in metres.
        least: Least distance, in metres.
    """
    for part in range(1, PATH_PARTS + 1):
        s = part / PATH_PARTS
        x, y = p[0] + s * (goal[0] - p[0]), p[1] + s * (goal[1] - p[1])
        if not distance_to(row, x, y, p[2] + s * (goal[2] - p[2])) >= least:
            return False
    return True


@compiled()
def are_apart(p, rows, clearances, spacing):  # type: ignore[no-untyped-def]
    """Returns whether tips are clear of the solids after the first one, and of each other.

    Args:
        p: Centres of the tips, shape (n, 3), in metres.
        rows: The object and the other solids, as for `distance_to`, shape (1 + m, 19).
        clearances: Least distances of the tips from these, shape (1 + m, n), in metres.
        spacing: Least distances of the tips from each other, shape (n, n), in metres.
    """
    for i in range(len(p)):
        x, y, z = p[i, 0], p[i, 1], p[i, 2]
        for k in range(1, len(rows)):
            if not clearances[k, i] - distance_to(rows[k], x, y, z) <= ROUNDING:
                return False
        for j in range(i):
            a, b, c = x - p[j, 0], y - p[j, 1], z - p[j, 2]
            if not spacing[i, j] - math.sqrt(a * a + b * b + c * c) <= ROUNDING:
                return False
    return True


@compiled(
    "b1(f8[:,::1], f8[:,::1], f8[:,::1], f8, f8, f8, f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1])"
)
def write_straight_step(  # type: ignore[no-untyped-def]
    p, v, goal, speed, acceleration, period, rows, clearances, spacing, moved
):
    """Writes the next positions of tips, and returns whether they may move straight.

    Args:
        p: Centres of the tips in G, shape (n, 3), in metres.
        v: Velocities of the tips in G, shape (n, 3), in m/s.
        goal: Goals of the centres in G, shape (n, 3), in metres.
        speed: Largest speed of a tip, in m/s.
        acceleration: Largest acceleration of a tip, in m/s².
        period: Seconds between ticks.
        rows: The object and the other solids, as for `distance_to`, shape (1 + m, 19).
        clearances: Least distances of the tips from these, shape (1 + m, n), in metres.
        spacing: Least distances of the tips from each other, shape (n, n), in metres.
        moved: Result, shape (n, 3), in metres.
    """
    if not are_apart(goal, rows, clearances, spacing):
        return False
    change = acceleration * period
    for i in range(len(p)):
        there = distance_to(rows[0], goal[i, 0], goal[i, 1], goal[i, 2])
        least = min(max(there, clearances[0, i] - INTRUSION), clearances[0, i])
        here = distance_to(rows[0], p[i, 0], p[i, 1], p[i, 2])
        is_permitted = least - there <= ROUNDING
        if not (is_permitted and is_clear_path(rows[0], p[i], goal[i], min(least, here) - GRAZE)):
            return False
        squares = 0.0
        for axis in range(3):
            squares += ((goal[i, axis] - p[i, axis]) / period) ** 2
        fastest = math.sqrt(squares)
        stopping = math.sqrt(change * (change / 4 + 2 * fastest)) - change / 2
        share = min(1.0, min(stopping, speed) / max(fastest, 1e-12))
        squares = 0.0
        for axis in range(3):
            squares += (share * (goal[i, axis] - p[i, axis]) / period - v[i, axis]) ** 2
        excess = max(1.0, math.sqrt(squares) / change)
        for axis in range(3):
            jump = share * (goal[i, axis] - p[i, axis]) / period - v[i, axis]
            moved[i, axis] = p[i, axis] + period * (v[i, axis] + jump / excess)
        if not least - distance_to(rows[0], moved[i, 0], moved[i, 1], moved[i, 2]) <= ROUNDING:
            return False
    return are_apart(moved, rows, clearances, spacing)


def compiled_straight_step(
    p_GT: FloatArray, v_GT: FloatArray, goal: FloatArray, pace: Pace, room: TipRoom
) -> FloatArray | None:
    """See `straight_step`, which computes steps around objects that are not a `PlacedSolid`."""
    if not isinstance(room.object, PlacedSolid):
        return straight_step(p_GT, v_GT, goal, pace, room)
    rows = np.array([room.object.row, *[solid.rounded_box() for solid, _ in room.others]])
    clearances = np.array([room.object_clearances, *[least for _, least in room.others]])
    moved, limits = np.empty(p_GT.shape), (pace.speed, pace.acceleration, pace.period)
    arrays = np.ascontiguousarray(p_GT), np.ascontiguousarray(v_GT), np.ascontiguousarray(goal)
    can_move = write_straight_step(*arrays, *limits, rows, clearances, room.spacing, moved)
    return moved if can_move else None
