"""Constraints of safe regions: fingertips, obstacles, reach, and thin walls."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.mesh_surface import AxisArea
from drake_pregrasp.geometry.solids import Solid
from drake_pregrasp.geometry.surface import ForbiddenPoints


def _z() -> FloatArray:
    return np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class FingerReach:
    """Reach of a finger, expressed in a frame F: the contacts that pass every given test.

    Attributes:
        solid: Solid that has to contain the contact, or None.
        direction: Direction in which the finger points away from the hand's axis, shape (3,), not
            zero; None if neither angle below is limited.
        half_angle: Largest angle between `direction` and the vector from the axis to the fingertip
            at its standoff, both projected across the axis, in radians.
        incidence: Largest angle between `direction` and the outward normal at the contact, in
            radians. Beyond it, a finger reaches around an edge and touches with a link.
        origin: Point of the hand's axis, shape (3,), in metres.
        axis: Axis of the hand, a unit vector, shape (3,).
    """

    solid: Solid | None = None
    direction: FloatArray | None = None
    half_angle: float = np.pi
    incidence: float = np.pi
    origin: FloatArray = field(default_factory=lambda: np.zeros(3))
    axis: FloatArray = field(default_factory=_z)

    def __post_init__(self) -> None:
        if self.direction is None:
            if min(self.half_angle, self.incidence) < np.pi:
                raise InvalidArgumentError("a reach with an angle needs a direction")
            return
        length = float(np.linalg.norm(self.direction))
        if not length > 0:
            raise InvalidArgumentError("a reach's direction must not be zero")
        object.__setattr__(self, "direction", self.direction / length)
        if self.half_angle < np.pi and not np.linalg.norm(self._level(self.direction)) > 0:
            raise InvalidArgumentError("a sector's direction must not be along the hand's axis")

    def permits(self, contacts: FloatArray, normals: FloatArray, tips: FloatArray) -> BoolArray:
        """Returns the mask of the contacts that the finger reaches, shape (k,).

        Args:
            contacts: Contacts in F, shape (k, 3), in metres.
            normals: Outward unit normals at the contacts, shape (k, 3).
            tips: Centres of the fingertip at its standoff from each contact, in F, shape (k, 3), in
                metres.
        """
        permitted = np.ones(len(contacts), dtype=bool)
        if self.solid is not None:
            permitted &= self.solid.distance(contacts) <= 0
        if self.direction is None:
            return permitted
        if self.half_angle < np.pi:
            outward, middle = self._level(tips - self.origin), self._level(self.direction)
            lengths = np.linalg.norm(outward, axis=1) * np.linalg.norm(middle)
            permitted &= outward @ middle >= np.cos(self.half_angle) * lengths
        if self.incidence < np.pi:
            permitted &= normals @ self.direction >= np.cos(self.incidence)
        return permitted

    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "FingerReach":
        """Returns the reach expressed in a frame G in which F has the given pose."""
        return replace(
            self,
            solid=None if self.solid is None else self.solid.moved(R_GF, p_GF),
            direction=None if self.direction is None else R_GF @ self.direction,
            origin=R_GF @ self.origin + p_GF,
            axis=R_GF @ self.axis,
        )

    def _level(self, vectors: FloatArray) -> FloatArray:
        """Returns the parts of vectors across the axis, shape (..., 3)."""
        level: FloatArray = vectors - (vectors @ self.axis)[..., None] * self.axis
        return level


NO_CAUSE = -1
"""Cause of a limit that no contact and no obstacle causes."""

OPPOSITE = -0.5
"""Cosine between outward normals below which they count as opposite: 120 degrees."""

_ALONG = (0.0, 0.5, 1.0)  # Shares of the standoff at which fingertips stay clear of obstacles.


class Limit(IntEnum):
    """Limit that leaves a contact an empty or a tiny region."""

    NONE = 0
    """No limit: the region is neither empty nor tiny."""
    FORBIDDEN = 1
    """Forbidden points, or a part of the surface that is forbidden to the contact."""
    CROWDED = 2
    """Another contact, whose index is the cause."""
    REACH = 3
    """The finger's reach."""
    OBSTACLE = 4
    """An obstacle, whose index is the cause."""
    WALL = 5
    """The candidates near the contact are on the other side of a wall."""
    PARTNER = 6
    """The distance to the coupled contact, which is the cause, is not met. It limits the goal and
    not the region."""


@dataclass(frozen=True, eq=False)
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
        if self.velocities.shape not in ((0, 3), (len(self.solids), 3)):
            raise InvalidArgumentError(
                f"velocities must be none or have shape ({len(self.solids)}, 3), one a solid, not"
                f" {self.velocities.shape}"
            )
        for name, numbers in (
            ("points", self.points.points),
            ("radii", self.points.radii),
            ("velocities", self.velocities),
        ):
            if not np.all(np.isfinite(numbers)):
                raise InvalidArgumentError(
                    f"{name} of obstacles must be finite, not {numbers.tolist()}"
                )

    def after(self, seconds: float) -> "Obstacles":
        """Returns the obstacles at their places some seconds later."""
        if not np.any(self.velocities):
            return self
        shifts = seconds * self.velocities
        moved = zip(self.solids, shifts, strict=True)
        return replace(self, solids=tuple(solid.moved(np.eye(3), shift) for solid, shift in moved))

    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "Obstacles":
        """Returns the obstacles expressed in a frame G in which F has the given pose."""
        return Obstacles(
            tuple(solid.moved(R_GF, p_GF) for solid in self.solids),
            ForbiddenPoints(
                self.points.points @ R_GF.T + p_GF,
                self.points.radii,
                self.points.normals @ R_GF.T,
            ),
            self.velocities @ R_GF.T,
        )


