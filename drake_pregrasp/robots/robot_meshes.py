"""Conversion of the meshes of a URDF to formats that Drake reads."""

import copy
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import trimesh

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError, first_line
from drake_pregrasp.geometry.meshes import Color, Piece, plain_color
from drake_pregrasp.robots.urdf_repair import DRAKE

_EXACT, _SHORT = ".17g", ".5f"  # Formats of coordinates in metres: all digits, or ten micrometres.
_CREASE = 0.6  # Edges with a larger angle between their faces stay sharp, in radians.


def convert_mesh(source: Path, target: Path, *, colors: bool) -> dict[Path, Color | None]:
    """Converts a mesh file, STL or DAE, and returns the OBJ file of each part with its colour.

    Args:
        source: Path of the mesh file.
        target: Path of the OBJ files without extension; missing folders are made.
        colors: Whether each colour becomes a separate part; otherwise there is one part.

    Raises:
        InvalidArgumentError: If the file cannot be read.
    """
    try:
        with warnings.catch_warnings():  # pycollada uses deprecated functions of numpy.
            warnings.simplefilter("ignore", DeprecationWarning)
            scene = trimesh.load_scene(source)
    except (OSError, ValueError, ImportError) as error:
        problem = f"{source} cannot be read as a mesh: {first_line(error)}"
        raise InvalidArgumentError(problem) from error
    meshes = [mesh for mesh in scene.dump() if isinstance(mesh, trimesh.Trimesh)]
    if not meshes:
        raise InvalidArgumentError(f"{source} cannot be read as a mesh: it has no triangles")
    parts: dict[Color | None, list[Piece]] = {}
    for mesh in meshes:
        parts.setdefault(plain_color(mesh) if colors else None, []).append(Piece("", mesh))
    converted = {}
    target.parent.mkdir(parents=True, exist_ok=True)
    for index, color in enumerate(sorted(parts, key=str)):
        number = f"_{index}" if len(parts) > 1 else ""
        path = target.with_name(f"{target.name}{number}.obj")
        converted[write_obj(parts[color], path, coordinates=_SHORT)] = color
    return converted


def _shaded(mesh: Any) -> Any:
    """Returns a mesh with smooth normals, except at its creases."""
    bare = trimesh.Trimesh(vertices=mesh.vertices, faces=mesh.faces)  # Without the old normals.
    bare.merge_vertices()
    return trimesh.graph.smooth_shade(bare, angle=_CREASE)


def write_obj(pieces: Sequence[Piece], path: Path, *, coordinates: str = _EXACT) -> Path:
    """Writes parts of a mesh, with their colours, as an OBJ file and returns its path.

    The file names no other one than a material library of plain colours, which is written beside it
    if any part has a colour.

    Args:
        pieces: Parts of the mesh.
        path: Path of the file.
        coordinates: Format of a vertex's coordinates, which by default keep all their digits.
    """
    lines, materials, count = [], [], 1
    if any(piece.color for piece in pieces):
        lines.append(f"mtllib {path.with_suffix('.mtl').name}\n")
    for index, piece in enumerate(pieces):
        red, green, blue, opacity = piece.color or (0.9, 0.9, 0.9, 1.0)
        materials.append(f"newmtl m{index}\nKd {red:.4g} {green:.4g} {blue:.4g}\nd {opacity:.4g}\n")
        lines.append(f"usemtl m{index}\n" if piece.color else "")
        shaded = _shaded(piece.mesh)
        for row, values in (
            (f"v %{coordinates} %{coordinates} %{coordinates}\n", shaded.vertices),
            ("vn %.6g %.6g %.6g\n", shaded.vertex_normals),
            ("f %d//%d %d//%d %d//%d\n", np.repeat(shaded.faces + count, 2, axis=1)),
        ):
            lines.append(row * len(values) % tuple(np.ravel(values).tolist()))
        count += len(shaded.vertices)
    path.write_text("".join(lines), encoding="ascii")
    if any(piece.color for piece in pieces):
        path.with_suffix(".mtl").write_text("".join(materials), encoding="ascii")
    return path


_HULL, _SHOWN = "collision", "visual"  # Folders of the converted meshes.


