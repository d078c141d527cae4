"""Tests for candidates on the contact's own side of a thin wall."""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.regions.constraints import OPPOSITE

WALL_TESTS = ("none", "normals", "surface")
"""No test; by the angle between outward normals; by paths over the surface."""

_DETOUR = 2.5
"""Largest ratio of a path over the surface to the straight line. It is 1.6 half-way around a ball,
at most 1.4 around the edge of a box, 2 between opposite faces of a cube, and more on a plate."""

_LINK = 2.0
"""Longest link of the surface's graph, in mean distances of candidates."""


def normals_agree(nhat_OC: FloatArray, normals: FloatArray) -> BoolArray:
    """Returns the mask of normals that are not opposite to those at the contacts, shape (n, k).

    Args:
        nhat_OC: Outward unit normals at the contacts, shape (n, 3).
        normals: Outward unit normals, shape (k, 3); a zero vector always passes.
    """
    agrees: BoolArray = nhat_OC @ normals.T >= OPPOSITE
    return agrees


class SurfaceGraph:
    """The candidates of a surface, linked to their neighbours on the same side.

    Args:
        surface: The object's surface.
    """

    def __init__(self, surface: ObjectSurface) -> None:
        self._p_OQ, self._normals = surface.p_OQ, surface.nhat_OQ
        self._spacing = float(np.sqrt(np.mean(surface.areas)))
        tree = cKDTree(surface.p_OQ)
        pairs = tree.query_pairs(_LINK * self._spacing, output_type="ndarray")
        normals = surface.nhat_OQ
        cosines = np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]])
        pairs = pairs[cosines >= OPPOSITE]
        lengths = np.linalg.norm(surface.p_OQ[pairs[:, 0]] - surface.p_OQ[pairs[:, 1]], axis=1)
        count = len(surface.p_OQ)
        # A length of zero would be no link.
        self._links = csr_array(
            (np.maximum(lengths, 1e-12), (pairs[:, 0], pairs[:, 1])), shape=(count, count)
        )

    def near_over_the_surface(self, p_OC: FloatArray, nhat_OC: FloatArray) -> BoolArray:
        """Returns the mask of candidates with a short path over the surface, shape (n, N).

        Args:
            p_OC: Contacts, shape (n, 3), in metres.
            nhat_OC: Outward unit normals at the contacts, shape (n, 3).
        """
        straight = np.linalg.norm(self._p_OQ - p_OC[:, None], axis=2)
        # Paths start at the nearest candidate on the contact's own side.
        penalty = np.where(normals_agree(nhat_OC, self._normals), 0.0, np.inf)
        starts = np.argmin(straight + penalty, axis=1)
        paths = dijkstra(self._links, directed=False, indices=starts)
        near: BoolArray = paths <= _DETOUR * straight + _LINK * self._spacing
        return near
