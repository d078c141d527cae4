"""Signed distances from the surface of a mesh, interpolated on a grid."""

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.geometry.sampling import split_triangles
from drake_pregrasp.geometry.surface import closest_points

CELL = 0.002
"""Edge length of a cell, in metres."""

MARGIN = 0.01
"""Width of the grid around the bounding box of the mesh, in metres: about a fingertip's radius."""

_MOST_NODES = 300_000  # Large objects have larger cells.
_EDGE = 0.004  # Longest edge of the parts of triangles, in metres.
_NEAREST = 8  # Parts whose distances are computed exactly, for each node.
_CHUNK = 20_000  # Nodes at a time.
_TIE = 1e-9  # Difference of distances that is rounding, in metres.
_CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


@dataclass(frozen=True, eq=False)
class DistanceGrid:
    """Signed distances from the surface of a closed mesh, in its frame M.

    Distances and gradients are exact at the nodes of a grid, and are interpolated in its cells.
    Outside the grid, the surface point nearest to the nearest place of the grid counts.

    Attributes:
        low: First node in M, shape (3,), in metres.
        cell: Edge length of a cell, in metres.
        counts: Number of nodes along x, y and z of M, shape (3,).
        nodes: Signed distance and its gradient in M at each node, in C order, shape (N, 4).
    """

    low: FloatArray
    cell: float
    counts: IntArray
    nodes: FloatArray

    def at(self, p_MP: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Returns signed distances and unit gradients; see `SignedDistance`.

        Args:
            p_MP: Positions of the points in M, shape (k, 3), in metres.
        """
        place = np.clip((p_MP - self.low) / self.cell, 0, self.counts - 1)
        first = np.minimum(place.astype(np.int64), self.counts - 2)
        share = (place - first)[:, None]
        weights = np.prod(np.where(_CORNERS, share, 1 - share), axis=2)
        i, j, k = np.moveaxis(first[:, None] + _CORNERS, 2, 0)
        index = (i * self.counts[1] + j) * self.counts[2] + k
        found = np.einsum("kc,kcv->kv", weights, self.nodes[index])
        distances, gradients = found[:, 0], found[:, 1:]
        gradients /= np.maximum(np.linalg.norm(gradients, axis=1, keepdims=True), 1e-9)
        clipped = self.low + self.cell * place
        beyond = np.flatnonzero(np.any(np.abs(clipped - p_MP) > _TIE, axis=1))
        if len(beyond):
            nearest = clipped[beyond] - distances[beyond, None] * gradients[beyond]
            away = p_MP[beyond] - nearest
            distances[beyond] = np.linalg.norm(away, axis=1)
            gradients[beyond] = away / distances[beyond, None]
        return distances, gradients


def distance_grid(mesh: trimesh.Trimesh, cell: float = CELL) -> DistanceGrid:
    """Returns the signed distances of a closed mesh with outward normals.

    Args:
        mesh: The mesh, in metres; its frame is M.
        cell: Least edge length of a cell, in metres.
    """
    extents = mesh.extents + 2 * MARGIN
    cell = max(cell, float(np.cbrt(np.prod(extents) / _MOST_NODES)))
    counts = np.ceil(extents / cell).astype(np.int64) + 1
    low = mesh.bounds.mean(axis=0) - cell * (counts - 1) / 2
    points = low + cell * np.indices(counts).reshape(3, -1).T
    parts = split_triangles(np.array(mesh.triangles), np.array(mesh.face_normals), _EDGE)
    parts = parts.chosen(parts.areas > 0)
    tree, count = cKDTree(parts.centroids), min(_NEAREST, len(parts.faces))
    nodes = np.empty((len(points), 4))
    for start in range(0, len(points), _CHUNK):
        p = points[start : start + _CHUNK]
        near = tree.query(p, k=count)[1].reshape(len(p), count)
        q = closest_points(parts.corners[near.ravel()], np.repeat(p, count, axis=0))
        away = p[:, None] - q.reshape(len(p), count, 3)
        lengths = np.linalg.norm(away, axis=2)
        # At an edge, the face whose plane is farthest from the point sets the sign.
        normals = parts.normals[near]
        heights = np.einsum("kni,kni->kn", away, normals)
        tied = lengths <= np.min(lengths, axis=1, keepdims=True) + _TIE
        best = np.argmax(np.where(tied, np.abs(heights), -1.0), axis=1)[:, None]
        length, height = (np.take_along_axis(v, best, axis=1) for v in (lengths, heights))
        distance = np.copysign(length, height)
        toward = np.take_along_axis(away, best[..., None], axis=1)[:, 0] * np.sign(distance)
        normal = np.take_along_axis(normals, best[..., None], axis=1)[:, 0]
        gradient = np.where(length > _TIE, toward / np.maximum(length, _TIE), normal)
        nodes[start : start + _CHUNK] = np.hstack([distance, gradient])
    return DistanceGrid(low, cell, counts, nodes)