@dataclass(frozen=True, eq=False)
class RegionConstraints:
    """Constraints of the regions of n contacts, expressed in O; none by default.

    Attributes:
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
        closed: For each contact the areas, in O, that are forbidden to it but not to others; empty
            for none.
        same_side: Candidates that no wall hides from each contact, shape (n, N). Those behind a
            wall belong to the nearest contact on their own side.
        fencing: Mask of the object's forbidden points that apply to each contact, shape (n, m).
    """

    obstacles: Obstacles = field(default_factory=Obstacles)
    later: Sequence[Obstacles] = ()
    clearance: float = 0.0
    tip_radii: FloatArray = field(default_factory=lambda: np.empty(0))
    tip_gap: float = 0.0
    standoff: float = 0.0
    nhat_OQ: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    nhat_OC: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    reach: Sequence[FingerReach | None] = ()
    closed: Sequence[Sequence[AxisArea]] = ()
    same_side: BoolArray | None = None
    fencing: BoolArray | None = None

    @cached_property
    def leaves_every_point(self) -> bool:
        """Whether `limits_at` permits every point to every contact."""
        blocked = self.obstacles.solids or len(self.obstacles.points) or any(self.closed)
        return not blocked and all(reach is None for reach in self.reach)

    @cached_property
    def add_half_spaces(self) -> bool:
        """Whether the half-spaces of the regions differ from those of all forbidden points."""
        obstacles = self.obstacles.solids or len(self.obstacles.points)
        tips = np.any(self.tip_radii) or self.tip_gap > 0
        return bool(obstacles or tips or self.fencing is not None)

    def normals_of(self, candidates: IntArray) -> FloatArray:
        """Returns outward normals of candidates, shape (k, 3); zeros if there are no normals.

        Args:
            candidates: Indices of the candidates, shape (k,).
        """
        return self.nhat_OQ[candidates] if len(self.nhat_OQ) else np.zeros((len(candidates), 3))

    def tip_radius(self, contact: int) -> float:
        """Returns the radius of the fingertip of the contact with that index, in metres."""
        return float(self.tip_radii[contact]) if len(self.tip_radii) else 0.0

    def limits_at(
        self, contact: int, points: FloatArray, normals: FloatArray
    ) -> tuple[IntArray, IntArray]:
        """Returns the `Limit` that keeps a contact from each point, and its cause, shape (k,) each.

        These limits hold for a point by itself: first forbidden areas, then reach, then obstacles
        in their order.

        Args:
            contact: Index of the contact.
            points: Points in O, shape (k, 3), in metres.
            normals: Outward unit normals at the points, shape (k, 3).
        """
        limits = np.full(len(points), int(Limit.NONE))
        causes = np.full(len(points), NO_CAUSE)
        radius = self.tip_radius(contact)
        if len(self.closed):
            for area in self.closed[contact]:
                limits[area.holds(normals)] = Limit.FORBIDDEN
        if len(self.reach) and (reach := self.reach[contact]) is not None:
            tips = points + (radius + self.standoff) * normals
            unreached = ~reach.permits(points, normals, tips)
            limits[unreached & (limits == Limit.NONE)] = Limit.REACH
        for index, gap in self._obstacle_gaps(points + radius * normals, normals):
            # A distance that is not a number counts as too near.
            touched = ~(gap >= radius + self.clearance) & (limits == Limit.NONE)
            limits[touched], causes[touched] = Limit.OBSTACLE, index
        return limits, causes

    def _obstacle_gaps(
        self, centres: FloatArray, normals: FloatArray
    ) -> Iterator[tuple[int, FloatArray]]:
        """Yields each obstacle's index, and its smallest distances from fingertips, shape (k,).

        The distances are from the tips' centres, between surface and standoff, now or later.
        """
        shares = _ALONG if self.standoff > 0 else _ALONG[:1]
        k = len(centres)
        along = np.concatenate([centres + share * self.standoff * normals for share in shares])
        for obstacles in (self.obstacles, *self.later):
            for index, solid in enumerate(obstacles.solids):
                yield index, np.min(solid.distance(along).reshape(len(shares), k), axis=0)
            spheres = zip(obstacles.points.points, obstacles.points.radii, strict=True)
            for index, (point, radius) in enumerate(spheres, start=len(obstacles.solids)):
                distances = np.linalg.norm(along - point, axis=1).reshape(len(shares), k)
                yield index, np.min(distances, axis=0) - radius


UNCONSTRAINED = RegionConstraints()
"""Constraints that limit nothing: the forbidden points alone bound the regions."""
