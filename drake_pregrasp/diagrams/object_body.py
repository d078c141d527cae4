"""The object as a body of a plant, with the mesh of the planner's surface, and obstacle bodies.

Contact is hydroelastic: pressure patches hold the object on a moving table, where single contact
points would hop. A flat solid meets a body where it meets its convex hull, so tables, which are
rigid, touch the hull, a compliant solid. Spheres such as the tip of a pusher touch the rigid mesh
itself, and so do links of a hand if the object is not convex: its hull would fill a cup.
"""

from collections.abc import Sequence
from typing import cast

import numpy as np
import trimesh
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    CollisionFilterDeclaration,
    GeometrySet,
    InMemoryMesh,
    ProximityProperties,
    Role,
    SceneGraph,
)
from pydrake.geometry import Mesh as MeshGeometry
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import (
    ModelInstanceIndex,
    PdControllerGains,
    PrismaticJoint,
    RigidBody,
    RotationalInertia,
    SpatialInertia,
)

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.config.object_config import GRAVITY
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.systems.hand_scene import drake_shape
from drake_pregrasp.systems.sources import MovingSolid
from drake_pregrasp.visualization.drawing import BODY_COLOR, drawn_solid

FIRST_TOUCH = 1e-6
"""Initial depth of the object in the table, in metres: without contact it would fall for one time
step and bounce."""

FRICTION = 0.8
"""Coulomb's coefficient of an object without a hand, the same as that of tables."""

MODULUS = 3e7
"""Hydroelastic modulus of obstacles, and the largest one of hulls, in Pa."""

DISSIPATION = 100.0
"""Dissipation of Hunt and Crossley, the same as that of tables, in s/m: nothing bounces."""

HULL, SURFACE = "hull", "surface"
"""Names of the collision geometries of an object."""

_COLOR = np.array([0.78, 0.80, 0.83, 1.0])
_DIGITS = 12  # Digits of coordinates in the OBJ text of a mesh for Drake.
_LEAST_AREA = 1e-10  # Of a hull's triangle, in m²: twice what Drake needs for a plane.
_LEAST_SHARE = 1e-5  # The same as a share of the hull's extent squared, for a small hull.
_MANY_CORNERS = 6  # So many corners give four points of contact that are not in a line.
_RESTING_DEPTH = 5e-6  # Of an object on its widest face, in metres. Stiffer objects rock.
_RESOLUTION = 0.1  # Drake requires it, but a hull is not tessellated.
_RIM = 0.25  # Width of the rim of a sliding object's faces, as a share of the way to their middle.
_LEAST_RIMMED = 1e-3  # Least share of the hull's area for a face with a rim: balls have none.
_BALL_RESOLUTION = 0.02  # Edges of the tetrahedra of obstacles that are balls, in metres.
_GAINS = PdControllerGains(p=1e4, d=2e2)  # The same as those of the conveyor.


def add_object(
    plant: MultibodyPlant,
    shape: Shape,
    mass: float,
    *,
    friction: float = FRICTION,
    slides: bool = False,
    name: str = "object",
) -> RigidBody:
    """Adds an object to a plant that is not finalized, and returns its body, whose frame is O.

    The body is homogeneous and free. Its collision geometries are its convex hull, which is
    compliant, and its mesh, which is rigid. When the plant is finalized, `separate_contacts` lets
    each of the other bodies collide with one of the two.

    Args:
        plant: Plant to which the object is added.
        shape: Shape of the object in O.
        mass: Mass of the object, in kg.
        friction: Coulomb's coefficient of the object.
        slides: Whether the object slides over a table or lands on it. Friction then moves the
            pressure to the front of its base, so that contact is needed near the edges, too.
        name: Name of the body and of its model instance.

    Raises:
        InvalidArgumentError: If `mass` is not positive, or the plant is finalized or has a model
            instance of this name.
    """
    if not 0 < mass < np.inf:
        raise InvalidArgumentError(f"mass must be greater than 0, not {mass}")
    if plant.is_finalized():
        raise InvalidArgumentError("plant: add the object before the plant is finalized")
    if plant.HasModelInstanceNamed(name):
        raise InvalidArgumentError(f"name: the plant has a model instance {name} already")
    inertia = _spatial_inertia(shape, mass)
    body = plant.AddRigidBody(name, plant.AddModelInstance(name), inertia)
    if not plant.geometry_source_is_registered():
        return body
    X_OG = RigidTransform()
    compliant, rigid = ProximityProperties(), ProximityProperties()
    for properties in (compliant, rigid):
        coulomb = CoulombFriction(friction, friction)
        AddContactMaterial(dissipation=DISSIPATION, friction=coulomb, properties=properties)
    hull = _contact_hull(shape.mesh)
    modulus = _hull_modulus(hull, mass)
    AddCompliantHydroelasticProperties(_RESOLUTION, modulus, compliant)
    AddRigidHydroelasticProperties(rigid)
    tetrahedra = MeshGeometry(mesh_data=_hull_data(hull, has_rims=slides))
    plant.RegisterCollisionGeometry(body, X_OG, tetrahedra, HULL, compliant)
    surface = MeshGeometry(mesh_data=mesh_data(shape.mesh))
    plant.RegisterCollisionGeometry(body, X_OG, surface, SURFACE, rigid)
    # Drake's VTK renderer needs normals, which at edges are different for each face.
    drawn = MeshGeometry(mesh_data=mesh_data(shape.mesh.smooth_shaded))
    plant.RegisterVisualGeometry(body, X_OG, drawn, SURFACE, _COLOR)
    return body


