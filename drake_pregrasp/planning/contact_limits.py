"""Limits and coupling of contact goals from one tick to the next."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import BoolArray, FloatArray
from drake_pregrasp.planning.quality_guard import Measure
from drake_pregrasp.planning.safe_regions import SafeRegions
from drake_pregrasp.planning.surface import ObjectSurface
from drake_pregrasp.planning.wall_test import normals_agree

ROUNDING = 1e-9
"""Overlap of fingertips that is none, in metres."""

Projection = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Maps points, shape (k, 3), to the nearest ones on a surface and the normals there."""

_HALVINGS = 12  # Of a step that comes out too long; then it is left out.
_ROUNDS = 40  # To bring a pair to its distance.


@dataclass(frozen=True)
class CoupledPair:
    """Two contacts of one finger, as its tip and a joint before it, at a fixed distance.

    Attributes:
        first: Index of the contact that moves freely.
        second: Index of the contact that follows it.
        distance: Between the two, in metres.
        tolerance: By which it may be off, in metres.
    """

    first: int
    second: int
    distance: float
    tolerance: float = 5e-4

    def error(self, p_OC: FloatArray) -> float:
        """Returns by how much the distance is off, in metres."""
        return abs(float(np.linalg.norm(p_OC[self.first] - p_OC[self.second])) - self.distance)


@dataclass(frozen=True)
class ContactLimits:
    """What holds goals back; by default nothing does.

    Attributes:
        max_step: Longest way of a goal over the object in one tick, in metres.
        deadband: A goal stays as long as what it should move to is nearer than that, in metres.
        pairs: Contacts that keep a distance.
        recover: Whether a contact whose region is empty moves to the nearest place it may have.
        guard: Measures of the grasp that no step may make worse.
    """

    max_step: float = np.inf
    deadband: float = 0.0
    pairs: tuple[CoupledPair, ...] = ()
    recover: bool = False
    guard: Measure | None = None

    @property
    def hold_nothing(self) -> bool:
        """Whether goals become what strategies choose."""
        free = self.max_step == np.inf and self.deadband == 0
        return free and not self.pairs and self.guard is None

    def __post_init__(self) -> None:
        if not self.max_step > 0:
            raise InvalidArgumentError(f"max_step must be greater than 0 m, not {self.max_step}")
        if not 0 <= self.deadband < np.inf:
            raise InvalidArgumentError(f"deadband must be at least 0 m, not {self.deadband}")
        contacts = [contact for pair in self.pairs for contact in (pair.first, pair.second)]
        if len(set(contacts)) < len(contacts):
            raise InvalidArgumentError(f"a contact is in two pairs: {contacts}")


def groups_of(pairs: Sequence[CoupledPair], num_contacts: int) -> list[list[int]]:
    """Returns the contacts that move together: the pairs, then each other contact alone."""
    together = [[pair.first, pair.second] for pair in pairs]
    paired = {contact for pair in together for contact in pair}
    return together + [[contact] for contact in range(num_contacts) if contact not in paired]


def step_toward(
    surface: ObjectSurface, p_OCi: FloatArray, goal: FloatArray, max_step: float
) -> FloatArray:
    """Returns the point over the allowed ground near the way to a goal, at most a step away.

    A contact that isn't on allowed ground goes there at once. No step leads through a wall.

    Args:
        surface: The object's surface.
        p_OCi: Where the contact is, shape (3,), in metres.
        goal: Where it should be, on the surface, shape (3,).
        max_step: In metres.
    """
    way = goal - p_OCi
    length = float(np.linalg.norm(way))
    starts, normals = surface.project(p_OCi[None])
    if length <= max_step and normals_agree(normals, surface.project(goal[None])[1])[0, 0]:
        return goal
    start: FloatArray = starts[0]
    if np.linalg.norm(start - p_OCi) > max_step:
        return start
    near = surface.candidates_within(p_OCi, max_step)
    near = near[normals_agree(normals, surface.nhat_OQ[near])[0]]
    step = min(max_step, length)
    for _ in range(_HALVINGS if len(near) else 0):
        point: FloatArray = surface.project_into((p_OCi + step / length * way)[None], [near])[0][0]
        if np.linalg.norm(point - p_OCi) <= max_step:
            return point
        step /= 2
    return p_OCi


