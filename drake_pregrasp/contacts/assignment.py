"""Assignment of fingers to contacts, and initial contacts."""

import math

import numpy as np
from scipy.optimize import linear_sum_assignment

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.surface import ObjectSurface

FREE_TURN = (-np.inf, np.inf)
"""Range of a palm that turns as far as it likes."""


def assign_fingers(fingertips: FloatArray, contacts: FloatArray) -> IntArray:
    """Returns for each finger the contact that it goes to, so that all together travel least.

    Straight ways of least total length never cross in a plane: uncrossing two would shorten them.

    Args:
        fingertips: Where the fingertips are, shape (n, 3), in metres.
        contacts: Where they are to go, in the same frame, shape (n, 3).

    Raises:
        InvalidArgumentError: If there is not one contact for each fingertip.
    """
    if fingertips.shape != contacts.shape:
        raise InvalidArgumentError(
            f"{len(fingertips)} fingertips can't be assigned to {len(contacts)} contacts"
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
    """Returns for each finger of a radial hand its contact, and how far the palm has to turn.

    Fingers keep their order round the palm, so that none crosses another. Of the n ways to do so,
    each with the palm turned by the mean offset, as far as it can, the one is taken that leaves
    most to spare: whose largest excess over what a finger may be aside is least.

    Args:
        finger_azimuths: Where the fingers are about the palm's axis, shape (n,), in radians.
        contact_azimuths: Where they are to go, about the same axis, shape (n,).
        largest_offset: Up to where a finger reaches aside from its own azimuth, in radians; or that
            of each, shape (n,).
        yaw_range: Least and largest angle of the palm, in radians.

    Returns:
        The index of each finger's contact, shape (n,), and the palm's angle.

    Raises:
        InvalidArgumentError: If there is not one contact for each finger, or one is out of reach.
    """
    n = len(finger_azimuths)
    if finger_azimuths.shape != contact_azimuths.shape:
        raise InvalidArgumentError(
            f"{n} fingers can't be assigned to {len(contact_azimuths)} contacts"
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
            f"no finger reaches contact {shifted[worst]}: it is {offsets[worst]:.2f} rad aside"
            f" from the nearest in turn, at most {allowed[worst]:g}"
        )
    order = np.empty(n, dtype=np.int64)
    order[fingers] = shifted
    return order, yaw


def mean_angle(angles: FloatArray) -> float:
    """Returns the direction of the sum of unit vectors at some angles, in radians."""
    return float(np.arctan2(np.mean(np.sin(angles)), np.mean(np.cos(angles))))


def palm_turn(
    p_GT: FloatArray,
    finger_azimuths: FloatArray,
    before: float,
    yaw_range: tuple[float, float] = FREE_TURN,
) -> float:
    """Returns how far a palm turns so that its fingers are least aside from their own azimuths.

    Args:
        p_GT: Where the fingertips are to be about the palm's axis, z, shape (n, 3), in metres.
        finger_azimuths: Where the fingers are about it at yaw 0, shape (n,), in radians.
        before: The last yaw: there is no jump at half a turn.
        yaw_range: Least and largest angle of the palm, in radians.
    """
    yaw = mean_angle(np.arctan2(p_GT[:, 1], p_GT[:, 0]) - finger_azimuths)
    return float(np.clip(before + math.remainder(yaw - before, 2 * math.pi), *yaw_range))


def turned_within(yaw: float, yaw_range: tuple[float, float]) -> float:
    """Returns an angle, or one that is whole turns away, as near to it as a range has it.

    Args:
        yaw: In radians.
        yaw_range: Least and largest angle, in radians; of an endless range, all are inside.
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


_FACING = 0.5
"""Cosine of the largest angle between a normal and the outward direction of a finger."""


def ring_contacts(surface: ObjectSurface, count: int) -> FloatArray:
    """Returns contacts on a ring round the centre of mass, as of a hand that closes on it.

    For each, a ray goes out level from the centre of mass, at equal angles about z of O from x on.
    The contact is the candidate that is nearest to the ray, among those that face its way if there
    are any.

    Args:
        surface: The object's surface.
        count: n, at least 1.

    Returns:
        Shape (n, 3), in O, in metres.

    Raises:
        InvalidArgumentError: If the surface has fewer candidates than that.
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
