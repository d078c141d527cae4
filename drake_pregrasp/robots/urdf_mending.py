"""Adapts URDF files of other simulators to Drake."""

import copy
from collections.abc import Iterable
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

DRAKE = "http://drake.mit.edu"
"""Namespace of Drake's own elements."""

_IGNORED = ("safety_controller", "dynamics")  # Elements of joints that Drake warns about.
_SLACK = 1e-12  # Rounding error of moments of inertia, in kg m².


@dataclass(frozen=True)
class Drive:
    """Drive of a joint to desired positions.

    Attributes:
        stiffness: Gain of the position error, in N m/rad.
        damping: Gain of the velocity error, in N m s/rad.
        rotor_inertia: Inertia of the rotor reflected by the gears, in kg m².
        effort: Largest torque, in N m, or None for that of the model.
        acceleration: Largest acceleration, in rad/s², or None for no limit.
    """

    stiffness: float
    damping: float
    rotor_inertia: float
    effort: float | None = None
    acceleration: float | None = None


def drop_from(robot: Element, link: str) -> None:
    """Removes a link and all that hangs on it, with their joints."""
    for joint in robot.findall("joint"):
        if _end(joint, "child") == link:
            robot.remove(joint)
        elif _end(joint, "parent") == link:
            drop_from(robot, _end(joint, "child"))
    for element in robot.findall(f"link[@name='{link}']"):
        robot.remove(element)


def _end(joint: Element, side: str) -> str:
    element = joint.find(side)
    return "" if element is None else element.get("link", "")


def add_robot(robot: Element, other: Element) -> None:
    """Adds all links and joints of another robot."""
    robot.extend(copy.deepcopy([e for e in other if e.tag in ("link", "joint")]))


def weld(
    robot: Element, parent: str, child: str, *, xyz: Iterable[float], rpy: Iterable[float]
) -> None:
    """Adds a fixed joint between two links, of which `world` is Drake's world body."""
    joint = SubElement(robot, "joint", name=f"{child}_to_{parent}", type="fixed")
    SubElement(joint, "origin", xyz=_text(xyz), rpy=_text(rpy))
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)


def _text(numbers: Iterable[float]) -> str:
    return " ".join(f"{number:.12g}" for number in numbers)


def drop_ignored(robot: Element) -> None:
    """Removes what Drake cannot use, and would warn of."""
    for joint in robot.findall("joint"):
        for element in [element for element in joint if element.tag in _IGNORED]:
            joint.remove(element)


def mend_inertias(robot: Element) -> list[str]:
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


def drive_joints(robot: Element, drive: Drive, *, prefix: str) -> None:
    """Adds actuators with gains to the movable joints whose names start with a prefix."""
    ElementTree.register_namespace("drake", DRAKE)
    for joint in robot.findall("joint"):
        name, limit = joint.get("name", ""), joint.find("limit")
        if joint.get("type") == "fixed" or limit is None or not name.startswith(prefix):
            continue
        if drive.effort is not None:
            limit.set("effort", f"{drive.effort:g}")
        if drive.acceleration is not None:
            limit.set(f"{{{DRAKE}}}acceleration", f"{drive.acceleration:g}")
        transmission = SubElement(robot, "transmission")
        SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
        SubElement(transmission, "joint", name=name)
        actuator = SubElement(transmission, "actuator", name=name)
        SubElement(actuator, f"{{{DRAKE}}}rotor_inertia", value=f"{drive.rotor_inertia:g}")
        SubElement(actuator, f"{{{DRAKE}}}gear_ratio", value="1")
        gains = {"p": f"{drive.stiffness:g}", "d": f"{drive.damping:g}"}
        SubElement(actuator, f"{{{DRAKE}}}controller_gains", gains)


def set_contact(robot: Element, coefficient: float, stiffness: float) -> None:
    """Sets the Coulomb friction coefficient and point-contact stiffness in N/m of collisions."""
    for collision in robot.iterfind("link/collision"):
        properties = SubElement(collision, f"{{{DRAKE}}}proximity_properties")
        SubElement(properties, f"{{{DRAKE}}}mu_static", value=f"{coefficient:g}")
        SubElement(properties, f"{{{DRAKE}}}mu_dynamic", value=f"{coefficient:g}")
        SubElement(properties, f"{{{DRAKE}}}point_contact_stiffness", value=f"{stiffness:g}")
