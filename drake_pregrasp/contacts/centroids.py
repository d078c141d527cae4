"""Contact goals: weighted centroids of safe regions (Eq. 3-4), projected onto the surface."""

from collections.abc import Iterable
from dataclasses import replace
from functools import partial

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts import goal_limits
from drake_pregrasp.contacts.selection_input import (
    ContactGoals,
    GoalFunction,
    SelectionInput,
    WeightFunction,
)
from drake_pregrasp.errors import ContactError
from drake_pregrasp.geometry.surface import CONTACT_TOLERANCE, ObjectSurface
from drake_pregrasp.regions.constraints import Limit

TIE = 1e-9
"""Largest relative difference of weights that counts as rounding."""


def gaussian_log_weights(q: FloatArray, mu: FloatArray, Sigma: FloatArray) -> FloatArray:
    """Returns log(b_n) of Eq. 3 without its constant factor, shape (N,).

    b_n = P(q_n, mu, Sigma) = exp(-(q_n - mu)ᵀ Sigma⁻¹ (q_n - mu) / 2) / sqrt(det(Sigma) (2 pi)^d)

    The logarithm avoids underflow: with a standard deviation of a millimetre, exp(-(0.05/0.001)²/2)
    is zero on the whole surface, and the centroid would be 0/0. A tiny covariance selects the
    candidate nearest to the mean, a huge one the plain centroid.

    Args:
        q: Points q_n, shape (N, 3), in metres.
        mu: Mean, shape (3,), in metres.
        Sigma: Covariance, symmetric and positive definite, shape (3, 3), in m².
    """
    d = q - mu
    log_b: FloatArray = -0.5 * np.einsum("ni,ni->n", d @ np.linalg.inv(Sigma), d)
    return log_b


def position_tracking(selection: SelectionInput, i: int) -> FloatArray:
    """Returns log(b_n) of the Gaussian about the centre of mass over region i, shape (k,)."""
    surface = selection.surface
    q = surface.p_OQ[selection.regions.members(i)]
    return gaussian_log_weights(q, surface.p_OCoM, selection.covariance_O)


def weighted_centroid(q: FloatArray, log_b: FloatArray, areas: FloatArray) -> FloatArray:
    """Returns the centroid c_i of points weighted by b_n and their areas, shape (3,) (Eq. 4).

    c_i = sum b_n A_n q_n / sum b_n A_n

    The areas A_n make the sum an integral over the surface, so uneven sampling has no influence.

    Args:
        q: Points q_n, shape (k, 3) with k >= 1, in metres.
        log_b: log(b_n) up to a constant, shape (k,); -inf for a weight of zero.
        areas: Surface area that each point represents, shape (k,), in m².
    """
    highest = log_b.max()
    # If all weights are zero, all points count equally.
    b = np.exp(log_b - highest) * areas if highest > -np.inf else areas
    c_i: FloatArray = b @ q / b.sum()
    return c_i


def region_goals(
    selection: SelectionInput, contacts: Iterable[int], strategy: WeightFunction
) -> FloatArray:
    """Returns the weighted centroids of the contacts' regions, projected onto them, shape (k, 3).

    The centroid of a region that bends around an edge lies inside the object. The goal is its
    projection onto the region's patches.

    Args:
        selection: Surface, contacts, regions and estimate of this tick.
        contacts: Indices of k contacts whose regions are not empty.
        strategy: Weights of the candidates.
    """
    surface, members, centroids = selection.surface, [], []
    for i in contacts:
        n = selection.regions.members(i)
        log_b = strategy(selection, i)
        members.append(n)
        centroids.append(weighted_centroid(surface.p_OQ[n], log_b, surface.areas[n]))
    return surface.project_into(np.array(centroids), members)[0]


def best_points(
    selection: SelectionInput, contacts: Iterable[int], strategy: WeightFunction
) -> FloatArray:
    """Returns the candidate with the largest weight in each contact's region, shape (k, 3).

    Of weights that differ by rounding only, the first one counts.

    Args:
        selection: Surface, contacts, regions and estimate of this tick.
        contacts: Indices of k contacts whose regions are not empty.
        strategy: Weights of the candidates.
    """
    best = []
    for i in contacts:
        log_b = strategy(selection, i)
        best.append(selection.regions.members(i)[np.argmax(log_b >= log_b.max() - TIE)])
    return selection.surface.p_OQ[best]


def select_contacts(
    selection: SelectionInput,
    strategy: WeightFunction,
    *,
    best_point: bool = False,
    in_turns: bool = False,
    limits: goal_limits.ContactLimits | None = None,
    choose: GoalFunction | None = None,
) -> ContactGoals:
    """Moves each contact to the weighted centroid of its safe region, projected onto the surface.

    A contact whose region is empty stays where it is on the object, unless it is to recover.

    Args:
        selection: Surface, contacts, regions and estimate of this tick.
        strategy: Weights of the candidates, from `make_strategy` or a function of your own.
        best_point: Whether to move to the candidate with the largest weight, not to the centroid.
        in_turns: Whether the contacts move one after another, each with the new goals of those
            before it, and not all at once. The regions are those of the tick in both cases.
        limits: Limits on the goals.
        choose: A faster implementation of `region_goals`, or of `best_points`, with that strategy.
    """
    limits = limits or goal_limits.ContactLimits()
    regions = selection.regions
    if choose is None:
        choose = partial(best_points if best_point else region_goals, strategy=strategy)
    active = selection.active.nonzero()[0]
    goals = selection.p_OC.copy()
    for movers in active[:, None] if in_turns else active[None]:
        if len(movers) == 0:
            continue
        seen = replace(selection, p_OC=goals.copy()) if in_turns else selection
        goals[movers] = choose(seen, movers)
        if regions.constraints.predicates.permits_all:
            continue
        barred = selection.limits_of(movers, goals[movers])[0] != Limit.NONE
        for i in movers[barred].tolist():  # The nearest candidate replaces a forbidden goal.
            points = selection.surface.p_OQ[regions.members(i)]
            goals[i] = points[np.argmin(np.linalg.norm(points - goals[i], axis=1))]
    limited = goal_limits.limited_goals(selection, goals, limits)
    if limits.recover:
        limited = goal_limits.with_returning_contacts(selection, limited, limits.max_step)
    on_patches = selection.active
    if limited is not goals:
        on_patches = on_patches & (limited == goals).all(axis=1)
    return goal_limits.judged_goals(selection, limited, on_patches, limits)


def verify_contacts(surface: ObjectSurface, goals: ContactGoals) -> None:
    """Checks active goals against the whole mesh and against the allowed surface.

    Args:
        surface: The object's surface.
        goals: Contact goals in O.

    Raises:
        ContactError: If a goal is off by more than `CONTACT_TOLERANCE`; the message has the error.
    """
    contacts = np.flatnonzero(goals.active)
    if len(contacts) == 0:
        return
    p_OC = goals.p_OC[contacts]
    nearest, _ = surface.project(p_OC)
    off_surface = np.linalg.norm(nearest - p_OC, axis=1)
    for contact, height, off in zip(contacts, surface.distance(p_OC), off_surface, strict=True):
        if not abs(height) <= CONTACT_TOLERANCE:
            side = "inside" if height < 0 else "off"
            raise ContactError(f"contact {contact} is {1e3 * abs(height):.3g} mm {side} the object")
        if not off <= CONTACT_TOLERANCE:
            raise ContactError(f"contact {contact} is {1e3 * off:.3g} mm off the allowed surface")
