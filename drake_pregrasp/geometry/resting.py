"""Poses in which a body rests on a table, and the flat sides on which it stands."""

from typing import NamedTuple

import numpy as np
import scipy.linalg
import trimesh
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.resources import require_packages

MAX_HULL_TRIANGLES = 10_000
"""Largest number of triangles of a convex hull whose probable poses are searched: a few seconds."""

FIRM = np.radians(1.0)
"""Least angle of a tilt out of a firm resting pose, in radians: less is lost by a jerk."""

TIPPING = np.radians(8.0)
"""Least tilt that tips a body over the edge of a face on which it stands, in radians."""

_COS_SAME = np.cos(np.radians(1.0))  # Cosine of the largest angle between normals of one face.
_FLATNESS = 1e-3  # Largest depth of a vertex of a face below it, over the body's extent.
_LEVEL = 1e-6  # Ratio of a height to the body's extent up to which a vertex is on the table.
_EQUAL = 1e-3  # Difference of probabilities that are equal.
_SAME_HEIGHT = 5e-3  # Difference of heights that are equal, over the largest height.
_DIGITS = 6  # Decimals of compared directions: rounding must not choose between equal ones.
_MOST_TIPS = 10_000  # Largest number of edges and vertices over which a body tips.


def settled_rotation(mesh: trimesh.Trimesh) -> FloatArray:
    """Returns the rotation by which a body on a table tips until it rests, shape (3, 3).

    The body tips slowly and without sliding over the edge or vertex of its support polygon that is
    nearest to the vertical through its centre of mass, until another vertex touches the table. It
    rests if the vertical passes through the support polygon, and a tilt by `FIRM` over no edge
    leads to a lower pose. If it rests at the start, the rotation is the identity.

    Args:
        mesh: Closed surface of the homogeneous body, in a frame whose z axis points up.
    """
    p = np.array(mesh.convex_hull.vertices) - mesh.center_mass
    level = _LEVEL * float(np.max(np.ptp(p, axis=0)))
    R: FloatArray = np.eye(3)
    for _ in range(_MOST_TIPS):
        tipped = p @ R.T
        low = float(np.min(tipped[:, 2]))
        on_table = tipped[:, 2] <= low + level
        for direction, inside in _tips(tipped[on_table, :2], -low * np.tan(FIRM)):
            ahead = tipped[~on_table, :2] @ direction - inside
            angle = float(np.min(np.arctan2(tipped[~on_table, 2] - low, ahead)))
            tip = Rotation.from_rotvec(angle * np.array([-direction[1], direction[0], 0.0]))
            if inside < 0 or np.min(tip.apply(tipped)[:, 2]) > low + level:
                R = tip.as_matrix() @ R
                break
        else:
            break
    return R


def _tips(support: FloatArray, firm: float) -> list[tuple[FloatArray, float]]:
    """Returns the ways in which a body tips: horizontal unit vectors, and lengths in metres.

    A length says how far the vertical is inside the support polygon; below zero, it is outside.

    Args:
        support: Vertices of the support polygon, relative to the vertical, shape (k, 2), in metres.
        firm: Distance to an edge from which the body does not tip over it, in metres.
    """
    middle = support - np.mean(support, axis=0)
    start = support[np.argsort(np.arctan2(middle[:, 1], middle[:, 0]))]
    edges = np.roll(start, -1, axis=0) - start
    squares = np.maximum(np.sum(edges**2, axis=1), np.finfo(float).tiny)  # Of one vertex, 0.
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.sqrt(squares)[:, None]
    inside = np.sum(normals * start, axis=1)
    if len(support) > 2 and np.all(inside >= 0):
        order = np.argsort(inside, kind="stable")
        return [(normals[i], float(inside[i])) for i in order if inside[i] < firm]
    shares = np.clip(-np.sum(start * edges, axis=1) / squares, 0, 1)
    feet = start + shares[:, None] * edges
    distances = np.linalg.norm(feet, axis=1)
    nearest = int(np.argmin(distances))
    if distances[nearest] > 0:
        return [(-feet[nearest] / distances[nearest], -float(distances[nearest]))]
    return [(normals[nearest] if len(support) > 1 else np.array([1.0, 0.0]), 0.0)]


