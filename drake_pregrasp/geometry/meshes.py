"""Mesh files of unknown origin, and the closed surfaces that a mesh consists of.

Only formats that are triangles and little else are read. Textures are not, so that no image is
decoded, and the only other files that are opened are buffers of a glTF file and materials of an OBJ
file, beside it.
"""

import itertools
import json
import re
import struct
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

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

MAX_VERTICES = 3 * MAX_FACES
"""Vertices of a mesh: those of triangles that share none."""

MAX_PIECES = 1000
"""Parts of a mesh file, each as often as it is placed."""

MAX_NAME = 200
"""Characters of a part's name, and of a vertex; further ones are left out."""

MAX_MATERIAL_BYTES = 1_000_000
"""Bytes of a material library of an OBJ file."""

MAX_WORDS = 4_000_000
"""Words of an OFF file, or of a PLY file in text; their readers take a microsecond for each."""

MAX_VALUES = 500_000
"""Values of the JSON of a glTF file."""

_MAX_NUMBERS = 20_000_000  # In the arrays of a glTF file, which may claim any count.

_OPTIONS: Mapping[str, Mapping[str, Any]] = {
    ".obj": {"split_objects": True, "skip_materials": True},
    ".stl": {},
    ".ply": {"skip_materials": True},
    ".off": {},
    ".gltf": {},
    ".glb": {},
}

MESH_SUFFIXES = tuple(_OPTIONS)
"""Endings of the names of mesh files."""

_GLB_HEADER = struct.Struct("<4sIIII")  # Magic, version, length; the first chunk's length and kind.

Color = tuple[float, ...]


class Piece(NamedTuple):
    """A named part of a mesh file.

    Attributes:
        name: Name of the part, or of its material if parts are told apart by materials.
        mesh: Triangles of the part, in the frame of the file.
        color: Red, green, blue and opacity, from 0 to 1, or None if the file does not say.
    """

    name: str
    mesh: trimesh.Trimesh
    color: Color | None = None


