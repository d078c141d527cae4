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
    """Returns by how much a tip and a normal are inside a sector's two angles, below 0 outside."""
    x, y, z = tx - row[0], ty - row[1], tz - row[2]
    height = x * row[3] + y * row[4] + z * row[5]
    x, y, z = x - height * row[3], y - height * row[4], z - height * row[5]
    length = math.sqrt(x * x + y * y + z * z)
    sideways = x * row[6] + y * row[7] + z * row[8] - row[12] * length
    return sideways, nx * row[9] + ny * row[10] + nz * row[11] - row[13]


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
def limit_of_point(i, contact, q, nhat, shared, near, check_reach):  # type: ignore[no-untyped-def]
    """Returns the limit and cause of one point for one contact, as `Predicates.limits_at`.

    Args:
        i: Index of the contact.
        contact: Row of the contact.
        q: Point, three numbers in metres.
        nhat: Outward unit normal at the point, three numbers.
        shared: What the contacts share; see `shared_arrays`.
        near: Indices of the solids and of the obstacle points to be tested, ascending.
        check_reach: Whether the reach is tested.
    """
    (x, y, z), (nx, ny, nz), (solids, points, clearance, standoff, hand) = q, nhat, shared
    near_solids, near_points = near
    ax, ay, az = abs(nx), abs(ny), abs(nz)
    if ax >= ay and ax >= az:
        face, along = 0, nx
    elif ay >= az:
        face, along = 2, ny
    else:
        face, along = 4, nz
    if along != 0.0 and contact[_CLOSED + face + (along > 0.0)] > 0.0:
        return _FORBIDDEN, NO_CAUSE
    radius = contact[RADIUS]
    far = radius + standoff
    if check_reach:
        if not distance_to(contact[_SOLID:], x, y, z) <= 0.0:
            return _REACH, NO_CAUSE
        sideways, facing = sector_gaps(
            contact[_SECTOR:], x + far * nx, y + far * ny, z + far * nz, nx, ny, nz
        )
        if not (sideways >= 0.0 and facing >= 0.0):
            return _REACH, NO_CAUSE
    if np.max(hand[4]) > 0.0:
        tip, least = (x + radius * nx, y + radius * ny, z + radius * nz), hand[4]
        measures = finger_measures_of(i, hand, tip, nhat)
        for k in range(len(least)):
            if least[k] > 0.0 and not measures[k] >= least[k]:
                return _REACH, NO_CAUSE
    needed = radius + clearance
    shares = _SHARES if standoff > 0.0 else 1
    for j in near_solids:
        for share in range(shares):
            height = radius + share * standoff / (_SHARES - 1)
            distance = distance_to(solids[j], x + height * nx, y + height * ny, z + height * nz)
            if not distance >= needed:
                return _OBSTACLE, int(solids[j, 19])
    for j in near_points:
        for share in range(shares):
            height = radius + share * standoff / (_SHARES - 1)
            dx = x + height * nx - points[j, 0]
            dy = y + height * ny - points[j, 1]
            dz = z + height * nz - points[j, 2]
            if math.sqrt(dx * dx + dy * dy + dz * dz) - points[j, 3] < needed:
                return _OBSTACLE, int(points[j, 4])
    return _NONE, NO_CAUSE


