"""Meshes that a URDF names, converted and named anew."""

import copy
from collections.abc import Callable
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from drake_pregrasp.robots.mesh_conversion import ConvertedMesh, convert_mesh
from drake_pregrasp.robots.urdf_mending import DRAKE


def convert_meshes(
    robot: Element,
    find: Callable[[str], Path],
    folder: Path,
    on_progress: Callable[[int, int], None],
) -> None:
    """Converts all meshes of a robot, and has it name the new files, relative to a folder.

    Those of collision shapes are declared to be convex hulls: that is what they were made as, and
    the only kind that meets others as it is. Visual ones become a shape for each of their colours.

    Args:
        robot: The URDF.
        find: Gives the file of a name.
        folder: Where new files go.
        on_progress: Called with how many files are done, of how many.
    """
    visuals = [(link, visual) for link in robot.iter("link") for visual in link.findall("visual")]
    hulls = list(robot.iterfind("link/collision/geometry/mesh"))
    names = sorted(
        {_name(m) for m in hulls} | {_name(m) for _, v in visuals for m in v.iter("mesh")}
    )
    shown = {_name(mesh) for _, visual in visuals for mesh in visual.iter("mesh")}
    converted: dict[str, list[ConvertedMesh]] = {}
    for done, name in enumerate(names):
        on_progress(done, len(names))
        source = find(name)
        kind = "visual" if name in shown else "collision"
        target = folder / f"{kind}_{source.stem.replace('.', '_')}"
        converted[name] = convert_mesh(source, target, colors=name in shown)
    on_progress(len(names), len(names))
    for mesh in hulls:
        mesh.set("filename", converted[_name(mesh)][0].path.name)
        SubElement(mesh, f"{{{DRAKE}}}declare_convex")
    for link, visual in visuals:
        for mesh in visual.iter("mesh"):
            _show(link, visual, converted[_name(mesh)])


def _name(mesh: Element) -> str:
    return mesh.get("filename", "")


def _show(link: Element, visual: Element, parts: list[ConvertedMesh]) -> None:
    """Puts visuals of the parts in place of one visual."""
    place = list(link).index(visual)
    link.remove(visual)
    for part in parts:
        shown = copy.deepcopy(visual)
        for mesh in shown.iter("mesh"):
            mesh.set("filename", part.path.name)
        if part.color is not None:
            material = SubElement(shown, "material", name=part.path.stem)
            SubElement(material, "color", rgba=" ".join(f"{c:g}" for c in part.color))
        link.insert(place, shown)
