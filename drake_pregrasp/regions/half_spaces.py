"""Half-spaces that bound a safe region, and those of solids and of neighbouring fingertips."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.geometry.solids import Solid
from drake_pregrasp.regions.constraints import OPPOSITE, Limit, RegionConstraints


@dataclass(frozen=True, eq=False)
class HalfSpaces:
    """Half-spaces n_j·(q - c_i) <= b_j that bound the region of a contact at c_i.

    Attributes:
        normals: Normals n_j, of any length, shape (m, d), in metres.
        bounds: Bounds b_j, shape (m,), in m² for normals in metres.
        limits: The `Limit` that each half-space stands for, shape (m,).
        causes: Index of the contact or obstacle behind each, or `NO_CAUSE`, shape (m,).
    """

    normals: FloatArray
    bounds: FloatArray
    limits: IntArray
    causes: IntArray

    def chosen(self, mask: BoolArray) -> "HalfSpaces":
        """Returns the half-spaces of a mask, shape (m,)."""
        return HalfSpaces(
            self.normals[mask], self.bounds[mask], self.limits[mask], self.causes[mask]
        )


def joined(parts: Sequence[HalfSpaces]) -> HalfSpaces:
    """Returns the union of several sets of half-spaces."""
    return HalfSpaces(
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.bounds for part in parts]),
        np.concatenate([part.limits for part in parts]),
        np.concatenate([part.causes for part in parts]),
    )


def solid_half_spaces(c_i: FloatArray, solids: Sequence[Solid], margin: float) -> HalfSpaces:
    """Returns, for each solid, the half-space that touches it at its point nearest to a contact.

    The half-space is set back by the margin, so that the whole convex solid is on its far side,
    at least as far off as that.

    Args:
        c_i: Contact, shape (d,), in metres; its first three coordinates are its place.
        solids: Convex obstacles.
        margin: Distance by which half-spaces are set back, in metres.
    """
    distances, gradients = np.empty(len(solids)), np.zeros((len(solids), len(c_i)))
    for index, solid in enumerate(solids):
        distance, gradient = solid.distance_and_gradient(c_i[None, :3])
        distances[index], gradients[index, :3] = distance[0], gradient[0]
    limits = np.full(len(solids), int(Limit.OBSTACLE))
    return HalfSpaces(-gradients, distances - margin, limits, np.arange(len(solids)))


def neighbour_half_spaces(
    i: int, c: FloatArray, h: FloatArray, constraints: RegionConstraints
) -> HalfSpaces:
    """Returns the boundaries of a contact's Voronoi cell, set back to leave room for fingertips.

    The boundary towards c_k is (c_k - c_i)·(q - c_i) <= (d² + h_i - h_k)/2, d = |c_k - c_i|.
    Setting it back by r_i on one side and by r_k on the other, and by half a gap on both, keeps
    the tips r_i + r_k and the gap apart. Weights h_i alone cannot: equal ones cancel.

    Args:
        i: Index of the contact.
        c: All contacts, shape (n, d), in metres; distances are between their first three
            coordinates.
        h: Weights h_i, shape (n,), in m²; -inf for lost fingers, which need no room.
        constraints: The fingertips' radii and gap, and the normals at the contacts.
    """
    normals = c - c[i]
    normals[:, 3:] = 0
    d = np.linalg.norm(normals, axis=1)
    needs_room = (d > 0) & np.isfinite(h)
    if len(constraints.nhat_OC):
        needs_room &= constraints.nhat_OC @ constraints.nhat_OC[i] >= OPPOSITE
    k = np.flatnonzero(needs_room)
    setback = constraints.tip_radius(i) + constraints.tip_gap / 2
    bounds = (d[k] ** 2 + h[i] - h[k]) / 2 - d[k] * setback
    return HalfSpaces(normals[k], bounds, np.full(len(k), int(Limit.CROWDED)), k)
