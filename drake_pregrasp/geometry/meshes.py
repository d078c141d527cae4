"""Mesh files of unknown origin, and the closed surfaces that a mesh consists of.

Only formats that are triangles and little else are read. Materials and textures are not, so that no
image is decoded, and the only other files that are opened are buffers of a glTF file, beside it.
"""

import json
import struct
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from trimesh.resolvers import Resolver

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.resources import check_inside, read_bounded

MAX_MESH_BYTES = 50_000_000
"""Bytes of a mesh file, and of each buffer beside it."""

MAX_FACES = 200_000
"""Triangles of a mesh: with more a simulation would crawl."""

MAX_PIECES = 1000
"""Parts of a mesh file, each as often as it is placed."""

_MAX_NUMBERS = 20_000_000  # In the arrays of a glTF file, which may claim any count.

_OPTIONS: Mapping[str, Mapping[str, Any]] = {
    ".obj": {"split_objects": True, "skip_materials": True},
    ".stl": {},
    ".ply": {"skip_materials": True},
    ".off": {},
    ".gltf": {"skip_materials": True},
    ".glb": {"skip_materials": True},
}

MESH_SUFFIXES = tuple(_OPTIONS)
"""What names of mesh files end with."""

_GLB_HEADER = struct.Struct("<4sIIII")  # Magic, version, length; the first chunk's length and kind.


def read_pieces(path: Path) -> list[tuple[str, trimesh.Trimesh]]:
    """Returns the named parts of a mesh file, each in the frame of the file.

    Args:
        path: The file.

    Raises:
        InvalidArgumentError: If it can't be read, or is too much.
    """
    kind = path.suffix.lower()
    if kind not in _OPTIONS:
        raise InvalidArgumentError(
            f"{path} can't be read as a mesh: its name must end with {', '.join(MESH_SUFFIXES)}"
        )
    data = read_bounded(path, MAX_MESH_BYTES)
    try:
        if kind in (".gltf", ".glb"):
            _check_gltf(kind, data)
        elif kind in (".obj", ".off"):
            data = data.decode(errors="replace").encode()  # Else trimesh guesses the encoding.
        # Unprocessed: trimesh would leave out vertices that are not finite.
        scene = trimesh.load_scene(
            BytesIO(data),
            file_type=kind.removeprefix("."),
            resolver=_Beside(path.parent),
            process=False,
            **_OPTIONS[kind],
        )
        return _placed_pieces(scene)
    except Exception as error:  # trimesh's readers raise whatever their parsers do.
        problem = " ".join(str(error).split()) or type(error).__name__
        if isinstance(error, ImportError):  # Of what guesses an encoding, once all else failed.
            problem = f"it is no {kind.removeprefix('.')} file"
        raise InvalidArgumentError(f"{path} can't be read as a mesh: {problem}") from error


def _placed_pieces(scene: trimesh.Scene) -> list[tuple[str, trimesh.Trimesh]]:
    pieces: list[tuple[str, trimesh.Trimesh]] = []
    faces = 0
    nodes = scene.graph.nodes_geometry
    if len(nodes) > MAX_PIECES:
        raise InvalidArgumentError(f"it has {len(nodes)} parts; at most {MAX_PIECES}")
    for node in nodes:
        transform, name = scene.graph[node]
        geometry = scene.geometry[name]
        count = len(getattr(geometry, "faces", ()))
        faces += count
        if faces > MAX_FACES:
            raise InvalidArgumentError(f"it has more than {MAX_FACES} triangles; simplify it")
        if count:
            if geometry.vertices.shape[1:] != (3,):  # Some readers take the width of any row.
                raise InvalidArgumentError("it has a vertex without three coordinates")
            pieces.append((str(name), geometry.copy().apply_transform(transform)))
    return pieces


def _check_gltf(kind: str, data: bytes) -> None:
    """Raises an error if a glTF file claims more than it can hold, or its nodes go in a circle."""
    if kind == ".glb":
        _, _, _, length, _ = _GLB_HEADER.unpack_from(data)
        data = data[_GLB_HEADER.size : _GLB_HEADER.size + length]
    tree = json.loads(data)
    # No array has more than 16 numbers in an element.
    if sum(abs(int(array["count"])) for array in tree.get("accessors", [])) > _MAX_NUMBERS // 16:
        raise InvalidArgumentError("its arrays claim too many elements")
    nodes = tree.get("nodes", [])
    if len(nodes) > MAX_PIECES:
        raise InvalidArgumentError(f"it has {len(nodes)} nodes; at most {MAX_PIECES}")
    children = [child for node in nodes for child in node.get("children", [])]
    if len(set(children)) != len(children):
        raise InvalidArgumentError("a node is the child of two; nodes must be a tree")


