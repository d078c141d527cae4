"""Pictures of regions and goals on the object by Drake's VTK renderer, as in the paper's Fig. 5."""

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    RenderCameraCore,
    Rgba,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, Solid
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.regions.safe_regions import NO_REGION
from drake_pregrasp.studies.drawn_mesh import camera_pose, drawn_mesh
from drake_pregrasp.studies.vtk_picture import (
    ByteArray,
    Light,
    coloured,
    lit_renderer,
    take_picture,
)
from drake_pregrasp.systems.drawing import NO_REGION_COLOR, contact_color, tint

_LIGHTS = (Light([0.0, 0.0, 1.0], 1.0), Light([0.5, 0.3, 0.8], 0.35), Light([0.0, 1.0, 0.0], 0.35))
_MARKER_SHARE = 0.055  # Radius of a goal's ball, of the object's mean extent.
_LIFT = 4e-4  # Metres that regions stand off the surface.
_OBJECT_COLOR = Rgba(0.85, 0.86, 0.88)
_OBSTACLE_COLOR = Rgba(0.35, 0.37, 0.40)


def render_goals(
    surface: ObjectSurface,
    labels: IntArray,
    p_OC: FloatArray,
    contacts: list[int],
    *,
    yaw: float,
    obstacles: Sequence[Solid] = (),
    pixels: tuple[int, int] = (520, 480),
) -> ByteArray:
    """Returns a picture of the object, shape (height, width, 3).

    Args:
        surface: The object's surface.
        labels: The contact that owns each candidate, or `NO_REGION`, shape (N,).
        p_OC: Goals to draw, in O, shape (k, 3), in metres.
        contacts: The index of each, for its colour.
        yaw: Direction from which the camera looks down on the object, in radians about z of O.
        obstacles: Balls and boxes in O; half-spaces are left out.
        pixels: Width and height.
    """
    scene = SceneGraph()
    scene.AddRenderer("vtk", lit_renderer(_LIGHTS))
    source = scene.RegisterSource("goals")

    def add(X_OG: RigidTransform, shape: Shape, color: Rgba, name: str) -> None:
        scene.RegisterAnchoredGeometry(source, coloured(X_OG, shape, color, name))

    extents = surface.mesh.extents
    add(RigidTransform(), drawn_mesh(surface.mesh.triangles), _OBJECT_COLOR, "object")
    owners = np.repeat(labels, np.diff(surface.patch_starts))
    for label in np.unique(labels).tolist():
        color = NO_REGION_COLOR if label == NO_REGION else tint(contact_color(label), 0.3)
        region = surface.patches[owners == label]
        add(RigidTransform(), drawn_mesh(region, lift=_LIFT), color, f"region_{label}")
    radius = _MARKER_SHARE * float(np.cbrt(np.prod(extents)))
    # Outside the surface, as a fingertip would be: a thin wall must not show it on both sides.
    centres = p_OC + radius * surface.project(p_OC)[1]
    for centre, contact in zip(centres, contacts, strict=True):
        add(RigidTransform(centre), Sphere(radius), contact_color(contact), f"goal_{contact}")
    for index, solid in enumerate(obstacles):
        if isinstance(solid, BallSolid):
            X_OS = RigidTransform(solid.center)
            add(X_OS, Sphere(solid.radius), _OBSTACLE_COLOR, f"obstacle_{index}")
        elif isinstance(solid, BoxSolid):
            R_OS = RotationMatrix.ProjectToRotationMatrix(solid.R_FB)
            X_OS = RigidTransform(R_OS, solid.center)
            add(X_OS, Box(*solid.size), _OBSTACLE_COLOR, f"obstacle_{index}")

    context = scene.CreateDefaultContext()
    query = scene.get_query_output_port().Eval(context)
    camera = ColorRenderCamera(
        RenderCameraCore(
            "vtk", CameraInfo(*pixels, 0.5), ClippingRange(0.01, 10.0), RigidTransform()
        )
    )
    middle = np.mean(surface.mesh.bounds, axis=0)
    distance = 2.9 * float(np.linalg.norm(extents)) / 1.4
    X_OK = camera_pose(middle, distance * np.array([0.85 * np.cos(yaw), 0.85 * np.sin(yaw), 0.53]))
    return take_picture(query, camera, X_OK)
