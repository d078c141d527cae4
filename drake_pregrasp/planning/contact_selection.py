"""Eq. 3-4: the next contact point of each safe region."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from drake_pregrasp.planning.arrays import BoolArray, FloatArray
from drake_pregrasp.planning.safe_regions import SafeRegions
from drake_pregrasp.planning.surface import CONTACT_TOLERANCE, ObjectSurface


class ContactStatus(IntEnum):
    """What has become of a contact at a tick."""

    LOST = -1
    """The finger is gone (its weight h_i is -inf); its goal is void."""
    INACTIVE = 0
    """The safe region is empty, or the goal is held on forbidden ground: it doesn't count in G."""
    ACTIVE = 1
    """The goal lies on the allowed surface and has a safe region."""


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
    """

    p_OC: FloatArray
    status: FloatArray

    @property
    def active(self) -> BoolArray:
        """Mask of the active contacts, shape (n,)."""
        mask: BoolArray = self.status == ContactStatus.ACTIVE
        return mask


def select_contacts(
    selection: SelectionInput,
    strategy: WeightFunction,
    *,
    best_point: bool = False,
    in_turns: bool = False,
) -> ContactGoals:
    """Moves each contact to the centroid of its safe region (Eq. 4), projected onto the surface.

    The centroid of a region that bends round an edge is a point of a chord, inside the object:
    what becomes the goal is its projection onto the allowed surface. A contact whose region is
    empty stays where it is on the object.

    Args:
        selection: Surface, contacts, regions and estimate of this tick.
        strategy: From `make_strategy`, or a weight function of your own.
        best_point: Whether to move to the candidate of the largest weight instead of the centroid.
        in_turns: Whether the contacts move one after another, each seeing where those before it
            have gone, instead of all as if the others stayed. The regions are those of the tick.
    """
    surface, regions = selection.surface, selection.regions
    status = _status(regions.sizes() > 0, regions.lost)
    active = np.flatnonzero(status == ContactStatus.ACTIVE)
    if len(active) == 0:
        return ContactGoals(p_OC=selection.p_OC, status=status)
    p_OC = selection.p_OC
    for movers in active[:, None] if in_turns else active[None]:
        log_weights = strategy(replace(selection, p_OC=p_OC))
        points = []
        for contact in movers:
            q = regions.members(int(contact))
            if best_point:
                points.append(surface.p_OQ[q[np.argmax(log_weights[q])]])
            else:
                points.append(weighted_centroid(surface.p_OQ[q], log_weights[q], surface.areas[q]))
        p_OC = p_OC.copy()
        p_OC[movers], _ = surface.project(np.array(points))
    return ContactGoals(p_OC=p_OC, status=status)


def hold_contacts(selection: SelectionInput) -> ContactGoals:
    """Returns goals that stay where they are on the object.

    Active are those that have a safe region and lie on the allowed surface.

    Args:
        selection: Surface, contacts and regions; the estimate is not used.
    """
    p_OC, regions = selection.p_OC, selection.regions
    nearest, _ = selection.surface.project(p_OC)
    allowed = np.linalg.norm(nearest - p_OC, axis=1) <= CONTACT_TOLERANCE
    status = _status(allowed & (regions.sizes() > 0), regions.lost)
    return ContactGoals(p_OC=p_OC, status=status)


def _status(active: BoolArray, lost: BoolArray) -> FloatArray:
    status = np.where(active, ContactStatus.ACTIVE, ContactStatus.INACTIVE)
    return np.where(lost, ContactStatus.LOST, status).astype(float)
