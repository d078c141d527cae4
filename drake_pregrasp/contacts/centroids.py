"""The check that contact goals lie on the object, against the mesh itself."""

from dataclasses import replace

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.contacts.goal_limits import (
    ContactLimits,
    judged_goals,
    limit_at,
    limited_goals,
    with_returning_contacts,
)
from drake_pregrasp.contacts.selection_input import (
    ContactGoals,
    KernelStrategy,
    SelectionInput,
    WeightFunction,
)
from drake_pregrasp.errors import ContactError
from drake_pregrasp.geometry.surface import CONTACT_TOLERANCE, ObjectSurface
from drake_pregrasp.kernels import Weighting
from drake_pregrasp.regions.constraints import Limit


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
            seen = replace(selection, p_OC=goals.copy()) if in_turns else selection
            goals[movers] = _chosen(seen, movers, strategy, best_point)
    on_ground = np.zeros(len(goals), dtype=bool)
    on_ground[active] = True
    limited = limited_goals(selection, goals.copy(), limits)
    if limits.recover:
        limited = with_returning_contacts(selection, limited, limits.max_step)
    on_ground &= (limited == goals).all(axis=1)
    return judged_goals(selection, limited, on_ground, limits)


def _chosen(
    selection: SelectionInput, movers: IntArray, strategy: WeightFunction, best_point: bool
) -> FloatArray:
    """Returns what the strategy chooses for some contacts, on their regions' ground, (k, 3)."""
    surface, partition = selection.surface, selection.regions.partition
    if partition is not None and isinstance(strategy, KernelStrategy) and not best_point:
        weighting = Weighting(strategy.kind, strategy.stretch, selection.covariance_O)
        centroids = surface.kernel.centroids(partition, selection.p_OC, movers, weighting)
        goals, _ = surface.project_onto_regions(centroids, partition, movers)
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
    if not selection.regions.constraints.leaves_every_point:
        selection.project(goals)  # All at once.
    for k, (contact, q) in enumerate(zip(movers.tolist(), members, strict=True)):
        goals[k] = _permitted(selection, contact, goals[k], q)
    return goals


def _permitted(
    selection: SelectionInput, contact: int, goal: FloatArray, members: IntArray
) -> FloatArray:
    """Returns a goal, or the member nearest to it if the constraints forbid what lies between."""
    if limit_at(selection, contact, goal)[0] == Limit.NONE:
        return goal
    points = selection.surface.p_OQ[members]
    nearest: FloatArray = points[np.argmin(np.linalg.norm(points - goal, axis=1))]
    return nearest


def verify_contacts(surface: ObjectSurface, goals: ContactGoals) -> None:
    """Checks active goals against the whole mesh and against the allowed surface.

    Args:
        surface: The object's surface.
        goals: Contact goals in O.

    Raises:
        ContactError: If one is farther off than `CONTACT_TOLERANCE`; the message says how far.
    """
    contacts = np.flatnonzero(goals.active)
    if len(contacts) == 0:
        return
    p_OC = goals.p_OC[contacts]
    nearest, _ = surface.project(p_OC)
    off_ground = np.linalg.norm(nearest - p_OC, axis=1)
    for contact, height, way in zip(contacts, surface.distance(p_OC), off_ground, strict=True):
        if not abs(height) <= CONTACT_TOLERANCE:
            side = "inside" if height < 0 else "off"
            raise ContactError(f"contact {contact} is {1e3 * abs(height):.3g} mm {side} the object")
        if not way <= CONTACT_TOLERANCE:
            raise ContactError(f"contact {contact} is {1e3 * way:.3g} mm off the allowed surface")
