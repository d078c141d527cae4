"""The object as a body of a plant."""

import numpy as np
from pydrake.geometry import Box as BoxShape
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RigidBody

from drake_pregrasp.diagrams.box_model import resized_box_sdf
from drake_pregrasp.diagrams.object_config import ObjectConfig
from drake_pregrasp.resources import resource_folder

FIRST_TOUCH = 1e-6
"""Depth in metres by which the object starts in the table: without any contact, it would fall
freely for one time step, and start with a bounce."""

_FRICTION = CoulombFriction(static_friction=0.8, dynamic_friction=0.8)


def add_object_body(plant: MultibodyPlant, object_config: ObjectConfig) -> RigidBody:
    """Adds the object to a plant that isn't finalized, and returns its body; its frame is O."""
    sdf = resized_box_sdf(
        resource_folder("models") / "cube.sdf", object_config.size, object_config.mass
    )
    (cube,) = Parser(plant).AddModelsFromString(sdf, "sdf")
    return plant.GetBodyByName("cube", cube)


def add_solid_collision(
    plant: MultibodyPlant, body: RigidBody, object_config: ObjectConfig
) -> GeometryId:
    """Lets the object be touched everywhere, not only where it stands."""
    shape = BoxShape(*np.array(object_config.size))
    return plant.RegisterCollisionGeometry(body, RigidTransform(), shape, "solid", _FRICTION)


def standing_height(object_config: ObjectConfig) -> float:
    """Returns the height of O, in metres, over the table that the object stands on."""
    return object_config.size[2] / 2 - FIRST_TOUCH
