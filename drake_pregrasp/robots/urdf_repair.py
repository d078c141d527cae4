"""Adapts URDF files of other simulators to Drake."""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

DRAKE = "http://drake.mit.edu"
"""Namespace of Drake's own elements."""

_IGNORED = ("safety_controller", "dynamics")  # Elements of joints that Drake warns about.
_SLACK = 1e-12  # Rounding error of moments of inertia, in kg m².


def drop_from(robot: Element, link: str) -> None:
    """Removes a link and all links below it, with their joints."""
    for joint in robot.findall("joint"):
        if _end(joint, "child") == link:
            robot.remove(joint)
        elif _end(joint, "parent") == link:
            drop_from(robot, _end(joint, "child"))
    for element in robot.findall(f"link[@name='{link}']"):
        robot.remove(element)


def drop_world(robot: Element) -> None:
    """Removes the joints on the world, so that the base of the robot is free."""
    for joint in robot.findall("joint"):
        if _end(joint, "parent") == "world":
            robot.remove(joint)
    for element in robot.findall("link[@name='world']"):
        robot.remove(element)


def _end(joint: Element, side: str) -> str:
    element = joint.find(side)
    return "" if element is None else element.get("link", "")


def drop_ignored(robot: Element) -> None:
    """Removes elements of joints that Drake ignores, and damping: that of drives replaces it."""
    for joint in robot.findall("joint"):
        for element in [element for element in joint if element.tag in _IGNORED]:
            joint.remove(element)


def repair_inertias(robot: Element) -> list[str]:
    """Makes rotational inertias physically valid, and returns the names of changed links.

    If the principal moments violate the triangle inequality a + b >= c or are not positive,
    products of inertia are set to zero. Inertias of links without mass are removed.
    """
    mended = []
    for link in robot.findall("link"):
        inertial, inertia, mass = (
            link.find(p) for p in ("inertial", "inertial/inertia", "inertial/mass")
        )
        if inertial is None or inertia is None or mass is None:
            continue
        if float(mass.get("value", "0")) == 0:
            link.remove(inertial)
        elif not _is_possible(inertia):
            for name in ("ixy", "ixz", "iyz"):
                inertia.set(name, "0")
            mended.append(link.get("name", ""))
    return mended


def _is_possible(inertia: Element) -> bool:
    xx, yy, zz, xy, xz, yz = (
        float(inertia.get(f"i{axes}", "0")) for axes in ("xx", "yy", "zz", "xy", "xz", "yz")
    )
    moments = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    return bool(moments[0] > 0 and moments[0] + moments[1] >= moments[2] - _SLACK)


def set_contact(robot: Element, coefficient: float, stiffness: float) -> None:
    """Sets the Coulomb friction coefficient and point-contact stiffness in N/m of collisions."""
    ElementTree.register_namespace("drake", DRAKE)
    for collision in robot.iterfind("link/collision"):
        properties = SubElement(collision, f"{{{DRAKE}}}proximity_properties")
        SubElement(properties, f"{{{DRAKE}}}mu_static", value=f"{coefficient:g}")
        SubElement(properties, f"{{{DRAKE}}}mu_dynamic", value=f"{coefficient:g}")
        SubElement(properties, f"{{{DRAKE}}}point_contact_stiffness", value=f"{stiffness:g}")
