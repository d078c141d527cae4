"""Meshes that a URDF names, converted and named anew."""

import copy
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from drake_pregrasp.robots.mesh_conversion import ConvertedMesh, convert_mesh
from drake_pregrasp.robots.urdf_mending import DRAKE

_HULL, _SHOWN = "collision", "visual"  # Folders of what is made.


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
        folder: Where new files go, below `collision` and `visual` as their sources lie to each
            other.
        on_progress: Called with how many files are done, of how many.
    """
    visuals = [(link, visual) for link in robot.iter("link") for visual in link.findall("visual")]
    hulls = list(robot.iterfind("link/collision/geometry/mesh"))
    # One file may be of both kinds: hulls are whole, whatever its colours.
    uses = sorted(
        {(_HULL, _name(mesh)) for mesh in hulls}
        | {(_SHOWN, _name(mesh)) for _, visual in visuals for mesh in visual.iter("mesh")}
    )
    targets = _targets({name: find(name) for _, name in uses})
    converted: dict[tuple[str, str], list[ConvertedMesh]] = {}
    for done, (kind, name) in enumerate(uses):
        on_progress(done, len(uses))
        target = folder / kind / targets[name]
        converted[kind, name] = convert_mesh(find(name), target, colors=kind == _SHOWN)
    on_progress(len(uses), len(uses))
    for mesh in hulls:
        (whole,) = converted[_HULL, _name(mesh)]
        mesh.set("filename", whole.path.relative_to(folder).as_posix())
        SubElement(mesh, f"{{{DRAKE}}}declare_convex")
    for link, visual in visuals:
        for mesh in visual.iter("mesh"):
            _show(link, visual, converted[_SHOWN, _name(mesh)], folder)


def _targets(sources: Mapping[str, Path]) -> dict[str, Path]:
    """Returns where each file goes: its path below the folder that holds all of them."""
    resolved = {name: source.resolve() for name, source in sources.items()}
    if not resolved:
        return {}
    top = os.path.commonpath([source.parent for source in resolved.values()])
    return {name: source.relative_to(top) for name, source in resolved.items()}


def _name(mesh: Element) -> str:
    return mesh.get("filename", "")


def _show(link: Element, visual: Element, parts: list[ConvertedMesh], folder: Path) -> None:
    """Puts visuals of the parts in place of one visual."""
    place = list(link).index(visual)
    link.remove(visual)
    for part in parts:
        name = part.path.relative_to(folder).as_posix()
        shown = copy.deepcopy(visual)
        for mesh in shown.iter("mesh"):
            mesh.set("filename", name)
        if part.color is not None:
            material = SubElement(shown, "material", name=name)
            SubElement(material, "color", rgba=" ".join(f"{c:g}" for c in part.color))
        link.insert(place, shown)
