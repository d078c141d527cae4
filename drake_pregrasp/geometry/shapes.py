"""Closed triangle meshes of objects: primitives, surfaces of revolution, and mesh files."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import cast

import numpy as np
import trimesh

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.closed_surfaces import orient_components
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.geometry.meshes import Piece, read_pieces
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, SignedDistance, Solid
from drake_pregrasp.resources import resolve_path

FACET_ERROR = 5e-5
"""Largest distance of facets from the approximated round surface, in metres."""

MAX_EXTENT = 3.0
"""Largest extent of an object, in metres: a file in millimetres is a thousand times too large."""

MAX_COORDINATE = 100.0
"""Largest coordinate of a vertex in the frame of its file, in metres."""

MIN_EXTENT = 1e-3
"""Smallest extent of an object, the longest edge of its bounding box, in metres."""

_FOLDED = 5e-3  # Angle between faces of a fold, in radians.
_SEEN = 1e-3  # Share of the area from which on a folded face counts.
_SECTIONS = (24, 256)  # Smallest and largest number of facets around a circle.
_SUBDIVISIONS = (3, 6)  # Smallest and largest number, from the faces of an icosahedron.

_SUBDIVISION_ERROR = 0.292
"""Upper bound of 4^k times the facet error of a unit ball after k subdivisions."""


@dataclass(frozen=True, eq=False)
class Shape:
    """Closed surface of an object in its frame O.

    Attributes:
        mesh: Watertight mesh with outward normals, in metres.
        part_names: Names of the mesh's parts.
        face_parts: Index of each face's part, shape (F,).
        simple: The same body as a simple solid, if it is one.
    """

    mesh: trimesh.Trimesh
    part_names: tuple[str, ...]
    face_parts: IntArray
    simple: Solid | None = None

    @property
    def p_OCoM(self) -> FloatArray:
        """Centre of mass of the homogeneous body in O, shape (3,), in metres."""
        return np.array(self.mesh.center_mass)

    @cached_property
    def solid(self) -> SignedDistance:
        """The body in O, for a hand that moves around it."""
        return self.simple or MeshSolid.of(self.mesh)

    def turned(self, R: FloatArray) -> "Shape":
        """Returns the shape turned about the origin of O by a rotation matrix, shape (3, 3)."""
        if np.array_equal(R, np.eye(3)):
            return self
        mesh = trimesh.Trimesh(self.mesh.vertices @ R.T, self.mesh.faces, process=False)
        return replace(self, mesh=mesh, simple=self.simple and self.simple.moved(R, np.zeros(3)))

    def part(self, name: str) -> int:
        """Returns the index of the part with a name.

        Raises:
            InvalidArgumentError: If the name is unknown; the message lists the names.
        """
        if name not in self.part_names:
            raise InvalidArgumentError(
                f"the mesh has no part {name!r}; there are: {', '.join(self.part_names)}"
            )
        return self.part_names.index(name)


def box_shape(size: Sequence[float]) -> Shape:
    """Returns a box centred on the origin.

    Args:
        size: Edge lengths along x, y and z, in metres.
    """
    solid = BoxSolid(np.zeros(3), np.eye(3), np.array(size))
    return _one_part(trimesh.creation.box(extents=size), solid)


def cylinder_shape(radius: float, length: float) -> Shape:
    """Returns a cylinder centred on the origin, with its axis along z.

    Args:
        radius: Radius of the cylinder, in metres.
        length: Length of the cylinder along z, in metres.
    """
    z = length / 2
    return revolved_shape([[0, -z], [radius, -z], [radius, z], [0, z]])


def ball_shape(radius: float) -> Shape:
    """Returns a ball centred on the origin.

    Args:
        radius: Radius of the ball, in metres.
    """
    fewest, most = _SUBDIVISIONS
    needed = np.ceil(np.log(_SUBDIVISION_ERROR * radius / FACET_ERROR) / np.log(4))
    subdivisions = int(np.clip(needed, fewest, most))
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return _one_part(mesh, BallSolid(np.zeros(3), radius))


def revolved_shape(profile: Sequence[Sequence[float]]) -> Shape:
    """Returns the solid of revolution of a profile about z.

    Args:
        profile: Points (r, z) of a polyline with r >= 0, shape (k, 2), in metres. A polyline whose
            ends are not both on the axis is closed, which makes a ring.

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
    return mesh_shape(trimesh.creation.revolve(line, sections=sections), "the profile")