@compiled()
def near_obstacles(contact, box, shared, lists, gaps):  # type: ignore[no-untyped-def]
    """Returns the indices of solids and obstacle points that tips may touch from a box of points.

    Distances change no faster than points. Tips that touch points of the box are near the tip that
    would touch its middle.

    Args:
        contact: Row of the contact.
        box: Midpoint of the points (3), of their normals (3), and the radii of both.
        shared: What the contacts share; see `shared_arrays`.
        lists: Memory for the indices of all solids, and for those of all obstacle points.
        gaps: Memory for a number of each point.
    """
    (x, y, z, nx, ny, nz, size, turn), (solids, points, clearance, standoff, _) = box, shared
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
def reach_of_box(contact, box, standoff):  # type: ignore[no-untyped-def]
    """Returns 1 if a finger reaches a whole box of points, -1 if no point of it, 0 if unknown."""
    x, y, z, nx, ny, nz, size, turn = box
    size, turn = size * _ABOVE + 1e-12, turn * _ABOVE + 1e-12
    height = contact[RADIUS] + standoff
    sector = contact[_SECTOR:]
    inside = -distance_to(contact[_SOLID:], x, y, z)
    sideways, facing = sector_gaps(
        sector, x + height * nx, y + height * ny, z + height * nz, nx, ny, nz
    )
    away = (size + height * turn) * (1.0 + abs(sector[12]))
    if sector[12] == ANY_ANGLE:
        away = 0.0
    if sector[13] == ANY_ANGLE:
        turn = 0.0
    if inside < -size or sideways < -away or facing < -turn:
        return -1
    return int(inside >= size and sideways >= away and facing >= turn)


@compiled()
def is_closed(contact):  # type: ignore[no-untyped-def]
    """Returns whether any face is closed to a contact."""
    count = 0
    for face in range(6):
        count += contact[_CLOSED + face] > 0.0
    return count > 0


@compiled()
def no_limits(contact):  # type: ignore[no-untyped-def]
    """Returns whether a contact has neither closed faces nor a limited reach."""
    unlimited = contact[_SECTOR + 12] == ANY_ANGLE and contact[_SECTOR + 13] == ANY_ANGLE
    return unlimited and contact[_SOLID + 17] == np.inf and not is_closed(contact)


@compiled(f"Tuple((i8[::1], i8[::1]))(f8[:,::1], {SHARED}, i8[::1], f8[:,::1], f8[:,::1])")
def limits_of_points(contacts, shared, which, q, nhat):  # type: ignore[no-untyped-def]
    """Returns the limit and cause of each point for its contact, as `Predicates.limits_at`."""
    solids, points, _, _, _ = shared
    limits, causes = np.empty(len(q), dtype=np.int64), np.empty(len(q), dtype=np.int64)
    lists = np.empty(len(solids), np.int64), np.empty(len(points), np.int64)
    gaps = np.empty(len(points))
    for k in range(len(q)):
        i, contact = which[k], contacts[which[k]]
        place, normal = (q[k, 0], q[k, 1], q[k, 2]), (nhat[k, 0], nhat[k, 1], nhat[k, 2])
        box = (q[k, 0], q[k, 1], q[k, 2], nhat[k, 0], nhat[k, 1], nhat[k, 2], 0.0, 0.0)
        near = near_obstacles(contact, box, shared, lists, gaps)
        limits[k], causes[k] = limit_of_point(i, contact, place, normal, shared, near, True)
    return limits, causes


@compiled(f"f8[::1]({_HAND}, i8, f8[::1], i8[::1], f8[:,::1], f8[:,::1])")
def weights_by_measure(hand, measure, radii, labels, q, nhat):  # type: ignore[no-untyped-def]
    """Returns a measure of the finger in whose region each candidate is, as `finger_measure`.

    Args:
        hand: Attributes of the hand's `FingerMeasures`; see `numbers_of`.
        measure: Index of the measure.
        radii: Radius of each fingertip, in metres.
        labels: Index of the finger of each candidate; below 0 for none.
        q: Candidates in O, in metres.
        nhat: Their outward unit normals.
    """
    weights = np.zeros(len(q))
    for n in range(len(q)):
        i, normal = labels[n], (nhat[n, 0], nhat[n, 1], nhat[n, 2])
        if i >= 0:
            x, y, z = normal
            tip = (q[n, 0] + radii[i] * x, q[n, 1] + radii[i] * y, q[n, 2] + radii[i] * z)
            value = finger_measures_of(i, hand, tip, normal)[measure]
            weights[n] = 0.0 if math.isnan(value) else value
    return weights


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
    result: tuple[IntArray, IntArray] = limits_of_points(
        predicates.contacts,
        shared_arrays(predicates),
        np.array(contacts, dtype=np.int64),
        np.array(points, dtype=float, order="C"),
        np.array(normals, dtype=float, order="C"),
    )
    return result
