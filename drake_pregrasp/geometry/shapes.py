"""Closed triangle meshes of objects: primitives, surfaces of revolution, and mesh files."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.closed_surfaces import orient_components
from drake_pregrasp.geometry.meshes import read_pieces

FACET_ERROR = 5e-5
"""Farthest that facets are to be from the round surface they stand for, in metres."""

MAX_EXTENT = 3.0
"""Longest object that is believed, in metres: a file in millimetres is a thousand times too big."""

MAX_COORDINATE = 100.0
"""Farthest that a vertex may be from the origin of its file, along an axis, in metres."""

MIN_EXTENT = 1e-3
"""Longest edge that an object's bounding box has to have, in metres."""

_SECTIONS = (24, 256)  # Fewest and most facets round a circle.
_SUBDIVISIONS = (3, 6)  # Fewest and most, of the faces of an icosahedron.

_SUBDIVISION_ERROR = 0.292
"""Farthest that the facets of a unit ball are off after k subdivisions, times 4^k, from above."""


@dataclass(frozen=True, eq=False)
class Shape:
    """An object's closed surface, in its frame O.

    Attributes:
        mesh: Watertight, its normals outward, in metres.
        part_names: Names of the parts that faces may belong to.
        face_parts: Index of each face's part, shape (F,).
    """

    mesh: trimesh.Trimesh
    part_names: tuple[str, ...]
    face_parts: IntArray

    @property
    def p_OCoM(self) -> FloatArray:
        """The centre of mass of the homogeneous body, shape (3,), in metres."""
        center: FloatArray = np.array(self.mesh.center_mass)
        return center

    def part(self, name: str) -> int:
        """Returns the index of the part of that name.

        Raises:
            InvalidArgumentError: If there is none; the message lists the names there are.
        """
        if name not in self.part_names:
            raise InvalidArgumentError(
                f"the mesh has no part {name!r}; there are: {', '.join(self.part_names)}"
            )
        return self.part_names.index(name)


def box_shape(size: Sequence[float]) -> Shape:
    """Returns a box about the origin with those edge lengths, in metres."""
    return _one_part(trimesh.creation.box(extents=size))


def cylinder_shape(radius: float, length: float) -> Shape:
    """Returns a cylinder about the origin, its axis along z, all lengths in metres."""
    z = length / 2
    return revolved_shape([[0, -z], [radius, -z], [radius, z], [0, z]])


def ball_shape(radius: float) -> Shape:
    """Returns a ball about the origin, its radius in metres."""
    fewest, most = _SUBDIVISIONS
    needed = np.ceil(np.log(_SUBDIVISION_ERROR * radius / FACET_ERROR) / np.log(4))
    subdivisions = int(np.clip(needed, fewest, most))
    return _one_part(trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius))


def revolved_shape(profile: Sequence[Sequence[float]]) -> Shape:
    """Returns the solid that a line in the half-plane (r, z) encloses as it turns about z.

    Args:
        profile: Points (r, z) in metres, r >= 0, from the axis back to the axis, with z rising
            along the outside; a line that doesn't end on the axis is closed into a ring.

    Raises:
        InvalidArgumentError: If the profile encloses no solid.
    """
    line = np.array(profile, dtype=float)
    is_line = line.ndim == 2 and line.shape[1] == 2 and len(line) >= 3
    if not (is_line and np.all(np.isfinite(line)) and np.all(line[:, 0] >= 0)):
        raise InvalidArgumentError("a profile needs three points (r, z) or more, with r >= 0")
    if not (line[0, 0] == 0 and line[-1, 0] == 0):
        line = np.vstack([line, line[:1]])
    r, z = line.T
    enclosed = abs(float(r @ np.roll(z, -1) - z @ np.roll(r, -1))) / 2
    if not enclosed > 1e-6 * float(np.max(np.ptp(line, axis=0))) ** 2:
        raise InvalidArgumentError(f"the profile encloses no area: {line.tolist()}")
    fewest, most = _SECTIONS
    ratio = np.clip(FACET_ERROR / max(float(np.max(line[:, 0])), FACET_ERROR), 0, 1)
    sections = int(np.clip(np.ceil(np.pi / np.arccos(1 - ratio)), fewest, most))
    return _one_part(_checked(trimesh.creation.revolve(line, sections=sections), "the profile"))


