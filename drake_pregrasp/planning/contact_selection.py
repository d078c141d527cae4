"""Eq. 3-4: the next contact point of each safe region."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.planning.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.planning.contact_limits import (
    ROUNDING,
    ContactLimits,
    follow_pairs,
    groups_of,
    hold_where_tips_meet,
    step_toward,
    tip_gaps,
)
from drake_pregrasp.planning.contact_status import contact_status, is_active
from drake_pregrasp.planning.kernels import Weighting
from drake_pregrasp.planning.quality_guard import keep_quality
from drake_pregrasp.planning.region_constraints import NO_CAUSE, Limit
from drake_pregrasp.planning.safe_regions import SafeRegions
from drake_pregrasp.planning.surface import CONTACT_TOLERANCE, ObjectSurface
from drake_pregrasp.planning.wall_test import normals_agree


@dataclass(frozen=True, eq=False)
class SelectionInput:
    """What a strategy may look at when it weighs candidate points.

    Attributes:
        surface: The object's surface, in the frame of its estimated pose. Its centre of mass is
            there by definition the mean mu of Eq. 3.
        p_OC: Contact points as they are, shape (n, 3), in metres.
        regions: Their safe regions.
        covariance_O: Sigma of Eq. 3, expressed in O, shape (3, 3), in m².
    """

    surface: ObjectSurface
    p_OC: FloatArray
    regions: SafeRegions
    covariance_O: FloatArray


WeightFunction = Callable[[SelectionInput], FloatArray]
"""Maps a selection's input to log(b_n) for each candidate, shape (N,), up to a constant."""


@dataclass(frozen=True)
class KernelStrategy:
    """A weight function that kernels know as well.

    Attributes:
        log_weights: The weight function.
        kind: What kernels call it, one of their `KINDS`.
        stretch: Whether it stretches its weights over each region.
    """

    log_weights: WeightFunction
    kind: str
    stretch: bool

    def __call__(self, selection: SelectionInput) -> FloatArray:
        """Returns log(b_n) for each candidate, shape (N,), up to a constant."""
        return self.log_weights(selection)


def gaussian_log_weights(
    points: FloatArray, mean: FloatArray, covariance: FloatArray
) -> FloatArray:
    """Returns log(b_n) of the Gaussian of Eq. 3, without its constant factor, shape (N,).

    The logarithm keeps apart what the density itself rounds to zero: with a covariance of
    millimetres, exp(-(0.05/0.001)²/2) underflows on the whole surface and Eq. 4 would be 0/0. A
    tiny covariance thus selects the candidate nearest to the mean, a huge one the plain centroid.

    Args:
        points: q_n, shape (N, 3), in metres.
        mean: mu, shape (3,), in metres.
        covariance: Sigma, symmetric and positive definite, shape (3, 3), in m².
    """
    whitened = (points - mean) @ np.linalg.inv(np.linalg.cholesky(covariance)).T
    log_weights: FloatArray = -0.5 * np.einsum("ij,ij->i", whitened, whitened)
    return log_weights


def weighted_centroid(points: FloatArray, log_weights: FloatArray, areas: FloatArray) -> FloatArray:
    """Returns the centroid of Eq. 4, shape (3,), of points weighted by b_n and their areas.

    The areas make the sum an integral over the surface, so that uneven sampling has no pull.

    Args:
        points: Shape (k, 3) with k >= 1, in metres.
        log_weights: log(b_n) up to a constant, shape (k,); -inf for a weight of zero.
        areas: Surface area each point stands for, shape (k,).
    """
    highest = float(np.max(log_weights))
    if highest == -np.inf:  # All weights are zero: none stands out.
        log_weights, highest = np.zeros(len(points)), 0.0
    weights = np.exp(log_weights - highest) * areas
    centroid: FloatArray = weights @ points / np.sum(weights)
    return centroid


@dataclass(frozen=True, eq=False)
class ContactGoals:
    """Contact goals of one tick, in the object frame.

    Attributes:
        p_OC: Contact points, shape (n, 3), in metres.
        status: A `ContactStatus` for each, shape (n,).
        causes: Index of the contact or obstacle behind it, or `NO_CAUSE`, shape (n,).
    """

    p_OC: FloatArray
    status: FloatArray
    causes: FloatArray

    @property
    def active(self) -> BoolArray:
        """Mask of the active contacts, shape (n,)."""
        return is_active(self.status)


def select_contacts(
    selection: SelectionInput,
    strategy: WeightFunction,
    *,
    best_point: bool = False,
    in_turns: bool = False,
    limits: ContactLimits | None = None,
) -> ContactGoals:
    """Moves each contact to the centroid of its safe region (Eq. 4), projected onto the surface.

    The centroid of a region that bends round an edge is a point of a chord, inside the object:
    what becomes the goal is its projection onto the region's ground. A contact whose region is
    empty stays where it is on the object, unless it is to recover.

    Args:
        selection: Surface, contacts, regions and estimate of this tick.
        strategy: From `make_strategy`, or a weight function of your own.
        best_point: Whether to move to the candidate of the largest weight instead of the centroid.
        in_turns: Whether the contacts move one after another, each seeing where those before it
            have gone, instead of all as if the others stayed. The regions are those of the tick.
        limits: What holds goals back.
    """
    limits = limits or ContactLimits()
    regions, p_OC = selection.regions, selection.p_OC
    active = np.flatnonzero((regions.sizes() > 0) & ~regions.lost)
    goals = p_OC.copy()
    for movers in active[:, None] if in_turns else active[None]:
        if len(movers):
            goals[movers] = _chosen(replace(selection, p_OC=goals), movers, strategy, best_point)
    on_ground = np.zeros(len(goals), dtype=bool)
    on_ground[active] = True
    limited = _limited(selection, goals.copy(), limits)
    if limits.recover:
        limited = _with_returning_contacts(selection, limited, limits.max_step)
    on_ground &= np.all(limited == goals, axis=1)
    return _judged(selection, limited, on_ground, limits)