def follow_pairs(
    surface: ObjectSurface,
    regions: SafeRegions,
    pairs: Sequence[CoupledPair],
    p_OC: FloatArray,
    p_OC_before: FloatArray,
    max_step: float,
) -> FloatArray:
    """Moves the second contact of each pair to where the distance holds, in its own region.

    A pair whose distance can't be met, or is met worse than before, stays where it was.

    Args:
        surface: The object's surface.
        regions: The contacts' regions.
        pairs: The pairs.
        p_OC: Goals, shape (n, 3), in metres.
        p_OC_before: Goals of the tick before, shape (n, 3).
        max_step: In metres.
    """
    p_OC = p_OC.copy()
    for pair in pairs:
        members = regions.members(pair.second)
        first, before = p_OC[pair.first], p_OC_before[pair.second]
        for _ in range(_ROUNDS if len(members) else 0):
            if pair.error(p_OC) <= pair.tolerance / 2:
                break
            away = p_OC[pair.second] - first
            point = first + pair.distance * away / max(float(np.linalg.norm(away)), 1e-12)
            p_OC[pair.second] = surface.project_into(point[None], [members])[0][0]
        allowed = max(pair.tolerance, pair.error(p_OC_before))
        too_far = np.linalg.norm(p_OC[pair.second] - before) > max_step
        if pair.error(p_OC) > allowed or too_far:
            both = [pair.first, pair.second]
            p_OC[both] = p_OC_before[both]
    return p_OC


def tip_gaps(
    p_OC: FloatArray, nhat_OC: FloatArray, tip_radii: FloatArray, gap: float = 0.0
) -> FloatArray:
    """Returns what is to spare between fingertips that touch at the contacts, shape (n, n).

    Args:
        p_OC: Contacts, shape (n, 3), in metres.
        nhat_OC: Outward unit normals there, shape (n, 3).
        tip_radii: Shape (n,), in metres.
        gap: That there has to be between them, in metres.

    Returns:
        In metres, below zero where tips are too near; infinite on the diagonal.
    """
    centres = p_OC + tip_radii[:, None] * nhat_OC
    distances = np.linalg.norm(centres[:, None] - centres, axis=2)
    gaps: FloatArray = distances - tip_radii[:, None] - tip_radii - gap
    np.fill_diagonal(gaps, np.inf)
    return gaps


def hold_where_tips_meet(
    project: Projection,
    p_OC: FloatArray,
    p_OC_before: FloatArray,
    active: BoolArray,
    tip_radii: FloatArray,
    gap: float,
    pairs: Sequence[CoupledPair],
) -> FloatArray:
    """Takes steps back until no two fingertips are too near that weren't so before.

    Holding all is always a way out, so the search ends; coupled contacts are held together.

    Args:
        project: Of the object's surface.
        p_OC: Goals, shape (n, 3), in metres.
        p_OC_before: Goals of the tick before, shape (n, 3).
        active: Contacts that take part, shape (n,).
        tip_radii: Shape (n,), in metres.
        gap: Between tips, in metres.
        pairs: Coupled contacts.
    """
    both_active = active[:, None] & active
    before = tip_gaps(p_OC_before, project(p_OC_before)[1], tip_radii, gap)
    needed = np.minimum(0.0, before) - ROUNDING
    p_OC = p_OC.copy()
    partners = {pair.first: pair.second for pair in pairs}
    partners |= {pair.second: pair.first for pair in pairs}
    for _ in range(len(p_OC)):
        gaps = tip_gaps(p_OC, project(p_OC)[1], tip_radii, gap)
        meets = np.any((gaps < needed) & both_active, axis=1)
        moved = np.any(p_OC != p_OC_before, axis=1)
        if not np.any(meets & moved):
            break
        held = np.flatnonzero(meets & moved)
        held = np.unique([*held, *(partners.get(int(i), i) for i in held)])
        p_OC[held] = p_OC_before[held]
    return p_OC
