"""Pictures of regions and goals on the object by Drake's VTK renderer, as in the paper's Fig. 5."""

import numpy as np
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    GeometryInstance,
    LightParameter,
    MakeRenderEngineVtk,
    PerceptionProperties,
    RenderCameraCore,
    RenderEngineVtkParams,
    Rgba,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo

from drake_pregrasp.planning.arrays import FloatArray, IntArray
from drake_pregrasp.planning.safe_regions import NO_REGION
from drake_pregrasp.planning.surface import ObjectSurface
from drake_pregrasp.systems.palette import NO_REGION_COLOR, contact_color, tint

_BACKGROUND = [1.0, 1.0, 1.0]
_LIGHTS = (([0.0, 0.0, 1.0], 1.0), ([0.5, 0.3, 0.8], 0.35), ([0.0, 1.0, 0.0], 0.35))
_MARKER_SHARE = 0.06  # Radius of a goal's ball, of the object's largest extent.


def render_goals(
    surface: ObjectSurface,
    labels: IntArray,
    p_OC: FloatArray,
    contacts: list[int],
    *,
    yaw: float,
    pixels: tuple[int, int] = (520, 480),
) -> FloatArray:
    """Returns a picture of the object, shape (height, width, 3), of bytes.

    Args:
        surface: The object's surface.
        labels: The contact that owns each candidate, or `NO_REGION`, shape (N,).
        p_OC: Goals to draw, in O, shape (k, 3), in metres.
        contacts: The index of each, for its colour.
        yaw: Direction from which the camera looks down on the object, in radians about z of O.
        pixels: Width and height.
    """
    scene = SceneGraph()
    parameters = RenderEngineVtkParams()
    parameters.default_clear_color = _BACKGROUND
    parameters.lights = [
        LightParameter(type="directional", frame="camera", direction=direction, intensity=strength)
        for direction, strength in _LIGHTS
    ]
    scene.AddRenderer("vtk", MakeRenderEngineVtk(parameters))
    source = scene.RegisterSource("goals")

    def add(X_OG: RigidTransform, shape: Shape, color: Rgba, name: str) -> None:
        properties = PerceptionProperties()
        properties.AddProperty("phong", "diffuse", color)
        instance = GeometryInstance(X_OG, shape, name)
        instance.set_perception_properties(properties)
        scene.RegisterAnchoredGeometry(source, instance)

    extents = surface.mesh.extents
    add(RigidTransform(), Box(*extents), Rgba(0.85, 0.86, 0.88), "object")
    edges = np.sqrt(surface.areas)
    for k, label in enumerate(labels):
        color = NO_REGION_COLOR if label == NO_REGION else tint(contact_color(label), 0.3)
        n = surface.nhat_OQ[k]
        size = np.where(np.abs(n) > 0.5, 1e-3, edges[k])
        add(RigidTransform(surface.p_OQ[k]), Box(*size), color, f"tile_{k}")
    radius = _MARKER_SHARE * float(extents.max())
    for p_OCi, contact in zip(p_OC, contacts, strict=True):
        add(RigidTransform(p_OCi), Sphere(radius), contact_color(contact), f"goal_{contact}")

    context = scene.CreateDefaultContext()
    query = scene.get_query_output_port().Eval(context)
    camera = ColorRenderCamera(
        RenderCameraCore(
            "vtk", CameraInfo(*pixels, 0.5), ClippingRange(0.01, 10.0), RigidTransform()
        )
    )
    X_OK = _camera_pose(yaw, 2.9 * float(np.linalg.norm(extents)) / 1.4)
    image = query.RenderColorImage(camera, scene.world_frame_id(), X_OK)
    rgb: FloatArray = np.array(image.data[:, :, :3])
    return rgb


def _camera_pose(yaw: float, distance: float) -> RigidTransform:
    """Returns X_OK of a camera K (z forward, y down) that looks at O's origin from above."""
    p_OK = distance * np.array([0.85 * np.cos(yaw), 0.85 * np.sin(yaw), 0.53])
    z = -p_OK / np.linalg.norm(p_OK)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return RigidTransform(RotationMatrix(np.column_stack([x, np.cross(z, x), z])), p_OK)
