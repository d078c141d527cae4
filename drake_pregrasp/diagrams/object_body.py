"""The object as a body of a plant, with the mesh of the planner's surface.

A box stands on four small spheres; other bodies touch its faces. Every other shape is a rigid
hydroelastic body with its own triangle mesh. Contact is then correct for concave shapes too: a
convex decomposition would fill a cup. Pressure patches hold the object on a moving table, where
single contact points would hop. Drake allows contact of a rigid mesh only with compliant bodies, so
tables and pushers are compliant.
"""

import xml.etree.ElementTree as ET
from collections.abc import Sequence

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
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.resources import resource_folder

# Without this, the writer renames the prefix and Drake ignores its own elements.
ET.register_namespace("drake", "http://drake.mit.edu")


def resized_box_sdf(size: Sequence[float], mass: float) -> str:
    """Returns the SDF text of the shipped cube as a homogeneous box of another size and mass.

    The spheres at the corners of the cube, its feet, move to the corners of the box.

    Args:
        size: Edge lengths of the box, in metres.
        mass: Mass of the box, in kg.
    """
    root = ET.parse(resource_folder("models") / "cube.sdf").getroot()
    (size_element,) = root.iterfind(".//visual[@name='body']/geometry/box/size")
    growth = (np.array(size) - _numbers(size_element)) / 2
    size_element.text = _text(size)
    for pose in root.iterfind(".//collision/pose"):
        values = _numbers(pose)
        values[:3] += np.sign(values[:3]) * growth
        pose.text = _text(values)
    squares = np.array(size) ** 2
    moments = mass / 12 * (np.sum(squares) - squares)
    for tag, value in zip(("mass", "ixx", "iyy", "izz"), [mass, *moments], strict=True):
        (element,) = root.iterfind(f".//inertial//{tag}")
        element.text = _text([value])
    return ET.tostring(root, encoding="unicode")


def _numbers(element: ET.Element) -> FloatArray:
    return np.array([float(word) for word in (element.text or "").split()])


def _text(values: Sequence[float] | FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values)


FIRST_TOUCH = 1e-6
"""Initial depth of the object in the table, in metres: without contact it would fall for one time
step and bounce."""

_FRICTION = CoulombFriction(static_friction=0.8, dynamic_friction=0.8)
_COLOR = np.array([0.78, 0.80, 0.83, 1.0])
_DIGITS = 12  # Digits of coordinates in the OBJ text of a mesh for Drake.


def add_object_body(plant: MultibodyPlant, object_config: ObjectConfig) -> RigidBody:
    """Adds the object to a plant that is not finalized, and returns its body, whose frame is O."""
    if isinstance(object_config, Box):
        sdf = resized_box_sdf(object_config.size, object_config.mass)
        (cube,) = Parser(plant).AddModelsFromString(sdf, "sdf")
        return plant.GetBodyByName("cube", cube)
    shape = object_config.make_shape()
    body = plant.AddRigidBody(
        "object", plant.AddModelInstance("object"), _spatial_inertia(shape, object_config.mass)
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
    """Adds a collision geometry to all faces of a box; other shapes already have theirs.

    Args:
        plant: Plant that is not finalized.
        body: Body of the object.
        object_config: The object.
        friction: Friction of the added geometry.

    Returns:
        The added geometries. In contact with a table, a face would be a single point that hops.
    """
    if not isinstance(object_config, Box):
        return []
    geometry = BoxGeometry(*np.array(object_config.size))
    return [plant.RegisterCollisionGeometry(body, RigidTransform(), geometry, "solid", friction)]


def standing_position(object_config: ObjectConfig) -> FloatArray:
    """Returns the position of O in W for an object that stands on a table, shape (3,), in metres.

    Its centre of mass is above the origin of W.
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
        mass, shape.p_OCoM, RotationalInertia(I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
    )
