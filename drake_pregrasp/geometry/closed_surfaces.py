"""Closed surfaces of a mesh: bodies, and cavities in them."""

import itertools

import numpy as np
import trimesh

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError

MAX_COMPONENTS = 100
"""Largest number of closed surfaces of a mesh."""

MAX_PAIRS = 20_000_000
"""Largest number of pairs of a point and a triangle from closed surfaces whose bounding boxes
overlap: ten million pairs take two to four seconds."""

_CHUNK = 2_000_000  # Pairs of a point and a triangle in one vectorized step.
_DEPTH = 1e-6  # Surfaces that are less deep in each other only touch, in metres.


def orient_components(mesh: trimesh.Trimesh, what: str) -> None:
    """Orients the closed surfaces of a mesh in place, with normals out of the material.

    A surface inside another surface is a cavity, a surface inside a cavity is solid, and so on.

    Args:
        mesh: Watertight mesh, each of whose closed surfaces has a consistent winding.
        what: Name of the mesh in errors.

    Raises:
        InvalidArgumentError: If two surfaces cross, or if there are too many surfaces or pairs.
    """
    labels = trimesh.graph.connected_component_labels(mesh.face_adjacency, len(mesh.faces))
    count = int(np.max(labels)) + 1
    if count > MAX_COMPONENTS:
        raise InvalidArgumentError(
            f"{what} has {count} closed surfaces; at most {MAX_COMPONENTS}, unite them"
        )
    triangles = np.array(mesh.triangles)
    volumes = np.bincount(labels, weights=np.linalg.det(triangles), minlength=count)
    parts = [triangles[labels == part] for part in range(count)]
    bounds = [(part.min(axis=(0, 1)), part.max(axis=(0, 1))) for part in parts]
    depths = np.zeros(count, dtype=np.int64)
    shrunk = [_shrunk(*each) for each in zip(parts, volumes, strict=True) if count > 1]
    near: dict[tuple[int, int], BoolArray] = {}
    for inner, outer in itertools.permutations(range(len(shrunk)), 2):
        points, edges = shrunk[inner]
        low, high = bounds[outer]
        ends = points[edges]
        is_near = np.all((low <= ends.max(axis=1)) & (ends.min(axis=1) <= high), axis=1)
        near[inner, outer] = is_near
    pairs = sum(
        len(np.unique(shrunk[inner][1][is_near])) * len(parts[outer])
        for (inner, outer), is_near in near.items()
    )
    if pairs > MAX_PAIRS:
        raise InvalidArgumentError(
            f"{what} has closed surfaces in each other with {pairs} pairs of a point and a"
            f" triangle; at most {MAX_PAIRS}, simplify it or leave out its cavities"
        )
    for (inner, outer), is_near in near.items():
        points, edges = shrunk[inner]
        used, nearby = np.unique(edges[is_near], return_inverse=True)
        inside = is_inside(points[used], parts[outer])
        is_within = np.all(inside) and len(used) == len(points)
        crosses = np.any(inside) and not is_within
        if crosses or _pierces(points[used], nearby.reshape(-1, 2), parts[outer]):
            raise InvalidArgumentError(
                f"{what} has closed surfaces that cross; `drake-pregrasp mesh repair` unites them"
            )
        depths[inner] += bool(is_within)
    flipped = ((volumes > 0) != (depths % 2 == 0))[labels]
    if np.any(flipped):
        mesh.faces = np.where(flipped[:, None], mesh.faces[:, ::-1], mesh.faces)


def _shrunk(triangles: FloatArray, volume: float) -> tuple[FloatArray, IntArray]:
    """Returns the points of a closed surface, a little inside it, and its edges as their indices.

    Points of surfaces that only touch each other then lie clearly outside.
    """
    points, corners = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    corners = corners.reshape(-1, 3)
    a, b, c = np.moveaxis(triangles, 1, 0)
    normals = np.zeros(points.shape)
    np.add.at(normals, corners, np.cross(b - a, c - a)[:, None] * np.sign(volume))
    lengths = np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    edges = np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return points - _DEPTH * normals / lengths, np.unique(edges, axis=0)


def _pierces(points: FloatArray, edges: IntArray, triangles: FloatArray) -> bool:
    """Returns whether an edge between two points pierces a triangle, or touches its sides."""
    step = max(1, _CHUNK // max(1, len(points)))
    for start in range(0, len(triangles), step):
        part = triangles[start : start + step]
        normals = np.cross(part[:, 1] - part[:, 0], part[:, 2] - part[:, 0])
        is_above = points @ normals.T > np.einsum("fi,fi->f", normals, part[:, 0])
        edge, face = np.nonzero(is_above[edges[:, 0]] != is_above[edges[:, 1]])
        p, q = np.moveaxis(points[edges[edge]], 1, 0)
        corners = part[face] - p[:, None]
        # Volumes of the tetrahedra of the edge with each side of the triangle.
        sides = np.cross(corners, np.roll(corners, -1, axis=1))
        volumes = np.einsum("ki,ksi->ks", q - p, sides)
        rounding = 1e-12 * np.abs(volumes).max(axis=1, keepdims=True, initial=0.0)
        if np.any(np.all(volumes >= -rounding, axis=1) | np.all(volumes <= rounding, axis=1)):
            return True
    return False


def is_inside(points: FloatArray, triangles: FloatArray) -> BoolArray:
    """Returns the mask of points inside a closed surface of either orientation, shape (k,).

    The solid angles of its triangles add up to 4 pi, or -4 pi, for points inside, to 0 for others
    (van Oosterom & Strackee, 1983, give the solid angle of a triangle).

    Args:
        points: Points, shape (k, 3), in metres.
        triangles: Triangles of the surface, shape (F, 3, 3), in metres.
    """
    total = np.zeros(len(points))
    step = max(1, _CHUNK // max(1, len(triangles)))
    for start in range(0, len(points), step):
        a, b, c = np.moveaxis(triangles - points[start : start + step, None, None], 2, 0)
        la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
        numerator = np.einsum("kfi,kfi->kf", a, np.cross(b, c))
        denominator = la * lb * lc
        for u, v, length in ((a, b, lc), (b, c, la), (c, a, lb)):
            denominator += np.einsum("kfi,kfi->kf", u, v) * length
        total[start : start + step] = 2 * np.sum(np.arctan2(numerator, denominator), axis=1)
    return np.abs(total) > 2 * np.pi
