"""Constraints of safe regions: fingertips, obstacles, reach, and thin walls."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.mesh_surface import AxisArea
from drake_pregrasp.geometry.solids import Solid, rounded_box_distances
from drake_pregrasp.geometry.surface import ForbiddenPoints
from drake_pregrasp.regions.finger_measures import FINGER_MEASURES, FingerMeasures
from drake_pregrasp.regions.finger_reach import UNLIMITED, FingerReach, moved_reaches, reached

NO_CAUSE = -1
"""Cause of a limit that no contact and no obstacle causes."""

_ABOVE = 1 + 1e-9  # A search with this share more than a distance misses nothing by rounding.

_I = np.eye(3)

OPPOSITE = -0.5
"""Cosine between outward normals below which they count as opposite: 120 degrees."""

ALONG = (0.0, 0.5, 1.0)
"""Shares of the standoff at which fingertips stay clear of obstacles."""


class Limit(IntEnum):
    """Limit that leaves a contact an empty or a tiny region."""

    NONE = 0
    """No limit: the region is neither empty nor tiny."""
    FORBIDDEN = 1
    """Forbidden points, or a part of the surface that is forbidden to the contact."""
    CROWDED = 2
    """Another contact, whose index is the cause."""
    REACH = 3
    """The finger's reach, or its measures."""
    OBSTACLE = 4
    """An obstacle, whose index is the cause."""
    WALL = 5
    """The candidates near the contact are on the other side of a wall."""
    PARTNER = 6
    """The contact is off its place beside the coupled contact, which is the cause. It limits the
    goal and not the region."""
    LATE = 7
    """The finger cannot be at the contact in time."""


@dataclass(eq=False)
class Obstacles:
    """Obstacles in a frame F, for example the world.

    The index of an obstacle counts the solids first, then the points.

    Attributes:
        solids: Convex solids.
        points: Points z_j with radii R_j.
        velocities: Velocities of the solids, shape (k, 3), in m/s; empty if they do not move.
            Points do not move.

    Raises:
        InvalidArgumentError: If velocities are given, but not one for each solid, or if a number is
            not finite.
    """

    solids: tuple[Solid, ...] = ()
    points: ForbiddenPoints = field(default_factory=ForbiddenPoints.none)
    velocities: FloatArray = field(default_factory=lambda: np.empty((0, 3)))

    def __post_init__(self) -> None:
        self.velocities = velocities = np.asarray(self.velocities, dtype=float)
        points, count = self.points, len(self.solids)
        if (shape := velocities.shape) not in ((0, 3), (count, 3)):
            raise InvalidArgumentError(
                f"velocities must be none or have shape ({count}, 3), one a solid, not {shape}"
            )
        named = {"points": points.points, "radii": points.radii, "velocities": velocities}
        for name, numbers in named.items():
            if numbers.size and not np.isfinite(numbers).all():
                raise InvalidArgumentError(
                    f"{name} of obstacles must be finite, not {numbers.tolist()}"
                )

    @cached_property
    def rows(self) -> FloatArray:
        """Rows of the solids for `rounded_box_distances`, shape (k, 19)."""
        return np.array([solid.rounded_box() for solid in self.solids]).reshape(-1, 19)

    def after(self, seconds: float) -> "Obstacles":
        """Returns the obstacles at their places some seconds later."""
        shifts, solids = seconds * self.velocities, list(self.solids)
        for index in np.flatnonzero(shifts.any(axis=1)):
            solids[index] = solids[index].moved(_I, shifts[index])
        return Obstacles(tuple(solids), self.points, self.velocities)

    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "Obstacles":
        """Returns the obstacles expressed in a frame G in which F has the given pose."""
        return Obstacles(
            tuple(solid.moved(R_GF, p_GF) for solid in self.solids),
            ForbiddenPoints(
                self.points.points @ R_GF.T + p_GF, self.points.radii, self.points.normals @ R_GF.T
            ),
            self.velocities @ R_GF.T,
        )


RADIUS, REACH_SOLID, SECTOR, CLOSED = 0, slice(1, 20), slice(20, 35), slice(35, 41)
"""Parts of a contact's row in `Predicates`: the radius of the fingertip; the solid and the sector
of its reach (see `reached`); and which faces are closed, in the order of `_FACES`."""

_AXIS = slice(SECTOR.start + 3, SECTOR.start + 6)  # The axis of the hand; see `reached`.

_FACES = ("-x", "+x", "-y", "+y", "-z", "+z")


