"""Collision-free positions and paths of fingertips around an object."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, norms
from drake_pregrasp.geometry.mesh_surface import INTRUSION
from drake_pregrasp.geometry.solids import SignedDistance, Solid

_PASSES = 6  # A tip pushed out by one constraint may violate another one.
_DEPTHS = np.arange(0.0, 0.25, 0.004)  # Places on the way out of a hollow, in metres.
_ON_SIDE = 0.7  # Least horizontal part of a unit outward direction on a side.
_SQUEEZED = 2e-3  # Clearance to other solids that a tip may give up to pass, in metres.

PATH_PARTS = 16
"""Number of equal parts of a straight path, whose ends find its distance from the object to 0.2 mm.
"""

ROUNDING = 1e-12
"""Tolerance of clearances, in metres."""

GRAZE = 1e-4
"""Largest violation of the clearance by a free path, in metres."""

_SHARES = np.linspace(0.0, 1.0, PATH_PARTS + 1)[:, None]


@dataclass(frozen=True, eq=False)
class TipRoom:
    """Free space for the centres of n fingertips, in a frame G.

    Attributes:
        object: The object in G.
        object_clearances: Least distance of each tip's centre from the object, shape (n,), in
            metres.
        others: Other solids to avoid in G, such as table and obstacles, each with the least
            distance of the tips' centres from it, shape (n,), in metres.
        spacing: Least distance between tips' centres, shape (n, n), in metres.
        intrusions: How much nearer to the object than `object_clearances` each tip may come where
            its goal is as near, shape (n,), in metres.
    """

    object: SignedDistance
    object_clearances: FloatArray
    others: tuple[tuple[Solid, FloatArray], ...]
    spacing: FloatArray
    intrusions: FloatArray

    def moved(self, R_FG: FloatArray, p_FG: FloatArray) -> "TipRoom":
        """Returns the same room expressed in a frame F.

        Args:
            R_FG: Orientation of G in F, shape (3, 3).
            p_FG: Position of G in F, shape (3,), in metres.
        """
        others = tuple((solid.moved(R_FG, p_FG), least) for solid, least in self.others)
        return replace(self, object=self.object.moved(R_FG, p_FG), others=others)

    def with_room_at(self, goal: FloatArray) -> "TipRoom":
        """Returns the room with tips that may come as near to the object as their goals are.

        Between parts of the object, a tip has no more room than contacts need (`TipSize`), unless
        it holds the object: then it is on its way to touch it.

        Args:
            goal: Goals of the tips' centres in G, shape (n, 3), in metres.
        """
        least = self.object_clearances
        nearest = np.maximum(self.object.distance(goal), least - self.intrusions)
        return replace(self, object_clearances=np.minimum(nearest, least))

    def permitted(self, p_GT: FloatArray) -> FloatArray:
        """Returns approximately the nearest permitted positions in G, shape (n, 3), in metres.

        They are never inside the object. Without free space beside it, they are inside others. If
        all are permitted, the same array is returned.

        Args:
            p_GT: Centres of the tips in G, shape (n, 3), in metres.
        """
        p_GT = _pushed_out(p_GT, self.object, self.object_clearances)
        for _ in range(_PASSES):
            before = p_GT
            for solid, clearance in self.others:
                p_GT = _pushed_out(p_GT, solid, clearance)
            p_GT = _spread(p_GT, self.spacing)
            if p_GT is before:
                break
            p_GT = _pushed_out(p_GT, self.object, self.object_clearances)
        return p_GT


@dataclass(frozen=True)
class Pace:
    """Limits of a motion in ticks.

    Attributes:
        speed: Largest speed, in m/s.
        acceleration: Largest acceleration, in m/s².
        period: Seconds between ticks.
    """

    speed: float
    acceleration: float
    period: float

    def toward(self, v: FloatArray, v_last: FloatArray) -> FloatArray:
        """Returns the next velocities of points on their ways to places at rest, shape (n, 3).

        A point does not overshoot its place: it moves no faster than it can stop there.

        Args:
            v: Velocities that reach the places in one period, shape (n, 3), in m/s.
            v_last: Present velocities, shape (n, 3), in m/s.
        """
        change = self.acceleration * self.period
        fastest = norms(v)[:, None]
        stopping = np.sqrt(change * (change / 4 + 2 * fastest)) - change / 2
        slowed = np.minimum(stopping, self.speed) / np.maximum(fastest, 1e-12)
        return self.limited(v * np.minimum(1.0, slowed), v_last)

    def least_times(self, distances: FloatArray) -> FloatArray:
        """Returns the least times in which moving points come to rest at places, shape (n,).

        Args:
            distances: Distances of the places, shape (n,), in metres.
        """
        braking = self.speed**2 / (2 * self.acceleration)
        slowing = np.sqrt(2 * np.clip(distances, 0.0, braking) / self.acceleration)
        times: FloatArray = slowing + np.maximum(0.0, distances - braking) / self.speed
        return times

    def has_arrived(self, way: FloatArray, v: FloatArray) -> bool:
        """Returns whether points rest at their places, up to rounding.

        Args:
            way: Displacements to the places, shape (n, 3), in metres.
            v: Present velocities, shape (n, 3), in m/s.
        """
        step = self.period * v
        return bool(np.vdot(way, way) + np.vdot(step, step) <= ROUNDING**2)

    def limited(self, v: FloatArray, v_last: FloatArray) -> FloatArray:
        """Returns the next velocities with limited acceleration, shape (n, 3), in m/s.

        Args:
            v: Desired velocities, shape (n, 3), in m/s.
            v_last: Present velocities, shape (n, 3), in m/s.
        """
        jump = v - v_last
        excess = norms(jump)[:, None] / (self.acceleration * self.period)
        return np.asarray(v_last + jump / np.maximum(1.0, excess))


def straight_step(
    p_GT: FloatArray, v_GT: FloatArray, goal: FloatArray, pace: Pace, room: TipRoom
) -> FloatArray | None:
    """Returns the next positions of tips that move straight to their goals, shape (n, 3), or None.

    It is None if a goal or a next position is not permitted, or a path is not free, and `p_GT`
    itself if the tips rest at their goals. Otherwise it is what `shape_goals` returns, in
    `TipRoom.with_room_at` of the goals.

    Args:
        p_GT: Centres of the tips in G, shape (n, 3), in metres.
        v_GT: Velocities of the tips in G, shape (n, 3), in m/s.
        goal: Goals of the centres in G, shape (n, 3), in metres.
        pace: Limits of the motion.
        room: Free space of the tips.
    """
    room = room.with_room_at(goal)
    if room.permitted(goal) is not goal or not _is_free(p_GT, goal, room).all():
        return None
    moved = p_GT + pace.period * pace.toward((goal - p_GT) / pace.period, v_GT)
    if room.permitted(moved) is not moved:
        return None
    return p_GT if pace.has_arrived(goal - p_GT, v_GT) else moved


def shape_goals(
    p_GT: FloatArray, v_GT: FloatArray, goal: FloatArray, pace: Pace, room: TipRoom
) -> FloatArray:
    """Returns the next positions of tips on their paths to goals, in G, shape (n, 3), in metres.

    A tip moves straight if the path is clear of the object, otherwise around its convex hull on the
    shorter side, or over it if other solids block that side. It moves around z of G, which points
    to the palm. It enters and leaves a hollow along the normal of the surface or vertically. It
    keeps its pace unless solids or other tips push it out.

    Args:
        p_GT: Centres of the tips in G, shape (n, 3), in metres.
        v_GT: Velocities of the tips in G, shape (n, 3), in m/s.
        goal: Permitted goals of the centres in G, shape (n, 3), in metres.
        pace: Limits of the motion.
        room: Free space of the tips.
    """
    way = goal - p_GT
    free = _is_free(p_GT, goal, room)
    if not free.all():
        way = np.where(free[:, None], way, _detour(p_GT, goal, room))
    return room.permitted(p_GT + pace.period * pace.toward(way / pace.period, v_GT))


def _detour(p_GT: FloatArray, goal: FloatArray, room: TipRoom) -> FloatArray:
    """Returns displacements around the object's hull, and out of hollows and to their entrances."""
    hull = room.object.hull()
    if hull is room.object:
        return _way_round(p_GT, goal, room)
    leaving, entrance = _way_out(p_GT, room), goal + _way_out(goal, room)
    is_inside, free = np.any(leaving, axis=1), _is_free(p_GT, entrance, room)
    around = _way_round(p_GT, entrance, replace(room, object=hull))
    around = np.where(free[:, None], entrance - p_GT, around)
    return np.asarray(np.where(is_inside[:, None], leaving, around))


