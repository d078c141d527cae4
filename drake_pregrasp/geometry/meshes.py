"""Readers of mesh files from untrusted sources.

Only formats that hold little more than triangles are supported. Textures are skipped, so no image
is decoded. The only other files that are opened are the buffers of a glTF file and the materials of
an OBJ file, beside it.
"""

import json
import re
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.resources import check_inside, read_bounded

MAX_MESH_BYTES = 50_000_000
"""Largest size of a mesh file, and of each buffer beside it, in bytes."""

MAX_FACES = 200_000
"""Largest number of triangles of a mesh, which bounds the simulation's computing time."""

MAX_VERTICES = 3 * MAX_FACES
"""Largest number of vertices of a mesh, reached by triangles without shared vertices."""

MAX_PIECES = 1000
"""Largest number of parts of a mesh file; a part counts once for each placement."""

MAX_NAME = 200
"""Largest number of characters of a part's name and of a vertex; further ones are ignored."""

MAX_MATERIAL_BYTES = 1_000_000
"""Largest size of a material library of an OBJ file, in bytes."""

MAX_WORDS = 4_000_000
"""Largest number of words of an OFF file or a PLY file in text: reading takes 1 µs per word."""

MAX_VALUES = 500_000
"""Largest number of values in the JSON of a glTF file."""

_MAX_PLACEMENT = 1e9  # Of the placement of a node, far more than any mesh needs.
_MAX_NUMBERS = 20_000_000  # Numbers in a glTF file's arrays, which may claim any count.

_OPTIONS: Mapping[str, Mapping[str, Any]] = {
    ".obj": {"split_objects": True, "skip_materials": True},
    ".stl": {},
    ".ply": {"skip_materials": True},
    ".off": {},
    ".gltf": {},
    ".glb": {},
}

MESH_SUFFIXES = tuple(_OPTIONS)
"""File name extensions of the supported formats."""

_GLB_HEADER = struct.Struct("<4sIIII")  # Magic, version, length; the first chunk's length and kind.

Color = tuple[float, ...]


class Piece(NamedTuple):
    """A named part of a mesh file.

    Attributes:
        name: Name of the part, or of its material if parts are separated by materials.
        mesh: Triangles of the part, in the frame of the file.
        color: Red, green, blue and opacity, from 0 to 1, or None if the file has no colour.
    """

    name: str
    mesh: trimesh.Trimesh
    color: Color | None = None


def read_pieces(path: Path, *, colors: bool = False) -> list[Piece]:
    """Returns the named parts of a mesh file, each in the frame of the file.

    Args:
        path: Path of the file.
        colors: Whether to read plain colours. The parts of an OBJ file are then its materials
            instead of its named objects.

    Raises:
        InvalidArgumentError: If the file cannot be read or exceeds a limit.
    """
    kind = path.suffix.lower()
    if kind not in _OPTIONS:
        raise InvalidArgumentError(
            f"{path} cannot be read as a mesh: its name must end with {', '.join(MESH_SUFFIXES)}"
        )
    data = read_bounded(path, MAX_MESH_BYTES)
    with _naming(path):
        data, beside = _plain(kind, data, by_material=colors)
        materials: Mapping[str, Color] = {}
        buffers = {}
        if kind != ".obj":
            buffers = {name: _read_buffer(path.parent, name) for name in beside}
        elif colors and beside:
            materials = _read_materials(path.parent, beside[0])
        # Unprocessed: trimesh would leave out vertices that are not finite.
        scene = trimesh.load_scene(
            BytesIO(data),
            file_type=kind.removeprefix("."),
            resolver=buffers,
            process=False,
            **_OPTIONS[kind],
        )
        pieces = _placed_pieces(scene)
    return [piece._replace(color=materials.get(piece.name, piece.color)) for piece in pieces]