@dataclass(frozen=True, eq=False)
class Predicates:
    """Tests that a point on the surface must pass by itself, for n contacts, as plain arrays in O.

    A contact may have a point unless its normal is on a closed face, its finger does not reach it
    or has too small measures there, or the fingertip there is too near to an obstacle, at the
    contact, half-way to its standoff, or at its standoff. Both the reference and the compiled
    implementation use these arrays.

    Attributes:
        contacts: Row of each contact, shape (n, 41): `RADIUS`, `REACH_SOLID`, `SECTOR`, `CLOSED`.
        solids: Rows of the solids at all times, and the index of each obstacle, shape (k, 20); in
            ascending order of the index.
        points: Points, their radii and the index of each obstacle, shape (p, 5); in ascending order
            of the index.
        clearance: Least distance between fingertips and obstacles, in metres.
        standoff: Distance from the surface at which fingertips wait, in metres.
        finger_measures: Measures of the fingers, or None if they are unknown and not limited.
        permits_all: Whether every contact may have every point.
    """

    contacts: FloatArray
    solids: FloatArray
    points: FloatArray
    clearance: float
    standoff: float
    finger_measures: FingerMeasures | None
    permits_all: bool

    @property
    def known_finger_measures(self) -> FingerMeasures:
        """Measures of the fingers.

        Raises:
            InvalidArgumentError: If they are unknown.
        """
        if self.finger_measures is None:
            raise InvalidArgumentError(f"{', '.join(FINGER_MEASURES)} need the fingers of a hand")
        return self.finger_measures

    def finger_measures_at(
        self, contacts: IntArray, points: FloatArray, normals: FloatArray
    ) -> FloatArray:
        """Returns the `FINGER_MEASURES` at points, shape (k, 5); see `FingerMeasures.at`.

        Args:
            contacts: As for `limits_at`, as the other arguments.
            points: Points in O.
            normals: Outward unit normals.
        """
        p_OT = points + self.contacts[contacts, RADIUS, None] * normals
        return self.known_finger_measures.at(contacts, p_OT, normals)

    def limits_at(
        self, contacts: IntArray, points: FloatArray, normals: FloatArray
    ) -> tuple[IntArray, IntArray]:
        """Returns the `Limit` that keeps a contact from its point, and its cause, shape (k,) each.

        First come closed faces, then reach and measures, then obstacles in their order.

        Args:
            contacts: Index of each point's contact, shape (k,).
            points: Points in O, shape (k, 3), in metres.
            normals: Outward unit normals at the points, shape (k, 3).
        """
        limits = np.full(len(points), int(Limit.NONE))
        causes = np.full(len(points), NO_CAUSE)
        axis = np.argmax(np.abs(normals), axis=1)
        along = normals[np.arange(len(points)), axis]
        face = 2 * axis + (along > 0)
        closed = self.contacts[contacts, CLOSED.start + face] > 0
        limits[closed & (along != 0)] = Limit.FORBIDDEN
        radii = self.contacts[contacts, RADIUS]
        tips = points + (radii + self.standoff)[:, None] * normals
        for i in np.unique(contacts):
            own = np.flatnonzero((contacts == i) & (limits == Limit.NONE))
            row = self.contacts[i, REACH_SOLID.start : SECTOR.stop]
            limits[own[~reached(row, points[own], normals[own], tips[own])]] = Limit.REACH
        free = np.flatnonzero(limits == Limit.NONE)
        if self.finger_measures is not None and self.finger_measures.is_limiting:
            measures = self.finger_measures_at(contacts[free], points[free], normals[free])
            is_able = self.finger_measures.permits(measures)
            limits[free[~is_able]] = Limit.REACH
            free = free[is_able]
        first = self._first_obstacles(points[free], normals[free], radii[free])
        touched = np.isfinite(first)
        limits[free[touched]] = Limit.OBSTACLE
        causes[free[touched]] = first[touched]
        return limits, causes

    def _first_obstacles(
        self, points: FloatArray, normals: FloatArray, radii: FloatArray
    ) -> FloatArray:
        """Returns the lowest index of the obstacles that fingertips touch, or inf, shape (k,)."""
        first = np.full(len(points), np.inf)
        if len(points) == 0 or not (len(self.solids) or len(self.points)):
            return first
        needed = radii + self.clearance
        for share in ALONG if self.standoff > 0 else ALONG[:1]:
            centres = points + (radii + share * self.standoff)[:, None] * normals
            for solid in self.solids[::-1]:
                # A distance that is not a number counts as too near.
                touched = ~(rounded_box_distances(solid, centres) >= needed)
                first[touched] = np.minimum(first[touched], solid[19])
            if len(self.points):
                places, widths, indices = self.points[:, :3], self.points[:, 3], self.points[:, 4]
                near = cKDTree(centres).query_ball_point(places, _ABOVE * (widths + max(needed)))
                point = np.repeat(np.arange(len(near)), list(map(len, near)))
                own = np.fromiter(itertools.chain(*near), np.int64, len(point))
                gaps = np.linalg.norm(centres[own] - places[point], axis=1) - widths[point]
                touched = gaps < needed[own]
                np.minimum.at(first, own[touched], indices[point[touched]])
        return first


LimitFunction = Callable[[Predicates, IntArray, FloatArray, FloatArray], tuple[IntArray, IntArray]]
"""An implementation of `Predicates.limits_at`."""


