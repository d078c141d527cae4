"""Half-spaces that bound the safe regions, and those of solids and of neighbouring fingertips."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray, norms
from drake_pregrasp.geometry.solids import nearest_solids
from drake_pregrasp.regions.constraints import NO_CAUSE, OPPOSITE, Limit


@dataclass(frozen=True, eq=False)
class HalfSpaces:
    """Half-spaces n_ij·(q - c_i) <= b_ij that bound the regions of n contacts c_i.

    Attributes:
        normals: Normals n_ij, of any length, shape (n, m, d), in metres.
        bounds: Bounds b_ij, shape (n, m), in m² for normals in metres; inf where nothing is bound.
        limits: `Limit` of each half-space, shape (m,).
        causes: Index of the contact or obstacle that causes each, or `NO_CAUSE`, shape (m,).
    """

    normals: FloatArray
    bounds: FloatArray
    limits: IntArray
    causes: IntArray


def counted(limit: Limit, count: int, first: int = 0) -> tuple[IntArray, IntArray]:
    """Returns the `limits` and `causes` of half-spaces of one limit with causes that count up.

    Args:
        limit: The limit.
        count: Number of half-spaces.
        first: Cause of the first one; or `NO_CAUSE` for all.
    """
    causes = np.full(count, NO_CAUSE) if first == NO_CAUSE else first + np.arange(count)
    return np.full(count, int(limit)), causes


def joined(parts: Sequence[HalfSpaces]) -> HalfSpaces:
    """Returns the union of several sets of half-spaces of the same contacts."""
    # Half-spaces are on axis 1, but on axis 0 of limits and causes.
    arrays = zip(*(vars(part).values() for part in parts), strict=True)
    return HalfSpaces(*(np.concatenate(own, axis=min(own[0].ndim - 1, 1)) for own in arrays))


def solid_half_spaces(c: FloatArray, solids: FloatArray, margins: FloatArray) -> HalfSpaces:
    """Returns the half-spaces that touch each solid at its points nearest to the contacts.

    A half-space is set back by the margin, so that the distance of the convex solid from it is at
    least the margin.

    Args:
        c: Contacts, shape (n, d), in metres; their first three coordinates are positions.
        solids: Rows of the convex obstacles for `rounded_box_distances`, shape (s, 19 or more).
        margins: Distance by which the half-spaces of each contact are set back, shape (n,), in
            metres.
    """
    distances, gradients = nearest_solids(solids, c[:, :3])
    normals = np.zeros((len(c), len(solids), c.shape[1]))
    normals[:, :, :3] = -gradients.swapaxes(0, 1)
    return HalfSpaces(normals, (distances - margins).T, *counted(Limit.OBSTACLE, len(solids)))


def neighbour_half_spaces(
    c: FloatArray, h: FloatArray, setbacks: FloatArray, nhat_OC: FloatArray
) -> HalfSpaces:
    """Returns the boundaries of the Voronoi cells, set back to leave room for fingertips.

    The boundary towards c_k is (c_k - c_i)·(q - c_i) <= (d² + h_i - h_k)/2, d = |c_k - c_i|.
    Setting it back by r_i on one side and by r_k on the other, and by half a gap on both, keeps
    the tips r_i + r_k and the gap apart. Weights h_i alone cannot: equal ones cancel.

    Args:
        c: Contacts, shape (n, d), in metres; distances are between their first three coordinates.
        h: Weights h_i, shape (n,), in m²; -inf for lost fingers, which need no room.
        setbacks: Distance by which the boundaries of each contact are set back, shape (n,), in
            metres: r_i and half the gap. At zero, the boundary of the cell is enough.
        nhat_OC: Outward unit normals at the contacts, shape (n, 3), or empty. Contacts with
            opposite normals need no room from each other.
    """
    normals = c - c[:, None]
    normals[:, :, 3:] = 0
    d, is_there = norms(normals), np.isfinite(h)
    needs_room = (d > 0) & (setbacks > 0)[:, None] & is_there
    if len(nhat_OC):
        needs_room &= nhat_OC @ nhat_OC.T >= OPPOSITE
    h = np.where(is_there, h, 0.0)
    bounds = (d**2 + h[:, None] - h) / 2 - d * setbacks[:, None]
    bounds = np.where(needs_room, bounds, np.inf)
    return HalfSpaces(normals, bounds, *counted(Limit.CROWDED, len(c)))
