"""Points that are projected onto a surface again and again within a tick."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.sampling import unit_normals
from drake_pregrasp.kernels import (
    Ground,
    Partition,
    TickKernel,
    closest_points,
    make_kernel,
)

CONTACT_TOLERANCE = 1e-4
"""Farthest a contact may be off the surface to count as on it, in metres."""


@dataclass(frozen=True, eq=False)
class ForbiddenPoints:
    """Points Z that contacts keep away from (the obstacles of Eq. 1).

    Attributes:
        points: z_j, shape (m, d), in metres, d = 3 unless Eq. 1 is used over more coordinates; the
            frame is named by whoever holds them.
        radii: R_j of Eq. 2, shape (m,), in metres.
        normals: Outward unit normals of the ground they stand for, shape (m, d); zero, as by
            default, for points that stand for none.
    """

    points: FloatArray
    radii: FloatArray
    normals: FloatArray = None  # type: ignore[assignment]  # Made of the points' shape.

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] < 1:
            raise InvalidArgumentError(f"points must have shape (m, 3), not {self.points.shape}")
        if self.radii.shape != (len(self.points),) or not np.all(self.radii >= 0):
            raise InvalidArgumentError("radii must be one number >= 0 for each forbidden point")
        if self.normals is None:
            object.__setattr__(self, "normals", np.zeros(self.points.shape))
        if self.normals.shape != self.points.shape:
            raise InvalidArgumentError("normals must be one for each forbidden point")

    def __len__(self) -> int:
        return len(self.points)

    @staticmethod
    def none() -> "ForbiddenPoints":
        """Returns an empty set."""
        return ForbiddenPoints(np.empty((0, 3)), np.empty(0))

    def joined(self, other: "ForbiddenPoints") -> "ForbiddenPoints":
        """Returns the union with `other`, which is in the same frame."""
        return ForbiddenPoints(
            np.concatenate([self.points, other.points]),
            np.concatenate([self.radii, other.radii]),
            np.concatenate([self.normals, other.normals]),
        )


@dataclass(frozen=True, eq=False)
class ObjectSurface:
    """Where contacts may be on an object O, in its frame.

    The allowed surface is divided into patches of triangles, one for each candidate, so that a
    point can be projected onto the ground of some candidates only. The arrays are never written to
    after construction: one surface serves many systems.

    Attributes:
        p_OQ: Candidate points q of Y, shape (N, 3), in metres.
        nhat_OQ: Outward unit normals at the candidates, shape (N, 3).
        areas: Surface area each candidate stands for, shape (N,), in m².
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
    _ground: Ground = field(init=False, repr=False)
    _triangle_normals: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_ground", Ground(self.p_OQ, self.patches, self.patch_starts))
        object.__setattr__(self, "_triangle_normals", unit_normals(self.patches))

    @cached_property
    def is_clear_of_forbidden_points(self) -> BoolArray:
        """Which candidates are out of the balls R_j around the forbidden points, shape (N,)."""
        clear = np.ones(len(self.p_OQ), dtype=bool)
        for radius in np.unique(self.forbidden.radii):
            points = self.forbidden.points[self.forbidden.radii == radius]
            distances, _ = cKDTree(points).query(self.p_OQ)
            clear &= distances > radius
        return clear

    @cached_property
    def kernel(self) -> TickKernel:
        """What finds regions and centroids over the candidates fast; made when first asked for."""
        return make_kernel(self.p_OQ, self.nhat_OQ, self.areas, self.p_OCoM)

    @property
    def longest_lever_arm(self) -> float:
        """Distance of the mesh's farthest vertex from the centre of mass, in metres."""
        return float(np.max(np.linalg.norm(self.mesh.vertices - self.p_OCoM, axis=1)))

    def project(self, p_OP: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Projects points onto the allowed surface.

        Args:
            p_OP: Points in O, shape (k, 3), in metres.

        Returns:
            The nearest allowed points, shape (k, 3), and the outward normals there, shape (k, 3).
            Between patches at the same distance the one that comes first is taken.
        """
        if len(p_OP) == 0:
            return np.empty((0, 3)), np.empty((0, 3))
        nearest, which = self.kernel.project(p_OP, self._ground)
        return nearest, self._triangle_normals[which]

    def project_into(
        self, p_OP: FloatArray, candidates: Sequence[IntArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Projects each point onto the ground of its own candidates.

        Args:
            p_OP: Points in O, shape (k, 3), in metres.
            candidates: For each point the indices of one candidate or more.

        Returns:
            As `project` does.
        """
        if len(p_OP) == 0:
            return np.empty((0, 3)), np.empty((0, 3))
        near = self._ground.near_of(p_OP, candidates)
        nearest, which = self.kernel.nearest_on_triangles(p_OP, near, self._ground.patches)
        return nearest, self._triangle_normals[which]

    def project_onto_regions(
        self, p_OP: FloatArray, partition: Partition, contacts: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Projects each point onto the ground of one contact's region.

        Args:
            p_OP: Points in O, shape (k, 3), in metres.
            partition: Of the surface's `kernel`.
            contacts: For each point the index of a contact whose region isn't empty, shape (k,).

        Returns:
            As `project` does.
        """
        nearest, which = self.kernel.project_onto_regions(p_OP, partition, contacts, self._ground)
        return nearest, self._triangle_normals[which]

    def candidates_within(self, p_OP: FloatArray, distance: float) -> IntArray:
        """Returns the candidates whose patches come that near to a point p_OP, or nearly, (k,)."""
        return self._ground.owners_within(p_OP, distance)

    def distance(self, p_OP: FloatArray) -> FloatArray:
        """Returns the signed distances of points in O from the whole surface.

        Args:
            p_OP: Shape (k, 3), in metres.

        Returns:
            Shape (k,), in metres: below zero inside the object; NaN for points that aren't finite.
        """
        distances = np.empty(len(p_OP))
        triangles = self.mesh.triangles
        for index, point in enumerate(p_OP):
            nearest = closest_points(triangles, np.tile(point, (len(triangles), 1)))
            away = point - nearest
            squares = np.einsum("ij,ij->i", away, away)
            if not np.all(np.isfinite(squares)):
                distances[index] = np.nan
                continue
            best = np.flatnonzero(squares <= np.min(squares) + 1e-18)
            # At an edge the face that is seen best tells in from out.
            heights = np.einsum("ij,ij->i", away[best], self.mesh.face_normals[best])
            height = heights[np.argmax(np.abs(heights))]
            distances[index] = np.copysign(np.sqrt(squares[best[0]]), height)
        return distances


class RememberedProjection:
    """Projects points as `ObjectSurface.project` does, but the same point only once.

    Args:
        surface: Onto which.
    """

    def __init__(self, surface: ObjectSurface) -> None:
        self._surface = surface
        self._known: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def __call__(self, p_OP: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Returns the nearest allowed points and the outward normals there, each (k, 3)."""
        keys = [point.tobytes() for point in p_OP]
        new = [index for index, key in enumerate(keys) if key not in self._known]
        if new:
            found = zip(*self._surface.project(p_OP[new]), strict=True)
            self._known.update(zip((keys[index] for index in new), found, strict=True))
        if not keys:
            return np.empty((0, 3)), np.empty((0, 3))
        points, normals = zip(*(self._known[key] for key in keys), strict=True)
        return np.array(points), np.array(normals)
