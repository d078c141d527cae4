"""What has become of contacts at a tick, and why."""

from collections.abc import Mapping
from enum import IntEnum

import numpy as np

from drake_pregrasp.planning.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.planning.region_constraints import Limit


class ContactStatus(IntEnum):
    """What has become of a contact at a tick.

    Above zero it is active: the goal lies on the allowed surface, has a safe region and counts in
    G. From two on in size, the name says what leaves it a tiny region, or none.
    """

    LOST = -1
    """The finger is gone (its weight h_i is -inf); its goal is void."""
    INACTIVE = 0
    """Nothing has been planned yet."""
    ACTIVE = 1
    """The goal has a region of its own."""
    NO_ALLOWED_GROUND = -2
    LITTLE_ALLOWED_GROUND = 2
    CROWDED_OUT = -3
    CROWDED = 3
    OUT_OF_REACH = -4
    HARDLY_IN_REACH = 4
    OBSTRUCTED = -5
    NEARLY_OBSTRUCTED = 5
    BEHIND_WALL = -6
    NEARLY_BEHIND_WALL = 6
    APART_FROM_PARTNER = 7


# By whether a contact is active, and what limits it.
_STATUS = np.array([1.0 + np.array(Limit)] * 2)
_STATUS[0] *= -1
_STATUS[0, Limit.NONE] = ContactStatus.INACTIVE


def is_active(status: FloatArray) -> BoolArray:
    """Returns which contacts take part, of their `ContactStatus`, shape (n,)."""
    mask: BoolArray = status > 0
    return mask


def contact_status(active: BoolArray, lost: BoolArray, limits: IntArray) -> FloatArray:
    """Returns the `ContactStatus` of contacts, shape (n,).

    Args:
        active: Mask of those that are active, shape (n,).
        lost: Mask of those whose finger is gone, shape (n,).
        limits: The `Limit` of each, shape (n,).
    """
    status: FloatArray = _STATUS[active.astype(np.int64), limits]
    status[lost] = ContactStatus.LOST
    return status


def describe_status(
    status: float, cause: float, obstacle_names: Mapping[int, str] | None = None
) -> str:
    """Returns a contact's status in words.

    Args:
        status: A `ContactStatus`.
        cause: Index of the contact or obstacle behind it, or `NO_CAUSE`.
        obstacle_names: What obstacles are called, by their index, that have a name.
    """
    index = int(cause)
    obstacle = (obstacle_names or {}).get(index, f"obstacle {index}")
    return _DESCRIPTIONS[ContactStatus(int(status))].format(index, obstacle=obstacle)


_DESCRIPTIONS = {
    ContactStatus.LOST: "lost",
    ContactStatus.INACTIVE: "not planned yet",
    ContactStatus.ACTIVE: "active",
    ContactStatus.NO_ALLOWED_GROUND: "no allowed ground",
    ContactStatus.LITTLE_ALLOWED_GROUND: "little allowed ground",
    ContactStatus.CROWDED_OUT: "crowded out by contact {}",
    ContactStatus.CROWDED: "crowded by contact {}",
    ContactStatus.OUT_OF_REACH: "out of reach",
    ContactStatus.HARDLY_IN_REACH: "hardly in reach",
    ContactStatus.OBSTRUCTED: "obstructed by {obstacle}",
    ContactStatus.NEARLY_OBSTRUCTED: "nearly obstructed by {obstacle}",
    ContactStatus.BEHIND_WALL: "behind a wall",
    ContactStatus.NEARLY_BEHIND_WALL: "nearly behind a wall",
    ContactStatus.APART_FROM_PARTNER: "not at its distance from contact {}",
}
