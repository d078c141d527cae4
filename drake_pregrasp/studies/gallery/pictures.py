"""Rendering with Drake's VTK engine: lights, meshes, cameras, and an object with its goals."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray
from pydrake.common import MemoryFile
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    GeometryInstance,
    InMemoryMesh,
    LightParameter,
    MakeRenderEngineVtk,
    Mesh,
    PerceptionProperties,
    QueryObject,
    RenderCameraCore,
    RenderEngine,
    RenderEngineVtkParams,
    Rgba,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.geometry.solids import Solid
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.visualization.drawing import (
    BODY_COLOR,
    VOLUME_COLOR,
    camera_pose,
    contact_color,
    drawn_solid,
    region_color,
)

ByteArray = NDArray[np.uint8]

RENDERER = "vtk"
"""Name of the renderer in a scene."""

WHITE = (1.0, 1.0, 1.0)
"""Default background colour."""


class Light(NamedTuple):
    """A directional light.

    Attributes:
        direction: Direction of the light in `frame`, shape (3,); z of the camera points forward.
        intensity: Intensity; 1 fully lights a surface that faces the light.
        frame: Name of the frame of `direction`, `camera` or `world`.
    """

    direction: Sequence[float]
    intensity: float
    frame: str = "camera"


_LIGHTS = (Light([0.0, 0.0, 1.0], 1.0), Light([0.5, 0.3, 0.8], 0.35), Light([0.0, 1.0, 0.0], 0.35))
_MARKER_SHARE = 0.055  # Radius of a goal's ball divided by the object's mean extent.
_LIFT = 4e-4  # Metres between a drawn region and the surface.
_OBJECT_COLOR = Rgba(0.85, 0.86, 0.88)


def lit_renderer(
    lights: Sequence[Light], background: tuple[float, float, float] = WHITE
) -> RenderEngine:
    """Returns a VTK renderer with directional lights.

    Args:
        lights: Lights of the scene.
        background: Red, green and blue of the background, each from 0 to 1.
    """
    parameters = RenderEngineVtkParams()
    parameters.default_clear_color = list(background)
    parameters.lights = [
        LightParameter(type="directional", frame=frame, direction=direction, intensity=intensity)
        for direction, intensity, frame in lights
    ]
    return MakeRenderEngineVtk(parameters)


def coloured(X_FS: RigidTransform, shape: Shape, color: Rgba, name: str) -> GeometryInstance:
    """Returns a geometry with a perception role only.

    Args:
        X_FS: Pose of the shape S in the frame F that it will be registered with.
        shape: Shape of the geometry.
        color: Diffuse colour of the whole shape.
        name: Name of the geometry, unique among the geometries of F.
    """
    properties = PerceptionProperties()
    properties.AddProperty("phong", "diffuse", color)
    instance = GeometryInstance(X_FS, shape, name)
    instance.set_perception_properties(properties)
    return instance


def drawn_mesh(triangles: FloatArray, lift: float = 0.0) -> Mesh:
    """Returns a mesh of triangles with flat normals.

    Args:
        triangles: Corners of the triangles, shape (k, 3, 3), in metres.
        lift: Distance in metres by which the triangles are moved along their normals.
    """
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    mesh = trimesh.Trimesh(triangles.reshape(-1, 3), faces, process=False)
    mesh.vertices = mesh.vertices + lift * np.repeat(mesh.face_normals, 3, axis=0)
    text = trimesh.exchange.obj.export_obj(mesh, include_normals=True)
    return Mesh(mesh_data=InMemoryMesh(mesh_file=MemoryFile(text.encode(), ".obj", "mesh.obj")))


def color_camera(pixels: tuple[int, int], field_of_view: float) -> ColorRenderCamera:
    """Returns a camera.

    Args:
        pixels: Width and height of the camera's pictures, in pixels.
        field_of_view: Vertical field of view in radians.
    """
    info, depths = CameraInfo(*pixels, field_of_view), ClippingRange(0.01, 10.0)
    return ColorRenderCamera(RenderCameraCore(RENDERER, info, depths, RigidTransform()))


def take_picture(query: QueryObject, camera: ColorRenderCamera, X_WK: RigidTransform) -> ByteArray:
    """Returns a picture of a scene, shape (height, width, 3).

    Args:
        query: Query object of a scene that has the camera's renderer.
        camera: Camera that takes the picture.
        X_WK: Pose of the camera K in the world W.
    """
    image = query.RenderColorImage(camera, query.inspector().world_frame_id(), X_WK)
    return np.array(image.data[:, :, :3])


def goal_geometry(
    surface: ObjectSurface, labels: IntArray, p_OC: FloatArray, contacts: Sequence[int]
) -> list[GeometryInstance]:
    """Returns the safe regions and the goals as geometry in O, in the colours of their contacts.

    Args:
        surface: Surface of the object O.
        labels: Index of the contact that owns each candidate, or `NO_REGION`, shape (N,).
        p_OC: Positions of the goals to draw, in O, shape (k, 3), in metres.
        contacts: Index of the contact of each goal, which sets its colour, length k.
    """
    owners = np.repeat(labels, np.diff(surface.patch_starts))
    drawn = []
    for label in np.unique(labels).tolist():
        region = drawn_mesh(surface.patches[owners == label], lift=_LIFT)
        drawn.append(coloured(RigidTransform(), region, region_color(label), f"region_{label}"))
    radius = _MARKER_SHARE * float(np.cbrt(np.prod(surface.mesh.extents)))
    # Balls touch the surface from outside: centred on a thin wall, they would show on both sides.
    centers = p_OC + radius * surface.project(p_OC)[1]
    for center, contact in zip(centers, contacts, strict=True):
        X_OG, color = RigidTransform(center), contact_color(contact)
        drawn.append(coloured(X_OG, Sphere(radius), color, f"goal_{contact}"))
    return drawn


def render_goals(
    surface: ObjectSurface,
    labels: IntArray,
    p_OC: FloatArray,
    contacts: Sequence[int],
    *,
    yaw: float,
    bodies: Sequence[Solid] = (),
    volumes: Sequence[Solid] = (),
    pixels: tuple[int, int] = (520, 480),
) -> ByteArray:
    """Returns a picture of safe regions and goals on the object, shape (height, width, 3).

    Args:
        surface: Surface of the object O.
        labels: Index of the contact that owns each candidate, or `NO_REGION`, shape (N,).
        p_OC: Positions of the goals to draw, in O, shape (k, 3), in metres.
        contacts: Index of the contact of each goal, which sets its colour, length k.
        yaw: Azimuth of the camera about z of O, in radians.
        bodies: Obstacles in O that are bodies, which are opaque.
        volumes: No-touch volumes in O, which are translucent.
        pixels: Width and height of the picture, in pixels.
    """
    scene = SceneGraph()
    scene.AddRenderer(RENDERER, lit_renderer(_LIGHTS))
    source = scene.RegisterSource("goals")
    whole = drawn_mesh(surface.mesh.triangles)
    drawn = [coloured(RigidTransform(), whole, _OBJECT_COLOR, "object")]
    drawn += goal_geometry(surface, labels, p_OC, contacts)
    for index, (solid, color) in enumerate(
        [(body, Rgba(*BODY_COLOR)) for body in bodies] + [(v, VOLUME_COLOR) for v in volumes]
    ):
        shape, X_OS = drawn_solid(solid)
        drawn.append(coloured(X_OS, shape, color, f"obstacle_{index}"))
    for instance in drawn:
        scene.RegisterAnchoredGeometry(source, instance)
    query = scene.get_query_output_port().Eval(scene.CreateDefaultContext())
    distance = 2.9 * float(np.linalg.norm(surface.mesh.extents)) / 1.4
    p_TK_O = distance * np.array([0.85 * np.cos(yaw), 0.85 * np.sin(yaw), 0.53])
    X_OK = camera_pose(np.mean(surface.mesh.bounds, axis=0), p_TK_O)
    return take_picture(query, color_camera(pixels, 0.5), X_OK)