def stable_rotation(mesh: trimesh.Trimesh) -> FloatArray:
    """Returns the rotation of a body to its most probable resting pose, shape (3, 3).

    The probability is that of a slow drop from a random orientation (Goldberg et al., 1999). Poses
    with the centre of mass at the same height count together, as on the facets of a round side. Of
    those that are equally probable then, the most probable facet at the smallest angle is chosen.
    If it is not firm, the body tips on from there, as `settled_rotation` says.

    Args:
        mesh: Closed surface of the homogeneous body, in a frame whose z axis points up.

    Raises:
        InvalidArgumentError: If a package of the extra `meshes` is not installed, or the convex
            hull has too many triangles.
    """
    require_packages("networkx", extra="meshes", purpose="rest: stable")
    hull = mesh.convex_hull
    if (count := len(hull.faces)) > MAX_HULL_TRIANGLES:
        raise InvalidArgumentError(
            f"rest: stable is for convex hulls of at most {MAX_HULL_TRIANGLES} triangles, not"
            f" {count}; simplify the mesh"
        )
    poses, probabilities = trimesh.poses.compute_stable_poses(mesh, seed=0)
    heights = poses[:, 2] @ np.append(mesh.center_mass, 1.0)
    is_same = np.abs(heights[:, None] - heights) <= _SAME_HEIGHT * np.max(heights)
    totals = is_same @ probabilities
    is_best = totals >= np.max(totals) - _EQUAL
    is_best &= probabilities >= np.max(probabilities[is_best]) - _EQUAL
    up = poses[is_best, 2, :3]
    rotation, _ = Rotation.align_vectors(
        [[0.0, 0.0, 1.0]], up[[np.argmax(np.round(up[:, 2], _DIGITS))]]
    )
    turned = trimesh.Trimesh(rotation.apply(mesh.vertices), mesh.faces, process=False)
    R: FloatArray = settled_rotation(turned) @ rotation.as_matrix()
    return R


class FlatSide(NamedTuple):
    """Face of a body's convex hull on which it stands.

    Attributes:
        nhat: Outward unit normal in O, shape (3,).
        p_OV: Three or four of its vertices, far apart, in O, shape (k, 3), in metres.
    """

    nhat: FloatArray
    p_OV: FloatArray


def flat_sides(corners: FloatArray, p_OCoM: FloatArray) -> list[FlatSide]:
    """Returns the faces on which a body stands, and does not tip over before a tilt of `TIPPING`.

    Facets whose normals differ by a degree or less are one face, so that vertices may be rounded.
    The facets of a round mesh with 23 of them or more, on which it rolls, tip earlier.

    Args:
        corners: Vertices of the convex hull in O, shape (k, 3), in metres.
        p_OCoM: Centre of mass in O, inside the hull, shape (3,), in metres.
    """
    p = corners - p_OCoM
    hull, level = ConvexHull(p), _FLATNESS * float(np.max(np.ptp(p, axis=0)))
    a, b, c = np.moveaxis(p[hull.simplices], 1, 0)
    largest_first = np.argsort(-np.linalg.norm(np.cross(b - a, c - a), axis=1), kind="stable")
    normals = np.empty((0, 3))
    found = []
    for nhat in hull.equations[largest_first, :3]:
        if np.any(normals @ nhat > _COS_SAME):
            continue
        normals = np.vstack([normals, nhat])
        heights = p @ nhat
        least = float(heights.max()) * np.tan(TIPPING)
        on_side = heights > heights.max() - level
        flat = p[on_side] @ scipy.linalg.null_space(nhat[None])
        if np.abs(flat).max() < least or np.linalg.matrix_rank(flat - flat[0], level) < 2:
            continue
        if -ConvexHull(flat).equations[:, 2].max() >= least > 0:
            one = np.linalg.norm(flat - flat.mean(axis=0), axis=1).argmax()
            other = np.linalg.norm(flat - flat[one], axis=1).argmax()
            aside = (flat - flat[one]) @ [[0, -1], [1, 0]] @ (flat[other] - flat[one])
            ends = np.unique([one, other, aside.argmax(), aside.argmin()])
            found.append(FlatSide(nhat, corners[on_side][ends]))
    return found
