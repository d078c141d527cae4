"""The half-spaces that bound a safe region: those of Eq. 1, of solids, and of neighbours."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.geometry.solids import Solid
from drake_pregrasp.geometry.surface import ForbiddenPoints
from drake_pregrasp.regions.constraints import (
    NO_CAUSE,
    OPPOSITE,
    Limit,
    RegionConstraints,
)


@dataclass(frozen=True, eq=False)
class Planes:
    """Half-spaces n_j·(q - c_i) <= b_j that bound the region of a contact at c_i.

    Attributes:
        normals: n_j, shape (m, d); of any length.
        bounds: b_j, shape (m,).
        limits: The `Limit` that each stands for, shape (m,).
        causes: The contact or obstacle behind it, or `NO_CAUSE`, shape (m,).
    """

    normals: FloatArray
    bounds: FloatArray
    limits: IntArray
    causes: IntArray

    def beyond(self, from_contact: FloatArray) -> BoolArray:
        """Returns which points q - c_i, shape (k, d), are beyond which plane, shape (m, k)."""
        outside: BoolArray = self.normals @ from_contact.T > self.bounds[:, None]
        return outside

    @staticmethod
    def joined(parts: Sequence["Planes"]) -> "Planes":
        """Returns all planes of several sets."""
        return Planes(
            np.concatenate([part.normals for part in parts]),
            np.concatenate([part.bounds for part in parts]),
            np.concatenate([part.limits for part in parts]),
            np.concatenate([part.causes for part in parts]),
        )


def bounding_planes(
    contact: int,
    p_OC: FloatArray,
    contact_weights: FloatArray,
    forbidden: ForbiddenPoints,
    constraints: RegionConstraints,
) -> Planes:
    """Returns what bounds a region in its cell: forbidden points, tips beside it, and obstacles.

    Args:
        contact: i.
        p_OC: All contacts, shape (n, d), in metres; their first three coordinates are places.
        contact_weights: h, shape (n,), in m²; -inf for the lost.
        forbidden: Points Z and radii R_j, in O.
        constraints: With fingertips, obstacles, and which forbidden points fence contacts in.
    """
    p_OCi = p_OC[contact]
    if constraints.fencing is not None:
        fences = constraints.fencing[contact]
        forbidden = ForbiddenPoints(forbidden.points[fences], forbidden.radii[fences])
    planes = [point_planes(p_OCi, forbidden, margin=0, limit=Limit.FORBIDDEN, first_cause=NO_CAUSE)]
    tip_radius = constraints.tip_radius(contact)
    margin = tip_radius + constraints.clearance
    obstacles = constraints.obstacles
    if tip_radius + constraints.tip_gap > 0:
        planes.append(neighbour_planes(contact, p_OC, contact_weights, constraints))
    if obstacles.solids:
        planes.append(solid_planes(p_OCi, obstacles.solids, margin))
    if len(obstacles.points):
        first = len(obstacles.solids)
        planes.append(
            point_planes(
                p_OCi, obstacles.points, margin=margin, limit=Limit.OBSTACLE, first_cause=first
            )
        )
    return Planes.joined(planes) if len(planes) > 1 else planes[0]


def point_planes(
    p_OCi: FloatArray, points: ForbiddenPoints, *, margin: float, limit: Limit, first_cause: int
) -> Planes:
    """Returns the planes of Eq. 1 for points Z, with radii enlarged by a margin.

    With w_ij of Eq. 2, |c_i - q|² <= |z_j - q|² - w_ij is (z_j - c_i)·(q - c_i) <= d (d - R_j),
    d = |z_j - c_i|. For d = 0 both sides are zero, and the test holds everywhere.

    Args:
        p_OCi: c_i, shape (d,), in metres.
        points: z_j and R_j, with d coordinates or the first few of them: such a point stands for
            all values of the others.
        margin: Added to each R_j, in metres.
        limit: What the planes stand for.
        first_cause: Cause of the first point; those of the others follow. `NO_CAUSE` for none.
    """
    normals = _with_zeros(points.points - p_OCi[: points.points.shape[1]], len(p_OCi))
    d = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    causes = np.full(len(d), NO_CAUSE)
    if first_cause != NO_CAUSE:
        causes = first_cause + np.arange(len(d))
    bounds = d * (d - points.radii - margin)
    return Planes(normals, bounds, np.full(len(d), int(limit)), causes)


def solid_planes(p_OCi: FloatArray, solids: Sequence[Solid], margin: float) -> Planes:
    """Returns, for each solid, the plane of Eq. 1 for its point nearest to c_i, set back.

    Such a plane leaves the whole convex solid on its far side, as far off as the margin.

    Args:
        p_OCi: c_i, shape (d,), in metres; its first three coordinates are its place.
        solids: The obstacles.
        margin: By which planes are set back, in metres.
    """
    distances, gradients = np.empty(len(solids)), np.empty((len(solids), 3))
    for index, solid in enumerate(solids):
        distance, gradient = solid.distance_and_gradient(p_OCi[None, :3])
        distances[index], gradients[index] = distance[0], gradient[0]
    limits = np.full(len(solids), int(Limit.OBSTACLE))
    normals = _with_zeros(-gradients, len(p_OCi))
    return Planes(normals, distances - margin, limits, np.arange(len(solids)))


def neighbour_planes(
    contact: int,
    p_OC: FloatArray,
    contact_weights: FloatArray,
    constraints: RegionConstraints,
) -> Planes:
    """Returns the boundaries of a weighted Voronoi cell, set back by the fingertip's radius.

    The boundary towards c_k is (c_k - c_i)·(q - c_i) <= (d² + h_i - h_k)/2, d = |c_k - c_i|.
    Setting it back by r_i on one side and by r_k on the other, and by half a gap on both, keeps
    the tips r_i + r_k and the gap apart.
    Equal weights h_i alone, even squares of radii, cancel and keep nothing apart.

    Args:
        contact: i.
        p_OC: All contacts, shape (n, d), in metres; their first three coordinates are places, and
            only these are looked at.
        contact_weights: h, shape (n,), in m²; -inf for the lost, which need no room.
        constraints: With the fingertips and their gap.
    """
    normals = p_OC[:, :3] - p_OC[contact, :3]
    d = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    needs_room = (d > 0) & np.isfinite(contact_weights)
    if len(constraints.nhat_OC):
        needs_room &= constraints.nhat_OC @ constraints.nhat_OC[contact] >= OPPOSITE
    others = np.flatnonzero(needs_room)
    d = d[others]
    bounds = (d**2 + contact_weights[contact] - contact_weights[others]) / 2
    bounds -= d * (constraints.tip_radius(contact) + constraints.tip_gap / 2)
    limits = np.full(len(others), int(Limit.CROWDED))
    return Planes(_with_zeros(normals[others], p_OC.shape[1]), bounds, limits, others)


def _with_zeros(vectors: FloatArray, size: int) -> FloatArray:
    """Returns vectors with zeros for further coordinates, shape (m, size)."""
    if vectors.shape[1] == size:
        return vectors
    return np.pad(vectors, ((0, 0), (0, size - vectors.shape[1])))
