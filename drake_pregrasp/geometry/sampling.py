"""Even samples of a triangulated surface, each with its own patch."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError

MAX_TRIANGLES = 1_000_000
"""Largest number of triangles of a split surface, which take about 0.3 GB and 5 s."""


@dataclass(frozen=True, eq=False)
class Triangles:
    """Small triangles that form a surface or a part of one.

    Attributes:
        corners: Corners, shape (T, 3, 3), in metres.
        normals: Outward unit normals, shape (T, 3).
        faces: Index of the face, or of the patch, that contains each triangle, shape (T,).
    """

    corners: FloatArray
    normals: FloatArray
    faces: IntArray

    @cached_property
    def centroids(self) -> FloatArray:
        """Centroids, shape (T, 3), in metres."""
        return np.asarray(np.mean(self.corners, axis=1))

    @cached_property
    def areas(self) -> FloatArray:
        """Areas, shape (T,), in m²."""
        return np.asarray(trimesh.triangles.area(self.corners))

    @cached_property
    def radii(self) -> FloatArray:
        """Distance from each centroid to its farthest corner, shape (T,), in metres."""
        away = np.linalg.norm(self.corners - self.centroids[:, None], axis=2)
        return np.asarray(np.max(away, axis=1))

    def chosen(self, which: BoolArray | IntArray) -> "Triangles":
        """Returns the triangles that a mask, shape (T,), or their indices select."""
        return Triangles(self.corners[which], self.normals[which], self.faces[which])


def split_triangles(corners: FloatArray, normals: FloatArray, longest_edge: float) -> Triangles:
    """Halves triangles across their longest edge until no edge is longer than a limit.

    Args:
        corners: Corners of the triangles, shape (F, 3, 3), in metres.
        normals: Unit normals of the triangles, shape (F, 3).
        longest_edge: Largest allowed edge, in metres.

    Raises:
        InvalidArgumentError: If there would be more than `MAX_TRIANGLES`.
    """
    area = float(np.sum(trimesh.triangles.area(corners)))
    # A triangle's area is at most half the square of its longest edge.
    if area > MAX_TRIANGLES * longest_edge**2 / 2:
        raise _too_fine(longest_edge)
    done_corners, done_faces = [np.empty((0, 3, 3))], [np.empty(0, dtype=np.int64)]
    faces, done = np.arange(len(corners)), 0
    while len(corners):
        edges = np.roll(corners, -1, axis=1) - corners
        squares = np.einsum("tij,tij->ti", edges, edges)
        longest = np.argmax(squares, axis=1)
        is_long = np.max(squares, axis=1) > longest_edge**2
        done_corners.append(corners[~is_long])
        done_faces.append(faces[~is_long])
        done += len(done_faces[-1])
        if done + 2 * int(np.sum(is_long)) > MAX_TRIANGLES:
            raise _too_fine(longest_edge)
        # With its longest edge from a to b, a triangle (a, b, c) becomes (a, m, c) and (m, b, c).
        order = (longest[is_long, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(corners[is_long], order[:, :, None], 1), 1, 0)
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
        faces = np.tile(faces[is_long], 2)
    all_faces = np.concatenate(done_faces)
    return Triangles(np.concatenate(done_corners), normals[all_faces], all_faces)


def _too_fine(longest_edge: float) -> InvalidArgumentError:
    return InvalidArgumentError(
        f"triangles with edges of at most {1e3 * longest_edge:.3g} mm would be more than"
        f" {MAX_TRIANGLES} on this surface: choose a larger spacing"
    )


def unit_normals(corners: FloatArray) -> FloatArray:
    """Returns the unit normals of triangles by their winding, shape (T, 3).

    Args:
        corners: Corners of the triangles, shape (T, 3, 3), in metres.
    """
    crosses: FloatArray = trimesh.triangles.cross(corners)
    lengths = np.linalg.norm(crosses, axis=1, keepdims=True)
    return np.asarray(crosses / np.maximum(lengths, np.finfo(float).tiny))


def lifted(points: FloatArray, normals: FloatArray, length: float) -> FloatArray:
    """Returns points with their scaled normals as three further coordinates, shape (k, 6).

    The two sides of a thin wall are then at least two lengths apart.

    Args:
        points: Positions of the points, shape (k, 3), in metres.
        normals: Unit normals at the points, shape (k, 3).
        length: Factor of the normals, in metres.
    """
    return np.hstack([points, length * normals])


def choose_evenly(
    triangles: Triangles, distance: float, generator: np.random.Generator
) -> tuple[IntArray, IntArray]:
    """Returns a maximal Poisson-disk sample of the triangles' centroids, and their owners.

    No two samples are nearer to each other than `distance`, and no further sample fits. Distances
    are between lifted points, so that each side of a thin wall has its own samples.

    Args:
        triangles: Triangles whose centroids are sampled.
        distance: Smallest distance of two samples, in metres.
        generator: Generator of the order in which triangles are tried.

    Returns:
        Ascending indices of the sampled triangles, shape (N,); and the position of the nearest
        sample in this array for each triangle, shape (T,).
    """
    points = lifted(triangles.centroids, triangles.normals, distance)
    tree = cKDTree(points)
    is_free = np.ones(len(points), dtype=bool)
    chosen = []
    for index in generator.permutation(len(points)):
        if is_free[index]:
            chosen.append(index)
            is_free[tree.query_ball_point(points[index], distance)] = False
    samples = np.sort(np.array(chosen, dtype=np.int64))
    return samples, cKDTree(points[samples]).query(points)[1]
