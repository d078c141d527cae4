"""Tests of single points, and of whole blocks of them, by the arrays of `Predicates`."""

import math
from typing import Any

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.regions.constraints import (
    ALONG,
    CLOSED,
    NO_CAUSE,
    RADIUS,
    REACH_SOLID,
    SECTOR,
    Limit,
    Predicates,
)
from drake_pregrasp.regions.finger_measures import LEAST_ARM, FingerMeasures
from drake_pregrasp.regions.finger_reach import ANY_ANGLE

_SOLID, _SECTOR, _CLOSED = REACH_SOLID.start, SECTOR.start, CLOSED.start
_NONE, _FORBIDDEN, _REACH, _OBSTACLE = map(
    int, (Limit.NONE, Limit.FORBIDDEN, Limit.REACH, Limit.OBSTACLE)
)
_SHARES = len(ALONG)
_HAND = "Tuple((f8[:,::1], f8[:,::1], f8[:,:,:,:,::1], f8[:,::1], f8[::1], f8[:,::1], f8[::1]))"
SHARED = f"Tuple((f8[:,::1], f8[:,::1], f8, f8, {_HAND}))"
"""Types of what the contacts share; see `shared_arrays`."""

_ABOVE = 1 + 1e-9  # Decisions about blocks must not be reversed by rounding.


@compiled()
def any_positive(values):  # type: ignore[no-untyped-def]
    """Returns whether any of some numbers is above 0."""
    found = False
    for value in values:
        found |= value > 0.0
    return found


@compiled()
def distance_to(row, x, y, z):  # type: ignore[no-untyped-def]
    """Returns the signed distance of a point from a solid, as `rounded_box_distances`."""
    x, y, z = x - row[0], y - row[1], z - row[2]
    largest, square = -math.inf, 0.0
    for k in range(3):
        along = x * row[3 + k] + y * row[6 + k] + z * row[9 + k]
        beyond = max(along - row[15 + k], row[12 + k] - along)
        largest = max(largest, beyond)
        square += max(beyond, 0.0) ** 2
    return math.sqrt(square) + min(largest, 0.0) - row[18]


