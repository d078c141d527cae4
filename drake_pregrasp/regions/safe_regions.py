"""Safe regions S_i of the contacts: obstacle-aware weighted Voronoi cells (Eq. 1-2).

`safe_region_labels` is Eq. 1-2 as printed, and the oracle of the tests. The planner uses
`compute_safe_regions`: the same inequalities as half-spaces, and further constraints.
"""

import contextlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.spatial.distance import cdist

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.surface import ForbiddenPoints
from drake_pregrasp.regions.constraints import (
    NO_CAUSE,
    Limit,
    Predicates,
    RegionConstraints,
)
from drake_pregrasp.regions.half_spaces import (
    HalfSpaces,
    counted,
    joined,
    neighbour_half_spaces,
    solid_half_spaces,
)

NO_REGION = -1
"""Label of a candidate point that lies in no safe region."""

TINY_SHARE = 0.05
"""A region is tiny if it has less than this fraction of an equal share of the candidates."""


def safe_region_labels(
    q: FloatArray, c: FloatArray, h: FloatArray, z: FloatArray, R: FloatArray
) -> IntArray:
    """Assigns candidate points to the safe regions S_i, by Eq. 1-2 as printed.

    Args:
        q: Candidate points of Y in the object frame O, shape (N, 3), in metres.
        c: Contact points c_i in O, shape (n, 3), in metres.
        h: Weights h_i, shape (n,), in m²; -inf for a lost finger.
        z: Forbidden points z_j in O, shape (m, 3), in metres.
        R: Radius R_j around each forbidden point, shape (m,), in metres.

    Returns:
        Index i of the region S_i that each candidate lies in, or `NO_REGION`, shape (N,). If power
        distances are equal, the candidate belongs to the contact with the lowest index.
    """
    # |c_i - q|² - h_i <= |c_k - q|² - h_k for all k: the least power distance owns q.
    distance_squared = cdist(q, c, "sqeuclidean")
    i = np.argmin(distance_squared - h, axis=1)
    # |c_i - q|² <= |z_j - q|² - w_ij for all j, with w_ij = 2 R_j |c_i - z_j| - |c_i - z_j|².
    distance = cdist(c, z)
    w = 2 * R * distance - distance**2
    own = np.take_along_axis(distance_squared, i[:, None], axis=1)
    is_safe = np.all(own <= cdist(q, z, "sqeuclidean") - w[i], axis=1)
    return np.where(is_safe & (h[i] > -np.inf), i, NO_REGION)


@dataclass(frozen=True, eq=False)
class SafeRegions:
    """The safe regions S_i of n contacts over the N candidate points of a surface.

    To change labels, use `dataclasses.replace`.

    Attributes:
        labels: Index i of the region that each candidate lies in, or `NO_REGION`, shape (N,).
        lost: Mask of the contacts whose finger is lost and that have no region, shape (n,).
        limits: The `Limit` that leaves each contact an empty or tiny region, shape (n,).
        causes: Index of the contact or obstacle that causes that limit, or `NO_CAUSE`, shape (n,).
        constraints: Constraints of the regions, besides the forbidden points.
    """

    labels: IntArray
    lost: BoolArray
    limits: IntArray
    causes: IntArray
    constraints: RegionConstraints

    @staticmethod
    def unlimited(labels: IntArray, num_contacts: int) -> "SafeRegions":
        """Returns regions of contacts that nothing limits, given their labels, shape (N,)."""
        limits, causes = np.full(num_contacts, int(Limit.NONE)), np.full(num_contacts, NO_CAUSE)
        lost, constraints = np.zeros(num_contacts, dtype=bool), RegionConstraints(num_contacts)
        return SafeRegions(labels, lost, limits, causes, constraints)

    def members(self, contact: int) -> IntArray:
        """Returns the indices of the candidates in S_i of the contact with that index."""
        return np.flatnonzero(self.labels == contact)

    def sizes(self) -> IntArray:
        """Returns the number of candidates in each region, shape (n,)."""
        return self.counts

    @cached_property
    def counts(self) -> IntArray:
        """Number of candidates in each region, shape (n,).

        Raises:
            InvalidArgumentError: If a label is neither `NO_REGION` nor that of a contact.
        """
        n, counts = len(self.lost), np.empty(0, dtype=np.int64)
        with contextlib.suppress(ValueError):  # A number is negative.
            counts = np.bincount(self.labels - NO_REGION, minlength=1 + n)[1:]
        if len(counts) != n:
            raise InvalidArgumentError(f"labels of regions must be from {NO_REGION} to {n - 1}")
        return counts


