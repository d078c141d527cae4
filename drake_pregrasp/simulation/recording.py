"""The Meshcat recording of a run."""

from collections.abc import Mapping

import numpy as np
from pydrake.geometry import (
    Meshcat,
    MeshcatParams,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
)
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.hand_description import Arm
from drake_pregrasp.diagrams.expected_path import expected_path
from drake_pregrasp.diagrams.hand_station import HandStation
from drake_pregrasp.diagrams.object_plant import ObjectPlant
from drake_pregrasp.diagrams.pregrasp_planner import PregraspPlanner
from drake_pregrasp.errors import OutputError
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.pregrasp_visualizer import PregraspVisualizer
from drake_pregrasp.systems.status_labels import StatusLabels

# Bright from all sides, so that the regions' colours can be told apart on every face, and a little
# brighter from above, so that hollows and edges show.
_LIGHTS = {
    "AmbientLight": 1.7,
    "PointLightNegativeX": 0.0,
    "PointLightPositiveX": 8.0,
}

# From where the camera looks, for an object of unit size, and what share of a longer path counts as
# the object: then all of it is in the picture.
_CAMERA = np.array([1.9, 1.65, 1.1])
_ARM_CAMERA = np.array([0.9, -2.1, 1.1])  # Beside the arm, which stands behind along x.
_ARM_RAISED = np.array([0.0, 0.0, 0.15])  # As much of an arm over its palm is shown, in metres.
_VIEW = 0.5

_LABEL_HOVER = 0.065  # Height of the labels over the object, in metres.


def start_meshcat() -> Meshcat:
    """Starts a viewer on this machine only, at any free port, with its stage set.

    Raises:
        OutputError: If Drake may not open a port.
    """
    try:
        meshcat = Meshcat(MeshcatParams(host="localhost", show_stats_plot=False))
    except RuntimeError as error:
        raise OutputError(f"Meshcat can't start ({error}); run without a recording") from error
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Background", "top_color", [1.0, 1.0, 1.0])
    meshcat.SetProperty("/Background", "bottom_color", [0.86, 0.88, 0.91])
    for light, intensity in _LIGHTS.items():
        meshcat.SetProperty(f"/Lights/{light}/<object>", "intensity", intensity)
    return meshcat


def add_recording(
    builder: DiagramBuilder,
    meshcat: Meshcat,
    *,
    object_plant: ObjectPlant | HandStation,
    planner: PregraspPlanner,
    surface: ObjectSurface,
    tile_surface: ObjectSurface,
    num_contacts: int,
    path: FloatArray,
    direction: FloatArray,
    publish_period: float,
    live: bool,
    obstacle_names: Mapping[int, str],
) -> None:
    """Adds visualizers of the plant and the planner, looks at the object's path, and records.

    The path holds positions of O in W, shape (k, 3), in metres; the camera is in that direction. A
    viewer sees the run as it goes
    only if it is `live`: that takes as long again as recording it.
    Obstacles have their names by their indices, where they have one.
    """
    MeshcatVisualizer.AddToBuilder(
        builder,
        object_plant.GetOutputPort("query_object"),
        meshcat,
        MeshcatVisualizerParams(publish_period=publish_period),
    )
    visualizer = builder.AddNamedSystem(
        "pregrasp_visualizer",
        PregraspVisualizer(
            meshcat=meshcat,
            surface=surface,
            tile_surface=tile_surface,
            num_contacts=num_contacts,
            publish_period=publish_period,
        ),
    )
    for name in (
        "X_WO_estimated",
        "p_WC",
        "contact_status",
        "safe_regions",
        "p_WO_covariance",
    ):
        builder.Connect(planner.GetOutputPort(name), visualizer.GetInputPort(name))
    labels = builder.AddNamedSystem(
        "status_labels",
        StatusLabels(
            meshcat=meshcat,
            num_contacts=num_contacts,
            publish_period=publish_period,
            hover=_LABEL_HOVER + float(np.max(surface.mesh.vertices[:, 2])),
            yaw=float(np.arctan2(direction[1], direction[0]) + np.pi / 2),
            obstacle_names=obstacle_names,
        ),
    )
    for name in ("X_WO_estimated", "contact_status", "contact_causes", "tracking_status"):
        builder.Connect(planner.GetOutputPort(name), labels.GetInputPort(name))
    extent = max(0.1, float(surface.mesh.extents.max()))
    meshcat.SetCameraPose(*camera_pose(path, extent, direction))
    meshcat.StartRecording(
        frames_per_second=1 / publish_period, set_visualizations_while_recording=live
    )


def shown_path(scenario: Scenario) -> tuple[FloatArray, FloatArray]:
    """Returns positions in W that the camera has to see, shape (k, 3), in metres, and from where.

    They are those of the object; with a hand also those of its palm, and no longer than until it
    stands still.
    """
    grasp = scenario.grasp
    duration = scenario.simulation_duration + scenario.planner.estimator.lookahead
    if not grasp.has_hand:
        return expected_path(scenario.motion, duration, scenario.object), _CAMERA
    settings, hand = grasp.make_settings(), load_hand(grasp.hand)
    duration = min(duration, grasp.latest_rest(hand.fingertips))
    path = expected_path(scenario.motion, duration, scenario.object)
    above = hand.palm_height + max(settings.lift_height, settings.approach_height)
    raised: FloatArray = path + np.array([0.0, 0.0, above])
    has_arm = isinstance(hand.base, Arm)
    if has_arm:
        raised += _ARM_RAISED
    return np.concatenate([path, raised[[0, -1]]]), _ARM_CAMERA if has_arm else _CAMERA


def camera_pose(
    path: FloatArray, extent: float, direction: FloatArray = _CAMERA
) -> tuple[FloatArray, FloatArray]:
    """Returns where the camera is and what it looks at, so that a whole path is in the picture.

    Args:
        path: Positions of the object, shape (k, 3), in metres.
        extent: Size of the object, in metres.
        direction: From where it looks, for an object of unit size, shape (3,).
    """
    low, high = path.min(axis=0), path.max(axis=0)
    target: FloatArray = (low + high) / 2
    scale = max(extent, _VIEW * float((high - low).max() + extent))
    return target + scale * direction, target


def recording_html(meshcat: Meshcat) -> str:
    """Ends the recording and returns it as one self-contained page."""
    meshcat.StopRecording()
    meshcat.PublishRecording()
    page: str = meshcat.StaticHtml()
    return page
