"""How far contacts get towards their goals, and which of the goals are active."""

import numpy as np

from drake_pregrasp.planning.arrays import BoolArray, FloatArray
from drake_pregrasp.planning.contact_limits import (
    ROUNDING,
    ContactLimits,
    follow_pairs,
    groups_of,
    hold_where_tips_meet,
    step_toward,
    tip_gaps,
)
from drake_pregrasp.planning.contact_status import contact_status
from drake_pregrasp.planning.quality_guard import keep_quality
from drake_pregrasp.planning.region_constraints import NO_CAUSE, Limit
from drake_pregrasp.planning.selection_input import ContactGoals, SelectionInput
from drake_pregrasp.planning.surface import CONTACT_TOLERANCE
from drake_pregrasp.planning.wall_test import normals_agree


def hold_contacts(selection: SelectionInput) -> ContactGoals:
    """Returns goals that stay where they are on the object.

    Active are those that have a safe region and lie on the allowed surface.

    Args:
        selection: Surface, contacts and regions; the estimate is not used.
    """
    unknown = np.zeros(len(selection.p_OC), dtype=bool)
    return judged_goals(selection, selection.p_OC, unknown, ContactLimits())


def limited_goals(
    selection: SelectionInput, goals: FloatArray, limits: ContactLimits
) -> FloatArray:
    """Returns how far contacts get towards their goals in one tick, shape (n, 3), in metres.

    Args:
        selection: Surface, contacts and regions.
        goals: What the strategy has chosen, shape (n, 3), in metres; overwritten.
        limits: What holds goals back.
    """
    surface, regions, p_OC = selection.surface, selection.regions, selection.p_OC
    if limits.hold_nothing and len(regions.constraints.tip_radii) == 0:
        return goals
    # A lost finger needs no partner any more.
    pairs = [p for p in limits.pairs if not (regions.lost[p.first] or regions.lost[p.second])]
    may_stay = np.zeros(len(goals), dtype=bool)
    if limits.deadband > 0 or limits.guard is not None:
        may_stay = hold_contacts(selection).active
    stays = may_stay & (np.linalg.norm(goals - p_OC, axis=1) < limits.deadband)
    goals[stays] = p_OC[stays]
    if np.isfinite(limits.max_step):
        for contact in range(len(goals)):
            goals[contact] = step_toward(surface, p_OC[contact], goals[contact], limits.max_step)
    if pairs:
        goals = follow_pairs(surface, regions, pairs, goals, p_OC, limits.max_step)
    guarded = may_stay.copy()
    for pair in pairs:  # If one of them has to go, or both to their distance, both go.
        both = [pair.first, pair.second]
        guarded[both] &= np.all(may_stay[both]) and pair.error(p_OC) <= pair.tolerance
    if limits.guard is not None:
        groups = groups_of(pairs, len(goals))
        goals = keep_quality(surface, goals, p_OC, guarded, limits.guard, groups)
    tip_radii = regions.constraints.tip_radii
    if len(tip_radii):
        taking_part = (regions.sizes() > 0) & ~regions.lost
        apart = hold_where_tips_meet(
            selection.project,
            goals,
            p_OC,
            taking_part,
            tip_radii,
            regions.constraints.tip_gap,
            pairs,
        )
        # Steps that are taken back one by one can leave the rest worse than all of them held.
        if limits.guard is not None and np.any(apart != goals):
            everybody = [range(len(goals))]
            apart = keep_quality(surface, apart, p_OC, guarded, limits.guard, everybody)
        goals = apart
    return goals


