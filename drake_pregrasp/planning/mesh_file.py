"""Mesh files of unknown origin, read by trimesh out of memory.

Only formats that are triangles and little else are read. Materials and textures are not, so that no
image is decoded, and the only other files that are opened are buffers of a glTF file, beside it.
"""

import json
import struct
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import trimesh
from trimesh.resolvers import Resolver

from drake_pregrasp.bounded_file import read_bounded
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.resources import check_inside

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
