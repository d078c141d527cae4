"""Meshes of robots made into what Drake reads: OBJ files of one colour each, with normals."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from drake_pregrasp.errors import InvalidArgumentError, first_line

_DIGITS = 5  # Of coordinates in metres.
_CREASE = 0.6  # Edges with a larger angle between their faces stay sharp, in radians.


@dataclass(frozen=True)
class ConvertedMesh:
    """A part of a mesh.

    Attributes:
        path: Its OBJ file.
        color: Red, green, blue and opacity, from 0 to 1, or None if the file doesn't say.
    """

    path: Path
    color: tuple[float, ...] | None


def convert_mesh(source: Path, target: Path, *, colors: bool) -> list[ConvertedMesh]:
    """Converts a mesh file, STL or DAE, and returns its parts.

    Args:
        source: The file.
        target: Its new place, to which `.obj` is added; folders that lack are made.
        colors: Whether each colour becomes a part of its own; else all is one part.

    Raises:
        InvalidArgumentError: If the file can't be read.
    """
    try:
        with warnings.catch_warnings():  # pycollada uses what newer numpy will do without.
            warnings.simplefilter("ignore", DeprecationWarning)
            scene = trimesh.load_scene(source)
    except (OSError, ValueError, ImportError) as error:
        problem = f"{source} can't be read as a mesh: {first_line(error)}"
        raise InvalidArgumentError(problem) from error
    meshes = [mesh for mesh in scene.dump() if isinstance(mesh, trimesh.Trimesh)]
    if not meshes:
        raise InvalidArgumentError(f"{source} can't be read as a mesh: it has no triangles")
    parts: dict[tuple[float, ...] | None, list[Any]] = {}
    for mesh in meshes:
        parts.setdefault(_color(mesh) if colors else None, []).append(mesh)
    converted = []
    for index, (color, same) in enumerate(sorted(parts.items(), key=lambda item: str(item[0]))):
        number = f"_{index}" if len(parts) > 1 else ""
        path = target.with_name(f"{target.name}{number}.obj")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(_obj_text(same), encoding="ascii")
        converted.append(ConvertedMesh(path, color))
    return converted


def _color(mesh: Any) -> tuple[float, ...] | None:
    material = getattr(mesh.visual, "material", None)
    if material is None:
        return None
    return tuple(np.round(np.array(material.main_color) / 255, 3).tolist())


def _obj_text(meshes: list[Any]) -> str:
    shaded = []
    for mesh in meshes:
        bare = trimesh.Trimesh(vertices=mesh.vertices, faces=mesh.faces)  # Without its old normals.
        bare.merge_vertices()
        shaded.append(trimesh.graph.smooth_shade(bare, angle=_CREASE))
    text: str = trimesh.exchange.obj.export_obj(
        trimesh.util.concatenate(shaded),
        include_normals=True,
        include_color=False,
        include_texture=False,
        digits=_DIGITS,
        header=None,
    )
    return text