def _way_out(p_GT: FloatArray, room: TipRoom) -> FloatArray:
    """Returns straight displacements of tips out of the object's hollows, shape (n, 3), in metres.

    It is the shorter free one of the normal of the surface and the vertical. Tips beside the convex
    hull do not move, nor do those for which neither is free.

    Args:
        p_GT: Centres of the tips in G, shape (n, 3), in metres.
        room: Free space of the tips.
    """
    hull, least, away = room.object.hull(), room.object_clearances - GRAZE, np.zeros(p_GT.shape)
    if np.all(hull.distance(p_GT) >= least):
        return away
    shortest = np.full(len(p_GT), np.inf)
    _, normals = room.object.distance_and_gradient(p_GT)
    for direction in (normals, np.array([[0.0, 0.0, 1.0]])):
        points = (p_GT + _DEPTHS[:, None, None] * direction).reshape(-1, 3)
        is_out = hull.distance(points).reshape(len(_DEPTHS), -1) >= least
        is_free = room.object.distance(points).reshape(len(_DEPTHS), -1) >= least
        is_free[0] = True
        first = np.argmax(is_out, axis=0)
        free_until = np.where(is_free.all(axis=0), len(_DEPTHS), np.argmin(is_free, axis=0))
        length = np.where(is_out.any(axis=0) & (first < free_until), _DEPTHS[first], np.inf)
        shorter = length < shortest
        away[shorter] = (_DEPTHS[first, None] * direction)[shorter]
        shortest = np.minimum(length, shortest)
    return away