def resting_position(shape: Shape) -> FloatArray:
    """Returns the position of O in W for an object that rests on a table, shape (3,), in metres.

    Its axes are those of W, and its centre of mass is above the origin of W.
    """
    lowest = float(np.min(shape.mesh.vertices[:, 2]))
    position: FloatArray = -shape.p_OCoM
    position[2] = -lowest - FIRST_TOUCH
    return position


def mesh_data(mesh: trimesh.Trimesh) -> InMemoryMesh:
    """Returns a mesh for Drake, with normals."""
    text = mesh.export(file_type="obj", digits=_DIGITS, include_normals=True)
    return InMemoryMesh(mesh_file=MemoryFile(text, ".obj", "object.obj"))


def _contact_hull(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Returns the convex hull of a mesh without triangles that are too thin for Drake."""
    hull = cast(trimesh.Trimesh, mesh.convex_hull)
    least = min(_LEAST_AREA, _LEAST_SHARE * float(np.max(hull.extents)) ** 2)
    while np.any(thin := hull.area_faces < least):
        edges = np.linalg.norm(hull.triangles - np.roll(hull.triangles, 1, axis=1), axis=2)[thin]
        # The corner opposite the longest edge is on this edge.
        middle = hull.faces[thin][np.arange(len(edges)), np.argmax(edges, axis=1) - 2]
        hull = cast(
            trimesh.Trimesh, trimesh.convex.convex_hull(np.delete(hull.vertices, middle, axis=0))
        )
    return hull


def _hull_faces(hull: trimesh.Trimesh) -> list[IntArray]:
    """Returns the indices of the triangles of each flat face of a convex hull."""
    in_facet = np.zeros(len(hull.faces), dtype=bool)
    in_facet[[index for facet in hull.facets for index in facet]] = True
    return [*hull.facets, *np.flatnonzero(~in_facet)[:, None]]


def _hull_modulus(hull: trimesh.Trimesh, mass: float) -> float:
    """Returns the hydroelastic modulus of a hull with which it lies `_RESTING_DEPTH` deep, in Pa.

    The pressure in the hull grows linearly from zero at its surface to the modulus at its centroid.
    """
    faces = _hull_faces(hull)
    areas = [float(np.sum(hull.area_faces[face])) for face in faces]
    widest = int(np.argmax(areas))
    any_triangle = faces[widest][0]
    to_face = hull.triangles_center[any_triangle] - hull.centroid
    thickness = float(to_face @ hull.face_normals[any_triangle])
    pressure = mass * GRAVITY / areas[widest]
    return min(MODULUS, pressure * thickness / _RESTING_DEPTH)


def _hull_data(hull: trimesh.Trimesh, *, has_rims: bool) -> InMemoryMesh:
    """Returns a convex hull for Drake, as tetrahedra that meet at its centroid.

    Each tetrahedron presses at one point of its patch of contact. Faces with few corners are
    divided at their centres, because an object that stands on two such points rocks. A rim has
    points of its own: without it a cube presses at two thirds of the way to its edges at most.

    Args:
        hull: The convex hull in O.
        has_rims: Whether its faces, but for small ones, have a rim of narrow triangles.
    """
    # trimesh hashes its arrays at each access.
    vertices, faces, centroid = np.array(hull.vertices), np.array(hull.faces), hull.centroid
    shares = np.array(hull.area_faces) / hull.area
    points, triangles = [*vertices], []
    for face in _hull_faces(hull):
        own = faces[face]
        edges = {(t[k - 1], t[k]) for t in own for k in range(3)}
        border = [(a, b) for a, b in edges if (b, a) not in edges]
        middle = np.mean([vertices[a] for a, _ in border], axis=0)
        corners = vertices[border] - centroid
        # Triangles that are only almost in a plane may have their middle beside them.
        volumes = np.cross(corners[:, 0], corners[:, 1]) @ (middle - centroid)
        is_round = np.all(volumes > 0)
        if has_rims and is_round and np.sum(shares[face]) >= _LEAST_RIMMED:
            inner = {a: len(points) + k for k, (a, _) in enumerate(border)}
            points += [vertices[a] + _RIM * (middle - vertices[a]) for a, _ in border]
            for a, b in border:
                triangles += [(a, b, inner[b]), (a, inner[b], inner[a])]
                triangles.append((inner[a], inner[b], len(points)))
            points.append(middle)
        elif len(border) < _MANY_CORNERS and is_round:
            triangles += [(a, b, len(points)) for a, b in border]
            points.append(middle)
        else:
            triangles += [tuple(triangle) for triangle in own]
    points.append(centroid)
    lines = [
        "# vtk DataFile Version 3.0",
        "hull",
        "ASCII",
        "DATASET UNSTRUCTURED_GRID",
        f"POINTS {len(points)} double",
        *(" ".join(f"{x:.{_DIGITS}g}" for x in point) for point in points),
        f"CELLS {len(triangles)} {5 * len(triangles)}",
        *(f"4 {b} {a} {c} {len(points) - 1}" for a, b, c in triangles),
        f"CELL_TYPES {len(triangles)}",
        *["10"] * len(triangles),
    ]
    return InMemoryMesh(mesh_file=MemoryFile("\n".join(lines), ".vtk", "hull.vtk"))


def _spatial_inertia(shape: Shape, mass: float) -> SpatialInertia:
    """Returns the inertia of a homogeneous body, about O and expressed in O."""
    I = shape.mesh.moment_inertia * (mass / shape.mesh.volume)  # noqa: E741
    return SpatialInertia.MakeFromCentralInertia(
        mass, shape.p_OCoM, RotationalInertia(I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
    )


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
    AddCompliantHydroelasticProperties(_BALL_RESOLUTION, MODULUS, properties)
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