def load_shape(file: str | Path, *, scale: float = 1.0) -> Shape:
    """Reads a mesh file: OBJ, STL, PLY, OFF or glTF; see `MESH_SUFFIXES`.

    Named objects of the file become the shape's parts.

    Args:
        file: Path from the working directory, or `package://drake_pregrasp/...`.
        scale: Length of the file's unit, in metres.

    Raises:
        InvalidArgumentError: If the file cannot be read, or the mesh is not watertight, has no
            volume, or is too large or too small; the message says what would help.
    """
    path = resolve_path(str(file), Path.cwd())
    if not path.is_file():
        raise InvalidArgumentError(f"{path}: no such file")
    pieces = read_pieces(path)
    if not pieces:
        raise InvalidArgumentError(f"{path} holds no triangles")
    part_names = tuple(dict.fromkeys(piece.name for piece in pieces))
    face_parts = np.concatenate(
        [np.full(len(piece.mesh.faces), part_names.index(piece.name)) for piece in pieces]
    )
    mesh = scaled_whole(pieces, scale, str(path))
    _check_size(mesh.vertices, str(path))
    # Pieces of a closed surface share their seams only after equal vertices are merged.
    mesh.merge_vertices()
    return Shape(checked_mesh(mesh, str(path)), part_names, face_parts)


def scaled_whole(pieces: Sequence[Piece], scale: float, what: str) -> trimesh.Trimesh:
    """Returns pieces as one mesh, with all their vertices.

    Args:
        pieces: Pieces of a file, at least one.
        scale: Length of the file's unit, in metres.
        what: Name of the mesh in errors.

    Raises:
        InvalidArgumentError: If a vertex is not finite.
    """
    whole = cast(trimesh.Trimesh, trimesh.util.concatenate([piece.mesh for piece in pieces]))
    with np.errstate(over="ignore", invalid="ignore"):
        vertices = scale * whole.vertices
    if not np.all(np.isfinite(vertices)):
        raise InvalidArgumentError(f"{what} has a vertex that is not finite")
    return trimesh.Trimesh(vertices, whole.faces, process=False)


def mesh_shape(mesh: trimesh.Trimesh, what: str) -> Shape:
    """Returns the shape of a mesh with one part.

    Args:
        mesh: Closed mesh with merged vertices, in metres.
        what: Name of the mesh in errors.

    Raises:
        InvalidArgumentError: If the mesh does not enclose a volume, or its size is not allowed.
    """
    return _one_part(checked_mesh(mesh, what))


def _one_part(mesh: trimesh.Trimesh, simple: Solid | None = None) -> Shape:
    return Shape(mesh, ("body",), np.zeros(len(mesh.faces), dtype=np.int64), simple)


def _check_size(vertices: FloatArray, what: str) -> float:
    """Checks the size of the bounding box, and returns its longest edge in metres."""
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


def checked_mesh(mesh: trimesh.Trimesh, what: str) -> trimesh.Trimesh:
    """Checks that a mesh encloses a volume, and returns it with outward normals."""
    longest = _check_size(mesh.vertices, what)
    if not mesh.is_watertight:
        _, counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
        raise InvalidArgumentError(
            f"{what} is not watertight: {np.sum(counts == 1)} edges have a face on one side only,"
            f" {np.sum(counts > 2)} have more than two; `drake-pregrasp mesh repair` closes holes"
            " and unites parts"
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
    folded = mesh.face_adjacency[mesh.face_adjacency_angles > np.pi - _FOLDED]
    if np.any(np.min(mesh.area_faces[folded], axis=1) > _SEEN * mesh.area):
        raise InvalidArgumentError(
            f"{what} folds back on itself, as polygons with a corner that points inward do; save it"
            " with triangles"
        )
    moments = np.linalg.eigvalsh(mesh.moment_inertia * np.sign(volume))
    if not (moments[0] > 0 and moments[0] + moments[1] > moments[2]):
        raise InvalidArgumentError(f"{what} is no body: its surface crosses itself")
    return mesh


def _with_one_winding(mesh: trimesh.Trimesh) -> IntArray:
    """Returns the faces of a watertight mesh with a consistent winding, shape (F, 3)."""
    faces = np.array(mesh.faces, dtype=np.int64)
    pairs, edges = mesh.face_adjacency, mesh.face_adjacency_edges
    # Two faces agree if they traverse their common edge in opposite directions.
    runs = [
        np.any((faces[f] == edges[:, :1]) & (np.roll(faces[f], -1, 1) == edges[:, 1:]), axis=1)
        for f in pairs.T
    ]
    differ = (runs[0] == runs[1]).astype(np.int64)
    # The graph has each face twice, original and flipped, and connects faces that agree.
    count = len(faces)
    first = np.concatenate([pairs[:, 0], pairs[:, 0] + count])
    second = np.concatenate([pairs[:, 1] + count * differ, pairs[:, 1] + count * (1 - differ)])
    labels = trimesh.graph.connected_component_labels(np.column_stack([first, second]), 2 * count)
    is_turned = labels[:count] > labels[count:]
    return np.where(is_turned[:, None], faces[:, ::-1], faces)
