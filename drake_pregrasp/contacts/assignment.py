"""Assignment of fingers to contacts, and initial contacts."""

import cmath
import math

import numpy as np
from scipy.optimize import linear_sum_assignment

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.contacts.goal_limits import has_room, tip_gaps
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.regions.constraints import RegionConstraints

FREE_TURN = (-np.inf, np.inf)
"""Range of a palm that turns without limits, in radians."""


def assign_fingers(fingertips: FloatArray, contacts: FloatArray) -> IntArray:
    """Returns the index of each finger's contact with the smallest sum of distances, shape (n,).

    In a plane, the straight paths of such an assignment do not cross: uncrossing two paths would
    shorten them.

    Args:
        fingertips: Positions of the fingertips, shape (n, 3), in metres.
        contacts: Positions of the contacts in the same frame, shape (n, 3), in metres.

    Raises:
        InvalidArgumentError: If there is not one contact for each fingertip.
    """
    if fingertips.shape != contacts.shape:
        raise InvalidArgumentError(
            f"{len(fingertips)} fingertips cannot be assigned to {len(contacts)} contacts"
        )
    travel = np.linalg.norm(fingertips[:, None] - contacts, axis=2)
    _, assigned = linear_sum_assignment(travel)
    order: IntArray = np.array(assigned, dtype=np.int64)
    return order


def assign_fingers_round(
    finger_azimuths: FloatArray,
    contact_azimuths: FloatArray,
    *,
    largest_offset: float | FloatArray = np.pi,
    yaw_range: tuple[float, float] = FREE_TURN,
) -> tuple[IntArray, float]:
    """Returns the contact of each finger of a radial hand, and the angle of the palm.

    Fingers keep their order around the palm, so that none crosses another. There are n such
    assignments; for each of them the palm turns by the mean offset within its range. The function
    returns the assignment with the largest margin: the one that minimises the largest excess of an
    offset over its limit.

    Args:
        finger_azimuths: Azimuths of the fingers about the palm's axis, shape (n,), in radians.
        contact_azimuths: Azimuths of the contacts about the same axis, shape (n,), in radians.
        largest_offset: Largest angle between a fingertip and its finger's azimuth, in radians; or
            that of each finger, shape (n,).
        yaw_range: Smallest and largest angle of the palm, in radians.

    Returns:
        The index of each finger's contact, shape (n,), and the palm's angle, in radians.

    Raises:
        InvalidArgumentError: If there is not one contact for each finger, or one is out of reach.
    """
    n = len(finger_azimuths)
    if finger_azimuths.shape != contact_azimuths.shape:
        raise InvalidArgumentError(
            f"{n} fingers cannot be assigned to {len(contact_azimuths)} contacts"
        )
    fingers, contacts = np.argsort(finger_azimuths), np.argsort(contact_azimuths)
    allowed = np.broadcast_to(largest_offset, n)[fingers]
    best = (np.inf, 0.0, contacts, np.empty(n))
    for shift in range(n):
        shifted = np.roll(contacts, shift)
        turns = contact_azimuths[shifted] - finger_azimuths[fingers]
        yaw = turned_within(mean_angle(turns), yaw_range)
        offsets = np.abs(wrapped(turns - yaw))
        excess = float(np.max(offsets - allowed))
        if excess < best[0]:
            best = (excess, yaw, shifted, offsets)
    excess, yaw, shifted, offsets = best
    if excess > 0:
        worst = int(np.argmax(offsets - allowed))
        raise InvalidArgumentError(
            f"no finger reaches contact {shifted[worst]}: it is {offsets[worst]:.2f} rad away from"
            f" the azimuth of its finger, which reaches {allowed[worst]:g} rad to either side"
        )
    order = np.empty(n, dtype=np.int64)
    order[fingers] = shifted
    return order, yaw


def mean_angle(angles: FloatArray) -> float:
    """Returns the direction of the sum of unit vectors at some angles, in radians."""
    return math.atan2(np.sin(angles).sum(), np.cos(angles).sum())


def palm_turn(
    p_GT: FloatArray,
    finger_azimuths: FloatArray,
    before: float,
    yaw_range: tuple[float, float] = FREE_TURN,
    slack: float = 0.0,
) -> float:
    """Returns the palm's yaw that brings its fingers nearest to the goals of their fingertips.

    It minimises the sum of squared distances between goals and fingertips at their own azimuths, at
    any common radius: a goal counts in proportion to its distance from the palm's axis, near which
    its azimuth means nothing. Otherwise a goal near the axis, such as one inside a bowl, would turn
    the palm, the reach with it, and the goals with the reach, without end. A palm with slack turns
    only as far as it must to be within its slack of that yaw.

    Args:
        p_GT: Goals of the fingertips relative to the palm's axis z, shape (n, 3), in metres.
        finger_azimuths: Azimuths of the fingers about that axis at yaw 0, shape (n,), in radians.
        before: Last yaw, in radians; the result is continuous with it.
        yaw_range: Smallest and largest angle of the palm, in radians.
        slack: Angle by which the last yaw may be off before the palm turns, in radians.
    """
    yaw = cmath.phase(np.vdot(np.exp(1j * finger_azimuths), p_GT[:, 0] + 1j * p_GT[:, 1]))
    low, high = yaw_range
    turn = max(low, min(before + math.remainder(yaw - before, 2 * math.pi), high)) - before
    return max(low, min(before + turn - max(-slack, min(turn, slack)), high))


