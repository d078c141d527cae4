"""Limits and coupling of contact goals from one tick to the next, and which goals are active."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, norms
from drake_pregrasp.contacts.contact_pairs import Pair, groups_of
from drake_pregrasp.contacts.quality_guard import Measure, keep_quality
from drake_pregrasp.contacts.selection_input import ContactGoals, ContactStatus, SelectionInput
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.surface import CONTACT_TOLERANCE, ObjectSurface
from drake_pregrasp.regions.constraints import NO_CAUSE, Limit, RegionConstraints
from drake_pregrasp.regions.walls import normals_agree

ROUNDING = 1e-9
"""Overlap of fingertips, in metres, and share of a step, that count as rounding."""

_HALVINGS = 12  # Times that a step is halved if it comes out too long; then it is left out.
_ROUNDS = 40  # Largest number of projections that bring a pair to its distance.


@dataclass(frozen=True)
class ContactLimits:
    """Limits on the motion of goals; none by default.

    Attributes:
        max_step: Longest step of a goal over the object in one tick, in metres.
        deadband: Distance below which a goal does not move, in metres.
        pairs: Pairs of contacts that keep a distance, or are opposite each other.
        recover: Whether a contact whose region is empty moves to the nearest permitted candidate.
        guard: Measures of the grasp that no step may make worse.
    """

    max_step: float = np.inf
    deadband: float = 0.0
    pairs: tuple[Pair, ...] = ()
    recover: bool = False
    guard: Measure | None = None

    def __post_init__(self) -> None:
        if not self.max_step > 0:
            raise InvalidArgumentError(f"max_step must be greater than 0 m, not {self.max_step}")
        if not 0 <= self.deadband < np.inf:
            raise InvalidArgumentError(f"deadband must be at least 0 m, not {self.deadband}")
        contacts = [contact for pair in self.pairs for contact in (pair.first, pair.second)]
        if len(set(contacts)) < len(contacts):
            raise InvalidArgumentError(f"a contact is in two pairs: {contacts}")


def steps_toward(
    surface: ObjectSurface, p_OC: FloatArray, goals: FloatArray, max_step: float
) -> FloatArray:
    """Returns points of the allowed surface towards goals, each at most a step away, shape (n, 3).

    A contact that is off the allowed surface returns to it at once. No step leads through a wall.

    Args:
        surface: The object's surface.
        p_OC: Contacts, shape (n, 3), in metres.
        goals: Goals on the surface, shape (n, 3), in metres.
        max_step: Longest step, in metres.
    """
    n, offsets = len(p_OC), goals - p_OC
    nearest, normals = surface.project(np.concatenate([p_OC, goals]))
    starts, lengths = nearest[:n], norms(offsets)
    arrives = (lengths <= max_step) & normals_agree(normals[:n], normals[n:]).diagonal()
    returns = norms(starts - p_OC) > max_step
    after = np.where(arrives[:, None], goals, np.where(returns[:, None], starts, p_OC))
    longest = max_step * (1 + ROUNDING)  # On a flat face the point is exactly a step away.
    moving = np.flatnonzero(~arrives & ~returns)
    for halving in range(_HALVINGS):
        if len(moving) == 0:
            break
        shares = np.minimum(max_step / lengths[moving], 1.0) / 2**halving
        straight = p_OC[moving] + shares[:, None] * offsets[moving]
        points, there = surface.project(straight)
        fits = norms(points - p_OC[moving]) <= longest
        fits &= normals_agree(normals[moving], there).diagonal()
        after[moving[fits]] = points[fits]
        moving = moving[~fits]
    return after


def follow_pairs(
    selection: SelectionInput, goals: FloatArray, pairs: Sequence[Pair], max_step: float
) -> FloatArray:
    """Moves the second contact of each pair, in its own region, to its place beside the first.

    A pair stays if the second contact neither reaches its place nor comes closer to it than before.

    Args:
        selection: Surface, contacts and regions of this tick.
        goals: Goals, shape (n, 3), in metres.
        pairs: The pairs.
        max_step: Longest step, in metres.
    """
    p_OC, p_OC_before, surface = goals.copy(), selection.p_OC, selection.surface
    normals = surface.project(p_OC)[1]
    normals_before = surface.project(p_OC_before)[1]
    for pair in pairs:
        a, b = both = [pair.first, pair.second]
        members = selection.regions.members(b)
        axis = selection.regions.constraints.hand_axis(a)
        for _ in range(_ROUNDS if len(members) else 0):
            if pair.error(p_OC, normals, axis) <= pair.tolerance / 2:
                break
            place = pair.place(p_OC[a], normals[a], p_OC[b], normals[b], axis)
            p_OC[[b]], normals[[b]] = surface.project_into(place[None], [members])
        allowed = max(pair.tolerance, pair.error(p_OC_before, normals_before, axis))
        too_far = np.linalg.norm(p_OC[b] - p_OC_before[b]) > max_step * (1 + ROUNDING)
        if pair.error(p_OC, normals, axis) > allowed or too_far:
            p_OC[both] = p_OC_before[both]
    return p_OC


def tip_gaps(
    p_OC: FloatArray, nhat_OC: FloatArray, tip_radii: FloatArray, gap: float = 0.0
) -> FloatArray:
    """Returns the gaps between fingertips that touch at the contacts, shape (n, n).

    Args:
        p_OC: Contacts, shape (n, 3), in metres.
        nhat_OC: Outward unit normals at the contacts, shape (n, 3).
        tip_radii: Radii of the fingertips, shape (n,), in metres.
        gap: Required gap, which is subtracted, in metres.

    Returns:
        Gaps in metres, below zero where tips are too near; infinite on the diagonal.
    """
    centres = p_OC + tip_radii[:, None] * nhat_OC
    gaps: FloatArray = norms(centres[:, None] - centres) - tip_radii[:, None] - tip_radii - gap
    gaps.flat[:: len(gaps) + 1] = np.inf
    return gaps


def hold_where_tips_meet(
    selection: SelectionInput, goals: FloatArray, pairs: Sequence[Pair]
) -> FloatArray:
    """Undoes steps until no two fingertips are too near, except those that were so before.

    Undoing all of them always helps, so the search ends. Coupled contacts are held together.

    Args:
        selection: Contacts and regions of this tick.
        goals: Goals, shape (n, 3), in metres.
        pairs: Pairs of coupled contacts.
    """
    p_OC, p_OC_before = goals.copy(), selection.p_OC
    both_active = selection.active[:, None] & selection.active
    if not ((_gaps(selection, p_OC) < -ROUNDING) & both_active).any():
        return p_OC
    needed = np.minimum(0.0, _gaps(selection, p_OC_before)) - ROUNDING
    partners = {pair.first: pair.second for pair in pairs}
    partners |= {pair.second: pair.first for pair in pairs}
    for _ in range(len(p_OC)):
        meets = np.any((_gaps(selection, p_OC) < needed) & both_active, axis=1)
        moved = np.any(p_OC != p_OC_before, axis=1)
        if not np.any(meets & moved):
            break
        held = np.flatnonzero(meets & moved)
        held = np.unique([*held, *(partners.get(int(i), i) for i in held)])
        p_OC[held] = p_OC_before[held]
    return p_OC


def _gaps(selection: SelectionInput, p_OC: FloatArray) -> FloatArray:
    """Returns the gaps between fingertips at some contacts, less what is required, shape (n, n)."""
    constraints = selection.regions.constraints
    normals = selection.surface.project(p_OC)[1]
    return tip_gaps(p_OC, normals, constraints.tip_radii, constraints.tip_gap)


def hold_contacts(selection: SelectionInput) -> ContactGoals:
    """Returns goals that stay where they are on the object.

    Contacts that have a safe region and lie on the allowed surface are active.

    Args:
        selection: Surface, contacts and regions of this tick; the estimate is not used.
    """
    unknown = np.zeros(len(selection.p_OC), dtype=bool)
    return judged_goals(selection, selection.p_OC, unknown, ContactLimits())


def limited_goals(
    selection: SelectionInput, goals: FloatArray, limits: ContactLimits
) -> FloatArray:
    """Returns the places that contacts reach towards their goals in one tick, shape (n, 3).

    Args:
        selection: Surface, contacts and regions of this tick.
        goals: Goals that the strategy has chosen, shape (n, 3), in metres. If there are no limits,
            this array itself is returned.
        limits: Limits on the motion of goals.
    """
    surface, regions, p_OC = selection.surface, selection.regions, selection.p_OC
    free = limits.max_step == np.inf and limits.deadband == 0
    free &= not limits.pairs and limits.guard is None
    if free and len(regions.constraints.tip_radii) == 0:
        return goals
    goals = goals.copy()
    # The partner of a lost finger moves alone.
    pairs = [p for p in limits.pairs if not (regions.lost[p.first] or regions.lost[p.second])]
    may_stay = np.zeros(len(goals), dtype=bool)
    if limits.deadband > 0 or limits.guard is not None:
        may_stay = hold_contacts(selection).active
        stays = may_stay & (np.linalg.norm(goals - p_OC, axis=1) < limits.deadband)
        goals[stays] = p_OC[stays]
    if np.isfinite(limits.max_step):
        goals = steps_toward(surface, p_OC, goals, limits.max_step)
    if pairs:
        goals = follow_pairs(selection, goals, pairs, limits.max_step)
    guarded, normals = may_stay.copy(), surface.project(p_OC)[1] if pairs else p_OC
    for pair in pairs:  # If one of them has to move, or the second to its place, both may.
        both = [pair.first, pair.second]
        off = pair.error(p_OC, normals, regions.constraints.hand_axis(pair.first))
        guarded[both] &= np.all(may_stay[both]) and off <= pair.tolerance
    if limits.guard is not None:
        groups = groups_of(pairs, len(goals))
        goals = keep_quality(selection, goals, guarded, limits.guard, groups)
    if len(regions.constraints.tip_radii):
        apart = hold_where_tips_meet(selection, goals, pairs)
        # Undoing some of the steps can leave a worse grasp than undoing all of them.
        if limits.guard is not None and np.any(apart != goals):
            everybody = [range(len(goals))]
            apart = keep_quality(selection, apart, guarded, limits.guard, everybody)
        goals = apart
    return goals


def with_returning_contacts(
    selection: SelectionInput, goals: FloatArray, max_step: float
) -> FloatArray:
    """Moves each contact without a region towards the nearest permitted candidate.

    The candidate is on the contact's own side of a wall if there is one, since no step leads
    through, and has room next to the other fingertips.
    """
    surface, regions = selection.surface, selection.regions
    constraints, goals = regions.constraints, goals.copy()
    without = (regions.counts == 0) & ~regions.lost
    there = ~without & ~regions.lost
    normals = selection.surface.project(goals)[1]
    for contact in np.flatnonzero(without).tolist():
        free = has_room(surface, constraints, contact, goals, normals, there)
        on_its_side = free & normals_agree(normals[contact][None], surface.nhat_OQ)[0]
        choices = np.flatnonzero(on_its_side if np.any(on_its_side) else free)
        if len(choices):
            away = surface.p_OQ[choices] - goals[contact]
            target = surface.p_OQ[choices[np.argmin(np.sum(away**2, axis=1))]]
            goals[[contact]] = steps_toward(surface, goals[[contact]], target[None], max_step)
            normals[contact] = selection.surface.project(goals[[contact]])[1][0]
            there[contact] = True
    return goals


def has_room(
    surface: ObjectSurface,
    constraints: RegionConstraints,
    contact: int,
    p_OC: FloatArray,
    nhat_OC: FloatArray,
    there: BoolArray,
    seen: FloatArray | None = None,
) -> BoolArray:
    """Returns the mask of candidates that a contact may have beside others, shape (N,).

    Args:
        surface: The object's surface.
        constraints: Constraints of the contacts.
        contact: Index of the contact.
        p_OC: All contacts, shape (n, 3), in metres.
        nhat_OC: Outward unit normals at the contacts, shape (n, 3).
        there: Mask of the other contacts, shape (n,).
        seen: Projection along which fingertips keep apart, shape (3, 3); None for their distance.
    """
    limits, _ = constraints.limits_at(contact, surface.p_OQ, surface.nhat_OQ)
    free: BoolArray = (limits == Limit.NONE) & surface.is_clear_of_forbidden_points
    radius = constraints.tip_radius(contact)
    centres = surface.p_OQ + radius * surface.nhat_OQ
    for other in np.flatnonzero(there).tolist():
        other_radius = constraints.tip_radius(other)
        away = centres - (p_OC[other] + other_radius * nhat_OC[other])
        room = radius + other_radius + constraints.tip_gap
        free &= np.linalg.norm(away if seen is None else away @ seen, axis=1) > room
    return free


# Status by whether a contact is active (row), and by its limit (column).
_STATUS = np.array([1.0 + np.array(Limit)] * 2)
_STATUS[0] *= -1
_STATUS[0, Limit.NONE] = ContactStatus.INACTIVE
_LOST = float(ContactStatus.LOST)


def judged_goals(
    selection: SelectionInput,
    goals: FloatArray,
    on_surface: BoolArray,
    contact_limits: ContactLimits,
) -> ContactGoals:
    """Returns goals with their status; a permitted goal with a region and with room is active.

    Args:
        selection: Surface and regions of this tick.
        goals: Goals, shape (n, 3), in metres.
        on_surface: Mask of the goals that are known to be on the allowed surface, shape (n,).
        contact_limits: Limits on the goals, for the pairs.
    """
    regions = selection.regions
    constraints, limits, causes = regions.constraints, regions.limits.copy(), regions.causes.copy()
    active = selection.active.copy()
    if not on_surface.all():
        unknown = np.flatnonzero(~on_surface)
        nearest, _ = selection.surface.project(goals[unknown])
        off = unknown[np.linalg.norm(nearest - goals[unknown], axis=1) > CONTACT_TOLERANCE]
        limits[off], causes[off], active[off] = Limit.FORBIDDEN, NO_CAUSE, False
    if not constraints.predicates.permits_all and active.any():
        there = np.flatnonzero(active)
        limit, cause = selection.limits_of(there, goals[there])
        barred = limit != Limit.NONE
        off = there[barred]
        active[off], limits[off], causes[off] = False, limit[barred], cause[barred]
    if len(constraints.tip_radii):
        overlap = _gaps(selection, goals) < -ROUNDING
        for contact in np.flatnonzero(active & overlap.any(axis=1)).tolist():
            meets = np.flatnonzero(overlap[contact, :contact] & active[:contact])
            if len(meets):
                active[contact], limits[contact], causes[contact] = False, Limit.CROWDED, meets[0]
    normals = selection.surface.project(goals)[1] if contact_limits.pairs else goals
    for pair in contact_limits.pairs:
        axis = constraints.hand_axis(pair.first)
        is_off = pair.error(goals, normals, axis) > pair.tolerance
        if active[pair.first] and active[pair.second] and is_off:
            for contact, partner in ((pair.first, pair.second), (pair.second, pair.first)):
                limits[contact], causes[contact] = Limit.PARTNER, partner
    status: FloatArray = _STATUS[active.astype(np.int64), limits]
    status[regions.lost] = _LOST
    return ContactGoals(goals, status, causes.astype(float))