@dataclass(frozen=True, eq=False)
class RegionConstraints:
    """Constraints of the regions of n contacts, expressed in O; none by default.

    Attributes:
        num_contacts: Number of contacts n.
        obstacles: Obstacles now. A region ends at the plane through an obstacle's point nearest to
            c_i, set back by the fingertip's radius and the clearance. It contains no candidate at
            which the fingertip would be nearer to an obstacle, between surface and standoff.
        later: Obstacles at later times, in O as predicted for these times. No region contains a
            candidate at which the fingertip would be too near to one of them.
        clearance: Least distance between fingertips and obstacles, in metres.
        tip_radii: Radii of the fingertips, balls that touch the surface from outside, shape (n,),
            in metres; empty for points. Regions are set back by them from their common boundary.
        tip_gap: Least gap between fingertips, in metres.
        standoff: Distance from the surface, along the normal, at which fingertips wait, in metres.
        nhat_OQ: Outward unit normals at the candidates, shape (N, 3); needed for fingertips.
        nhat_OC: Outward unit normals at the contacts, shape (n, 3). Contacts with opposite normals,
            as on the two sides of a plate, need no room from each other.
        reach: Reach of each contact's finger, or None; empty for no limit.
        reach_pose: Orientation and position in O of the frame in which `reach` is expressed; None
            for O itself.
        finger_measures: Measures of the fingers in O, and least ones; None if they are unknown.
        closed: For each contact the areas, in O, that are forbidden to it but not to others; empty
            for none.
        same_side: Candidates that no wall hides from each contact, shape (n, N). Those behind a
            wall belong to the nearest contact on their own side.
        active_forbidden_points: Mask of the object's forbidden points that apply to each contact,
            shape (n, m).
    """

    num_contacts: int
    obstacles: Obstacles = field(default_factory=Obstacles)
    later: Sequence[Obstacles] = ()
    clearance: float = 0.0
    tip_radii: FloatArray = field(default_factory=lambda: np.empty(0))
    tip_gap: float = 0.0
    standoff: float = 0.0
    nhat_OQ: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    nhat_OC: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    reach: Sequence[FingerReach | None] = ()
    reach_pose: tuple[FloatArray, FloatArray] | None = None
    finger_measures: FingerMeasures | None = None
    closed: Sequence[Sequence[AxisArea]] = ()
    same_side: BoolArray | None = None
    active_forbidden_points: BoolArray | None = None

    def tip_radius(self, contact: int) -> float:
        """Returns the radius of the fingertip of the contact with that index, in metres."""
        return float(self.tip_radii[contact]) if len(self.tip_radii) else 0.0

    def hand_axis(self, contact: int) -> FloatArray:
        """Returns the hand's axis in O, a unit vector, shape (3,).

        It is 0 for a contact whose finger has a reach without a direction, or none.

        Args:
            contact: Index of the contact.
        """
        return np.asarray(self.predicates.contacts[contact, _AXIS])

    @cached_property
    def predicates(self) -> Predicates:
        """Tests of single points."""
        blocked = self.obstacles.solids or len(self.obstacles.points) or any(self.closed)
        blocked = blocked or (self.finger_measures is not None and self.finger_measures.is_limiting)
        rows = np.zeros((self.num_contacts, CLOSED.stop))
        own = rows[:, REACH_SOLID.start : SECTOR.stop]
        own[:] = UNLIMITED
        if len(self.tip_radii):
            rows[:, RADIUS] = self.tip_radii
        for row, reach in zip(own, self.reach, strict=False):
            if reach is not None:
                row[:] = reach.row
        if self.reach_pose is not None and any(self.reach):
            own[:] = moved_reaches(own, *self.reach_pose)
        for row, areas in zip(rows, self.closed, strict=False):
            for area in areas:
                row[CLOSED.start + _FACES.index(area.face)] = 1.0
        times = (self.obstacles, *self.later)
        solids = np.empty((len(self.obstacles.solids), len(times), 20))
        for k, at_time in enumerate(times):
            solids[:, k, :19] = at_time.rows
        solids[:, :, 19] = np.arange(len(solids))[:, None]
        points = np.empty((0, 5))
        if len(self.obstacles.points):
            at_times, first = [o.points for o in times], len(solids)
            points = np.concatenate(
                [np.c_[p.points, p.radii, first + np.arange(len(p))] for p in at_times]
            )
            points = points[np.argsort(points[:, 4], kind="stable")]
        return Predicates(
            rows,
            solids.reshape(-1, 20),
            points,
            self.clearance,
            self.standoff,
            self.finger_measures,
            permits_all=not blocked and all(reach is None for reach in self.reach),
        )

    def limits_at(
        self, contact: int, points: FloatArray, normals: FloatArray
    ) -> tuple[IntArray, IntArray]:
        """Returns `Predicates.limits_at` of one contact.

        Args:
            contact: Index of the contact.
            points: Points in O, shape (k, 3), in metres.
            normals: Outward unit normals at the points, shape (k, 3).
        """
        return self.predicates.limits_at(np.full(len(points), contact), points, normals)
