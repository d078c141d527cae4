"""Input and result of the selection of contact goals, and the status of contacts."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.regions.constraints import LimitFunction, Predicates
from drake_pregrasp.regions.safe_regions import SafeRegions


class ContactStatus(IntEnum):
    """Status of a contact at a tick.

    Above zero the contact is active: its goal lies on the allowed surface, has a safe region and
    counts in G. The values ±2 to ±6 name the limit that leaves the contact a tiny region (positive)
    or an empty one (negative).

    Attributes:
        LOST: The finger is lost or takes no contact: its weight h_i is -inf, its goal not valid.
        INACTIVE: Nothing has been planned yet.
        ACTIVE: The goal has a region of its own.
        NO_ALLOWED_SURFACE, LITTLE_ALLOWED_SURFACE: Forbidden points and areas.
        CROWDED_OUT, CROWDED: Another contact, which is the cause.
        OUT_OF_REACH, HARDLY_IN_REACH: Reach of the finger.
        OBSTRUCTED, NEARLY_OBSTRUCTED: An obstacle, which is the cause.
        BEHIND_WALL, NEARLY_BEHIND_WALL: The candidates nearby are on the other side of a wall.
        APART_FROM_PARTNER: The goal is off its place beside the coupled contact, the cause.
        TOO_LATE: The finger cannot be at its contact when the hand closes.
    """

    LOST = -1
    INACTIVE = 0
    ACTIVE = 1
    NO_ALLOWED_SURFACE = -2
    LITTLE_ALLOWED_SURFACE = 2
    CROWDED_OUT = -3
    CROWDED = 3
    OUT_OF_REACH = -4
    HARDLY_IN_REACH = 4
    OBSTRUCTED = -5
    NEARLY_OBSTRUCTED = 5
    BEHIND_WALL = -6
    NEARLY_BEHIND_WALL = 6
    APART_FROM_PARTNER = 7
    TOO_LATE = -8


def is_active(status: FloatArray) -> BoolArray:
    """Returns the mask of active contacts, given their `ContactStatus`, shape (n,)."""
    mask: BoolArray = status > 0
    return mask


def describe_status(
    status: float, cause: float, obstacle_names: Mapping[int, str] | None = None
) -> str:
    """Returns a contact's status in words.

    Args:
        status: A `ContactStatus`.
        cause: Index of the contact or obstacle that causes the status, or `NO_CAUSE`.
        obstacle_names: Names of obstacles by their index.
    """
    index = int(cause)
    obstacle = (obstacle_names or {}).get(index, f"obstacle {index}")
    return _DESCRIPTIONS[ContactStatus(int(status))].format(index, obstacle=obstacle)


_DESCRIPTIONS = {
    ContactStatus.LOST: "out of use",
    ContactStatus.INACTIVE: "not planned yet",
    ContactStatus.ACTIVE: "active",
    ContactStatus.NO_ALLOWED_SURFACE: "no allowed surface",
    ContactStatus.LITTLE_ALLOWED_SURFACE: "little allowed surface",
    ContactStatus.CROWDED_OUT: "crowded out by contact {}",
    ContactStatus.CROWDED: "crowded by contact {}",
    ContactStatus.OUT_OF_REACH: "out of reach",
    ContactStatus.HARDLY_IN_REACH: "active, hardly in reach",
    ContactStatus.OBSTRUCTED: "obstructed by {obstacle}",
    ContactStatus.NEARLY_OBSTRUCTED: "nearly obstructed by {obstacle}",
    ContactStatus.BEHIND_WALL: "behind a wall",
    ContactStatus.NEARLY_BEHIND_WALL: "nearly behind a wall",
    ContactStatus.APART_FROM_PARTNER: "off its place beside contact {}",
    ContactStatus.TOO_LATE: "too late for the closing",
}


@dataclass(frozen=True, eq=False)
class SelectionInput:
    """Input of the selection of contact goals at one tick, for the strategies.

    Attributes:
        surface: The object's surface, in O. The mean mu of the Gaussian weights is its centre of
            mass, because O has the estimated pose.
        p_OC: Contact points before this tick, in O, shape (n, 3), in metres.
        regions: The contacts' safe regions.
        covariance_O: Covariance Sigma of the Gaussian weights, expressed in O, shape (3, 3), in m²:
            that of the estimated position, plus the square of `position_spread`.
        limits_at: Implementation of `Predicates.limits_at`.
    """

    surface: ObjectSurface
    p_OC: FloatArray
    regions: SafeRegions
    covariance_O: FloatArray
    limits_at: LimitFunction = Predicates.limits_at

    @cached_property
    def active(self) -> BoolArray:
        """Mask of the contacts that have a region and take part in the grasp, shape (n,)."""
        return self.regions.counts > 0

    def limits_of(self, contacts: IntArray, p_OC: FloatArray) -> tuple[IntArray, IntArray]:
        """Returns the limits that keep contacts from points of the surface, and causes, (k,) each.

        Args:
            contacts: Indices of the contacts, shape (k,).
            p_OC: Point for each contact, shape (k, 3), in metres.
        """
        normals = self.surface.project(p_OC)[1]
        return self.limits_at(self.regions.constraints.predicates, contacts, p_OC, normals)


WeightFunction = Callable[[SelectionInput, int], FloatArray]
"""Maps a selection's input and the index of a contact to log(b_n) of the candidates in its region,
shape (k,), up to a constant."""

GoalFunction = Callable[[SelectionInput, IntArray], FloatArray]
"""Maps a selection's input and the indices of k contacts to goals on the patches of their regions,
shape (k, 3), in metres."""


@dataclass(frozen=True, eq=False)
class ContactGoals:
    """Contact goals of one tick, in the object frame.

    Attributes:
        p_OC: Contact points, shape (n, 3), in metres.
        status: `ContactStatus` of each contact, shape (n,).
        causes: Index of the contact or obstacle that causes each status, or `NO_CAUSE`, shape (n,).
        reassigned: Whether fingers have changed contacts, so that goals jump.
    """

    p_OC: FloatArray
    status: FloatArray
    causes: FloatArray
    reassigned: bool = False

    @property
    def active(self) -> BoolArray:
        """Mask of the active contacts, shape (n,)."""
        return is_active(self.status)
