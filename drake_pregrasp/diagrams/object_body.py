"""The object as a body of a plant, made from the same mesh that the planner's surface is.

A box stands on four small spheres, and is a box for whatever else touches it. Every other shape is
its own triangle mesh, as a rigid hydroelastic body: contact is then right for concave shapes too,
with no convex decomposition in between that would fill a cup or thicken a handle, and its patches
of pressure hold the object on a moving table without the hopping of single contact points. Drake
allows a rigid mesh only against a compliant partner, so tables and pushers are compliant.
"""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    GeometryId,
    InMemoryMesh,
    ProximityProperties,
)
from pydrake.geometry import Box as BoxGeometry
from pydrake.geometry import Mesh as MeshGeometry
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RigidBody, RotationalInertia, SpatialInertia

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.object_config import Box, ObjectConfig
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.resources import resource_folder

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


FIRST_TOUCH = 1e-6
"""Depth in metres by which the object starts in the table: without any contact, it would fall
freely for one time step, and start with a bounce."""

_FRICTION = CoulombFriction(static_friction=0.8, dynamic_friction=0.8)
_COLOR = np.array([0.78, 0.80, 0.83, 1.0])
_DIGITS = 12  # Of coordinates in the text that carries a mesh to Drake.


def add_object_body(plant: MultibodyPlant, object_config: ObjectConfig) -> RigidBody:
    """Adds the object to a plant that isn't finalized, and returns its body; its frame is O."""
    if isinstance(object_config, Box):
        sdf = resized_box_sdf(
            resource_folder("models") / "cube.sdf", object_config.size, object_config.mass
        )
        (cube,) = Parser(plant).AddModelsFromString(sdf, "sdf")
        return plant.GetBodyByName("cube", cube)
    shape = object_config.make_shape()
    body = plant.AddRigidBody(
        "object",
        plant.AddModelInstance("object"),
        _spatial_inertia(shape, object_config.mass),
    )
    if plant.geometry_source_is_registered():
        text = shape.mesh.export(file_type="obj", digits=_DIGITS)
        mesh = MeshGeometry(
            mesh_data=InMemoryMesh(mesh_file=MemoryFile(text, ".obj", "object.obj")), scale=1.0
        )
        properties = ProximityProperties()
        AddContactMaterial(friction=_FRICTION, properties=properties)
        AddRigidHydroelasticProperties(properties=properties)
        X_OG = RigidTransform()
        plant.RegisterCollisionGeometry(body, X_OG, mesh, "surface", properties)
        plant.RegisterVisualGeometry(body, X_OG, mesh, "surface", _COLOR)
    return body


def add_solid_collision(
    plant: MultibodyPlant,
    body: RigidBody,
    object_config: ObjectConfig,
    *,
    friction: CoulombFriction = _FRICTION,
) -> list[GeometryId]:
    """Lets a box be touched everywhere, not only where it stands; other shapes can be anyway.

    Args:
        plant: Not finalized.
        body: The object.
        object_config: What it is.
        friction: Of what is added.

    Returns:
        What was added. On a table it would be one hopping contact point.
    """
    if not isinstance(object_config, Box):
        return []
    geometry = BoxGeometry(*np.array(object_config.size))
    return [plant.RegisterCollisionGeometry(body, RigidTransform(), geometry, "solid", friction)]


def standing_position(object_config: ObjectConfig) -> FloatArray:
    """Returns where O is in W, shape (3,), in metres, when the object stands on a table.

    Its centre of mass is then above W's origin, wherever its mesh is in O.
    """
    shape = object_config.make_shape()
    lowest = float(np.min(shape.mesh.vertices[:, 2]))
    position: FloatArray = -shape.p_OCoM
    position[2] = -lowest - FIRST_TOUCH
    return position


def _spatial_inertia(shape: Shape, mass: float) -> SpatialInertia:
    """Returns the inertia of a homogeneous body, about O and expressed in O."""
    I = shape.mesh.moment_inertia * (mass / shape.mesh.volume)  # noqa: E741
    return SpatialInertia.MakeFromCentralInertia(
        mass,
        shape.p_OCoM,
        RotationalInertia(I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]),
    )
