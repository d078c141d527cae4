"""Visualizers of a simulation, and its recording in Meshcat."""

import contextlib
import os
import secrets
import socket
import stat
import sys
from typing import NamedTuple

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams, MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.hand_description import Arm
from drake_pregrasp.config.object_config import Conveyor, Toss
from drake_pregrasp.diagrams.expected_path import expected_path
from drake_pregrasp.diagrams.hand_controller import HandController
from drake_pregrasp.diagrams.hand_station import HandStation
from drake_pregrasp.diagrams.object_plant import ObjectPlant
from drake_pregrasp.diagrams.pregrasp_planner import PregraspPlanner
from drake_pregrasp.diagrams.wiring import connect
from drake_pregrasp.errors import OutputError
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.visualization.pregrasp_visualizer import PregraspVisualizer
from drake_pregrasp.visualization.run_timeline import RunTimeline

# Bright from all sides, so that the regions' colours are distinct on every face, and a little
# brighter from above, so that hollows and edges are visible.
_LIGHTS = {"AmbientLight": 1.7, "PointLightNegativeX": 0.0, "PointLightPositiveX": 8.0}

# Position of the camera relative to its target in W, for an object of unit size.
_CAMERA = np.array([1.4, 1.2, 0.85])
_HAND_CAMERA = np.array([1.36, 1.19, 0.78])
_ARM_CAMERA = np.array([0.64, -1.49, 0.78])  # Beside the arm, which stands behind along x.
_ARM_RAISED = 0.15  # Visible part of an arm above its palm, in metres.
_HEADROOM = 0.3  # Height of the drawing above the object, in object sizes.
_SMALLEST = 0.1  # Size that an object has at least for the camera, in metres.
_SHOWN_WAY = 0.3  # Motion along an axis, in object sizes, beyond which the camera follows.
_NEAREST = 1.1  # Smallest distance of the camera, in object sizes.
_VIEW = 0.55  # Share of a path's length that counts as object size, so that all of it is visible.


def start_meshcat(*, live: bool = False) -> Meshcat:
    """Starts a viewer that no web page can reach.

    Drake's server accepts pages of every origin, and a malformed message to it ends the process.
    So nothing listens at all for a recording. For watching, the server has a random port and, on
    Linux, a random address of this machine, and `served_page` stands in front of it.

    Args:
        live: Whether the viewer is for watching; otherwise it only records.

    Raises:
        OutputError: If Drake may not open a port.
    """
    random = ".".join(str(1 + secrets.randbelow(254)) for _ in range(3))
    host = f"127.{random}" if sys.platform == "linux" else "127.0.0.1"
    try:
        meshcat = Meshcat(MeshcatParams(host=host, port=0, show_stats_plot=False))
    except RuntimeError as error:
        raise OutputError(f"Meshcat cannot start ({error}); run without a recording") from error
    if not live:
        _close_sockets((host, meshcat.port()))
    return meshcat


def _close_sockets(address: tuple[str, int]) -> None:
    """Closes the sockets of this process at an address.

    Their owner keeps its descriptors, which are those of an empty file from now on.
    """
    for descriptor in map(int, os.listdir("/dev/fd")):
        with contextlib.suppress(OSError):  # The list has its own descriptor, which is closed.
            if not stat.S_ISSOCK(os.fstat(descriptor).st_mode):
                continue
            with socket.socket(fileno=os.dup(descriptor)) as found:
                is_there = found.getsockname() == address
            if is_there:
                with open(os.devnull, "rb") as nothing:
                    os.dup2(nothing.fileno(), descriptor, inheritable=False)


class CameraView(NamedTuple):
    """Camera that sees the whole motion of the object.

    It moves with the object by a share of the way, so that the object is not small in the picture.

    Attributes:
        p_WK: Initial position of the camera K in W, shape (3,), in metres.
        p_WT: Initial position of its target T in W, shape (3,), in metres.
        share: Displacement of K and T divided by that of the object, per axis of W, shape (3,).
        p_WO: Initial position of the object O in W, shape (3,), in metres.
    """

    p_WK: FloatArray
    p_WT: FloatArray
    share: FloatArray
    p_WO: FloatArray


