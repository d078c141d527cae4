"""A picture of a trial as it stands, by Drake's VTK renderer: no browser is needed."""

import numpy as np
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    RenderCameraCore,
    Rgba,
    Shape,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context
from pydrake.systems.sensors import CameraInfo

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.geometry.solids import HalfSpace
from drake_pregrasp.regions.safe_regions import SafeRegions
from drake_pregrasp.studies.drawn_mesh import camera_pose, drawn_mesh
from drake_pregrasp.studies.static_versus_dynamic.marks import ring_triangles
from drake_pregrasp.studies.static_versus_dynamic.scene import FINGERS
from drake_pregrasp.studies.static_versus_dynamic.trial import Trial
from drake_pregrasp.studies.vtk_picture import (
    ByteArray,
    Light,
    coloured,
    lit_renderer,
    take_picture,
)
from drake_pregrasp.systems.drawing import contact_color

_ENGINE = "photograph"
CAMERA = ColorRenderCamera(
    RenderCameraCore(_ENGINE, CameraInfo(600, 630, 0.55), ClippingRange(0.01, 10), RigidTransform())
)
"""What takes it."""

_ABOVE = np.array([0.0, 0.0, 0.14])  # Where it looks, from the turntable's middle.
_AZIMUTH, _ELEVATION, _DISTANCE = np.radians(-45), np.radians(17), 0.76
_LIGHTS = (  # Faces that the camera sees are lit.
    Light([0.0, 0.1, 1.0], 0.75),
    Light([0.9, 0.2, 0.4], 0.3),
    Light([-0.9, 0.2, 0.4], 0.45),
    Light([0.1, 0.1, -1.0], 0.4, "world"),
)
_WALL = (0.32, 0.001, 0.2)  # What is drawn of a half-space: width, thickness and height.
_WALL_COLOR = Rgba(0.95, 0.1, 0.1, 0.3)
_DOT_RADII, _DOT_SIDES = (0.0, 0.0017), 10  # In metres: of the inner and outer polygon.
_RING_RADII, _RING_SIDES = (0.0055, 0.008), 36
_RING_COLOR = Rgba(0, 0, 0)
_DOT_LIFT, _RING_LIFT = 4e-4, 1.2e-3  # Metres off the surface.


def photograph(trial: Trial, *, marks: bool) -> ByteArray:
    """Returns a picture, shape (height, width, 3).

    What is drawn for it is drawn in a copy of the trial's context: the trial goes on as without.

    Args:
        trial: Of an arm with goals.
        marks: Whether a black ring shows where each active finger would touch if the hand closed
            now, and, for arms that plan all the time, dots the safe regions.
    """
    context = trial.context.Clone()
    _Stage(trial, context).set_up(marks=marks)
    station = trial.parts.station
    # Geometry that comes to a context later has its pose only when something else moves.
    posture = station.plant.GetMyMutableContextFromRoot(context)
    station.plant.SetPositions(posture, station.plant.GetPositions(posture))
    scene = station.scene_graph
    query = scene.get_query_output_port().Eval(scene.GetMyContextFromRoot(context))
    return take_picture(query, CAMERA, camera_over(trial))


def camera_over(trial: Trial) -> RigidTransform:
    """Returns X_WK of the camera K: it goes with the turntable, but does not turn with it."""
    p_TK = _DISTANCE * np.array(
        [
            np.cos(_AZIMUTH) * np.cos(_ELEVATION),
            np.sin(_AZIMUTH) * np.cos(_ELEVATION),
            np.sin(_ELEVATION),
        ]
    )
    return camera_pose(_pose(trial, trial.context, "turntable").translation() + _ABOVE, p_TK)


def shown_goals(trial: Trial) -> tuple[FloatArray, FloatArray]:
    """Returns where active fingers would touch if the hand closed now, and outward normals, in W.

    Of the still hand, whose goals lie off the object until it closes, too.
    """
    goals = trial.parts.goals
    context = trial.context.Clone()
    status = goals.GetOutputPort("contact_status").Eval(goals.GetMyContextFromRoot(context))
    active = is_active(np.asarray(status))
    trial.parts.diagram.GetInputPort("close").FixValue(context, [1.0])
    targets = goals.GetOutputPort("fingertip_targets").Eval(goals.GetMyContextFromRoot(context))
    X_WC = [targets.Find(name) for name in trial.hand.kinematics.tip_frames]
    points = np.array([X.translation() for X in X_WC])
    normals = np.array([-X.rotation().matrix()[:, 2] for X in X_WC])
    return points[active], normals[active]


def has_regions(arm: str) -> bool:
    """Whether pictures of an arm show safe regions: only those that plan all the time have any."""
    return arm.startswith("dynamic")


class _Stage:
    """What is added to a context for a picture."""

    def __init__(self, trial: Trial, context: Context) -> None:
        self._trial, self._context = trial, context
        self._scene = trial.parts.station.scene_graph
        self._scene_context = self._scene.GetMyMutableContextFromRoot(context)

    def set_up(self, *, marks: bool) -> None:
        if marks:
            self._add_rings()
            if has_regions(self._trial.job.arm):
                self._add_regions()
        self._add_walls()
        self._scene.AddRenderer(self._scene_context, _ENGINE, lit_renderer(_LIGHTS))

    def _add_rings(self) -> None:
        points, normals = shown_goals(self._trial)
        if len(points):
            triangles = ring_triangles(points, normals, radii=_RING_RADII, sides=_RING_SIDES)
            mesh = drawn_mesh(triangles, lift=_RING_LIFT)
            self._add(RigidTransform(), mesh, _RING_COLOR, "rings")

    def _add_regions(self) -> None:
        planner, surface = self._trial.parts.planner, self._trial.surface
        port = planner.GetOutputPort("safe_regions")
        regions: SafeRegions = port.Eval(planner.GetMyContextFromRoot(self._context))
        X_WO = _pose(self._trial, self._context, "cube")
        for finger in range(FINGERS):
            members = regions.members(finger)
            if len(members):
                points, normals = surface.p_OQ[members], surface.nhat_OQ[members]
                dots = ring_triangles(points, normals, radii=_DOT_RADII, sides=_DOT_SIDES)
                mesh = drawn_mesh(dots, lift=_DOT_LIFT)
                self._add(X_WO, mesh, contact_color(finger), f"region_{finger}")

    def _add_walls(self) -> None:
        middle = _pose(self._trial, self._context, "turntable").translation()
        up = np.array([0.0, 0.0, 1.0])
        for index, solid in enumerate(self._trial.scene.area_at(self._context.get_time())):
            if isinstance(solid, HalfSpace):
                nearest = middle - solid.distance(middle[None])[0] * solid.normal
                along = np.cross(solid.normal, up)
                R_WA = RotationMatrix(np.column_stack([along, solid.normal, up]))
                X_WA = RigidTransform(R_WA, nearest + _WALL[2] / 2 * up)
                self._add(X_WA, Box(*_WALL), _WALL_COLOR, f"wall_{index}")

    def _add(self, X_WS: RigidTransform, shape: Shape, color: Rgba, name: str) -> None:
        instance = coloured(X_WS, shape, color, name)
        source = self._trial.parts.station.plant.get_source_id()
        frame = self._scene.world_frame_id()
        self._scene.RegisterGeometry(self._scene_context, source, frame, instance)


def _pose(trial: Trial, context: Context, body: str) -> RigidTransform:
    plant = trial.parts.station.plant
    X_WB: RigidTransform = plant.EvalBodyPoseInWorld(
        plant.GetMyContextFromRoot(context), plant.GetBodyByName(body)
    )
    return X_WB
