"""Obstacles as bodies of a plant, which collide with the object and a hand."""

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    CollisionFilterDeclaration,
    GeometrySet,
    ProximityProperties,
    Role,
    SceneGraph,
)
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import (
    ModelInstanceIndex,
    PdControllerGains,
    PrismaticJoint,
    RigidBody,
    SpatialInertia,
)

from drake_pregrasp.diagrams.object_body import DISSIPATION, FRICTION, MODULUS
from drake_pregrasp.systems.drawing import BODY_COLOR, drawn_solid
from drake_pregrasp.systems.hand_scene import drake_shape
from drake_pregrasp.systems.sources import MovingSolid

_RESOLUTION = 0.02  # Edges of the tetrahedra of balls, in metres.
_GAINS = PdControllerGains(p=1e4, d=2e2)  # The same as those of the conveyor.


def add_obstacle_bodies(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    obstacles: Sequence[MovingSolid],
    body: RigidBody,
) -> list[tuple[ModelInstanceIndex, float]]:
    """Adds obstacles as bodies, and returns the driven models with their speeds in m/s.

    Obstacles that do not move are fixed in the world; the others have a drive along their velocity.
    They do not collide with each other, nor with tables.

    Args:
        plant: Plant that is not finalized, with the object and tables but without a hand.
        scene_graph: SceneGraph of the plant.
        obstacles: Obstacles with their velocities, in W.
        body: Body of the object.
    """
    inspector, manager = scene_graph.model_inspector(), scene_graph.collision_filter_manager()
    others = set(inspector.GetAllGeometryIds(Role.kProximity))
    others -= set(plant.GetCollisionGeometriesForBody(body))
    properties, driven, solids = ProximityProperties(), [], []
    friction = CoulombFriction(FRICTION, FRICTION)
    AddContactMaterial(dissipation=DISSIPATION, friction=friction, properties=properties)
    AddCompliantHydroelasticProperties(_RESOLUTION, MODULUS, properties)
    for index, obstacle in enumerate(obstacles):
        name, speed = f"obstacle_{index}", float(np.linalg.norm(obstacle.velocity))
        carrier = plant.world_body()
        if speed > 0:
            instance = plant.AddModelInstance(name)
            # Any inertia will do, because the drive prescribes the motion.
            inertia = SpatialInertia.SolidSphereWithMass(1.0, 0.1)
            carrier = plant.AddRigidBody(name, instance, inertia)
            plant.set_gravity_enabled(instance, False)
            world, frame = plant.world_frame(), carrier.body_frame()
            slide = plant.AddJoint(PrismaticJoint(name, world, frame, obstacle.velocity))
            plant.AddJointActuator(name, slide).set_controller_gains(_GAINS)
            driven.append((instance, speed))
        shape, X_WS = drake_shape(obstacle.solid)
        solids.append(plant.RegisterCollisionGeometry(carrier, X_WS, shape, name, properties))
        drawn, X_WD = drawn_solid(obstacle.solid)
        plant.RegisterVisualGeometry(carrier, X_WD, drawn, name, BODY_COLOR)
    own = CollisionFilterDeclaration().ExcludeWithin(GeometrySet(solids))
    manager.Apply(own.ExcludeBetween(GeometrySet(solids), GeometrySet(list(others))))
    return driven
