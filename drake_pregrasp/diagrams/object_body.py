"""The object as a body of a plant, with the mesh of the planner's surface.

An object of any shape is a rigid hydroelastic body with its own triangle mesh. Contact is then
correct for concave shapes too: a convex decomposition would fill a cup. Pressure patches hold the
object on a moving table, where single contact points would hop. Drake allows contact of a rigid
mesh only with compliant bodies, so tables and pushers are compliant. Bodies without hydroelastic
properties, such as fingertips, touch the mesh's convex hull at a point.
"""

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    InMemoryMesh,
    ProximityProperties,
)
from pydrake.geometry import Mesh as MeshGeometry
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RigidBody, RotationalInertia, SpatialInertia

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.object_config import ObjectConfig
from drake_pregrasp.geometry.shapes import Shape

FIRST_TOUCH = 1e-6
"""Initial depth of the object in the table, in metres: without contact it would fall for one time
step and bounce."""

FRICTION = 0.8
"""Coulomb's coefficient of an object without a hand, the same as that of tables."""

_COLOR = np.array([0.78, 0.80, 0.83, 1.0])
_DIGITS = 12  # Digits of coordinates in the OBJ text of a mesh for Drake.


def add_object_body(
    plant: MultibodyPlant, object_config: ObjectConfig, *, friction: float = FRICTION
) -> RigidBody:
    """Adds the object to a plant that is not finalized, and returns its body, whose frame is O.

    Args:
        plant: Plant to which the object is added.
        object_config: The object.
        friction: Coulomb's coefficient of the object.
    """
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
        AddContactMaterial(friction=CoulombFriction(friction, friction), properties=properties)
        AddRigidHydroelasticProperties(properties=properties)
        X_OG = RigidTransform()
        plant.RegisterCollisionGeometry(body, X_OG, mesh, "surface", properties)
        plant.RegisterVisualGeometry(body, X_OG, mesh, "surface", _COLOR)
    return body


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
