"""Eq. 1-2: the safe region of each contact, an obstacle-aware weighted Voronoi cell."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.geometry.surface import ForbiddenPoints
from drake_pregrasp.kernels import Partition, TickKernel
from drake_pregrasp.regions.constraints import (
    NO_CAUSE,
    UNCONSTRAINED,
    Limit,
    RegionConstraints,
)
from drake_pregrasp.regions.half_spaces import Planes, bounding_planes

NO_REGION = -1
"""Label of a candidate point that lies in no safe region."""

TINY_SHARE = 0.05
"""A region is tiny if it has less than this share of what each contact would have of Y."""


_ASKED_FOR_REASONS = 1 << 11  # Candidates, if there are more: they settle what is most frequent.


@dataclass(frozen=True, eq=False)
class SafeRegions:
    """The safe regions S_i of n contacts over the N candidate points of a surface.

    Regions are disjoint by construction: each candidate carries one label.

    Attributes:
        found: The labels, or the same regions over the blocks of the kernel that found them.
        lost: Mask of the contacts that are lost and so have no region, shape (n,).
        limits: What leaves each contact an empty or tiny region, a `Limit` each, shape (n,).
        causes: Index of the contact or obstacle that does, or `NO_CAUSE`, shape (n,).
        constraints: What limited the regions beside Eq. 1.
    """

    found: IntArray | Partition
    lost: BoolArray
    limits: IntArray
    causes: IntArray
    constraints: RegionConstraints

    @staticmethod
    def unlimited(labels: IntArray, num_contacts: int) -> "SafeRegions":
        """Returns regions of contacts that nothing limits, shape (N,) of their labels."""
        return SafeRegions(
            found=labels,
            lost=np.zeros(num_contacts, dtype=bool),
            limits=np.full(num_contacts, int(Limit.NONE)),
            causes=np.full(num_contacts, NO_CAUSE),
            constraints=UNCONSTRAINED,
        )

    @cached_property
    def labels(self) -> IntArray:
        """Index i of the region each candidate lies in, or `NO_REGION`, shape (N,)."""
        found = self.found
        return found.labels_of_candidates() if isinstance(found, Partition) else found

    @property
    def partition(self) -> Partition | None:
        """The regions over the blocks of the kernel that found them, if one did."""
        return self.found if isinstance(self.found, Partition) else None

    def members(self, contact: int) -> IntArray:
        """Returns the indices of the candidates in S_i of the contact with that index."""
        indices: IntArray = np.flatnonzero(self.labels == contact)
        return indices

    def sizes(self) -> IntArray:
        """Returns the number of candidates in each region, shape (n,)."""
        if isinstance(self.found, Partition):
            return self.found.sizes
        counts: IntArray = np.bincount(self.labels - NO_REGION, minlength=1 + len(self.lost))[1:]
        return counts


def compute_safe_regions(
    p_OQ: FloatArray,
    p_OC: FloatArray,
    contact_weights: FloatArray,
    forbidden: ForbiddenPoints,
    constraints: RegionConstraints | None = None,
    *,
    kernel: TickKernel | None = None,
) -> SafeRegions:
    """Assigns candidate points to the contacts' safe regions (Eq. 1).

    A candidate q belongs to S_i if it passes two tests:

    - among contacts, |c_i - q|² - h_i is the least; of equals, the lowest index has it;
    - for each forbidden point, |c_i - q|² <= |z_j - q|² - w_ij with
      w_ij = 2 R_j d - d², d = |c_i - z_j| (Eq. 2): it is on this side of the plane across the way
      to z_j that touches the ball of radius R_j around it;

    and those of the constraints. A contact of weight -inf is lost: it has no region, and the others
    share what it had.

    Points may have more coordinates than three, as the paper proposes for forces, torques or joint
    capability (Sec. V.B), each scaled to metres. Forbidden points may leave the further ones out,
    and then hold for all of their values; solids always do, and are about the first three.

    Args:
        p_OQ: Candidate points of Y in O, shape (N, d), d >= 3, in metres.
        p_OC: Contact points c_i in O, shape (n, d), in metres.
        contact_weights: h_i, shape (n,), in m².
        forbidden: Points Z and radii R_j, in O.
        constraints: What else limits the regions.
        kernel: Of the same candidates, with d = 3. It is faster, and used if nothing else limits
            the regions.
    """
    constraints = constraints or UNCONSTRAINED
    lost = contact_weights == -np.inf
    num_sharing = max(1, len(p_OC) - int(np.count_nonzero(lost)))
    if kernel is not None and constraints.is_empty and contact_weights.max(initial=0) < np.inf:
        found = kernel.partition(p_OC, contact_weights, forbidden.points, forbidden.radii)
        asked = np.flatnonzero(~lost & (found.sizes < TINY_SHARE * len(p_OQ) / num_sharing))
        if len(asked) == 0:
            return SafeRegions(found, lost, *_no_limits(len(p_OC)), constraints)
        # Along the kernel's order each part of the surface has its share of any such sample.
        p_OQ = p_OQ[found.blocks.order[:: 1 + len(p_OQ) // _ASKED_FOR_REASONS]]
        _, limits, causes = _asked_one_by_one(
            asked, p_OQ, p_OC, contact_weights, forbidden, UNCONSTRAINED, num_sharing, all_tiny=True
        )
        return SafeRegions(found, lost, limits, causes, constraints)
    labels, limits, causes = _asked_one_by_one(
        np.flatnonzero(~lost), p_OQ, p_OC, contact_weights, forbidden, constraints, num_sharing
    )
    return SafeRegions(labels, lost, limits, causes, constraints)


def _no_limits(num_contacts: int) -> tuple[IntArray, IntArray]:
    return np.full(num_contacts, int(Limit.NONE)), np.full(num_contacts, NO_CAUSE)


def _asked_one_by_one(
    asked: IntArray,
    p_OQ: FloatArray,
    p_OC: FloatArray,
    contact_weights: FloatArray,
    forbidden: ForbiddenPoints,
    constraints: RegionConstraints,
    num_sharing: int,
    *,
    all_tiny: bool = False,
) -> tuple[IntArray, IntArray, IntArray]:
    """Returns labels, and limits and causes of tiny regions, by asking all points with all planes.

    Of contacts that aren't asked for, the labels are those of their whole cells. With `all_tiny`,
    all that are asked for are known to have tiny regions, whatever these points say.
    """
    limits, causes = _no_limits(len(p_OC))
    tiny = TINY_SHARE * len(p_OQ) / num_sharing
    cells = _cells(p_OQ, p_OC, contact_weights, constraints)
    labels = cells.copy()
    for i in asked.tolist():
        own = np.flatnonzero(cells == i)
        planes = bounding_planes(i, p_OC, contact_weights, forbidden, constraints)
        beyond = planes.beyond(p_OQ[own] - p_OC[i])
        nhat_OQ = constraints.nhat_OQ[own] if len(constraints.nhat_OQ) else np.zeros((len(own), 3))
        point_limits, point_causes = constraints.limits_at(i, p_OQ[own, :3], nhat_OQ)
        outside = np.any(beyond, axis=0) | (point_limits != Limit.NONE)
        labels[own[outside]] = NO_REGION
        if all_tiny or len(own) - np.sum(outside) < tiny:
            if len(own) < tiny or not np.any(outside):
                limits[i], causes[i] = _why_the_cell_is_tiny(i, p_OQ, p_OC, cells, constraints)
            else:
                limits[i], causes[i] = _most_frequent(planes, beyond, point_limits, point_causes)
    return labels, limits, causes


def _cells(
    p_OQ: FloatArray, p_OC: FloatArray, contact_weights: FloatArray, constraints: RegionConstraints
) -> IntArray:
    """Returns the contact in whose weighted Voronoi cell each candidate is, shape (N,)."""
    # Candidates run along the last axis: the reductions over few contacts or planes vectorise then.
    half_power = (np.sum(p_OC**2, axis=1) - contact_weights)[:, None] / 2 - p_OC @ p_OQ.T
    if constraints.same_side is not None:
        half_power[~constraints.same_side] = np.inf
    cells: IntArray = np.argmin(half_power, axis=0)
    cells[np.isposinf(np.min(half_power, axis=0))] = NO_REGION
    return cells


def _why_the_cell_is_tiny(
    contact: int,
    p_OQ: FloatArray,
    p_OC: FloatArray,
    cells: IntArray,
    constraints: RegionConstraints,
) -> tuple[int, int]:
    """Returns the limit and cause of a Voronoi cell that is small before anything cuts it."""
    away = p_OQ - p_OC[contact]
    distances = np.einsum("ij,ij->i", away, away)
    nearest_neighbours = np.where(cells == contact, np.inf, distances)
    q = int(np.argmin(nearest_neighbours))
    same_side = constraints.same_side
    if cells[q] == NO_REGION or (same_side is not None and not same_side[contact, q]):
        return Limit.WALL, NO_CAUSE
    return Limit.CROWDED, int(cells[q])


def _most_frequent(
    planes: Planes, beyond: BoolArray, point_limits: IntArray, point_causes: IntArray
) -> tuple[int, int]:
    """Returns the limit and cause that keep out most of a cell's candidates."""
    counts: dict[tuple[int, int], int] = {}
    for limit, cause in {*zip(planes.limits.tolist(), planes.causes.tolist(), strict=True)}:
        rows = (planes.limits == limit) & (planes.causes == cause)
        counts[limit, cause] = int(np.sum(np.any(beyond[rows], axis=0)))
    for limit, cause in {*zip(point_limits.tolist(), point_causes.tolist(), strict=True)}:
        if limit != Limit.NONE:
            own = int(np.sum((point_limits == limit) & (point_causes == cause)))
            counts[limit, cause] = max(counts.get((limit, cause), 0), own)
    return min(counts, key=lambda key: (-counts[key], key))
