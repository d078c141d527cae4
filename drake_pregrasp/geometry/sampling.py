"""Even samples of a triangulated surface, each with the patch that it stands for."""

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError

MAX_TRIANGLES = 2_000_000
"""How many small triangles a surface may be split into: they need some 0.6 GB."""


@dataclass(frozen=True, eq=False)
class Triangles:
    """Small triangles that together are a surface, or a part of one.

    Attributes:
        corners: Shape (T, 3, 3), in metres.
        normals: Outward unit normals, shape (T, 3).
        faces: Index of the mesh's face that each is a piece of, shape (T,).
    """

    corners: FloatArray
    normals: FloatArray
    faces: IntArray

    @property
    def centroids(self) -> FloatArray:
        """Shape (T, 3), in metres."""
        centroids: FloatArray = np.mean(self.corners, axis=1)
        return centroids

    @property
    def areas(self) -> FloatArray:
        """Shape (T,), in m²."""
        areas: FloatArray = trimesh.triangles.area(self.corners)
        return areas

    @property
    def radii(self) -> FloatArray:
        """Distance from each centroid to its farthest corner, shape (T,), in metres."""
        away = np.linalg.norm(self.corners - self.centroids[:, None], axis=2)
        radii: FloatArray = np.max(away, axis=1)
        return radii

    def chosen(self, mask: BoolArray) -> "Triangles":
        """Returns those of a mask, shape (T,)."""
        return Triangles(self.corners[mask], self.normals[mask], self.faces[mask])


def split_triangles(corners: FloatArray, normals: FloatArray, longest_edge: float) -> Triangles:
    """Halves triangles across their longest edge until no edge is longer than a limit.

    Args:
        corners: Shape (F, 3, 3), in metres.
        normals: Shape (F, 3).
        longest_edge: The limit, in metres.

    Raises:
        InvalidArgumentError: If that would take too many triangles.
    """
    area = float(np.sum(trimesh.triangles.area(corners)))
    if area > MAX_TRIANGLES * longest_edge**2 / 2:  # None is larger than half a square of its edge.
        raise _too_fine(longest_edge)
    done_corners, done_faces = [], []
    faces = np.arange(len(corners))
    done = 0
    while len(corners):
        edges = np.roll(corners, -1, axis=1) - corners
        squares = np.einsum("tij,tij->ti", edges, edges)
        longest = np.argmax(squares, axis=1)
        is_long = squares[np.arange(len(corners)), longest] > longest_edge**2
        done_corners.append(corners[~is_long])
        done += int(np.sum(~is_long))
        done_faces.append(faces[~is_long])
        if done + 2 * int(np.sum(is_long)) > MAX_TRIANGLES:
            raise _too_fine(longest_edge)
        # With its longest edge from a to b, a triangle (a, b, c) becomes (a, m, c) and (m, b, c).
        order = (longest[is_long, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(corners[is_long], order[:, :, None], 1), 1, 0)
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
        faces = np.tile(faces[is_long], 2)
    all_faces = np.concatenate(done_faces) if done_faces else np.empty(0, dtype=np.int64)
    all_corners = np.concatenate(done_corners) if done_corners else np.empty((0, 3, 3))
    return Triangles(all_corners, normals[all_faces], all_faces)


def _too_fine(longest_edge: float) -> InvalidArgumentError:
    return InvalidArgumentError(
        f"triangles with edges of at most {1e3 * longest_edge:.3g} mm would be more than"
        f" {MAX_TRIANGLES} on this surface: choose a larger spacing"
    )


def unit_normals(corners: FloatArray) -> FloatArray:
    """Returns the unit normals of triangles, shape (T, 3, 3), by their winding, shape (T, 3)."""
    crosses: FloatArray = trimesh.triangles.cross(corners)
    lengths = np.linalg.norm(crosses, axis=1, keepdims=True)
    normals: FloatArray = crosses / np.maximum(lengths, np.finfo(float).tiny)
    return normals


def lifted(points: FloatArray, normals: FloatArray, length: float) -> FloatArray:
    """Returns points with their normals, times a length, as three more coordinates, shape (k, 6).

    Distances between lifted points tell the two sides of a thin wall apart, which are two lengths
    away from each other at least.

    Args:
        points: Shape (k, 3), in metres.
        normals: Unit normals, shape (k, 3).
        length: In metres.
    """
    return np.hstack([points, length * normals])


def choose_evenly(
    triangles: Triangles, distance: float, generator: np.random.Generator
) -> tuple[IntArray, IntArray]:
    """Chooses triangles whose centroids are spread evenly: a Poisson-disk sample.

    No two are nearer to each other than `distance`, and none could be added. Distance is between
    lifted points, so that each face and each side of a wall gets its own.

    Args:
        triangles: What to choose from.
        distance: In metres.
        generator: Says in which order triangles are offered.

    Returns:
        The indices of the chosen, shape (N,), ascending; and for each triangle the place in
        them of the one nearest to it, shape (T,).
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
    _, owners = cKDTree(points[samples]).query(points)
    return samples, owners
