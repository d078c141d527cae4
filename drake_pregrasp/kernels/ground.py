"""The allowed surface as patches of triangles, one patch for each candidate."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError

_ROUNDING = 1 + 1e-9
_SQUARED_ROUNDING = 1e-7  # Share of a length by which a difference of squares may be off.

_FEW = 1 << 13
"""Candidates up to which asking all of them costs less than search trees do."""

_MANY_TRIANGLES = 512  # From which on it pays to leave out what is too far.


class Ground:
    """Finds the triangles on which the nearest point to another may be.

    Args:
        p_OQ: Candidates, shape (N, 3), in metres.
        patches: Triangles in the order of their candidates, shape (T, 3, 3).
        patch_starts: Place of each candidate's first triangle, and T, shape (N + 1,).

    Attributes:
        p_OQ: As given, and so the next two.
        patches: Triangles.
        patch_starts: Where each candidate's begin.
        reach: No patch goes farther than that from its candidate, which is on it, in metres.
        longest_edge: Of all triangles, in metres.
        tree: Of the candidates.
    """

    def __init__(self, p_OQ: FloatArray, patches: FloatArray, patch_starts: IntArray) -> None:
        self.p_OQ = p_OQ
        self.patches = np.require(patches, float, ["C", "W"])
        self.patch_starts = np.require(patch_starts, np.int64, ["C", "W"])
        self.tree = cKDTree(p_OQ)
        self._squares = np.einsum("ij,ij->i", p_OQ, p_OQ)
        self._extent = float(np.sqrt(np.max(self._squares)))
        self._owners = np.repeat(np.arange(len(p_OQ)), np.diff(patch_starts))
        away = np.linalg.norm(patches - p_OQ[self._owners, None], axis=2)
        self.reach = float(np.max(away)) * _ROUNDING
        centroids = np.mean(patches, axis=1)
        radii = np.linalg.norm(patches - centroids[:, None], axis=2)
        edges = np.roll(patches, -1, axis=1) - patches
        self.longest_edge = float(np.sqrt(np.max(np.sum(edges**2, axis=2)))) * _ROUNDING
        self._triangle_tree = cKDTree(centroids)
        self._triangle_radius = float(np.max(radii)) * _ROUNDING

    def near(self, points: FloatArray) -> list[IntArray]:
        """Returns for each point, shape (k, 3), the triangles that may be nearest."""
        if len(self.p_OQ) <= _FEW:
            return self._near_of_few(points, None)
        # The centroid of the nearest triangle is at most its radius farther away than the triangle.
        distances, _ = self._triangle_tree.query(points)
        return self.triangles_within(points, distances)

    def near_of(self, points: FloatArray, candidates: Sequence[IntArray]) -> list[IntArray]:
        """The same out of the patches of each point's own candidates, one or more.

        Raises:
            InvalidArgumentError: If a point has none.
        """
        if not all(len(q) for q in candidates):
            raise InvalidArgumentError("a point has no candidates to be projected onto")
        if len(self.p_OQ) <= _FEW:
            allowed = np.zeros((len(points), len(self.p_OQ)), dtype=bool)
            for row, own in zip(allowed, candidates, strict=True):
                row[own] = True
            return self._near_of_few(points, allowed)
        distances = np.array(
            [
                np.sqrt(np.min(np.sum((self.p_OQ[q] - point) ** 2, axis=1)))
                for point, q in zip(points, candidates, strict=True)
            ]
        )
        near = []
        is_chosen = np.zeros(len(self.p_OQ), dtype=bool)
        for triangles, q in zip(self.triangles_within(points, distances), candidates, strict=True):
            is_chosen[q] = True
            near.append(triangles[is_chosen[self._owners[triangles]]])
            is_chosen[q] = False
        return near

    def near_in_regions(
        self, points: FloatArray, labels: IntArray, contacts: IntArray
    ) -> list[IntArray]:
        """The same out of the candidates that carry each point's label, one or more."""
        if len(self.p_OQ) <= _FEW:
            return self._near_of_few(points, labels == contacts[:, None])
        distances, nearest = self.tree.query(points)
        for k in np.flatnonzero(labels[nearest] != contacts):
            away = self.p_OQ[labels == contacts[k]] - points[k]
            distances[k] = np.sqrt(np.min(np.einsum("ij,ij->i", away, away)))
        return [
            triangles[labels[self._owners[triangles]] == contact]
            for contact, triangles in zip(
                contacts, self.triangles_within(points, distances), strict=True
            )
        ]

    def _near_of_few(self, points: FloatArray, allowed: BoolArray | None) -> list[IntArray]:
        """The same out of the candidates that each point is allowed, shape (k, N)."""
        own_squares = np.einsum("ij,ij->i", points, points)
        squares = self._squares - 2 * points @ self.p_OQ.T + own_squares[:, None]
        if allowed is not None:
            squares[~allowed] = np.inf
        # Candidates are on the ground, so that the nearest bounds how far away it is.
        bounds = np.sqrt(np.maximum(squares.min(axis=1), 0))
        bounds += _SQUARED_ROUNDING * (self._extent + np.sqrt(own_squares))
        near = np.flatnonzero(squares <= ((bounds + self.reach) ** 2)[:, None])
        point, candidate = np.divmod(near, len(self.p_OQ))
        first = self.patch_starts[candidate]
        counts = self.patch_starts[candidate + 1] - first
        ends = np.cumsum(counts)
        triangles = np.arange(ends[-1]) + np.repeat(first - ends + counts, counts)
        point = np.repeat(point, counts)
        if len(triangles) > _MANY_TRIANGLES:
            away = np.linalg.norm(self.patches[triangles, 0] - points[point], axis=1)
            kept = away <= bounds[point] + self.longest_edge
            triangles, point = triangles[kept], point[kept]
        return np.split(triangles, np.searchsorted(point, np.arange(1, len(points))))

    def owners_within(self, point: FloatArray, distance: float) -> IntArray:
        """Returns the candidates whose patches come that near to a point, or nearly, (k,)."""
        (triangles,) = self.triangles_within(point[None], np.array([distance]))
        return np.unique(self._owners[triangles])

    def triangles_within(self, points: FloatArray, distances: FloatArray) -> list[IntArray]:
        """Returns for each point all triangles that are as near as its distance, and some more."""
        near = self._triangle_tree.query_ball_point(
            points, distances + self._triangle_radius, return_sorted=True
        )
        return [np.array(triangles, dtype=np.int64) for triangles in near]
