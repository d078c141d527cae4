"""Contact of an object with the other bodies of a plant."""

from collections.abc import Collection, Iterable, Iterator

import numpy as np
import trimesh
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    CollisionFilterDeclaration,
    Cylinder,
    GeometryId,
    GeometrySet,
    Mesh,
    ProximityProperties,
    Role,
    RoleAssign,
    SceneGraph,
    SceneGraphInspector,
    Sphere,
)
from pydrake.multibody.plant import ContactModel, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody

from drake_pregrasp.diagrams.object_body import HULL, SURFACE
from drake_pregrasp.errors import InvalidArgumentError

_LINK_MODULUS = 1e8  # Of links that touch a mesh, in Pa: 5 N press a fingertip 0.1 mm deep.
_LINK_RESOLUTION = 0.003  # Edge length of the facets of such links, in metres.
_FILLED = 1.05  # Volume of a convex hull over that of an object whose hollows it fills.


def separate_contacts(
    plant: MultibodyPlant, scene_graph: SceneGraph, body: RigidBody, *, is_convex: bool
) -> None:
    """Lets spheres and compliant cylinders, such as pads, touch the mesh of an object.

    The rest touches its hull.

    Links without hydroelastic properties have points of contact with the hull if the object is
    convex. Otherwise they become compliant and touch the mesh (`make_compliant`). Geometries that
    are separated already stay as they are.

    Args:
        plant: Finalized plant with all bodies that the object may touch.
        scene_graph: SceneGraph of the plant.
        body: Body of the object, from `add_object`.
        is_convex: Whether the object is convex, as `shape.mesh.is_convex` says.

    Raises:
        InvalidArgumentError: If the body has other collision geometries than those of `add_object`.
    """
    inspector = scene_graph.model_inspector()
    if not has_hull_and_surface(plant, inspector, body):
        raise InvalidArgumentError(f"body: {body.name()} must be a body from add_object")
    hull, surface = plant.GetCollisionGeometriesForBody(body)
    fine, flat = [], []
    for geometry in inspector.GetAllGeometryIds(Role.kProximity):
        if any(inspector.CollisionFiltered(own, geometry) for own in (hull, surface)):
            continue
        properties = ProximityProperties(inspector.GetProximityProperties(geometry))
        is_point, kind = not _is_hydroelastic(properties), inspector.GetShape(geometry)
        is_ball = isinstance(kind, Sphere) and not is_point
        is_pad = isinstance(kind, Cylinder) and _is_compliant(properties)
        if is_point and not is_convex:
            make_compliant(plant, scene_graph, [geometry])
            fine.append(geometry)
        elif is_ball or is_pad or (not is_convex and _modulus(properties) == _LINK_MODULUS):
            fine.append(geometry)
        else:
            flat.append(geometry)
    only = CollisionFilterDeclaration()
    only.ExcludeBetween(GeometrySet(hull), GeometrySet(fine))
    only.ExcludeBetween(GeometrySet(surface), GeometrySet(flat))
    scene_graph.collision_filter_manager().Apply(only)


def make_compliant(
    plant: MultibodyPlant, scene_graph: SceneGraph, geometries: Iterable[GeometryId]
) -> None:
    """Makes geometries of a hand compliant, unless they have hydroelastic properties.

    Args:
        plant: Plant with the geometries.
        scene_graph: SceneGraph of the plant.
        geometries: The geometries.
    """
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    for geometry in geometries:
        properties = ProximityProperties(inspector.GetProximityProperties(geometry))
        if not _is_hydroelastic(properties):
            AddCompliantHydroelasticProperties(_LINK_RESOLUTION, _LINK_MODULUS, properties)
            scene_graph.AssignRole(source, geometry, properties, RoleAssign.kReplace)


def has_hull_and_surface(
    plant: MultibodyPlant, inspector: SceneGraphInspector, body: RigidBody
) -> bool:
    """Returns whether a body has the collision geometries of `add_object`, and no others."""
    names = [inspector.GetName(g) for g in plant.GetCollisionGeometriesForBody(body)]
    return [name.rpartition("::")[2] for name in names] == [HULL, SURFACE]


def only_free_body(plant: MultibodyPlant) -> RigidBody | None:
    """Returns the free body of a finalized plant; None if there is none, or several."""
    free: set[BodyIndex] = plant.GetFloatingBaseBodies()
    return plant.get_body(free.pop()) if len(free) == 1 else None


def contact_problems(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    body: RigidBody,
    fingertips: Collection[GeometryId],
    volume: float,
) -> Iterator[str]:
    """Yields the reasons for which an object cannot be held in a plant as it would be in truth.

    Args:
        plant: Finalized plant with the object and the hand.
        inspector: Inspector of the plant's SceneGraph.
        body: Body of the object.
        fingertips: Collision geometries of the fingertips.
        volume: Volume of the object, in m³.
    """
    if plant.get_contact_model() == ContactModel.kPoint:
        yield (
            "the plant's contact_model is point: objects sink, hop or spin on single points of"
            " contact; set hydroelastic_with_fallback"
        )
        return
    geometries = plant.GetCollisionGeometriesForBody(body)
    if not any(_is_hydroelastic(inspector.GetProximityProperties(own)) for own in geometries):
        yield (
            f"{body.name()} has no hydroelastic properties: it sinks, hops or spins on single"
            " points of contact; add it by add_object, or make it compliant"
        )
    met = [[g for g in geometries if not inspector.CollisionFiltered(tip, g)] for tip in fingertips]
    if missed := sum(not there for there in met):
        yield f"{missed} of {len(met)} fingertips collide with nothing of {body.name()}"
    filled = sum(
        any(_is_met_as_hull(inspector, own, tip, volume) for own in there)
        for tip, there in zip(fingertips, met, strict=True)
    )
    if filled:
        yield (
            f"{filled} of {len(met)} fingertips meet the convex hull of {body.name()} and not its"
            " mesh, so that hollows are filled; add the object by add_object"
        )


def _is_met_as_hull(
    inspector: SceneGraphInspector, own: GeometryId, tip: GeometryId, volume: float
) -> bool:
    """Returns whether a fingertip meets a mesh where its convex hull fills a hollow.

    Drake takes the hull for points of contact, and for compliant meshes without tetrahedra.
    """
    shape = inspector.GetShape(own)
    if not isinstance(shape, Mesh):
        return False
    both = [inspector.GetProximityProperties(geometry) for geometry in (own, tip)]
    is_patch = all(map(_is_hydroelastic, both)) and any(map(_is_compliant, both))
    if is_patch and (not _is_compliant(both[0]) or shape.extension() == ".vtk"):
        return False
    hull = inspector.GetConvexHull(own)
    corners = np.array([hull.vertex(index) for index in range(hull.num_vertices())])
    return float(trimesh.convex.convex_hull(corners).volume) > _FILLED * volume


def _is_hydroelastic(properties: ProximityProperties) -> bool:
    return bool(properties.HasProperty("hydroelastic", "compliance_type"))


def _is_compliant(properties: ProximityProperties) -> bool:
    return _modulus(properties) > 0


def _modulus(properties: ProximityProperties) -> float:
    """Returns the hydroelastic modulus in Pa; 0 without one."""
    return float(properties.GetPropertyOrDefault("hydroelastic", "hydroelastic_modulus", 0.0))
