"""Animated pictures of any scenario, made without a browser."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from drake_pregrasp.config.hand_description import Arm
from drake_pregrasp.diagrams.hand_station import HandStation
from drake_pregrasp.diagrams.object_plant import ObjectPlant
from drake_pregrasp.diagrams.pregrasp_planner import PregraspPlanner
from drake_pregrasp.simulation.output import make_folder, replacing, writing
from drake_pregrasp.simulation.recording import CameraView, camera_view, make_timeline
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.run import check_name
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.studies.gallery import pictures
from drake_pregrasp.studies.gallery.pictures import ByteArray, Light
from drake_pregrasp.systems.loggers import GraspRecord
from drake_pregrasp.visualization.drawing import VOLUME_COLOR, camera_pose, drawn_solid
from drake_pregrasp.visualization.pregrasp_visualizer import GHOST_COLOR, are_apart
from drake_pregrasp.visualization.run_timeline import RunTimeline

_CAMERA = pictures.color_camera((400, 400), 0.46)
_WIDE_CAMERA = pictures.color_camera((400, 400), 1.31)  # The vertical field of view of Meshcat.
_FROM_ARM, _FROM_HAND = np.array([0.45, -1.0, 0.5]), np.array([0.75, 0.65, 0.5])
"""Position of the camera relative to its target in W, with and without an arm, in metres."""
_ABOVE = np.array([0.0, 0.0, 0.12])  # Target of the camera above the object, in metres.
_LIGHTS = (Light([0.3, 0.5, 0.8], 0.85), Light([-0.6, 0.3, 0.7], 0.6), Light([0.0, 1.0, 0.1], 0.3))
_EVEN_LIGHTS = (Light([0.3, 0.2, 1], 0.7), Light([-0.6, 0.1, 1], 0.45), Light([0, 1, 0.1], 0.35))
_BACKGROUND = (0.93, 0.94, 0.96)

_SHOWN = 100  # Milliseconds for which each picture of a film is shown.
_FINE, _COARSE = 0.025, 0.4  # Simulated time between pictures, near events and elsewhere, in s.
_BEFORE, _AFTER = 0.2, 0.6  # Simulated time around an event that is shown in slow motion, in s.
_SHORT = 3.0  # Runs that are not longer are in slow motion from start to end, in s.
_PANEL, _LINE, _DOT = 250, 19, 5  # Width of the text, height of a line, radius of a dot, in pixels.


class SceneCamera:
    """Takes pictures of a scenario, with regions and goals on the object.

    With a hand, the camera moves with the object. Otherwise it is that of a recording.

    Args:
        resolved: Scenario to simulate.
        timeline: Timeline that the simulation adds to; by default one that nobody reads.

    Attributes:
        records: Records of all control ticks so far.
    """

    def __init__(self, resolved: ResolvedScenario, timeline: RunTimeline | None = None) -> None:
        self.records: list[GraspRecord] = []
        self._resolved, hand = resolved, resolved.hand
        told = timeline or make_timeline(resolved, "")
        self._surface, self._drawn = resolved.surface, list[GeometryId]()

        def add_record(record: GraspRecord) -> None:
            self.records.append(record)
            told.add_grasp(record)

        diagram = make_diagram(resolved, sink=told.add_tick, grasp_sink=add_record)
        self._station: HandStation | ObjectPlant = diagram.GetSubsystemByName("object_plant")
        self._planner: PregraspPlanner = diagram.GetSubsystemByName("pregrasp_planner")
        lights = _EVEN_LIGHTS if hand is None else _LIGHTS
        self._station.scene_graph.AddRenderer(
            pictures.RENDERER, pictures.lit_renderer(lights, _BACKGROUND)
        )
        if hand is not None:
            has_arm = isinstance(hand.description.base, Arm)
            p_TK_W, share = _FROM_ARM if has_arm else _FROM_HAND, np.array([1.0, 1.0, 0.0])
            self._camera = _CAMERA
            self._view = CameraView(_ABOVE + p_TK_W, _ABOVE, share, np.zeros(3))
        else:
            self._camera, self._view = _WIDE_CAMERA, camera_view(resolved)
        self._simulator = Simulator(diagram)

    def advance(self, time: float) -> None:
        """Simulates up to a time in seconds."""
        self._simulator.AdvanceTo(time)

    def picture_at(self, time: float) -> ByteArray:
        """Returns the picture at a time, shape (height, width, 3).

        Args:
            time: Simulated time in seconds, not before that of the last picture.
        """
        self.advance(time)
        context = self._station.GetMyContextFromRoot(self._simulator.get_context())
        X_WO: RigidTransform = self._station.GetOutputPort("X_WO").Eval(context)
        self._draw(X_WO)
        query, view = self._station.GetOutputPort("query_object").Eval(context), self._view
        p_WT = view.p_WT + view.share * (X_WO.translation() - view.p_WO)
        X_WK = camera_pose(p_WT, view.p_WK - view.p_WT)
        return pictures.take_picture(query, self._camera, X_WK)

    def _draw(self, X_WO: RigidTransform) -> None:
        """Replaces what the planner draws in the scene: regions, goals, estimate, no-touch volumes.

        A closed hand has no goals.
        """
        planner, plant = self._planner, self._station.plant
        context = planner.GetMyContextFromRoot(self._simulator.get_context())
        regions = planner.GetOutputPort("safe_regions").Eval(context)
        status = planner.GetOutputPort("contact_status").Eval(context)
        p_WC = planner.GetOutputPort("p_WC").Eval(context).reshape(-1, 3)
        hold = planner.GetInputPort("hold_contacts")
        is_held = hold.HasValue(context) and hold.Eval(context)[0] > 0
        active = [] if is_held else np.flatnonzero(status > 0).tolist()
        X_OW, ahead = X_WO.inverse(), self._resolved.planner.estimator.lookahead
        p_OC = (X_OW @ p_WC[active].T).T
        drawn = pictures.goal_geometry(self._surface, regions.labels, p_OC, active)
        X_WE: RigidTransform = planner.GetOutputPort("X_WO_estimated").Eval(context)
        if are_apart(X_WE, X_WO):
            mesh = pictures.drawn_mesh(self._surface.mesh.triangles)
            drawn.append(pictures.coloured(X_OW @ X_WE, mesh, GHOST_COLOR, "estimate"))
        for index, volume in enumerate(self._resolved.no_touch_volumes):
            shape, X_WS = drawn_solid(volume.at(context.get_time() + ahead))
            drawn.append(pictures.coloured(X_OW @ X_WS, shape, VOLUME_COLOR, f"volume_{index}"))
        scene = self._station.scene_graph
        drawn_in = scene.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        source = plant.get_source_id()
        frame = plant.GetBodyFrameIdOrThrow(plant.GetBodyByName("object").index())
        for geometry in self._drawn:
            scene.RemoveGeometry(drawn_in, source, geometry)
        self._drawn = [
            scene.RegisterGeometry(drawn_in, source, frame, instance) for instance in drawn
        ]


def film_scenario(resolved: ResolvedScenario, name: str, out: Path) -> Path:
    """Writes the animated picture `out/NAME.webp` of a scenario, and returns its path.

    Like a recording, it has the run's timeline beside the scene, and is slow at events.

    Args:
        resolved: Scenario to simulate.
        name: Name of the scenario, for the title and the file.
        out: Folder of the picture.

    Raises:
        ScenarioError: If the name is invalid.
        OutputError: If the picture cannot be written.
    """
    check_name(name)
    make_folder(out)
    duration = resolved.scenario.simulation_duration
    rehearsal = make_timeline(resolved, name)
    SceneCamera(resolved, rehearsal).advance(duration)
    timeline = make_timeline(resolved, name)
    camera = SceneCamera(resolved, timeline)
    events = [time for time, _ in rehearsal.data()["events"] if time > 0]
    frames = [
        _with_timeline(camera.picture_at(time), timeline)
        for time in _picture_times(duration, events)
    ]
    return write_film(out / f"{name}.webp", frames)


def write_film(path: Path, frames: Sequence[Image.Image]) -> Path:
    """Writes an animated picture that repeats for ever, ten frames a second, and returns its path.

    Raises:
        OutputError: If the picture cannot be written.
    """
    first, *others = frames
    with writing(path), replacing(path) as partial:
        first.save(
            partial, save_all=True, append_images=others, duration=_SHOWN, loop=0, quality=60
        )
    return path


def _picture_times(duration: float, events: list[float]) -> Iterator[float]:
    time, shown = 0.0, -np.inf
    while time <= duration:
        is_near = duration <= _SHORT or any(e - _BEFORE <= time < e + _AFTER for e in events)
        if is_near or time - shown >= _COARSE - _FINE / 2:
            shown = time
            yield time
        time += _FINE


def _with_timeline(image: ByteArray, timeline: RunTimeline) -> Image.Image:
    """Returns a picture with the present state of the timeline on its left."""
    now = timeline.now()
    height, width, _ = image.shape
    page = Image.new("RGB", (_PANEL + width, height), "white")
    page.paste(Image.fromarray(image), (_PANEL, 0))
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(13)
    rows = [(f"{now['title'].partition(':')[0]}   {now['time']:.2f} s", None), ("", None)]
    for _, row, text in now["changes"]:
        color = now["colors"][int(row)] if row.isdigit() else None
        rows.append((f"{now['names'][int(row)]}   {text}" if color else f"{row}   {text}", color))
    events = [text for time, text in now["events"] if now["time"] - time < 2 * _AFTER]
    rows += [("", None), *((text, None) for text in events[-3:])]
    for index, (text, color) in enumerate(rows):
        y = _LINE * (index + 1)
        draw.text((2 * _LINE, y), text, "black", font, anchor="lm")
        if color:
            draw.circle((_LINE, y), _DOT, color)
    return page