def companions(path: Path) -> list[Path]:
    """Returns the other files that a mesh file refers to, whether they exist or not.

    They are the buffers of a glTF file, or the first material library of an OBJ file.

    Raises:
        InvalidArgumentError: If the file cannot be read.
    """
    kind = path.suffix.lower()
    if kind not in (".obj", ".gltf"):
        return []
    data = read_bounded(path, MAX_MESH_BYTES)
    with _naming(path):
        return [path.parent / name for name in _plain(kind, data)[1]]


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Turns whatever the readers of trimesh raise into an error that names the file."""
    try:
        yield
    except Exception as error:
        problem = " ".join(str(error).split()) or type(error).__name__
        if isinstance(error, ImportError):  # Of what guesses an encoding, once all else failed.
            problem = f"it is no {path.suffix.lower().removeprefix('.')} file"
        raise InvalidArgumentError(f"{path} cannot be read as a mesh: {problem}") from error


def _plain(kind: str, data: bytes, *, by_material: bool = False) -> tuple[bytes, list[str]]:
    """Returns a file reduced to triangles and plain colours, and the names of files beside it.

    Args:
        kind: File name extension.
        data: Content of the file.
        by_material: As for `_plain_obj`.

    Raises:
        InvalidArgumentError: If the file would take too long to parse.
    """
    if kind in (".gltf", ".glb"):
        return _plain_gltf(kind, data)
    if kind == ".obj":
        return _plain_obj(data, by_material=by_material)
    if kind == ".stl":
        _check_count(data.count(b"endsolid"), "solids", MAX_PIECES)
    elif kind == ".off":
        _check_words(data)
        data = data.decode(errors="replace").encode()  # Else trimesh guesses the encoding.
    elif b"ascii" in data.partition(b"\n")[2].partition(b"\n")[0].lower():
        _check_words(data)
    return data, []


def _check_count(count: int, what: str, most: int) -> None:
    if count > most:
        raise InvalidArgumentError(f"it has {count} {what}; at most {most}, simplify it")


def _check_words(data: bytes) -> None:
    characters = np.frombuffer(data, dtype=np.uint8)
    words = np.count_nonzero((characters <= ord(" ")) | (characters > ord("~")))
    _check_count(int(words), "words", MAX_WORDS)


def _placed_pieces(scene: trimesh.Scene) -> list[Piece]:
    pieces: list[Piece] = []
    faces = 0
    nodes = scene.graph.nodes_geometry
    _check_count(len(nodes), "parts", MAX_PIECES)
    for node in nodes:
        transform, name = scene.graph[node]
        geometry = scene.geometry[name]
        count = len(getattr(geometry, "faces", ()))
        faces += count
        _check_count(faces, "triangles", MAX_FACES)
        if count:
            if geometry.vertices.shape[1:] != (3,):  # Some readers take the width of any row.
                raise InvalidArgumentError("it has a vertex without three coordinates")
            if not 0 <= np.min(geometry.faces) <= np.max(geometry.faces) < len(geometry.vertices):
                raise InvalidArgumentError("it has a triangle with a vertex that is not there")
            mesh = trimesh.Trimesh(geometry.vertices, geometry.faces, process=False)
            pieces.append(
                Piece(str(name)[:MAX_NAME], mesh.apply_transform(transform), plain_color(geometry))
            )
    return pieces


def plain_color(mesh: trimesh.Trimesh) -> Color | None:
    """Returns the plain colour of a mesh's material, or None if it has none."""
    material = getattr(mesh.visual, "material", None)
    return None if material is None else tuple((material.main_color / 255).tolist())


_SPACES = bytes.maketrans(b"\r\t\v\f", b"\n   ")
_OBJ_LINE = re.compile(rb"^ *+(v|f|[og]|usemtl|mtllib) ([^\n]*)", re.MULTILINE)


def _plain_obj(data: bytes, *, by_material: bool) -> tuple[bytes, list[str]]:
    """Returns an OBJ file reduced to vertices, faces and names, and its first material library.

    Args:
        data: Content of the file.
        by_material: Whether parts are named by their materials instead of their objects.

    Raises:
        InvalidArgumentError: If the file has too many vertices, triangles or parts.
    """
    data = data.translate(_SPACES).replace(b"\\\n", b" ")
    name = b"usemtl" if by_material else b"o"
    most = {b"v": MAX_VERTICES, b"f": MAX_FACES, name: MAX_PIECES}
    lines, libraries, counts = [], [], Counter[bytes]()
    for match in _OBJ_LINE.finditer(data):
        key, words = match[1], match[2].split(None, MAX_FACES + 2)
        rest = b" ".join(words)[:MAX_NAME]
        if key == b"f":
            counts[key] += max(len(words) - 2, 1)  # Triangles.
            lines.append(b"f " + b" ".join(word.partition(b"/")[0] for word in words))
        elif key in most:
            counts[key] += 1
            lines.append((b"v " if key == b"v" else b"o ") + rest)
        elif key == b"mtllib" and rest:
            libraries.append(rest.decode(errors="replace"))
        if counts[key] > most.get(key, 0):
            what = {b"v": "vertices", b"f": "triangles"}.get(key, f"lines {key.decode()}")
            raise InvalidArgumentError(f"it has more than {most[key]} {what}; simplify it")
    return b"\n".join(lines).decode(errors="replace").encode(), libraries[:1]