@dataclass(frozen=True, eq=False)
class RegionBounds:
    """Everything that bounds the regions of n contacts at one tick, as plain arrays in O.

    Region i is the intersection of the weighted Voronoi cell of c_i with half-spaces, and with the
    candidates that pass the predicates of contact i.

    Attributes:
        c: Contacts c_i, shape (n, d), in metres; their first three coordinates are positions.
        h: Weights h_i, shape (n,), in m²; -inf for lost fingers.
        half_spaces: Half-spaces of forbidden points, neighbouring fingertips and obstacles.
        same_side: Candidates that no wall hides from each contact, shape (n, N), or None for all.
        predicates: Tests of single candidates.
        num_candidates: Number of candidates N.
        few: Number of candidates below which a region is tiny.
    """

    c: FloatArray
    h: FloatArray
    half_spaces: HalfSpaces
    same_side: BoolArray | None
    predicates: Predicates
    num_candidates: int
    few: float


Labelled = tuple[IntArray, IntArray, IntArray]
"""The region that each candidate of a surface lies in, or `NO_REGION`, shape (N,); of each contact,
the `Limit` that leaves it an empty or tiny region, and the cause of that, shape (n,) each."""

LabelCandidates = Callable[[RegionBounds], Labelled]
"""Labels the candidates of a surface; the reference is `label_candidates`."""


def compute_safe_regions(
    p_OQ: FloatArray,
    p_OC: FloatArray,
    contact_weights: FloatArray,
    forbidden: ForbiddenPoints,
    constraints: RegionConstraints | None = None,
    *,
    label: LabelCandidates | None = None,
) -> SafeRegions:
    """Computes the safe regions of the contacts over the candidate points.

    A contact with weight -inf is lost: it has no region, and its candidates belong to the others.

    Points may have more than three coordinates, as the paper proposes for forces, torques or joint
    capability (Sec. III.A), each scaled to metres. Forbidden points may omit the further
    coordinates, and then apply to all values of them. Solids concern only the first three.

    Args:
        p_OQ: Candidate points q of Y in O, shape (N, d), d >= 3, in metres.
        p_OC: Contact points c_i in O, shape (n, d), in metres.
        contact_weights: Weights h_i, shape (n,), in m².
        forbidden: Forbidden points z_j and radii R_j, in O.
        constraints: Further constraints of the regions.
        label: A faster implementation of `label_candidates` for these candidates.

    Raises:
        InvalidArgumentError: If there is no contact, one is not finite, or a weight is NaN.
    """
    if not (len(p_OC) and np.isfinite(p_OC).all()):
        raise InvalidArgumentError(f"contacts must be finite, one at least, not {p_OC.tolist()}")
    if np.isnan(contact_weights).any():
        raise InvalidArgumentError(f"weights must not be NaN: {contact_weights.tolist()}")
    constraints = constraints or RegionConstraints(len(p_OC))
    c, h, predicates = p_OC, contact_weights, constraints.predicates
    half_spaces = point_half_spaces(c, forbidden)
    if constraints.active_forbidden_points is not None:
        applied = np.where(constraints.active_forbidden_points, half_spaces.bounds, np.inf)
        half_spaces = replace(half_spaces, bounds=applied)
    parts, obstacles = [half_spaces], constraints.obstacles
    radii = constraints.tip_radii if len(constraints.tip_radii) else np.zeros(len(c))
    if len(constraints.tip_radii) or constraints.tip_gap > 0:
        setbacks = radii + constraints.tip_gap / 2
        parts.append(neighbour_half_spaces(c, h, setbacks, constraints.nhat_OC))
    if not predicates.permits_all:
        margins = radii + constraints.clearance
        now = predicates.solids[:: 1 + len(constraints.later)]
        if len(now):
            parts.append(solid_half_spaces(c, now, margins))
        if len(points := obstacles.points):
            limit, first, column = Limit.OBSTACLE, len(obstacles.solids), margins[:, None]
            own = point_half_spaces(c, points, margins=column, limit=limit, first_cause=first)
            parts.append(own)
    few = TINY_SHARE * len(p_OQ) / max(1, int(np.count_nonzero(h > -np.inf)))
    half_spaces = joined(parts) if len(parts) > 1 else half_spaces
    same_side, N = constraints.same_side, len(p_OQ)
    bounds = RegionBounds(c, h, half_spaces, same_side, predicates, N, few)
    if label is None:
        nhat = constraints.nhat_OQ if len(constraints.nhat_OQ) else np.zeros((N, 3))
        label = partial(label_candidates, p_OQ, nhat)
    labels, limits, causes = label(bounds)
    labels.flags.writeable = False  # They are counted once.
    return SafeRegions(labels, h == -np.inf, limits, causes, constraints)


