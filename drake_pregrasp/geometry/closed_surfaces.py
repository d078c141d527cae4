"""Closed surfaces of a mesh: bodies, and cavities in them."""

import itertools

import numpy as np
import trimesh

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.errors import InvalidArgumentError

MAX_COMPONENTS = 100
"""Largest number of closed surfaces of a mesh."""

MAX_PAIRS = 20_000_000
"""Largest number of pairs of a point and a triangle from closed surfaces whose bounding boxes
overlap: ten million pairs take two to four seconds."""

_CHUNK = 2_000_000  # Pairs of a point and a triangle in one vectorized step.


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
    parts = [triangles[labels == part] for part in range(count)]
    bounds = [(part.min(axis=(0, 1)), part.max(axis=(0, 1))) for part in parts]
    depths = np.zeros(count, dtype=np.int64)
    points = [np.unique(part.reshape(-1, 3), axis=0) for part in parts if count > 1]
    near: dict[tuple[int, int], BoolArray] = {}
    for inner, outer in itertools.permutations(range(len(points)), 2):
        low, high = bounds[outer]
        near[inner, outer] = np.all((low <= points[inner]) & (points[inner] <= high), axis=1)
    pairs = sum(int(np.sum(is_near)) * len(parts[outer]) for (_, outer), is_near in near.items())
    if pairs > MAX_PAIRS:
        raise InvalidArgumentError(
            f"{what} has closed surfaces in each other with {pairs} pairs of a point and a"
            f" triangle; at most {MAX_PAIRS}, simplify it or leave out its cavities"
        )
    for (inner, outer), is_near in near.items():
        inside = is_inside(points[inner][is_near], parts[outer])
        is_within = np.all(inside) and np.all(is_near)
        if np.any(inside) and not is_within:
            raise InvalidArgumentError(
                f"{what} has closed surfaces that cross; `drake-pregrasp mesh repair` unites them"
            )
        depths[inner] += bool(is_within)
    volumes = np.bincount(labels, weights=np.linalg.det(triangles), minlength=count)
    flipped = ((volumes > 0) != (depths % 2 == 0))[labels]
    if np.any(flipped):
        mesh.faces = np.where(flipped[:, None], mesh.faces[:, ::-1], mesh.faces)


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