def hold_contacts(selection: SelectionInput) -> ContactGoals:
    """Returns goals that stay where they are on the object.

    Active are those that have a safe region and lie on the allowed surface.

    Args:
        selection: Surface, contacts and regions; the estimate is not used.
    """
    unknown = np.zeros(len(selection.p_OC), dtype=bool)
    return _judged(selection, selection.p_OC, unknown, ContactLimits())


def _chosen(
    selection: SelectionInput, movers: IntArray, strategy: WeightFunction, best_point: bool
) -> FloatArray:
    """Returns what the strategy chooses for some contacts, on their regions' ground, (k, 3)."""
    surface, partition = selection.surface, selection.regions.partition
    if partition is not None and isinstance(strategy, KernelStrategy) and not best_point:
        weighting = Weighting(strategy.kind, strategy.stretch, selection.covariance_O)
        centroids = surface.kernel.centroids(partition, selection.p_OC, movers, weighting)
        goals, _ = surface.project_onto_regions(centroids, selection.regions.labels, movers)
        return goals
    log_weights = strategy(selection)
    members = [selection.regions.members(int(contact)) for contact in movers]
    points = []
    for q in members:
        if best_point:
            points.append(surface.p_OQ[q[np.argmax(log_weights[q])]])
        else:
            points.append(weighted_centroid(surface.p_OQ[q], log_weights[q], surface.areas[q]))
    goals, _ = surface.project_into(np.array(points), members)
    for k, (contact, q) in enumerate(zip(movers.tolist(), members, strict=True)):
        goals[k] = _permitted(selection, contact, goals[k], q)
    return goals


def _permitted(
    selection: SelectionInput, contact: int, goal: FloatArray, members: IntArray
) -> FloatArray:
    """Returns a goal, or the member nearest to it if the constraints forbid what lies between."""
    if _limit_at(selection, contact, goal)[0] == Limit.NONE:
        return goal
    points = selection.surface.p_OQ[members]
    nearest: FloatArray = points[np.argmin(np.linalg.norm(points - goal, axis=1))]
    return nearest


def _limit_at(selection: SelectionInput, contact: int, p_OCi: FloatArray) -> tuple[int, int]:
    """Returns what keeps a contact from a point on the surface, shape (3,), and its cause."""
    constraints = selection.regions.constraints
    if constraints.leaves_every_point:
        return Limit.NONE, NO_CAUSE
    _, normals = selection.surface.project(p_OCi[None])
    limits, causes = constraints.limits_at(contact, p_OCi[None], normals)
    return int(limits[0]), int(causes[0])


def _with_returning_contacts(
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
    normals = surface.project(goals)[1]
    for contact in np.flatnonzero(without).tolist():
        limits, _ = constraints.limits_at(contact, surface.p_OQ, surface.nhat_OQ)
        free = (limits == Limit.NONE) & surface.is_clear_of_forbidden_points
        radius = constraints.tip_radius(contact)
        centres = surface.p_OQ + radius * surface.nhat_OQ
        for other in np.flatnonzero(there).tolist():
            other_radius = constraints.tip_radius(other)
            away = centres - (goals[other] + other_radius * normals[other])
            free &= np.linalg.norm(away, axis=1) > radius + other_radius
        on_its_side = free & normals_agree(normals[contact][None], surface.nhat_OQ)[0]
        choices = np.flatnonzero(on_its_side if np.any(on_its_side) else free)
        if len(choices):
            away = surface.p_OQ[choices] - goals[contact]
            target = surface.p_OQ[choices[np.argmin(np.sum(away**2, axis=1))]]
            goals[contact] = step_toward(surface, goals[contact], target, max_step)
            normals[contact] = surface.project(goals[contact][None])[1][0]
            there[contact] = True
    return goals


def _limited(selection: SelectionInput, goals: FloatArray, limits: ContactLimits) -> FloatArray:
    surface, regions, p_OC = selection.surface, selection.regions, selection.p_OC
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
        apart = hold_where_tips_meet(surface, goals, p_OC, taking_part, tip_radii, pairs)
        # Steps that are taken back one by one can leave the rest worse than all of them held.
        if limits.guard is not None and np.any(apart != goals):
            everybody = [range(len(goals))]
            apart = keep_quality(surface, apart, p_OC, guarded, limits.guard, everybody)
        goals = apart
    return goals


def _judged(
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
    surface, regions = selection.surface, selection.regions
    constraints, limits, causes = regions.constraints, regions.limits.copy(), regions.causes.copy()
    if not np.all(on_ground):
        unknown = np.flatnonzero(~on_ground)
        nearest, _ = surface.project(goals[unknown])
        off = unknown[np.linalg.norm(nearest - goals[unknown], axis=1) > CONTACT_TOLERANCE]
        limits[off], causes[off] = Limit.FORBIDDEN, NO_CAUSE
    else:
        off = np.empty(0, dtype=np.int64)
    active = (regions.sizes() > 0) & ~regions.lost
    active[off] = False
    for contact in np.flatnonzero(active).tolist():
        limit, cause = _limit_at(selection, contact, goals[contact])
        if limit != Limit.NONE:
            active[contact], limits[contact], causes[contact] = False, limit, cause
    if len(constraints.tip_radii):
        gaps = tip_gaps(goals, surface.project(goals)[1], constraints.tip_radii)
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