def _is_free(p_GT: FloatArray, goal: FloatArray, room: TipRoom) -> BoolArray:
    points = p_GT + _SHARES[:, :, None] * (goal - p_GT)
    distances = room.object.distance(points.reshape(-1, 3)).reshape(points.shape[:2])
    # A tip that is too near, such as one that gives up its strain, leaves on a straight path.
    least = np.minimum(room.object_clearances, distances[0])
    return np.asarray(np.minimum.reduce(distances) >= least - GRAZE)


def _way_round(p_GT: FloatArray, goal: FloatArray, room: TipRoom) -> FloatArray:
    """Returns displacements along the object's side: a horizontal arc and the remaining height.

    A tip whose way is blocked rises. Above and below the object, tips slide along its surface
    towards their goals.
    """
    _, outward = room.object.distance_and_gradient(p_GT)
    straight = goal - p_GT
    sliding = straight - np.sum(straight * outward, axis=1, keepdims=True) * outward
    here, there = p_GT[:, :2], goal[:, :2]
    turn = here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0]
    angle = np.arctan2(turn, np.sum(here * there, axis=1))
    tangent = np.stack([-outward[:, 1], outward[:, 0]], axis=1)
    arc = angle * np.linalg.norm(here, axis=1)
    round_it = np.column_stack([arc[:, None] * tangent, straight[:, 2]])
    blocked = _is_blocked(p_GT, angle, straight[:, 2], room)
    round_it[blocked] = np.abs(arc)[blocked, None] * [0.0, 0.0, 1.0]
    on_side = np.linalg.norm(tangent, axis=1) > _ON_SIDE
    return np.asarray(np.where(on_side[:, None], round_it, sliding))


def _is_blocked(
    p_GT: FloatArray, angle: FloatArray, height: FloatArray, room: TipRoom
) -> BoolArray:
    """Returns whether other solids leave a tip no room on its way along the object's side, (n,).

    Args:
        p_GT: Centres of the tips in G, shape (n, 3), in metres.
        angle: Angles of the ways about z of G, shape (n,), in radians.
        height: Heights that the tips gain on their ways, shape (n,), in metres.
        room: Free space of the tips.
    """
    x, y, z = p_GT.T
    azimuths = np.arctan2(y, x) + _SHARES * angle
    radii = np.hypot(x, y) + room.object_clearances  # Beside the object, not inside.
    round_it = [radii * np.cos(azimuths), radii * np.sin(azimuths), z + _SHARES * height]
    points = np.stack(round_it, axis=2).reshape(-1, 3)
    distances, outward = room.object.distance_and_gradient(points)
    points -= (distances - np.tile(room.object_clearances, len(_SHARES)))[:, None] * outward
    blocked = np.zeros(len(p_GT), dtype=bool)
    for solid, clearance in room.others:
        gaps = solid.distance(points).reshape(len(_SHARES), -1) - clearance
        blocked |= gaps.min(axis=0) < -_SQUEEZED
    return blocked