def label_candidates(q: FloatArray, nhat: FloatArray, bounds: RegionBounds) -> Labelled:
    """Labels candidates, and tells what leaves regions tiny.

    The cells are the left side of Eq. 1. Subtracting |q|² and halving,

        |c_i - q|² - h_i <= |c_k - q|² - h_k   is   (|c_i|² - h_i)/2 - c_i·q  least for i.

    Args:
        q: Candidate points, shape (N, d), in metres.
        nhat: Outward unit normals at the candidates, shape (N, 3).
        bounds: Everything that bounds the regions.
    """
    c, h, half_spaces, n = bounds.c, bounds.h, bounds.half_spaces, len(bounds.c)
    # Axis by axis: a matrix product rounds each row differently, even those of equal contacts.
    products = sum(np.outer(c_k, q_k) for c_k, q_k in zip(c.T, q.T, strict=True))
    half_power: FloatArray = (np.sum(c**2, axis=1) - h)[:, None] / 2 - products
    if bounds.same_side is not None:
        half_power[~bounds.same_side] = np.inf
    cells: IntArray = np.argmin(half_power, axis=0)
    cells[np.isposinf(np.min(half_power, axis=0))] = NO_REGION
    labels = cells.copy()
    for i in range(n):
        own = np.flatnonzero(cells == i)
        excluded = half_spaces.normals[i] @ (q[own] - c[i]).T > half_spaces.bounds[i][:, None]
        labels[own[excluded.any(axis=0)]] = NO_REGION
    if not bounds.predicates.permits_all:
        own = np.flatnonzero(labels != NO_REGION)
        barred, _ = bounds.predicates.limits_at(labels[own], q[own, :3], nhat[own])
        labels[own[barred != Limit.NONE]] = NO_REGION
    limits, causes = np.full(n, int(Limit.NONE)), np.full(n, NO_CAUSE)
    counts = np.bincount(labels - NO_REGION, minlength=1 + n)[1:]
    for i in np.flatnonzero((counts < bounds.few) & (h > -np.inf)).tolist():
        limits[i], causes[i] = _limit_of_region(i, q, nhat, cells, bounds)
    return labels, limits, causes


