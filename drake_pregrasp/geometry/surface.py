"""Allowed surface of an object for contacts, and projection onto it."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.sampling import Triangles, unit_normals

CONTACT_TOLERANCE = 1e-4
"""Largest distance from the surface of a contact that counts as on the surface, in metres."""

_ROUNDING = 1 + 1e-9

TIE = 1e-14
"""Relative difference of squared distances that is rounding: of such triangles the first counts."""

NO_DISTANCE = 1e-15
"""Distance that is rounding, in metres."""

FLAT_CORNER = 1e-12
"""Squared sine of a corner up to which a triangle counts as degenerate: rounding would decide on
which side of its edges a point is."""


@dataclass(eq=False)
class ForbiddenPoints:
    """Points Z that contacts keep away from (the obstacles z_j of the paper).

    Attributes:
        points: Points z_j, shape (m, d), in metres, in the frame of the object that holds them;
            d = 3 unless regions use more coordinates.
        radii: R_j, shape (m,), in metres.
        normals: Outward unit normals of the surface that the points sample, shape (m, d); zero, as
            by default, for points that sample no surface.
    """

    points: FloatArray
    radii: FloatArray
    normals: FloatArray = None  # type: ignore[assignment]  # Zeros in the points' shape.

    def __post_init__(self) -> None:
        self.points = np.asarray(self.points, dtype=float)
        self.radii = np.asarray(self.radii, dtype=float)
        if self.points.ndim != 2 or self.points.shape[1] < 1:
            raise InvalidArgumentError(f"points must have shape (m, 3), not {self.points.shape}")
        if self.radii.shape != (len(self.points),) or not np.all(self.radii >= 0):
            raise InvalidArgumentError("radii must be one number >= 0 for each forbidden point")
        if self.normals is None:
            self.normals = np.zeros(self.points.shape)
        self.normals = np.asarray(self.normals, dtype=float)
        if self.normals.shape != self.points.shape:
            raise InvalidArgumentError("normals must be one for each forbidden point")

    def __len__(self) -> int:
        return len(self.points)

    @staticmethod
    def none() -> "ForbiddenPoints":
        """Returns an empty set."""
        return ForbiddenPoints(np.empty((0, 3)), np.empty(0))


@dataclass(frozen=True, eq=False)
class ObjectSurface:
    """The allowed surface of an object O for contacts, in the object frame.

    The allowed surface is divided into patches of triangles, one for each candidate, so that a
    point can be projected onto the patches of some candidates only. The arrays are never written to
    after construction: one surface serves many systems.

    Attributes:
        p_OQ: Candidate points q of Y, each on its own patch, shape (N, 3), in metres.
        nhat_OQ: Outward unit normals at the candidates, shape (N, 3).
        areas: Surface area that each candidate represents, shape (N,), in m².
        forbidden: Points Z that are part of the object.
        p_OCoM: The object's centre of mass, shape (3,), in metres.
        mesh: The whole surface, closed, in O.
        patches: Triangles of the allowed surface in the order of their candidates, shape (T, 3, 3).
        patch_starts: Place of each candidate's first triangle, and their number, shape (N + 1,).
    """

    p_OQ: FloatArray
    nhat_OQ: FloatArray
    areas: FloatArray
    forbidden: ForbiddenPoints
    p_OCoM: FloatArray
    mesh: trimesh.Trimesh
    patches: FloatArray
    patch_starts: IntArray

    @cached_property
    def is_clear_of_forbidden_points(self) -> BoolArray:
        """Mask of the candidates outside the balls R_j around forbidden points, shape (N,)."""
        clear = np.ones(len(self.p_OQ), dtype=bool)
        for radius in np.unique(self.forbidden.radii):
            points = self.forbidden.points[self.forbidden.radii == radius]
            clear &= cKDTree(points).query(self.p_OQ)[0] > radius
        return clear

    @cached_property
    def longest_lever_arm(self) -> float:
        """Distance of the mesh's farthest vertex from the centre of mass, in metres."""
        return float(np.max(np.linalg.norm(self.mesh.vertices - self.p_OCoM, axis=1)))

    def project(self, p_OP: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Projects points onto the allowed surface.

        Args:
            p_OP: Points in O, shape (k, 3), in metres.

        Returns:
            The nearest allowed points in O, shape (k, 3), in metres, and their outward normals,
            shape (k, 3). Of patches at the same distance, the first one counts.

        Raises:
            InvalidArgumentError: If a point is not finite.
        """
        if not np.isfinite(p_OP).all():
            raise InvalidArgumentError(f"points must be finite, not {p_OP.tolist()}")
        # A candidate is on its patch, so the nearest one bounds the distance to the surface.
        bounds, _ = self._tree.query(p_OP)
        reach = bounds * _ROUNDING + self.patch_reach
        near = self._tree.query_ball_point(p_OP, reach, return_sorted=True)
        point = np.repeat(np.arange(len(p_OP)), list(map(len, near)))
        candidates = np.fromiter(itertools.chain(*near), np.int64, len(point))
        return self._project_onto_patches(p_OP, point, candidates, bounds)

    def project_into(
        self, p_OP: FloatArray, candidates: Sequence[IntArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Projects each point onto the patches of its own candidates.

        Args:
            p_OP: Points in O, shape (k, 3), in metres.
            candidates: Indices of each point's candidates, at least one, in ascending order.

        Returns:
            Points and normals; see `project`.

        Raises:
            InvalidArgumentError: If a point is not finite, or has no candidates.
        """
        if not np.isfinite(p_OP).all():
            raise InvalidArgumentError(f"points must be finite, not {p_OP.tolist()}")
        counts = np.array(list(map(len, candidates)), dtype=np.int64)
        if not counts.all():
            raise InvalidArgumentError("a point has no candidates to be projected onto")
        if len(counts) == 0:
            return np.empty((0, 3)), np.empty((0, 3))
        point, own = np.repeat(np.arange(len(counts)), counts), np.concatenate(candidates)
        away = self.p_OQ[own] - p_OP[point]
        distances = np.sqrt(np.einsum("ij,ij->i", away, away))
        bounds = np.minimum.reduceat(distances, np.cumsum(counts) - counts)
        near = distances <= (bounds * _ROUNDING + self.patch_reach)[point]
        return self._project_onto_patches(p_OP, point[near], own[near], bounds)

    def _project_onto_patches(
        self, p_OP: FloatArray, point: IntArray, candidates: IntArray, bounds: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Projects points onto the patches of pairs of points and candidates.

        Args:
            p_OP: Points in O, shape (k, 3), in metres.
            point: Index of each pair's point, ascending, shape (p,).
            candidates: Index of each pair's candidate, ascending for each point, shape (p,).
            bounds: Upper bound of each point's distance, shape (k,), in metres.
        """
        ends = self.patch_starts[candidates + 1]
        counts = ends - self.patch_starts[candidates]
        point = np.repeat(point, counts)
        triangles = np.arange(len(point)) + np.repeat(ends - np.cumsum(counts), counts)
        away = self._triangles.centroids[triangles] - p_OP[point]
        reach = (bounds + self._triangle_radius) * _ROUNDING
        near = np.einsum("ij,ij->i", away, away) <= (reach**2)[point]
        point, triangles = point[near], triangles[near]
        closest = closest_points(self.patches[triangles], p_OP[point])
        away = closest - p_OP[point]
        squares = np.einsum("ij,ij->i", away, away)
        starts = np.searchsorted(point, np.arange(len(p_OP)))
        if len(p_OP) == 0:
            return np.empty((0, 3)), np.empty((0, 3))
        least = np.minimum.reduceat(squares, starts)
        farthest = (np.sqrt(least * (1 + TIE)) + NO_DISTANCE) ** 2
        nearest = np.flatnonzero(squares <= farthest[point])
        best = nearest[np.searchsorted(point[nearest], np.arange(len(p_OP)))]
        return closest[best], self._triangles.normals[triangles[best]]

    def nearest_candidates(self, p_OP: FloatArray) -> IntArray:
        """Returns the candidate nearest to each point of shape (k, 3), in metres, shape (k,)."""
        nearest: IntArray = self._tree.query(p_OP)[1]
        return nearest

    def candidates_within(self, p_OP: FloatArray, distance: float) -> IntArray:
        """Returns the candidates whose patches come that near to a point p_OP, or nearly, (k,)."""
        reach = (distance + self._triangle_radius) * _ROUNDING
        return np.unique(self._triangles.faces[self._triangle_tree.query_ball_point(p_OP, reach)])

    @cached_property
    def _tree(self) -> cKDTree:
        """The candidates in a search tree."""
        return cKDTree(self.p_OQ)

    @cached_property
    def _triangles(self) -> Triangles:
        """The triangles of all patches; their faces are the candidates."""
        owners = np.repeat(np.arange(len(self.p_OQ)), np.diff(self.patch_starts))
        return Triangles(self.patches, unit_normals(self.patches), owners)

    @cached_property
    def _triangle_tree(self) -> cKDTree:
        """The centroids of the triangles in a search tree."""
        return cKDTree(self._triangles.centroids)

    @cached_property
    def patch_reach(self) -> float:
        """Largest distance of a patch's corner from its candidate, in metres."""
        away = np.linalg.norm(self.patches - self.p_OQ[self._triangles.faces, None], axis=2)
        return float(np.max(away)) * _ROUNDING

    @cached_property
    def _triangle_radius(self) -> float:
        """Largest distance of a triangle's corner from its centroid, in metres."""
        return float(np.max(self._triangles.radii))

    def distance(self, p_OP: FloatArray) -> FloatArray:
        """Returns the signed distances of points from the whole surface.

        Args:
            p_OP: Positions of the points in O, shape (k, 3), in metres.

        Returns:
            Shape (k,), in metres: below zero inside the object; NaN for points that are not finite.
        """
        distances = np.empty(len(p_OP))
        triangles = self.mesh.triangles
        for index, point in enumerate(p_OP):
            away = point - closest_points(triangles, point)
            squares = np.einsum("ij,ij->i", away, away)
            if not np.all(np.isfinite(squares)):
                distances[index] = np.nan
                continue
            best = np.flatnonzero(squares <= np.min(squares) + 1e-18)
            # At an edge, the face whose plane is farthest from the point sets the sign.
            heights = np.einsum("ij,ij->i", away[best], self.mesh.face_normals[best])
            height = heights[np.argmax(np.abs(heights))]
            distances[index] = np.copysign(np.sqrt(squares[best[0]]), height)
        return distances


def closest_points(triangles: FloatArray, points: FloatArray) -> FloatArray:
    """Returns the point of each triangle that is nearest to its point, shape (k, 3).

    It is the foot of the perpendicular if the foot is inside the triangle, or else on the nearest
    edge. No absolute tolerances are used: those of trimesh are fourth powers of a length, and treat
    triangles of millimetres as points.

    Args:
        triangles: Corners a, b, c of each triangle, shape (k, 3, 3), in metres.
        points: Point for each triangle, shape (k, 3), or for all triangles, shape (3,), in metres.
    """
    away = points[..., None, :] - triangles
    edges = triangles.take((1, 2, 0), axis=1) - triangles
    squares = np.einsum("kij,kij->ki", edges, edges)
    along = np.einsum("kij,kij->ki", away, edges)
    shares = np.clip(along / np.maximum(squares, np.finfo(float).tiny), 0, 1)
    offsets = shares[:, :, None] * edges - away
    nearest_edge = np.einsum("kij,kij->ki", offsets, offsets).argmin(axis=1)
    closest: FloatArray = points + offsets[np.arange(len(offsets)), nearest_edge]
    # The foot is a + (v ab + w ac)/whole.
    ab, ac = edges[:, 0], -edges[:, 2]
    b_a, c_a = along[:, 0], np.einsum("ki,ki->k", away[:, 0], ac)
    bb, bc, cc = squares[:, 0], np.einsum("ki,ki->k", ab, ac), squares[:, 2]
    whole = bb * cc - bc * bc
    v, w = b_a * cc - c_a * bc, c_a * bb - b_a * bc
    inside = np.flatnonzero((v > 0) & (w > 0) & (v + w < whole) & (whole > FLAT_CORNER * bb * cc))
    foot = (v[inside, None] * ab[inside] + w[inside, None] * ac[inside]) / whole[inside, None]
    closest[inside] = triangles[inside, 0] + foot
    return closest