def read_pieces(path: Path, *, colors: bool = False) -> list[Piece]:
    """Returns the named parts of a mesh file, each in the frame of the file.

    Args:
        path: The file.
        colors: Whether parts have their plain colours; parts of an OBJ file are then those of one
            material each, instead of its named objects.

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
        materials: Mapping[str, Color] = {}
        if kind in (".gltf", ".glb"):
            data = _plain_gltf(kind, data)
        elif kind == ".obj":
            data, library = _plain_obj(data, by_material=colors)
            if colors and library:
                materials = _read_materials(path.parent, library)
        elif kind == ".off":
            _check_words(data)
            data = data.decode(errors="replace").encode()  # Else trimesh guesses the encoding.
        elif kind == ".ply" and b"ascii" in data.partition(b"\n")[2].partition(b"\n")[0].lower():
            _check_words(data)
        elif kind == ".stl" and data.count(b"endsolid") > MAX_PIECES:
            raise InvalidArgumentError(f"it has more than {MAX_PIECES} solids; unite them")
        # Unprocessed: trimesh would leave out vertices that are not finite.
        scene = trimesh.load_scene(
            BytesIO(data),
            file_type=kind.removeprefix("."),
            resolver=_Beside(path.parent),
            process=False,
            **_OPTIONS[kind],
        )
        pieces = _placed_pieces(scene)
        return [piece._replace(color=materials.get(piece.name, piece.color)) for piece in pieces]
    except Exception as error:  # trimesh's readers raise whatever their parsers do.
        problem = " ".join(str(error).split()) or type(error).__name__
        if isinstance(error, ImportError):  # Of what guesses an encoding, once all else failed.
            problem = f"it is no {kind.removeprefix('.')} file"
        raise InvalidArgumentError(f"{path} can't be read as a mesh: {problem}") from error


def _check_words(data: bytes) -> None:
    characters = np.frombuffer(data, dtype=np.uint8)
    words = np.count_nonzero((characters <= ord(" ")) | (characters > ord("~")))
    if words > MAX_WORDS:
        raise InvalidArgumentError(f"it has {words} words; at most {MAX_WORDS}, simplify it")


def _parse_json(data: bytes) -> Any:
    values = sum(data.count(mark) for mark in (b",", b":", b"[", b"{"))
    if values > MAX_VALUES:
        raise InvalidArgumentError(f"it has {values} values; at most {MAX_VALUES}, simplify it")
    return json.loads(data)


def companions(path: Path) -> list[Path]:
    """Returns the other files that a mesh file consists of, whether they are there or not.

    Those are the buffers of a glTF file, and the first material library of an OBJ file.

    Raises:
        InvalidArgumentError: If the file can't be read.
    """
    kind = path.suffix.lower()
    if kind not in (".obj", ".gltf"):
        return []
    data = read_bounded(path, MAX_MESH_BYTES)
    try:
        if kind == ".obj":
            _, library = _plain_obj(data)
            return [path.parent / library] if library else []
        buffers = _parse_json(data).get("buffers", [])
        uris = [str(buffer.get("uri", "data:")) for buffer in buffers]
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise InvalidArgumentError(f"{path} can't be read as a mesh: {error}") from error
    return [path.parent / uri for uri in uris if not uri.startswith("data:")]


def _placed_pieces(scene: trimesh.Scene) -> list[Piece]:
    pieces: list[Piece] = []
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
            if not 0 <= np.min(geometry.faces) <= np.max(geometry.faces) < len(geometry.vertices):
                raise InvalidArgumentError("it has a triangle with a vertex that isn't there")
            material = getattr(geometry.visual, "material", None)
            color = None if material is None else tuple((material.main_color / 255).tolist())
            mesh = trimesh.Trimesh(geometry.vertices, geometry.faces, process=False)
            pieces.append(Piece(str(name)[:MAX_NAME], mesh.apply_transform(transform), color))
    return pieces


_SPACES = bytes.maketrans(b"\r\t\v\f", b"\n   ")
_OBJ_LINE = re.compile(rb"^(v|f|[og]|usemtl|mtllib) ([^\n]*)", re.MULTILINE)


def _plain_obj(data: bytes, *, by_material: bool = False) -> tuple[bytes, str]:
    """Returns an OBJ file with no more than vertices, faces and names, and its material library.

    Args:
        data: The file.
        by_material: Whether parts have the names of their materials, instead of their own.

    Raises:
        InvalidArgumentError: If it has too many vertices, triangles or parts.
    """
    data = b"\n" + data.translate(_SPACES).replace(b"\\\n", b" ")
    for pair in (b"  ", b"\n "):
        while pair in data:
            data = data.replace(pair, pair[:1])
    name = b"usemtl" if by_material else b"o"
    for key, most in ((b"v", MAX_VERTICES), (b"f", MAX_FACES), (name, MAX_PIECES)):
        count = data.count(b"\n" + key + b" ")
        if count > most:
            what = f"it has {count} lines {key.decode()}; at most {most}"
            raise InvalidArgumentError(f"{what}, simplify it")
    lines, library, triangles = [], "", 0
    for match in _OBJ_LINE.finditer(data):
        key, rest = match[1], match[2].strip()
        if key == b"f":
            triangles += rest.count(b" ") - 1
            if triangles > MAX_FACES:
                raise InvalidArgumentError(f"it has more than {MAX_FACES} triangles; simplify it")
            lines.append(b"f " + re.sub(rb"/[^ ]*", b"", rest))
        elif key == b"v":
            lines.append(b"v " + rest[:MAX_NAME])
        elif key == name:
            lines.append(b"o " + rest[:MAX_NAME])
        elif key == b"mtllib":
            library = library or rest[:MAX_NAME].decode(errors="replace")
    return b"\n".join(lines).decode(errors="replace").encode(), library


def _read_materials(folder: Path, library: str) -> dict[str, Color]:
    """Returns the plain colours of a material library by name; none if there is no such file."""
    path = folder / library
    check_inside(path, [folder])
    if not path.is_file():
        return {}
    colors: dict[str, Color] = {}
    name = ""
    for line in read_bounded(path, MAX_MATERIAL_BYTES).decode(errors="replace").splitlines():
        key, _, value = line.strip().partition(" ")
        if key == "newmtl":
            name = value.strip()[:MAX_NAME]
        elif key in ("Kd", "d"):
            numbers = tuple(
                np.clip(np.nan_to_num([float(n) for n in value.split()]), 0, 1).tolist()
            )
            color = colors.get(name, (0.8, 0.8, 0.8, 1.0))
            colors[name] = (*numbers[:3], color[3]) if key == "Kd" else (*color[:3], numbers[0])
    return colors


def _plain_gltf(kind: str, data: bytes) -> bytes:
    """Returns a glTF file with no more than triangles and plain colours.

    Raises:
        InvalidArgumentError: If it claims more than it can hold, or its nodes go in a circle.
    """
    rest = b""
    if kind == ".glb":
        _, _, _, length, _ = _GLB_HEADER.unpack_from(data)
        rest = data[_GLB_HEADER.size + length :]
        data = data[_GLB_HEADER.size : _GLB_HEADER.size + length]
    tree = _parse_json(data)
    counts = [int(array["count"]) for array in tree.get("accessors", [])]
    # No array has more than 16 numbers in an element.
    if min(counts, default=0) < 0 or sum(counts) > _MAX_NUMBERS // 16:
        raise InvalidArgumentError("its arrays claim too many elements, or fewer than none")
    nodes = tree.get("nodes", [])
    if len(nodes) > MAX_PIECES:
        raise InvalidArgumentError(f"it has {len(nodes)} nodes; at most {MAX_PIECES}")
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
        return data
    data += b" " * (-len(data) % 4)
    size = _GLB_HEADER.size + len(data) + len(rest)
    return _GLB_HEADER.pack(b"glTF", 2, size, len(data), 0x4E4F534A) + data + rest


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

MAX_PAIRS = 20_000_000
"""Pairs of a point and a triangle, of closed surfaces whose bounding boxes overlap: each ten
million take two to four seconds."""

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
    depths = np.zeros(count, dtype=np.int64)
    points = [np.unique(part.reshape(-1, 3), axis=0) for part in parts if count > 1]
    near: list[tuple[int, int, BoolArray]] = []
    pairs = 0
    for inner, outer in itertools.permutations(range(len(points)), 2):
        low, high = bounds[outer]
        is_near = np.all((low <= points[inner]) & (points[inner] <= high), axis=1)
        near.append((inner, outer, is_near))
        pairs += int(np.sum(is_near)) * len(parts[outer])
    if pairs > MAX_PAIRS:
        raise InvalidArgumentError(
            f"{what} has closed surfaces in each other with {pairs} pairs of a point and a"
            f" triangle; at most {MAX_PAIRS}, simplify it or leave out its cavities"
        )
    for inner, outer, is_near in near:
        inside = is_inside(points[inner][is_near], parts[outer])
        if np.any(inside) and not (np.all(inside) and np.all(is_near)):
            raise InvalidArgumentError(
                f"{what} has closed surfaces that cross; unite them into one, for example with"
                " trimesh.boolean.union"
            )
        depths[inner] += bool(np.all(inside) and np.all(is_near))
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