def with_returning_contacts(
    selection: SelectionInput, goals: FloatArray, max_step: float
) -> FloatArray:
    """Sends each contact without a region to the nearest candidate that it may have.

    That is on its own side of a wall, if there is one, since no step leads through; and with room
    beside the others, wherever these are held.
    """
    surface, regions = selection.surface, selection.regions
    constraints, goals = regions.constraints, goals.copy()
    without = (regions.sizes() == 0) & ~regions.lost
    there = ~without & ~regions.lost
    normals = selection.project(goals)[1]
    for contact in np.flatnonzero(without).tolist():
        limits, _ = constraints.limits_at(contact, surface.p_OQ, surface.nhat_OQ)
        free = (limits == Limit.NONE) & surface.is_clear_of_forbidden_points
        radius = constraints.tip_radius(contact)
        centres = surface.p_OQ + radius * surface.nhat_OQ
        for other in np.flatnonzero(there).tolist():
            other_radius = constraints.tip_radius(other)
            away = centres - (goals[other] + other_radius * normals[other])
            room = radius + other_radius + constraints.tip_gap
            free &= np.linalg.norm(away, axis=1) > room
        on_its_side = free & normals_agree(normals[contact][None], surface.nhat_OQ)[0]
        choices = np.flatnonzero(on_its_side if np.any(on_its_side) else free)
        if len(choices):
            away = surface.p_OQ[choices] - goals[contact]
            target = surface.p_OQ[choices[np.argmin(np.sum(away**2, axis=1))]]
            goals[contact] = step_toward(surface, goals[contact], target, max_step)
            normals[contact] = selection.project(goals[contact][None])[1][0]
            there[contact] = True
    return goals


def judged_goals(
    selection: SelectionInput,
    goals: FloatArray,
    on_ground: BoolArray,
    contact_limits: ContactLimits,
) -> ContactGoals:
    """Says which goals are active: with a region, on allowed ground, permitted, and with room.

    Args:
        selection: Surface and regions.
        goals: Shape (n, 3), in metres.
        on_ground: Those that are known to be on allowed ground, shape (n,).
        contact_limits: With the pairs.
    """
    regions = selection.regions
    constraints, limits, causes = regions.constraints, regions.limits.copy(), regions.causes.copy()
    active = (regions.sizes() > 0) & ~regions.lost
    unknown = np.flatnonzero(~on_ground)
    if len(unknown):
        nearest, _ = selection.project(goals[unknown])
        off = unknown[np.linalg.norm(nearest - goals[unknown], axis=1) > CONTACT_TOLERANCE]
        limits[off], causes[off], active[off] = Limit.FORBIDDEN, NO_CAUSE, False
    limiting = () if constraints.leaves_every_point else np.flatnonzero(active).tolist()
    for contact in limiting:
        limit, cause = limit_at(selection, contact, goals[contact])
        if limit != Limit.NONE:
            active[contact], limits[contact], causes[contact] = False, limit, cause
    if len(constraints.tip_radii):
        normals = selection.project(goals)[1]
        gaps = tip_gaps(goals, normals, constraints.tip_radii, constraints.tip_gap)
        for contact in np.flatnonzero(active).tolist():
            meets = np.flatnonzero((gaps[contact, :contact] < -ROUNDING) & active[:contact])
            if len(meets):
                active[contact], limits[contact], causes[contact] = False, Limit.CROWDED, meets[0]
    for pair in contact_limits.pairs:
        if active[pair.first] and active[pair.second] and pair.error(goals) > pair.tolerance:
            for contact, partner in ((pair.first, pair.second), (pair.second, pair.first)):
                limits[contact], causes[contact] = Limit.PARTNER, partner
    status = contact_status(active, regions.lost, limits)
    return ContactGoals(goals, status, causes.astype(float))


def limit_at(selection: SelectionInput, contact: int, p_OCi: FloatArray) -> tuple[int, int]:
    """Returns what keeps a contact from a point on the surface, shape (3,), and its cause."""
    constraints = selection.regions.constraints
    if constraints.leaves_every_point:
        return Limit.NONE, NO_CAUSE
    key = contact, p_OCi.tobytes()
    if key not in selection.known_limits:
        _, normals = selection.project(p_OCi[None])
        limits, causes = constraints.limits_at(contact, p_OCi[None], normals)
        selection.known_limits[key] = int(limits[0]), int(causes[0])
    return selection.known_limits[key]