def load_shape(path: Path, *, scale: float = 1.0) -> Shape:
    """Reads a mesh file: OBJ, STL, PLY, OFF or glTF; see `MESH_SUFFIXES`.

    Named objects of the file become the shape's parts.

    Args:
        path: The file.
        scale: Metres for each unit of the file.

    Raises:
        InvalidArgumentError: If it can't be read, isn't watertight, has no volume, or has a size
            that no hand's object has; the message says what would help.
    """
    if not path.is_file():
        raise InvalidArgumentError(f"{path}: no such file")
    pieces = read_pieces(path)
    if not pieces:
        raise InvalidArgumentError(f"{path} holds no triangles")
    part_names = tuple(dict.fromkeys(piece.name for piece in pieces))
    face_parts = np.concatenate(
        [np.full(len(piece.mesh.faces), part_names.index(piece.name)) for piece in pieces]
    )
    with np.errstate(over="ignore"):
        vertices = scale * np.concatenate([piece.mesh.vertices for piece in pieces])
    if not np.all(np.isfinite(vertices)):
        raise InvalidArgumentError(f"{path} has a vertex that is not finite")
    _check_size(vertices, str(path))
    # Pieces of one closed surface share their seams only once equal vertices are merged.
    first_vertices = np.cumsum([0, *(len(piece.mesh.vertices) for piece in pieces[:-1])])
    faces = np.concatenate(
        [piece.mesh.faces + n for piece, n in zip(pieces, first_vertices, strict=True)]
    )
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices()
    return Shape(_checked(mesh, str(path)), part_names, face_parts)


def _one_part(mesh: trimesh.Trimesh) -> Shape:
    return Shape(mesh, ("body",), np.zeros(len(mesh.faces), dtype=np.int64))


def _check_size(vertices: FloatArray, what: str) -> float:
    """Returns the longest edge of the bounding box, in metres, if it is one that is believed."""
    low, high = np.min(vertices, axis=0), np.max(vertices, axis=0)
    with np.errstate(over="ignore"):
        longest = float(np.max(high - low))
    if longest > MAX_EXTENT:
        hint = " (if its unit is the millimetre, scale: 0.001)" if longest > 10 else ""
        raise InvalidArgumentError(
            f"{what} is {longest:.4g} m long; at most {MAX_EXTENT:g} m, choose a scale{hint}"
        )
    if not longest >= MIN_EXTENT:
        raise InvalidArgumentError(
            f"{what} is {longest:.3g} m long; at least {MIN_EXTENT:g} m, choose a scale"
        )
    farthest = float(np.max(np.abs([low, high])))
    if farthest > MAX_COORDINATE:
        raise InvalidArgumentError(
            f"{what} is {farthest:.4g} m away from its own origin; at most {MAX_COORDINATE:g} m"
        )
    return longest


def _checked(mesh: trimesh.Trimesh, what: str) -> trimesh.Trimesh:
    """Returns a mesh that encloses a volume, with its normals outward."""
    longest = _check_size(mesh.vertices, what)
    if not mesh.is_watertight:
        _, counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
        raise InvalidArgumentError(
            f"{what} is not watertight: {np.sum(counts == 1)} edges have a face on one side only,"
            f" {np.sum(counts > 2)} have more than two; close its holes and part what touches, for"
            " example with Blender's 3D-print tools"
        )
    if not mesh.is_winding_consistent:
        mesh.faces = _with_one_winding(mesh)
    orient_components(mesh, what)
    with np.errstate(invalid="ignore"):  # trimesh divides by the volume.
        volume = float(mesh.volume)
    if not abs(volume) > 1e-6 * longest**3:
        raise InvalidArgumentError(
            f"{what} encloses no volume ({volume:.3g} m³ in {longest:.3g} m);"
            " it must be the surface of a solid body"
        )
    moments = np.linalg.eigvalsh(mesh.moment_inertia * np.sign(volume))
    if not (moments[0] > 0 and moments[0] + moments[1] > moments[2]):
        raise InvalidArgumentError(f"{what} is no body: its surface crosses itself")
    return mesh


def _with_one_winding(mesh: trimesh.Trimesh) -> IntArray:
    """Returns the faces of a watertight mesh, turned so that neighbours agree, shape (F, 3).

    Where faces had to be turned, they are outward; other closed surfaces of the mesh are kept.
    """
    faces = np.array(mesh.faces, dtype=np.int64)
    pairs, edges = mesh.face_adjacency, mesh.face_adjacency_edges
    # Two faces agree if they run along their edge in opposite ways.
    runs = [
        np.any((faces[f] == edges[:, :1]) & (np.roll(faces[f], -1, 1) == edges[:, 1:]), axis=1)
        for f in pairs.T
    ]
    differ = (runs[0] == runs[1]).astype(np.int64)
    # Each face is there twice, as it is and turned; what belongs together is connected.
    count = len(faces)
    first = np.concatenate([pairs[:, 0], pairs[:, 0] + count])
    second = np.concatenate([pairs[:, 1] + count * differ, pairs[:, 1] + count * (1 - differ)])
    graph = csr_array((np.ones(len(first)), (first, second)), shape=(2 * count, 2 * count))
    _, labels = connected_components(graph, directed=False)
    kept, turned = labels[:count], labels[count:]
    is_turned = kept > turned
    surfaces = np.minimum(kept, turned)
    volumes = np.linalg.det(mesh.vertices[faces]) * np.where(is_turned, -1, 1)
    for surface in np.unique(surfaces[is_turned]):
        on_it = surfaces == surface
        if np.sum(volumes[on_it]) < 0:
            is_turned[on_it] = ~is_turned[on_it]
    faces[is_turned] = faces[is_turned, ::-1]
    return faces