def convert_meshes(
    robot: Element,
    find: Callable[[str], Path],
    folder: Path,
    on_progress: Callable[[int, int], None],
) -> None:
    """Converts all meshes of a robot, and replaces their names by those of the new files.

    Collision meshes are declared to be convex, because they were made as convex hulls. A visual
    mesh becomes one visual for each of its colours.

    Args:
        robot: The URDF.
        find: Function that returns the file of a name.
        folder: Folder for the new files, which have the same relative paths as their sources in its
            folders `collision` and `visual`.
        on_progress: Function that is called with the numbers of files done and of all.
    """
    visuals = [(link, visual) for link in robot.iter("link") for visual in link.findall("visual")]
    hulls = list(robot.iterfind("link/collision/geometry/mesh"))
    # One file may be of both kinds; its hull is whole, regardless of colours.
    uses = sorted(
        {(_HULL, _name(mesh)) for mesh in hulls}
        | {(_SHOWN, _name(mesh)) for _, visual in visuals for mesh in visual.iter("mesh")}
    )
    targets = _targets({name: find(name) for _, name in uses})
    converted: dict[tuple[str, str], dict[Path, Color | None]] = {}
    for done, (kind, name) in enumerate(uses):
        on_progress(done, len(uses))
        target = folder / kind / targets[name]
        converted[kind, name] = convert_mesh(find(name), target, colors=kind == _SHOWN)
    on_progress(len(uses), len(uses))
    for mesh in hulls:
        (whole,) = converted[_HULL, _name(mesh)]
        mesh.set("filename", whole.relative_to(folder).as_posix())
        SubElement(mesh, f"{{{DRAKE}}}declare_convex")
    for link, visual in visuals:
        for mesh in visual.iter("mesh"):
            _show(link, visual, converted[_SHOWN, _name(mesh)], folder)


def cut_boxes(robot: Element, find: Callable[[str], Path]) -> None:
    """Cuts collision boxes to the bounds of the first visual mesh of their links.

    A box that goes on into a rubber tip would touch before the tip at an angle.
    Only boxes and meshes whose axes are those of their link are compared.

    Args:
        robot: The URDF, with the names of the original meshes.
        find: Function that returns the file of a name.
    """
    for link in robot.iter("link"):
        mesh, shown = link.find("visual/geometry/mesh"), link.find("visual/origin")
        for collision in link.findall("collision"):
            box, place = collision.find("geometry/box"), collision.find("origin")
            if mesh is None or box is None or _is_turned(shown) or _is_turned(place):
                continue
            center, half = _vector(place, "xyz"), _vector(box, "size") / 2
            bounds = trimesh.load_scene(find(_name(mesh))).bounds + _vector(shown, "xyz")
            low = np.maximum(center - half, bounds[0])
            high = np.minimum(center + half, bounds[1])
            if np.all(low < high):
                place = SubElement(collision, "origin") if place is None else place
                place.set("xyz", " ".join(f"{x:.6g}" for x in (low + high) / 2))
                box.set("size", " ".join(f"{x:.6g}" for x in high - low))


def _is_turned(origin: Element | None) -> bool:
    return bool(np.any(_vector(origin, "rpy")))


def _vector(element: Element | None, key: str) -> FloatArray:
    text = "0 0 0" if element is None else element.get(key, "0 0 0")
    return np.array([float(part) for part in text.split()])


def _targets(sources: Mapping[str, Path]) -> dict[str, Path]:
    """Returns the path of each file relative to the common folder of all files."""
    resolved = {name: source.resolve() for name, source in sources.items()}
    if not resolved:
        return {}
    top = os.path.commonpath([source.parent for source in resolved.values()])
    return {name: source.relative_to(top) for name, source in resolved.items()}


def _name(mesh: Element) -> str:
    return mesh.get("filename", "")


def _show(link: Element, visual: Element, parts: Mapping[Path, Color | None], folder: Path) -> None:
    """Puts visuals of the parts in place of one visual."""
    place = list(link).index(visual)
    link.remove(visual)
    for path, color in parts.items():
        name = path.relative_to(folder).as_posix()
        shown = copy.deepcopy(visual)
        for mesh in shown.iter("mesh"):
            mesh.set("filename", name)
        if color is not None:
            material = SubElement(shown, "material", name=name)
            SubElement(material, "color", rgba=" ".join(f"{c:g}" for c in color))
        link.insert(place, shown)