def add_visualizers(
    builder: DiagramBuilder,
    meshcat: Meshcat,
    resolved: ResolvedScenario,
    object_plant: ObjectPlant | HandStation,
    planner: PregraspPlanner,
    controller: HandController | None,
    *,
    record: bool,
    live: bool,
    camera: CameraView | None = None,
    continues: PregraspVisualizer | None = None,
) -> None:
    """Adds visualizers of plant and planner, sets lights and camera, and starts a recording.

    Args:
        builder: Builder of the diagram.
        meshcat: Viewer for all drawings.
        resolved: Scenario to simulate.
        object_plant: Plant in the builder, with the object and perhaps a hand.
        planner: Planner in the builder.
        controller: Controller of the hand in the builder, or None without a hand.
        record: Whether to start a recording.
        live: Whether the viewer shows the simulation while it records.
        camera: Initial camera; by default one that sees the whole motion without following it.
        continues: Visualizer of an equal diagram whose drawings and camera are kept.
    """
    config = resolved.scenario.recording
    period = config.publish_period
    query, params = object_plant.GetOutputPort("query_object"), MeshcatVisualizerParams()
    params.publish_period = period
    params.prefix = "/drake/bodies"  # A page loads paths in alphabetical order: bodies come first.
    MeshcatVisualizer.AddToBuilder(builder, query, meshcat, params)
    visualizer = PregraspVisualizer(
        meshcat=meshcat,
        surface=resolved.surface,
        tile_surface=resolved.sampled_surface(config.tile_size),
        num_contacts=resolved.num_contacts,
        publish_period=period,
        record=record,
        continues=continues,
    )
    builder.AddNamedSystem("pregrasp_visualizer", visualizer)
    drawn = "X_WO_estimated p_WC contact_status safe_regions p_WO_covariance"
    connect(builder, planner, drawn, visualizer)
    connect(builder, object_plant, "X_WO", visualizer)
    if controller is not None and resolved.scenario.grasp.meeting.wait_at:
        connect(builder, controller, "catch_certificate", visualizer)
    if record:
        meshcat.StartRecording(1 / period, set_visualizations_while_recording=live)
    if continues is not None:
        return
    view = camera or camera_view(resolved, follows=False)
    for name in ("/Grid", "/Axes"):
        meshcat.SetProperty(name, "visible", False)
    meshcat.SetProperty("/Background", "top_color", [1.0, 1.0, 1.0])
    meshcat.SetProperty("/Background", "bottom_color", [0.86, 0.88, 0.91])
    for light, intensity in _LIGHTS.items():
        meshcat.SetProperty(f"/Lights/{light}/<object>", "intensity", intensity)
    meshcat.SetCameraPose(view.p_WK, view.p_WT)


def camera_view(
    resolved: ResolvedScenario, *, live: bool = False, follows: bool = True
) -> CameraView:
    """Returns the camera of a scenario.

    With a hand, the camera sees the palm too, until the hand rests.

    Args:
        resolved: Scenario to simulate.
        live: Whether a conveyor does not end.
        follows: Whether the camera follows an object that moves far; otherwise it stays.
    """
    scenario, hand, direction = resolved.scenario, resolved.hand, _CAMERA
    grasp, motion = scenario.grasp, resolved.motion
    extent = max(_SMALLEST, float(resolved.shape.mesh.extents.max()))
    duration = scenario.simulation_duration + scenario.planner.estimator.lookahead
    p_LA = np.array([0.0, 0.0, _HEADROOM * extent])
    if hand is not None:
        settings, description = grasp.make_settings(), hand.description
        if not grasp.meeting.wait_at:  # Else nobody knows yet when the hand meets the object.
            duration = min(duration, grasp.latest_rest(description.fingertips))
        above = description.palm_height + max(settings.lift_height, settings.approach_height)
        has_arm = isinstance(description.base, Arm)
        p_LA = hand.X_LA @ np.array([0.0, 0.0, above + has_arm * _ARM_RAISED])
        direction = _ARM_CAMERA if has_arm else _HAND_CAMERA
    path = expected_path(motion, duration, resolved.shape)
    if isinstance(motion, Toss) and motion.table and grasp.meeting.wait_at:
        # It slides or rolls on, perhaps as far as to the hand.
        path = np.append(path, [resolved.X_WO_waiting @ resolved.shape.p_OCoM], axis=0)
    shown = _SHOWN_WAY * extent
    share = follows * (1 - shown / np.maximum(np.ptp(path, axis=0), shown))
    if live and isinstance(motion, Conveyor):
        share = np.array([1.0, 1.0, 0.0])
    times = np.linspace(0.0, duration, len(path))
    ahead = scenario.planner.estimator.lookahead * np.gradient(path, times, axis=0)
    path = path - share * (path - path[0])
    path = np.concatenate([path, path + ahead, path[[0, -1]] + p_LA])
    low, high = path.min(axis=0), path.max(axis=0)
    target: FloatArray = (low + high) / 2
    scale = max(_NEAREST * extent, _VIEW * float((high - low).max() + extent))
    return CameraView(target + scale * direction, target, share, resolved.X_WO.translation())


def recording_html(meshcat: Meshcat, timeline: RunTimeline) -> str:
    """Ends the recording and returns it as one self-contained page.

    Args:
        meshcat: Viewer with the recording.
        timeline: Timeline of the recorded run, which the page shows over the scene.
    """
    meshcat.StopRecording()
    meshcat.PublishRecording()
    return timeline.added_to(meshcat.StaticHtml())


def make_timeline(
    resolved: ResolvedScenario, name: str, camera: CameraView | None = None
) -> RunTimeline:
    """Returns the timeline of a run that begins.

    Args:
        resolved: Scenario to simulate.
        name: Name of the run, for the title.
        camera: Initial camera of the page with the timeline, which follows the object; by default
            it stays.
    """
    description = resolved.scenario.description
    title = f"{name}: {description}" if description else name
    names, end = resolved.obstacle_names, resolved.planner.static_duration
    view = {} if camera is None else camera._asdict()
    follows = {name: vector.tolist() for name, vector in view.items()}
    n = resolved.num_contacts
    hand = resolved.hand
    return RunTimeline(
        title,
        n,
        fingertips=[tip.frame for tip in hand.description.fingertips] if hand else [],
        static_end=end,
        obstacle_names=names,
        camera=follows,
        waits=bool(resolved.scenario.grasp.meeting.wait_at),
    )