def _read_materials(folder: Path, library: str) -> dict[str, Color]:
    """Returns the plain colours of a material library by name; empty if the file is missing."""
    path = folder / library
    check_inside(path, [folder])
    if not path.is_file():
        return {}
    colors: dict[str, FloatArray] = {}
    name = ""
    for line in read_bounded(path, MAX_MATERIAL_BYTES).decode(errors="replace").splitlines():
        key, _, value = line.strip().partition(" ")
        if key == "newmtl":
            name = value.strip()[:MAX_NAME]
        elif key in ("Kd", "d"):
            color = colors.setdefault(name, np.array([0.8, 0.8, 0.8, 1.0]))
            first, count = (0, 3) if key == "Kd" else (3, 1)
            numbers = np.array(value.split()[:count], dtype=float)
            color[first : first + count] = np.clip(np.nan_to_num(numbers), 0, 1)
    return {name: tuple(color.tolist()) for name, color in colors.items()}


def _plain_gltf(kind: str, data: bytes) -> tuple[bytes, list[str]]:
    """Returns a glTF file reduced to triangles and plain colours, and its buffers beside it.

    Raises:
        InvalidArgumentError: If its arrays claim an impossible size, or its nodes are no tree.
    """
    rest = b""
    if kind == ".glb":
        _, _, _, length, _ = _GLB_HEADER.unpack_from(data)
        rest = data[_GLB_HEADER.size + length :]
        data = data[_GLB_HEADER.size : _GLB_HEADER.size + length]
    values = sum(data.count(mark) for mark in (b",", b":", b"[", b"{"))
    _check_count(values, "values", MAX_VALUES)
    tree = json.loads(data)
    uris = [str(buffer.get("uri", "data:")) for buffer in tree.get("buffers", [])]
    beside = [uri for uri in uris if not uri.startswith("data:")]
    counts = [int(array["count"]) for array in tree.get("accessors", [])]
    # No array has more than 16 numbers in an element.
    if min(counts, default=0) < 0 or sum(counts) > _MAX_NUMBERS // 16:
        raise InvalidArgumentError("its arrays claim too many elements, or fewer than none")
    nodes = tree.get("nodes", [])
    _check_count(len(nodes), "nodes", MAX_PIECES)
    for node in nodes:
        for key in ("matrix", "translation", "rotation", "scale"):
            if not all(abs(float(number)) <= _MAX_PLACEMENT for number in node.get(key, ())):
                raise InvalidArgumentError(
                    f"a node has a {key} with numbers over {_MAX_PLACEMENT:g}"
                )
    children = [child for node in nodes for child in node.get("children", [])]
    if len(set(children)) != len(children):
        raise InvalidArgumentError("a node is the child of two; nodes must be a tree")
    for key in ("images", "textures", "samplers", "animations", "skins", "cameras"):
        tree.pop(key, None)
    for material in tree.get("materials", []):
        color = material.get("pbrMetallicRoughness", {}).get("baseColorFactor")
        material.clear()
        material["pbrMetallicRoughness"] = {"baseColorFactor": color} if color else {}
    data = json.dumps(tree).encode()
    if kind == ".gltf":
        return data, beside
    data += b" " * (-len(data) % 4)
    size = _GLB_HEADER.size + len(data) + len(rest)
    return _GLB_HEADER.pack(b"glTF", 2, size, len(data), 0x4E4F534A) + data + rest, beside


def _read_buffer(folder: Path, name: str) -> bytes:
    path = folder / name
    if path.suffix.lower() != ".bin":
        raise InvalidArgumentError(f"{name} is not opened; buffers are files .bin beside it")
    check_inside(path, [folder])
    return read_bounded(path, MAX_MESH_BYTES)
