"""A box model file, resized."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import FloatArray

# Else the writer renames the prefix, and Drake ignores its own elements.
ET.register_namespace("drake", "http://drake.mit.edu")


def resized_box_sdf(path: Path, size: Sequence[float], mass: float) -> str:
    """Returns the SDF text of a one-link box model with another size and mass.

    Spheres that stand out of the file's box by nothing (its feet) do so of the new one as well.

    Args:
        path: The SDF file; its visual named `body` is the box.
        size: New edge lengths, in metres.
        mass: New mass of the homogeneous box, in kg.

    Raises:
        InvalidArgumentError: If the file can't be read, or isn't such a model.
    """
    try:
        tree = ET.parse(path)
    except (OSError, ET.ParseError) as error:
        raise InvalidArgumentError(f"{path} can't be read as SDF: {error}") from error
    size_element = tree.find(".//visual[@name='body']/geometry/box/size")
    if size_element is None:
        raise InvalidArgumentError(f"{path} has no visual named 'body' that is a box")
    growth = (np.array(size) - _numbers(size_element)) / 2
    size_element.text = _text(size)
    for collision in tree.iter("collision"):
        pose = collision.find("pose")
        if pose is not None:
            values = _numbers(pose)
            values[:3] += np.sign(values[:3]) * growth
            pose.text = _text(values)

    inertial = tree.find(".//inertial")
    if inertial is None:
        raise InvalidArgumentError(f"{path} has no inertial element")
    squares = np.array(size) ** 2
    moments = mass / 12 * (np.sum(squares) - squares)
    new_values = {"mass": mass, **dict(zip(("ixx", "iyy", "izz"), moments, strict=True))}
    for tag, value in new_values.items():
        for element in inertial.iter(tag):
            element.text = _text([value])
    return ET.tostring(tree.getroot(), encoding="unicode")


def _numbers(element: ET.Element) -> FloatArray:
    return np.array([float(word) for word in (element.text or "").split()])


def _text(values: Sequence[float] | FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values)
