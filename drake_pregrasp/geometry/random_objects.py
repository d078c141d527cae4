"""The 1,000 random objects of the package pybullet, each as one solid body at rest.

Only files of the package are read; none of its code is imported.
"""

import numpy as np
import trimesh

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.meshes import read_pieces
from drake_pregrasp.geometry.shapes import Shape, mesh_shape, scaled_whole
from drake_pregrasp.resources import python_package, require_packages

OBJECTS_URL = "objects://random/"
"""Prefix of the objects' names, `000.obj` to `999.obj`."""

NUM_OBJECTS = 1000
"""Number of objects."""

MASS = 0.1
"""Mass that the package states for every object, in kg."""

_SCALE = 0.015  # Length of the files' unit, in metres, as the package states it.

# Distance by which each closed surface of a file grows, in metres. The surfaces of an object touch
# each other, with coordinates rounded to 15 nm: they would be separate bodies.
_GROWTH = 5e-5


def object_url(index: int) -> str:
    """Returns the name of the object with an index from 0 to 999."""
    return f"{OBJECTS_URL}{index:03d}.obj"


def random_object(url: str, scale: float = 1.0) -> Shape:
    """Returns a random object in a frame O at its centre of mass, with z upward.

    It lies on the face of its convex hull on which its centre of mass is lowest, and so is stable.

    Args:
        url: Name of the object: `objects://random/017.obj`.
        scale: Factor of all lengths.

    Raises:
        InvalidArgumentError: If there is no such object, or the package is not installed.
    """
    name = url.removeprefix(OBJECTS_URL)
    index = name.removesuffix(".obj")
    if not (index.isdecimal() and url == object_url(int(index)) and int(index) < NUM_OBJECTS):
        last = object_url(NUM_OBJECTS - 1)
        raise InvalidArgumentError(f"there is no {url}; there are {object_url(0)} to {last}")
    require_packages("pybullet_data", "manifold3d", extra="objects", purpose=OBJECTS_URL)
    folder = python_package("pybullet_data")
    assert folder is not None
    pieces = read_pieces(folder / "random_urdfs" / index / name)
    mesh = scaled_whole(pieces, scale * _SCALE, url)
    mesh.merge_vertices()
    body = mesh_shape(_united(mesh, url), url).mesh
    body.apply_transform(_lying(body))
    return mesh_shape(body, url)


def _united(mesh: trimesh.Trimesh, url: str) -> trimesh.Trimesh:
    """Returns the union of the closed surfaces of a mesh, each of which has grown a little."""
    parts = list(mesh.split(only_watertight=False, repair=False))
    for part in parts:
        with np.errstate(divide="ignore"):  # trimesh divides by the volume.
            if part.volume < 0:
                part.invert()
        part.vertices = part.vertices + _GROWTH * part.vertex_normals
    union = trimesh.boolean.union(parts, engine="manifold", check_volume=False)
    if union.is_empty:
        raise InvalidArgumentError(f"{url} encloses no volume")
    return trimesh.Trimesh(union.vertices, union.faces, process=False)


def _lying(mesh: trimesh.Trimesh) -> np.ndarray:
    """Returns the transform of a body to its centre of mass and its most stable face."""
    hull, p_OCoM = mesh.convex_hull, mesh.center_mass
    heights = np.einsum("ij,ij->i", hull.triangles[:, 0] - p_OCoM, hull.face_normals)
    down = hull.face_normals[np.argmin(heights)]
    turned: np.ndarray = trimesh.geometry.align_vectors(down, [0.0, 0.0, -1.0])
    turned[:3, 3] = -turned[:3, :3] @ p_OCoM
    return turned