def turned_within(yaw: float, yaw_range: tuple[float, float]) -> float:
    """Returns an angle of a range that equals another one up to whole turns, or the nearest limit.

    Args:
        yaw: Any angle, in radians.
        yaw_range: Smallest and largest angle of the range, in radians.
    """
    low, high = yaw_range
    if not np.isfinite(low + high):
        return float(np.clip(yaw, low, high))
    middle = (low + high) / 2
    return float(np.clip(middle + math.remainder(yaw - middle, 2 * math.pi), low, high))


def wrapped(angles: FloatArray) -> FloatArray:
    """Returns angles in the range from -pi to pi, in radians."""
    within: FloatArray = (angles + np.pi) % (2 * np.pi) - np.pi
    return within


_UP = np.array([0.0, 0.0, 1.0])

_FACING = 0.5
"""Cosine of the largest angle between a normal and the outward direction of a finger."""


def ring_contacts(surface: ObjectSurface, count: int) -> FloatArray:
    """Returns contacts on a ring around the centre of mass, shape (n, 3), in O, in metres.

    The contacts belong to n rays from the centre of mass, parallel to the x-y plane of O and at
    equal angles from x of O on. Each contact is the candidate nearest to its ray, among those that
    face its direction if there are any.

    Args:
        surface: The object's surface.
        count: Number of contacts n, at least 1.

    Raises:
        InvalidArgumentError: If the surface has fewer than n candidates.
    """
    if not 1 <= count <= len(surface.p_OQ):
        raise InvalidArgumentError(
            f"there are candidates for 1 to {len(surface.p_OQ)} contacts, not for {count}"
        )
    angles = 2 * np.pi * np.arange(count) / count
    p_OC = np.empty((count, 3))
    is_free = np.ones(len(surface.p_OQ), dtype=bool)
    for index, angle in enumerate(angles):
        outward = np.array([np.cos(angle), np.sin(angle), 0.0])
        r = surface.p_OQ - surface.p_OCoM
        along = r @ outward
        across = np.linalg.norm(r - along[:, None] * outward, axis=1)
        facing = is_free & (surface.nhat_OQ @ outward >= _FACING) & (along > 0)
        choices = np.flatnonzero(facing if np.any(facing) else is_free)
        # Of candidates equally near to the ray, a finger meets the outermost first.
        best = choices[np.argmin(across[choices] - 1e-3 * along[choices])]
        p_OC[index] = surface.p_OQ[best]
        is_free[best] = False
    return p_OC


def make_room(
    surface: ObjectSurface, p_OC: FloatArray, constraints: RegionConstraints, up: FloatArray = _UP
) -> tuple[FloatArray, BoolArray]:
    """Moves contacts whose fingertips overlap to the nearest permitted candidates with room.

    Fingers come from above, so there is no room for one fingertip under another.
    Contacts that overlap with the fewest others have precedence.

    Args:
        surface: The object's surface.
        p_OC: Contacts, shape (n, 3), in metres.
        constraints: Constraints of the contacts, with fingertips.
        up: Unit vector from which fingers come, in O, shape (3,).

    Returns:
        The contacts, and the mask of those that have room, each on its own allowed surface.
    """
    p_OC, (_, normals), level = p_OC.copy(), surface.project(p_OC), np.eye(3) - np.outer(up, up)

    def gaps() -> FloatArray:
        tips = constraints.tip_radii, constraints.tip_gap
        return tip_gaps(p_OC @ level, normals @ level, *tips)

    there = np.zeros(len(p_OC), dtype=bool)
    for contact in np.argsort(np.sum(gaps() < 0, axis=1), kind="stable").tolist():
        room = has_room(surface, constraints, contact, p_OC, normals, there, level)
        choices = np.flatnonzero(room)
        if len(choices) and np.any(gaps()[contact, there] < 0):
            offsets = surface.p_OQ[choices] - p_OC[contact]
            nearest = choices[np.argmin(np.sum(offsets**2, axis=1))]
            p_OC[contact], normals[contact] = surface.p_OQ[nearest], surface.nhat_OQ[nearest]
        there[contact] = len(choices) > 0
    return p_OC, there
