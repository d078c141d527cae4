"""Visualizers of a simulation, and its recording in Meshcat."""

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams, MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.hand_description import Arm
from drake_pregrasp.diagrams.expected_path import expected_path
from drake_pregrasp.diagrams.hand_station import HandStation
from drake_pregrasp.diagrams.object_plant import ObjectPlant
from drake_pregrasp.diagrams.pregrasp_planner import PregraspPlanner
from drake_pregrasp.diagrams.wiring import connect
from drake_pregrasp.errors import OutputError
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.pregrasp_visualizer import PregraspVisualizer
from drake_pregrasp.systems.run_story import RunStory

# Bright from all sides, so that the regions' colours are distinct on every face, and a little
# brighter from above, so that hollows and edges are visible.
_LIGHTS = {"AmbientLight": 1.7, "PointLightNegativeX": 0.0, "PointLightPositiveX": 8.0}

# Position of the camera relative to its target in W, for an object of unit size.
_CAMERA = np.array([1.4, 1.2, 0.85])
_HAND_CAMERA = np.array([1.6, 1.4, 0.92])
_ARM_CAMERA = np.array([0.75, -1.75, 0.92])  # Beside the arm, which stands behind along x.
_ARM_RAISED = 0.15  # Visible part of an arm above its palm, in metres.
_VIEW = 0.6  # Share of a path's length that counts as object size, so that all of it is visible.


_SCENE = "/drake"  # Path under which everything is drawn.


def start_meshcat(*, live: bool = False) -> Meshcat:
    """Starts a viewer at any free port, for connections from this machine only.

    Args:
        live: Whether the viewer is for watching; otherwise it is empty until `recording_html`.

    Raises:
        OutputError: If Drake may not open a port.
    """
    try:
        meshcat = Meshcat(MeshcatParams(host="localhost", show_stats_plot=False))
    except RuntimeError as error:
        raise OutputError(f"Meshcat cannot start ({error}); run without a recording") from error
    meshcat.SetProperty(_SCENE, "visible", live)
    return meshcat


def add_visualizers(
    builder: DiagramBuilder,
    meshcat: Meshcat,
    scenario: Scenario,
    surface: ObjectSurface,
    object_plant: ObjectPlant | HandStation,
    planner: PregraspPlanner,
    *,
    record: bool,
    live: bool,
    continues: PregraspVisualizer | None = None,
) -> None:
    """Adds visualizers of plant and planner, sets lights and camera, and starts a recording.

    Args:
        builder: Builder of the diagram.
        meshcat: Viewer for all drawings.
        scenario: Scenario to simulate.
        surface: Surface of the object.
        object_plant: Plant in the builder, with the object and perhaps a hand.
        planner: Planner in the builder.
        record: Whether to start a recording.
        live: Whether the viewer shows the simulation while it records.
        continues: Visualizer of an equal diagram whose drawings and camera are kept.
    """
    num_contacts, period = scenario.num_contacts, scenario.recording.publish_period
    query, params = object_plant.GetOutputPort("query_object"), MeshcatVisualizerParams()
    params.publish_period = period
    params.prefix = "/drake/bodies"  # A page loads paths in alphabetical order: bodies come first.
    MeshcatVisualizer.AddToBuilder(builder, query, meshcat, params)
    visualizer = PregraspVisualizer(
        meshcat=meshcat,
        surface=surface,
        tile_surface=scenario.make_surface(scenario.recording.tile_size),
        num_contacts=num_contacts,
        publish_period=period,
        record=record,
        continues=continues,
    )
    builder.AddNamedSystem("pregrasp_visualizer", visualizer)
    drawn = "X_WO_estimated p_WC contact_status safe_regions p_WO_covariance"
    connect(builder, planner, drawn, visualizer)
    connect(builder, object_plant, "X_WO", visualizer)
    if record:
        meshcat.StartRecording(1 / period, set_visualizations_while_recording=live)
    if continues is not None:
        return
    path, direction = shown_path(scenario)
    extent = max(0.1, float(surface.mesh.extents.max()))
    for name in ("/Grid", "/Axes"):
        meshcat.SetProperty(name, "visible", False)
    meshcat.SetProperty("/Background", "top_color", [1.0, 1.0, 1.0])
    meshcat.SetProperty("/Background", "bottom_color", [0.86, 0.88, 0.91])
    for light, intensity in _LIGHTS.items():
        meshcat.SetProperty(f"/Lights/{light}/<object>", "intensity", intensity)
    meshcat.SetCameraPose(*camera_pose(path, extent, direction))


def shown_path(scenario: Scenario) -> tuple[FloatArray, FloatArray]:
    """Returns the positions that the camera must show, and the camera's direction.

    The positions in W, shape (k, 3), in metres, are those of the object. With a hand, they end when
    the hand rests, and include its palm. The direction is an argument of `camera_pose`.
    """
    grasp = scenario.grasp
    duration = scenario.simulation_duration + scenario.planner.estimator.lookahead
    if not grasp.has_hand:
        return expected_path(scenario.motion, duration, scenario.object), _CAMERA
    settings, model = grasp.make_settings(), scenario.load_hand_model()
    hand = model.description
    duration = min(duration, grasp.latest_rest(hand.fingertips))
    path = expected_path(scenario.motion, duration, scenario.object)
    above = hand.palm_height + max(settings.lift_height, settings.approach_height)
    has_arm = isinstance(hand.base, Arm)
    raised = path[[0, -1]] + model.X_LA @ np.array([0.0, 0.0, above + has_arm * _ARM_RAISED])
    return np.concatenate([path, raised]), _ARM_CAMERA if has_arm else _HAND_CAMERA


def camera_pose(
    path: FloatArray, extent: float, direction: FloatArray = _CAMERA
) -> tuple[FloatArray, FloatArray]:
    """Returns positions in W of the camera and its target, with a whole path in the picture.

    Args:
        path: Positions of the object in W, shape (k, 3), in metres.
        extent: Size of the object, in metres.
        direction: Position of the camera relative to its target in W, for an object of unit size,
            shape (3,).
    """
    low, high = path.min(axis=0), path.max(axis=0)
    target: FloatArray = (low + high) / 2
    scale = max(extent, _VIEW * float((high - low).max() + extent))
    return target + scale * direction, target


def recording_html(meshcat: Meshcat, story: RunStory) -> str:
    """Ends the recording and returns it as one self-contained page.

    Args:
        meshcat: Viewer with the recording.
        story: Story of the recorded run, which the page shows over the scene.
    """
    meshcat.StopRecording()
    meshcat.PublishRecording()
    meshcat.SetProperty(_SCENE, "visible", True)
    return story.added_to(meshcat.StaticHtml())


def make_story(scenario: Scenario, name: str) -> RunStory:
    """Returns the story of a run that begins."""
    title = f"{name}: {scenario.description}" if scenario.description else name
    names, end = scenario.obstacle_names, scenario.planner.static_duration
    return RunStory(title, scenario.num_contacts, static_end=end, obstacle_names=names)
