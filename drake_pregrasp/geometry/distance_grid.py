"""Signed distances from the surface of a mesh, interpolated on a grid."""

import itertools
from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.geometry.sampling import split_triangles
from drake_pregrasp.geometry.surface import closest_points

CELL = 0.002
"""Edge length of a cell, in metres."""

MARGIN = 0.01
"""Width of the grid around the bounding box of the mesh, in metres: about a fingertip's radius."""

TIE = 1e-9
"""Difference of distances that is rounding, in metres."""

_MOST_NODES = 300_000  # Large objects have larger cells.
_EDGE = 0.005  # Longest edge of the parts of triangles in the smallest cells, in metres.
_CHUNK = 20_000  # Nodes at a time.
_CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


@dataclass(frozen=True, eq=False)
class DistanceGrid:
    """Signed distances from the surface of a closed mesh, in its frame M.

    Distances and gradients are those of the nearest face at the nodes of a grid, which is found
    from neighbour to neighbour, and are interpolated in its cells.
    Outside the grid, the surface points nearest to the nodes of the nearest cell count. Inside of
    walls thinner than a cell, distances are above zero.

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

        They are NaN for points that are not finite.

        Args:
            p_MP: Positions of the points in M, shape (k, 3), in metres.
        """
        first, share, is_beyond = self._cells(p_MP)
        x, y, z = np.stack([1 - share, share], axis=2).swapaxes(0, 1)
        weights = (x[:, :, None, None] * y[:, None, :, None] * z[:, None, None, :]).reshape(-1, 8)
        found = (weights[:, None] @ self._corners(first)[1])[:, 0]
        distances, gradients = found[:, 0], found[:, 1:]
        lengths = np.sqrt(np.einsum("ki,ki->k", gradients, gradients))
        gradients /= np.maximum(lengths, 1e-9)[:, None]
        if is_beyond.any():
            distances[is_beyond], gradients[is_beyond] = self._beyond(
                p_MP[is_beyond], first[is_beyond]
            )
        return distances, gradients

    def distances(self, p_MP: FloatArray) -> FloatArray:
        """Returns the signed distances of `at` alone, in less time for many points.

        Args:
            p_MP: Positions of the points in M, shape (k, 3), in metres.
        """
        # One row for each axis, whose passes over many points take least time.
        places = np.subtract(p_MP.T, self.low[:, None], order="C")
        places /= self.cell
        last, tie = self.counts[:, None] - 1.0, TIE / self.cell
        is_within = np.logical_and.reduce((places >= -tie) & (places <= last + tie), axis=0)
        field = self.nodes[:, 0].reshape(self.counts)
        distances: FloatArray = map_coordinates(field, places, order=1, mode="nearest")
        if not is_within.all():
            beyond = p_MP[~is_within]
            distances[~is_within], _ = self._beyond(beyond, self._cells(beyond)[0])
        return distances

    def _cells(self, p_MP: FloatArray) -> tuple[IntArray, FloatArray, BoolArray]:
        """Returns the first nodes of the nearest cells, places in them, and who is not in them.

        The places are shares of the cells, shape (k, 3).
        """
        place = (p_MP - self.low) / self.cell
        within = np.minimum(np.fmax(place, 0.0), self.counts - 1.0)  # 0 for NaN.
        is_beyond = ~(np.abs(within - place).max(axis=1, initial=0.0) <= TIE / self.cell)
        first = np.minimum(within.astype(np.int64), self.counts - 2)
        return first, within - first, is_beyond

    def _corners(self, first: IntArray) -> tuple[FloatArray, FloatArray]:
        """Returns positions, shape (k, 8, 3), and values, shape (k, 8, 4), of the cells' nodes."""
        strides = np.array([self.counts[1] * self.counts[2], self.counts[2], 1])
        p_MN = self.low + self.cell * (first[:, None] + _CORNERS)
        return p_MN, self.nodes[(first @ strides)[:, None] + _CORNERS @ strides]

    def _beyond(self, p_MP: FloatArray, first: IntArray) -> tuple[FloatArray, FloatArray]:
        """Returns distances and gradients from the surface points nearest to the cells' nodes."""
        p_MN, nodes = self._corners(first)
        away = p_MP[:, None] - (p_MN - nodes[..., :1] * nodes[..., 1:])
        away[~np.isfinite(p_MP).all(axis=1)] = np.nan
        lengths = np.linalg.norm(away, axis=2)
        nearest = np.arange(len(away)), np.argmin(lengths, axis=1)
        distances = lengths[nearest]
        return distances, away[nearest] / distances[:, None]


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
    p = low + cell * np.indices(counts).reshape(3, -1).T
    corners, normals = np.array(mesh.triangles), np.array(mesh.face_normals)
    edge = _EDGE * max(1.0, cell / CELL)
    parts = split_triangles(corners, normals, edge)
    # Long thin faces have many more parts than their size needs: one for each of them and place.
    places = np.column_stack([parts.faces, np.round(parts.centroids / (edge / 4))])
    parts = parts.chosen(np.unique(places, axis=0, return_index=True)[1])
    # Nodes of the tree that fill space, rather than bound its points, take half the time here.
    tree = cKDTree(parts.centroids, compact_nodes=False, leafsize=32)
    face = parts.faces[tree.query(p, workers=-1)[1]]
    away = np.empty((len(p), 3))
    for chunk in np.array_split(np.arange(len(p)), 1 + len(p) // _CHUNK):
        away[chunk] = p[chunk] - closest_points(corners[face[chunk]], p[chunk])
    # The face with the nearest centroid is not always the nearest one. What a node has found, its
    # neighbours try next.
    is_new = np.ones(len(p), dtype=bool)
    strides = (counts[1] * counts[2], counts[2], 1)
    for _ in range(int(np.sum(counts))):  # A face comes as far as through the whole grid.
        before = face.copy()
        new = np.flatnonzero(is_new)
        place = np.array(np.unravel_index(new, counts))
        for axis, step in itertools.product(range(3), (1, -1)):
            has_neighbour = (place[axis] + step >= 0) & (place[axis] + step < counts[axis])
            source = new[has_neighbour]
            nodes, tried = source + step * strides[axis], face[source]
            differs = tried != face[nodes]
            nodes, tried = nodes[differs], tried[differs]
            found = p[nodes] - closest_points(corners[tried], p[nodes])
            is_better = _is_nearer(found, normals[tried], away[nodes], normals[face[nodes]])
            nodes = nodes[is_better]
            face[nodes], away[nodes] = tried[is_better], found[is_better]
        is_new = face != before
        if not is_new.any():
            break
    lengths = np.linalg.norm(away, axis=1)
    signs = np.where(np.einsum("ki,ki->k", away, normals[face]) < 0, -1.0, 1.0)
    gradients = np.where(lengths[:, None] > TIE, away * signs[:, None], normals[face])
    gradients /= np.linalg.norm(gradients, axis=1, keepdims=True)
    return DistanceGrid(low, cell, counts, np.column_stack([signs * lengths, gradients]))


def _is_nearer(
    away: FloatArray, normals: FloatArray, than: FloatArray, than_normals: FloatArray
) -> BoolArray:
    """Returns whether a face is nearer than another, by vectors from faces to points, (k,).

    At an edge, the face whose plane is farthest from the point counts: it has the right sign.
    """
    gain = np.linalg.norm(than, axis=1) - np.linalg.norm(away, axis=1)
    height = np.abs(np.einsum("ki,ki->k", away, normals))
    other = np.abs(np.einsum("ki,ki->k", than, than_normals))
    nearer: BoolArray = (gain > TIE) | (gain >= -TIE) & (height > other + TIE)
    return nearer