def point_half_spaces(
    c: FloatArray,
    points: ForbiddenPoints,
    *,
    margins: FloatArray | float = 0.0,
    limit: Limit = Limit.FORBIDDEN,
    first_cause: int = NO_CAUSE,
) -> HalfSpaces:
    """Returns the half-spaces that keep the region of each contact from forbidden points.

    This is the right side of Eq. 1, with w_ij of Eq. 2 and d = |z_j - c_i|. Subtracting |q|²,

        |c_i - q|² <= |z_j - q|² - w_ij   is   2 (z_j - c_i)·q <= |z_j|² - |c_i|² + d² - 2 R_j d
                                          or   (z_j - c_i)·(q - c_i) <= d (d - R_j).

    It is the plane across the line to z_j that touches the ball of radius R_j around it. For d = 0
    both sides are zero, and no candidate is excluded.

    Args:
        c: Contacts c_i, shape (n, d), in metres.
        points: Points z_j and radii R_j, with d coordinates or fewer; a point with fewer applies to
            all values of the others.
        margins: Distance added to each radius, in metres; or that of each contact, shape (n, 1).
        limit: `Limit` of the half-spaces.
        first_cause: Cause of the first point, from which the others count up; or `NO_CAUSE` for
            all.
    """
    m, size = points.points.shape
    by_axis = points.points.T - c[:, :size, None]
    if size < c.shape[1]:
        by_axis = np.pad(by_axis, ((0, 0), (0, c.shape[1] - size), (0, 0)))
    d = np.sqrt(np.add.reduce(by_axis * by_axis, axis=1))
    bounds = d * (d - points.radii - margins)
    return HalfSpaces(by_axis.swapaxes(1, 2), bounds, *counted(limit, m, first_cause))


def _limit_of_region(
    i: int, q: FloatArray, nhat: FloatArray, cells: IntArray, bounds: RegionBounds
) -> tuple[int, int]:
    """Returns the limit that leaves a contact a tiny region, and its cause.

    If the cell is tiny already, it is the limit of the cell, else the one that excludes most
    candidates of the cell.

    Args:
        i: Index of the contact.
        q: Candidate points, shape (N, d), in metres.
        nhat: Outward unit normals at the candidates, shape (N, 3).
        cells: Contact whose cell each candidate is in, shape (N,).
        bounds: Everything that bounds the regions.
    """
    own, c, half_spaces = np.flatnonzero(cells == i), bounds.c, bounds.half_spaces
    excluded = half_spaces.normals[i] @ (q[own] - c[i]).T > half_spaces.bounds[i][:, None]
    counts: Counter[tuple[int, int]] = Counter()
    keys = list(zip(half_spaces.limits.tolist(), half_spaces.causes.tolist(), strict=True))
    for limit, cause in set(keys):
        rows = (half_spaces.limits == limit) & (half_spaces.causes == cause)
        counts[limit, cause] = int(np.count_nonzero(excluded[rows].any(axis=0)))
    if not bounds.predicates.permits_all:
        barred, barring = bounds.predicates.limits_at(cells[own], q[own, :3], nhat[own])
        counts |= Counter(zip(barred.tolist(), barring.tolist(), strict=True))
        del counts[Limit.NONE, NO_CAUSE]
    if len(own) < bounds.few or not counts.total():
        return limit_of_cell(i, q, cells, bounds)
    return min(counts, key=lambda key: (-counts[key], key))


def limit_of_cell(i: int, q: FloatArray, cells: IntArray, bounds: RegionBounds) -> tuple[int, int]:
    """Returns what ends the cell of a contact: the cell or wall of the nearest other candidate.

    The arguments are those of `_limit_of_region`.
    """
    distances = np.where(cells == i, np.inf, np.sum((q - bounds.c[i]) ** 2, axis=1))
    k = int(np.argmin(distances))
    if cells[k] == NO_REGION or (bounds.same_side is not None and not bounds.same_side[i, k]):
        return Limit.WALL, NO_CAUSE
    return Limit.CROWDED, int(cells[k])
