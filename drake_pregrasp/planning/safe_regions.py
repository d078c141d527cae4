"""Eq. 1-2: the safe region of each contact, an obstacle-aware weighted Voronoi cell."""

from dataclasses import dataclass

import numpy as np

from drake_pregrasp.planning.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.planning.surface import ForbiddenPoints

NO_REGION = -1
"""Label of a candidate point that lies in no safe region."""


@dataclass(frozen=True, eq=False)
class SafeRegions:
    """The safe regions S_i of n contacts over the N candidate points of a surface.

    Regions are disjoint by construction: each candidate carries one label.

    Attributes:
        labels: Index i of the region each candidate lies in, or `NO_REGION`, shape (N,).
        lost: Mask of the contacts that are lost and so have no region, shape (n,).
    """

    labels: IntArray
    lost: BoolArray

    def members(self, contact: int) -> IntArray:
        """Returns the indices of the candidates in S_i of the contact with that index."""
        indices: IntArray = np.flatnonzero(self.labels == contact)
        return indices

    def sizes(self) -> IntArray:
        """Returns the number of candidates in each region, shape (n,)."""
        counts: IntArray = np.bincount(self.labels - NO_REGION, minlength=1 + len(self.lost))[1:]
        return counts


def compute_safe_regions(
    p_OQ: FloatArray,
    p_OC: FloatArray,
    contact_weights: FloatArray,
    forbidden: ForbiddenPoints,
) -> SafeRegions:
    """Assigns candidate points to the contacts' safe regions (Eq. 1).

    A candidate q belongs to S_i if it passes two tests:

    - among contacts, |c_i - q|² - h_i is the least; of equals, the lowest index has it;
    - for each forbidden point, |c_i - q|² <= |z_j - q|² - w_ij with
      w_ij = 2 R_j d - d², d = |c_i - z_j| (Eq. 2). Expanding the squares turns this into
      (q - c_i)·(z_j - c_i)/d <= d - R_j: the plane across the way to z_j that touches the ball of
      radius R_j around it. For d = 0 both sides of Eq. 1 are equal, and the test holds.

    A contact of weight -inf is lost: it has no region, and the others share what it had.

    Args:
        p_OQ: Candidate points of Y in O, shape (N, 3), in metres.
        p_OC: Contact points c_i in O, shape (n, 3), in metres.
        contact_weights: h_i, shape (n,), in m².
        forbidden: Points Z and radii R_j, in O.
    """
    # Candidates run along the last axis: the reductions over few contacts or planes vectorise then.
    half_power = (np.sum(p_OC**2, axis=1) - contact_weights)[:, None] / 2 - p_OC @ p_OQ.T
    labels = np.argmin(half_power, axis=0)
    lost = np.isneginf(contact_weights)
    for i, p_OCi in enumerate(p_OC):
        own = np.flatnonzero(labels == i)
        if lost[i]:  # Owns candidates only if every contact is lost.
            labels[own] = NO_REGION
            continue
        from_contact = p_OQ[own] - p_OCi
        to_obstacles = forbidden.points - p_OCi
        d = np.sqrt(np.einsum("ij,ij->i", to_obstacles, to_obstacles))
        limits = d * (d - forbidden.radii)
        beyond = to_obstacles @ from_contact.T > limits[:, None]
        labels[own[np.any(beyond, axis=0)]] = NO_REGION
    return SafeRegions(labels=labels, lost=lost)