def _pushed_out(p_GT: FloatArray, solid: SignedDistance, clearance: FloatArray) -> FloatArray:
    """Moves tips out to a solid's clearance; returns the same array if none moves."""
    lacking = clearance - solid.distance(p_GT)
    if np.maximum.reduce(lacking) <= ROUNDING:
        return p_GT
    _, gradient = solid.distance_and_gradient(p_GT)
    return p_GT + np.maximum(lacking, 0)[:, None] * gradient


def _spread(p_GT: FloatArray, spacing: FloatArray) -> FloatArray:
    """Moves both tips of a pair apart equally; returns the same array if none moves."""
    away = p_GT[:, None] - p_GT
    distance = norms(away)
    lacking = spacing - distance
    lacking.flat[:: len(p_GT) + 1] = 0  # A tip and itself.
    if np.maximum.reduce(lacking, axis=None) <= ROUNDING:
        return p_GT
    lacking = np.maximum(lacking, 0)
    unit = np.where(distance[..., None] > 0, away, np.triu(np.ones_like(distance))[..., None] - 0.5)
    unit /= np.linalg.norm(unit, axis=2, keepdims=True)
    return np.asarray(p_GT + np.sum(lacking[..., None] / 2 * unit, axis=1))


MOVING_CLEARANCE = 0.008
"""Least gap between moving fingertips and the object, in metres."""

OTHER_CLEARANCE = 0.004
"""Least gap between fingertips and other solids, and between fingertips, in metres."""

_WITHDRAWN_CLEARANCE = 0.02  # Gap of withdrawn fingertips to the object's top, in metres.


@dataclass(frozen=True, eq=False)
class TipPlaces:
    """Positions of fingertips around an object.

    Attributes:
        tip_radii: Radii of the fingertips, shape (n,), in metres.
        directions: Unit vectors across z to the fingers in the frame U of the palm, shape (n, 3).
        withdrawn_radii: Distance of each finger without a contact from z of the approach A, shape
            (n,), in metres.
    """

    tip_radii: FloatArray
    directions: FloatArray
    withdrawn_radii: FloatArray

    def first_contacts(self, p_GT: FloatArray, standoff: float) -> tuple[FloatArray, FloatArray]:
        """Returns contacts in G for which tips do not move, and their normals, each (n, 3).

        Args:
            p_GT: Centres of the tips in G, shape (n, 3), in metres.
            standoff: Gap between tips and contacts, in metres.
        """
        outward = p_GT * [1.0, 1.0, 0.0]
        length = np.linalg.norm(outward, axis=1, keepdims=True)
        normals = np.where(length > 0, outward / np.where(length > 0, length, 1), self.directions)
        return p_GT - (self.tip_radii + standoff)[:, None] * normals, normals

    def withdrawn(self, yaw: float, top: float) -> FloatArray:
        """Returns positions over the object for fingers without a contact, in A, shape (n, 3).

        Args:
            yaw: Yaw of the palm about z of A, in radians.
            top: Largest coordinate of the object along z of A, in metres.
        """
        x, y = self.withdrawn_radii * self.directions[:, :2].T
        c, s, z = np.cos(yaw), np.sin(yaw), top + self.tip_radii + _WITHDRAWN_CLEARANCE
        return np.stack([c * x - s * y, s * x + c * y, z], axis=1)

    def room(
        self,
        object_solid: SignedDistance,
        gaps: FloatArray,
        *,
        fixed: Sequence[Solid],
        obstacles: Sequence[Solid],
        holding: BoolArray,
    ) -> TipRoom:
        """Returns the free space for the tips' centres.

        Args:
            object_solid: The object in G.
            gaps: Commanded gap of each tip to the object, shape (n,), in metres; negative to press.
            fixed: Solids in G that all tips avoid, such as the table.
            obstacles: Solids in G that tips avoid unless they hold the object.
            holding: Whether each tip holds the object, shape (n,).
        """
        clearances = self.tip_radii + OTHER_CLEARANCE
        # A holding finger that an obstacle pushes along the object would lose the grasp.
        unless_holding = np.where(holding, -np.inf, clearances) if obstacles else clearances
        return TipRoom(
            object=object_solid,
            object_clearances=self.tip_radii + np.minimum(gaps, MOVING_CLEARANCE),
            others=(
                *((solid, clearances) for solid in fixed),
                *((solid, unless_holding) for solid in obstacles),
            ),
            spacing=clearances[:, None] + self.tip_radii,
            intrusions=np.where(holding, np.inf, INTRUSION),
        )
