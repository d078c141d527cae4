"""The body inside a closed mesh, with signed distances."""

from dataclasses import dataclass, replace

import numpy as np
import trimesh

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.distance_grid import CELL, DistanceGrid, distance_grid
from drake_pregrasp.geometry.solids import SignedDistance

_COARSE = 2 * CELL  # Cells of a convex hull, which only guides paths.


@dataclass(frozen=True, eq=False)
class MeshSolid(SignedDistance):
    """The body inside a closed mesh with the frame M, expressed in a frame F.

    Attributes:
        surface: Signed distances from the mesh, in M.
        around: Signed distances from its convex hull, in M; of a convex mesh, `surface`.
        corners: Vertices of the convex hull in M, shape (k, 3), in metres.
        R_FM: Orientation of M in F, shape (3, 3).
        p_FM: Position of M in F, shape (3,), in metres.
    """

    surface: DistanceGrid
    around: DistanceGrid
    corners: FloatArray
    R_FM: FloatArray
    p_FM: FloatArray

    @staticmethod
    def of(mesh: trimesh.Trimesh) -> "MeshSolid":
        """Returns the body inside a closed mesh with outward normals, in the mesh's frame.

        Args:
            mesh: The mesh, in metres.
        """
        hull, surface = mesh.convex_hull, distance_grid(mesh)
        around = surface if mesh.is_convex else distance_grid(hull, _COARSE)
        return MeshSolid(surface, around, np.array(hull.vertices), np.eye(3), np.zeros(3))

    def distance_and_gradient(self, p_FP: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `SignedDistance`."""
        distances, gradients = self.surface.at((p_FP - self.p_FM) @ self.R_FM)
        return distances, gradients @ self.R_FM.T

    def distance(self, p_FP: FloatArray) -> FloatArray:
        """See `SignedDistance`."""
        # A product of many rows by a small matrix wastes the threads of a BLAS library.
        return self.surface.distances(np.einsum("ki,ij->kj", p_FP - self.p_FM, self.R_FM))

    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "MeshSolid":
        """See `SignedDistance`."""
        return replace(self, R_FM=R_GF @ self.R_FM, p_FM=R_GF @ self.p_FM + p_GF)

    def highest(self, direction: FloatArray) -> float:
        """See `SignedDistance`."""
        return float(np.max(self.corners @ (self.R_FM.T @ direction)) + self.p_FM @ direction)

    def hull(self) -> "MeshSolid":
        """See `SignedDistance`."""
        return self if self.surface is self.around else replace(self, surface=self.around)