class _Beside(Resolver):
    """Opens the buffers of a glTF file, and no other file.

    Args:
        folder: Where the glTF file is.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def get(self, key: str) -> bytes:
        """Returns what the file of that name holds."""
        path = self._folder / key
        if path.suffix.lower() != ".bin":
            raise InvalidArgumentError(f"{key} is not opened; buffers are files .bin beside it")
        check_inside(path, [self._folder])
        return read_bounded(path, MAX_MESH_BYTES)

    def namespaced(self, namespace: str) -> "_Beside":
        """Returns the same: there is one folder only."""
        return self

    def keys(self) -> list[str]:
        """Returns no names."""
        return []

    def write(self, name: str, data: object) -> None:
        """Does nothing: no file is written."""


MAX_COMPONENTS = 100
"""Closed surfaces that a mesh may be made of."""

MAX_PAIRS = 200_000_000
"""Pairs of a point and a triangle that are looked at in all, to tell inside from outside: each ten
million take a second or two."""

_CHUNK = 2_000_000  # Pairs of a point and a triangle that are looked at in one go.


def orient_components(mesh: trimesh.Trimesh, what: str) -> None:
    """Turns each closed surface of a mesh so that its normals point out of the material, in place.

    A surface inside another one is a cavity, one inside of that is solid again, and so on.

    Args:
        mesh: Watertight, each of its surfaces with one winding.
        what: Names the mesh in errors.

    Raises:
        InvalidArgumentError: If two surfaces cross, so that ground of one lies inside the other.
    """
    labels = _face_components(mesh)
    count = int(np.max(labels)) + 1
    if count > MAX_COMPONENTS:
        raise InvalidArgumentError(
            f"{what} has {count} closed surfaces; at most {MAX_COMPONENTS}, unite them"
        )
    triangles = np.array(mesh.triangles)
    parts = [triangles[labels == part] for part in range(count)]
    bounds = [(part.min(axis=(0, 1)), part.max(axis=(0, 1))) for part in parts]
    pairs = 0
    depths = np.zeros(count, dtype=np.int64)
    for inner in range(count if count > 1 else 0):
        points = np.unique(parts[inner].reshape(-1, 3), axis=0)
        for outer in range(count):
            if inner == outer:
                continue
            low, high = bounds[outer]
            is_near = np.all((low <= points) & (points <= high), axis=1)
            pairs += int(np.sum(is_near)) * len(parts[outer])
            if pairs > MAX_PAIRS:
                raise InvalidArgumentError(
                    f"{what} has closed surfaces in each other with too many triangles; simplify"
                    " it, or leave out its cavities"
                )
            inside = np.zeros(len(points), dtype=bool)
            inside[is_near] = is_inside(points[is_near], parts[outer])
            if np.any(inside) and not np.all(inside):
                raise InvalidArgumentError(
                    f"{what} has closed surfaces that cross; unite them into one, for example with"
                    " trimesh.boolean.union"
                )
            depths[inner] += bool(np.all(inside))
    volumes = np.bincount(labels, weights=np.linalg.det(triangles), minlength=count)
    is_wrong = (volumes > 0) != (depths % 2 == 0)
    flipped = is_wrong[labels]
    if np.any(flipped):
        faces = np.array(mesh.faces)
        faces[flipped] = faces[flipped, ::-1]
        mesh.faces = faces


def is_inside(points: FloatArray, triangles: FloatArray) -> BoolArray:
    """Returns which points a closed surface winds round, whichever way it is turned, shape (k,).

    The solid angles of its triangles add up to 4 pi, or -4 pi, for points inside, to 0 for others
    (van Oosterom & Strackee, 1983, give the angle of one).

    Args:
        points: Shape (k, 3).
        triangles: Shape (F, 3, 3).
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
    inside: BoolArray = np.abs(total) > 2 * np.pi
    return inside


def _face_components(mesh: trimesh.Trimesh) -> IntArray:
    pairs = mesh.face_adjacency
    count = len(mesh.faces)
    links = csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, labels = connected_components(links, directed=False)
    found: IntArray = np.array(labels, dtype=np.int64)
    return found
