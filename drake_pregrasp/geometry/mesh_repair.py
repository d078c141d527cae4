"""Repair of meshes that enclose no solid: holes, and closed surfaces that cross or touch."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.meshes import read_pieces
from drake_pregrasp.geometry.sampling import split_triangles
from drake_pregrasp.geometry.shapes import checked_mesh, scaled_whole
from drake_pregrasp.geometry.surface import closest_points
from drake_pregrasp.resources import require_packages

_GROWTH = 1e-4  # Of surfaces that are united, as a share of the extent: touching ones then cross.
_CHECKED_EXTENT = 0.1  # Extent of the mesh while it is checked, in metres.
_SAMPLES = 5_000  # Points of the new surface whose distances to the old one are computed.
_PARTS_ALONG = 100  # Least number of parts of the old surface along its extent.
_NEAR = 16  # Parts of the old surface near a point, whose triangles may be the nearest.
_CHUNK = 20_000  # Points at a time, which bounds the memory.
_LEAST_AREA = 0.5  # Least share of the surface that must be left.


class Repair(NamedTuple):
    """A repaired mesh, and what the repair changed. Lengths are in the unit of the file.

    Attributes:
        mesh: The repaired mesh.
        volume: Volume that the repaired mesh encloses.
        area: Area of the repaired mesh.
        old_area: Area of the mesh of the file.
        distance: Largest distance to the surface of the file, of random points of the repaired one
            and of its vertices. Parts of that surface that are left out do not increase it.
        left_out: Number of surfaces of the file that could not be closed.
    """

    mesh: trimesh.Trimesh
    volume: float
    area: float
    old_area: float
    distance: float
    left_out: int


def repair_mesh(path: Path) -> Repair:
    """Returns the mesh of a file as the surface of one solid body.

    Holes are closed by fans of triangles, and the closed surfaces are united by manifold3d, after
    each has grown by a ten thousandth of the extent. A closed surface with inward normals stays a
    cavity if its bounding box is inside that of another one.

    Args:
        path: Path of the mesh file.

    Raises:
        InvalidArgumentError: If the file cannot be read, a package of the extra `meshes` is not
            installed, or the mesh cannot be repaired.
    """
    require_packages("manifold3d", "networkx", extra="meshes", purpose="mesh repair")
    pieces = read_pieces(path)
    if not pieces:
        raise InvalidArgumentError(f"{path} holds no triangles")
    old = scaled_whole(pieces, 1.0, str(path))
    old.merge_vertices()
    old.update_faces(old.unique_faces() & old.nondegenerate_faces(height=0.0))
    parts, closed = old.split(only_watertight=False, repair=False), []
    for part in parts:
        if not part.is_watertight:
            trimesh.repair.fix_winding(part)
            trimesh.repair.fill_holes(part, use_fan=True)
        if part.is_watertight and part.is_winding_consistent and part.volume != 0:
            closed.append(part)
    mesh = _united(closed, _GROWTH * float(np.max(old.extents))) if closed else None
    if mesh is None or sum(part.area for part in closed) < _LEAST_AREA * old.area:
        raise InvalidArgumentError(
            f"{path} cannot be repaired: {len(parts) - len(closed)} of its {len(parts)} surfaces"
            " have holes that cannot be closed"
        )
    # The limits of sizes are for metres, and the file may have another unit.
    unit = _CHECKED_EXTENT / float(np.max(mesh.extents))
    mesh = checked_mesh(mesh.apply_scale(unit), str(path)).apply_scale(1 / unit)
    return Repair(
        mesh, mesh.volume, mesh.area, old.area, _distance(mesh, old), len(parts) - len(closed)
    )


def _united(parts: list[trimesh.Trimesh], growth: float) -> trimesh.Trimesh | None:
    """Returns the union of closed surfaces less their cavities, or None if nothing is left.

    A surface is inside another one if its bounding box is: cavities of a solid satisfy that.
    """
    bodies: list[trimesh.Trimesh] = []
    cavities: list[trimesh.Trimesh] = []
    for part in parts:
        inside = any(
            other is not part
            and np.all(other.bounds[0] < part.bounds[0])
            and np.all(part.bounds[1] < other.bounds[1])
            for other in parts
        )
        if part.volume < 0:
            part.invert()
            (cavities if inside else bodies).append(part)
        else:
            bodies.append(part)
    if len(parts) > 1:
        for part in bodies:
            part.vertices = part.vertices + growth * part.vertex_normals
    union = trimesh.boolean.union(bodies, engine="manifold", check_volume=False)
    # Spaces that the bodies leave between them are filled.
    shells = union.split(only_watertight=False, repair=False)
    outer: list[trimesh.Trimesh] = [shell for shell in shells if shell.volume > 0]
    if not outer:
        return None
    solid: Any = trimesh.util.concatenate(outer)
    if cavities:
        hollow = [solid, *cavities]
        solid = trimesh.boolean.difference(hollow, engine="manifold", check_volume=False)
    return trimesh.Trimesh(solid.vertices, solid.faces, process=False)


def _distance(new: trimesh.Trimesh, old: trimesh.Trimesh) -> float:
    """Returns the largest distance of vertices and random points of a new surface to an old one."""
    points, _ = trimesh.sample.sample_surface(new, _SAMPLES, seed=0)
    points = np.concatenate([points, new.vertices])
    corners, edge = np.array(old.triangles), float(np.max(old.extents)) / _PARTS_ALONG
    parts = split_triangles(corners, np.array(old.face_normals), edge)
    count = min(_NEAR, len(parts.faces))
    farthest = 0.0
    for some in np.array_split(points, 1 + len(points) // _CHUNK):
        _, nearest = cKDTree(parts.centroids).query(some, k=count)
        candidates = np.repeat(some, count, axis=0)
        feet = closest_points(corners[parts.faces[nearest.ravel()]], candidates)
        gaps = np.linalg.norm(candidates - feet, axis=1).reshape(-1, count)
        farthest = max(farthest, float(np.max(np.min(gaps, axis=1))))
    return farthest