@compiled()
def sector_gaps(row, tx, ty, tz, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Returns by how much a tip and a normal are inside a sector's angles, below 0 outside."""
    x, y, z = tx - row[0], ty - row[1], tz - row[2]
    height = x * row[3] + y * row[4] + z * row[5]
    x, y, z = x - height * row[3], y - height * row[4], z - height * row[5]
    length = math.sqrt(x * x + y * y + z * z)
    sideways = x * row[6] + y * row[7] + z * row[8] - row[12] * length
    level = -abs(nx * row[3] + ny * row[4] + nz * row[5]) - row[14]
    return sideways, nx * row[9] + ny * row[10] + nz * row[11] - row[13], level


@compiled()
def finger_measures_of(finger, hand, tip, nhat):  # type: ignore[no-untyped-def]
    """Returns the five measures of a finger at one place, as `FingerMeasures.at`.

    Args:
        finger: Index of the finger.
        hand: Attributes of the hand's `FingerMeasures`.
        tip: Centre of the fingertip, three numbers in metres.
        nhat: Outward unit normal there, three numbers.
    """
    low, step, table, efforts, _, R, p = hand
    row, normal, share = np.zeros(table.shape[4]), np.zeros(3), np.empty((2, 3))
    corner, last = np.empty(3, np.int64), table.shape[1] - 1
    for axis in range(3):
        place = 0.0
        for k in range(3):
            place += R[k, axis] * (tip[k] - p[k])
            normal[axis] += R[k, axis] * nhat[k]
        place = (place - low[finger, axis]) / step[finger, axis]
        if not 0.0 <= place <= last:
            return math.nan, math.nan, math.nan, math.nan, math.nan
        corner[axis] = min(int(place), last - 1)
        share[1, axis] = place - corner[axis]
        share[0, axis] = 1.0 - share[1, axis]
    for offset in range(8):
        a, b, c = offset // 4, offset // 2 % 2, offset % 2
        weight = share[a, 0] * share[b, 1] * share[c, 2]
        for k in range(len(row)):
            row[k] += weight * table[finger, corner[0] + a, corner[1] + b, corner[2] + c, k]
    force = math.nan if math.isnan(row[-1]) else math.inf
    for j in range(efforts.shape[1]):
        arm = row[3 * j] * normal[0] + row[3 * j + 1] * normal[1] + row[3 * j + 2] * normal[2]
        largest = efforts[finger, j] / max(abs(arm), LEAST_ARM)
        force = largest if largest < force else force  # It stays NaN.
    return row[-4], row[-3], row[-2], row[-1], force


@compiled()
def limits_of_block(i, contact, q, nhat, start, stop, owners, shared, near, out, gaps):  # type: ignore[no-untyped-def]
    """Writes the limit and cause of points for one contact, as `Predicates.limits_at`.

    Loops run over many points without branches, so that the compiler makes vector instructions.

    Args:
        i: Index of the contact.
        contact: Row of the contact.
        q: Points, shape (d, N), of which those from `start` to `stop` are tested, in metres.
        nhat: Outward unit normals at the points, shape (3, N).
        start: First point.
        stop: End of the points.
        owners: Contact of each point. For others than i the limits of measures are left out.
        shared: What the contacts share; see `shared_arrays`.
        near: Indices of the solids and of the obstacle points to be tested, ascending.
        out: Limits and causes, which are written, shape (stop - start,) or more each.
        gaps: Memory for a number of each point.
    """
    (solids, points, clearance, standoff, hand), (limits, causes) = shared, out
    x, y, z, size = q[0, start:stop], q[1, start:stop], q[2, start:stop], stop - start
    nx, ny, nz = nhat[0, start:stop], nhat[1, start:stop], nhat[2, start:stop]
    limits[:size], causes[:size] = _NONE, NO_CAUSE
    radius = contact[RADIUS]
    if any_positive(contact[_CLOSED:]):
        for k in range(size):
            ax, ay, az = abs(nx[k]), abs(ny[k]), abs(nz[k])
            face, along = 4, nz[k]
            if ax >= ay and ax >= az:
                face, along = 0, nx[k]
            elif ay >= az:
                face, along = 2, ny[k]
            if along != 0.0 and contact[_CLOSED + face + (along > 0.0)] > 0.0:
                limits[k] = _FORBIDDEN
    if not no_limits(contact):
        solid, sector, far = contact[_SOLID:], contact[_SECTOR:], radius + standoff
        for k in range(size):
            gaps[k] = distance_to(solid, x[k], y[k], z[k])
        for k in range(size):
            tx, ty, tz = x[k] + far * nx[k], y[k] + far * ny[k], z[k] + far * nz[k]
            sideways, facing, level = sector_gaps(sector, tx, ty, tz, nx[k], ny[k], nz[k])
            is_reached = (gaps[k] <= 0.0) & (sideways >= 0.0) & (facing >= 0.0) & (level >= 0.0)
            limits[k] = _REACH if (limits[k] == _NONE) & (not is_reached) else limits[k]
    if any_positive(hand[4]):
        least = hand[4]
        for k in range(size):
            if limits[k] == _NONE and owners[k] == i:  # The only test that takes long.
                tip = x[k] + radius * nx[k], y[k] + radius * ny[k], z[k] + radius * nz[k]
                measures = finger_measures_of(i, hand, tip, (nx[k], ny[k], nz[k]))
                for m in range(len(least)):
                    if least[m] > 0.0 and not measures[m] >= least[m]:
                        limits[k] = _REACH
    needed, shares = radius + clearance, _SHARES if standoff > 0.0 else 1
    for kind in range(2):
        for j in near[kind]:
            cause = int(points[j, 4] if kind else solids[j, 19])
            for share in range(shares):
                height = radius + share * standoff / (_SHARES - 1)
                if kind:
                    px, py, pz, width = points[j, 0], points[j, 1], points[j, 2], points[j, 3]
                    for k in range(size):
                        dx, dy = x[k] + height * nx[k] - px, y[k] + height * ny[k] - py
                        dz = z[k] + height * nz[k] - pz
                        gaps[k] = math.sqrt(dx * dx + dy * dy + dz * dz) - width
                else:
                    for k in range(size):
                        tx, ty = x[k] + height * nx[k], y[k] + height * ny[k]
                        gaps[k] = distance_to(solids[j], tx, ty, z[k] + height * nz[k])
                for k in range(size):
                    is_touched = (limits[k] == _NONE) & (not gaps[k] >= needed)
                    limits[k] = _OBSTACLE if is_touched else limits[k]
                    causes[k] = cause if is_touched else causes[k]


@compiled()
def near_obstacles(contact, box, d, shared, lists, gaps):  # type: ignore[no-untyped-def]
    """Returns the indices of solids and obstacle points that tips may touch from a box of points.

    Distances change no faster than points. Tips that touch points of the box are near the tip that
    would touch its middle.

    Args:
        contact: Row of the contact.
        box: Row of the block in `Blocks.boxes`.
        d: Number of coordinates of the points.
        shared: What the contacts share; see `shared_arrays`.
        lists: Memory for the indices of all solids, and for those of all obstacle points.
        gaps: Memory for a number of each point.
    """
    x, y, z, nx, ny, nz = box[0], box[1], box[2], box[2 * d], box[2 * d + 1], box[2 * d + 2]
    size, turn, (solids, points, clearance, standoff, _) = box[-2], box[-1], shared
    radius, (near_solids, near_points) = contact[RADIUS], lists
    room = (radius + clearance + size + (radius + standoff) * turn) * _ABOVE
    shares = _SHARES if standoff > 0.0 else 1
    num_solids, num_points = 0, 0
    for j in range(len(solids)):
        for share in range(shares):
            height = radius + share * standoff / (_SHARES - 1)
            distance = distance_to(solids[j], x + height * nx, y + height * ny, z + height * nz)
            if not distance >= room:
                near_solids[num_solids] = j
                num_solids += 1
                break
    height, room = radius + standoff / 2.0, room + standoff / 2.0
    x, y, z = x + height * nx, y + height * ny, z + height * nz
    for j in range(len(points)):
        dx, dy, dz = x - points[j, 0], y - points[j, 1], z - points[j, 2]
        gaps[j] = dx * dx + dy * dy + dz * dz - (room + points[j, 3]) ** 2 * _ABOVE
    for j in range(len(points)):
        near_points[num_points] = j
        num_points += gaps[j] <= 0.0
    return near_solids[:num_solids], near_points[:num_points]


@compiled()
def no_limits(contact):  # type: ignore[no-untyped-def]
    """Returns whether a contact has neither closed faces nor a limited reach."""
    unlimited = contact[_SOLID + 17] == np.inf
    for k in range(12, 15):
        unlimited = unlimited and contact[_SECTOR + k] == ANY_ANGLE
    return unlimited and not any_positive(contact[_CLOSED:])


@compiled(f"i8[:,::1](f8[:,::1], {SHARED}, i8[::1], f8[:,::1], f8[:,::1])")
def limits_of_points(contacts, shared, which, q, nhat):  # type: ignore[no-untyped-def]
    """Returns the limit and cause of each point for its contact, as `Predicates.limits_at`."""
    solids, points, _, _, _ = shared
    found = np.empty((2, len(which)), np.int64)
    near, gaps = (np.arange(len(solids)), np.arange(len(points))), np.empty(1)
    for k in range(len(which)):
        i = which[k]
        out = found[0, k:], found[1, k:]
        limits_of_block(i, contacts[i], q, nhat, k, k + 1, which[k:], shared, near, out, gaps)
    return found


@compiled(f"void({_HAND}, i8, f8[::1], i8[::1], i8[::1], i8[::1], f8[:,::1], f8[:,::1], f8[::1])")
def write_finger_measures(hand, measure, radii, contacts, ends, candidates, q, nhat, b):  # type: ignore[no-untyped-def]
    """Writes a measure of the finger in whose region each candidate is, as `finger_measure`.

    Args:
        hand: Attributes of the hand's `FingerMeasures`; see `numbers_of`.
        measure: Index of the measure.
        radii: Radius of each fingertip, in metres.
        contacts: As the next two, part of `Members`.
        ends: Ends of the regions.
        candidates: Indices of the candidates.
        q: All candidates in O, in metres.
        nhat: Their outward unit normals.
        b: Result, shape (M,).
    """
    for region in range(len(contacts)):
        i = contacts[region]
        for k in range(ends[region], ends[region + 1]):
            n = candidates[k]
            x, y, z = nhat[n, 0], nhat[n, 1], nhat[n, 2]
            tip = (q[n, 0] + radii[i] * x, q[n, 1] + radii[i] * y, q[n, 2] + radii[i] * z)
            value = finger_measures_of(i, hand, tip, (x, y, z))[measure]
            b[k] = 0.0 if math.isnan(value) else value


def shared_arrays(predicates: Predicates) -> tuple[Any, ...]:
    """Returns solids, points, clearance and standoff of `Predicates`, and a hand's measures.

    If these are unknown, none of them limits.
    """
    measures = predicates.finger_measures
    numbers = _NO_MEASURES if measures is None else numbers_of(measures)
    around = predicates.solids, predicates.points, predicates.clearance, predicates.standoff
    return *around, numbers


def numbers_of(measures: FingerMeasures) -> tuple[FloatArray, ...]:
    """Returns the attributes of measures in the types of the compiled functions."""
    return tuple(np.require(part, float, ("C", "W")) for part in vars(measures).values())


_NO_MEASURES = numbers_of(
    FingerMeasures(*(np.zeros(shape) for shape in ((0, 3), (0, 3), 5 * (0,), (0, 0))))
)


def compiled_limits_at(
    predicates: Predicates, contacts: IntArray, points: FloatArray, normals: FloatArray
) -> tuple[IntArray, IntArray]:
    """Returns the limit that keeps a contact from its point, and its cause; see `Predicates`."""
    limits, causes = limits_of_points(
        predicates.contacts,
        shared_arrays(predicates),
        np.array(contacts, dtype=np.int64),
        np.array(points.T, dtype=float, order="C"),
        np.array(normals.T, dtype=float, order="C"),
    )
    return limits, causes
