"""Animated pictures of any scenario, made without a browser."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.hand_description import Arm
from drake_pregrasp.diagrams.hand_station import HandStation
from drake_pregrasp.diagrams.object_plant import ObjectPlant
from drake_pregrasp.diagrams.pregrasp_planner import PregraspPlanner
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.simulation.output import make_folder, writing
from drake_pregrasp.simulation.recording import camera_pose, make_story, shown_path
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.studies import pictures
from drake_pregrasp.studies.pictures import ByteArray, Light
from drake_pregrasp.systems.loggers import GraspRecord
from drake_pregrasp.systems.run_story import RunStory

_CAMERA = pictures.color_camera((400, 400), 0.46)
_WIDE_CAMERA = pictures.color_camera((400, 400), 1.31)  # The vertical field of view of Meshcat.
_FROM_ARM, _FROM_HAND = np.array([0.45, -1.0, 0.5]), np.array([0.75, 0.65, 0.5])
"""Position of the camera relative to its target in W, with and without an arm, in metres."""
_ABOVE = np.array([0.0, 0.0, 0.12])  # Target of the camera above the object, in metres.
_LIGHTS = (Light([0.3, 0.5, 0.8], 0.85), Light([-0.6, 0.3, 0.7], 0.6), Light([0.0, 1.0, 0.1], 0.3))
_SOFT_LIGHTS = tuple(light._replace(intensity=0.7 * light.intensity) for light in _LIGHTS)
_BACKGROUND = (0.93, 0.94, 0.96)

_SHOWN = 100  # Milliseconds for which each picture of a film is shown.
_FINE, _COARSE = 0.025, 0.4  # Simulated time between pictures, near events and elsewhere, in s.
_BEFORE, _AFTER = 0.2, 0.6  # Simulated time around an event that is shown in slow motion, in s.
_SHORT = 3.0  # Runs that are not longer are in slow motion from start to end, in s.
_PANEL, _LINE, _DOT = 250, 19, 5  # Width of the text, height of a line, radius of a dot, in pixels.


class SceneCamera:
    """Takes pictures of a scenario, with regions and goals on the object.

    With a hand, the camera moves with the object. Otherwise it stands where the one of a recording
    does.

    Args:
        scenario: Scenario to simulate.
        story: Story that the simulation adds to; by default one that nobody reads.

    Attributes:
        records: Records of all control ticks so far.
    """

    def __init__(self, scenario: Scenario, story: RunStory | None = None) -> None:
        self.records: list[GraspRecord] = []
        told = story or make_story(scenario, "")
        self._surface, self._drawn = scenario.make_surface(), list[GeometryId]()

        def add_record(record: GraspRecord) -> None:
            self.records.append(record)
            told.add_grasp(record)

        diagram = make_diagram(scenario, self._surface, sink=told.add_tick, grasp_sink=add_record)
        self._station: HandStation | ObjectPlant = diagram.GetSubsystemByName("object_plant")
        self._planner: PregraspPlanner = diagram.GetSubsystemByName("pregrasp_planner")
        lights = _LIGHTS if scenario.grasp.has_hand else _SOFT_LIGHTS
        self._station.scene_graph.AddRenderer(
            pictures.RENDERER, pictures.lit_renderer(lights, _BACKGROUND)
        )
        self._p_WT: FloatArray | None = None
        if scenario.grasp.has_hand:
            has_arm = isinstance(load_hand(scenario.grasp.hand).base, Arm)
            self._camera, self._p_TK_W = _CAMERA, _FROM_ARM if has_arm else _FROM_HAND
        else:
            path, direction = shown_path(scenario)
            extent = float(self._surface.mesh.extents.max())
            p_WK, self._p_WT = camera_pose(path, extent, direction)
            self._camera, self._p_TK_W = _WIDE_CAMERA, p_WK - self._p_WT
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
        self._draw_goals(X_WO)
        target = self._p_WT
        if target is None:
            target = X_WO.translation() * [1.0, 1.0, 0.0] + _ABOVE
        query = self._station.GetOutputPort("query_object").Eval(context)
        return pictures.take_picture(
            query, self._camera, pictures.camera_pose(target, self._p_TK_W)
        )

    def _draw_goals(self, X_WO: RigidTransform) -> None:
        """Replaces regions and goals in the scene by those of this tick; a closed hand has none."""
        planner, plant = self._planner, self._station.plant
        context = planner.GetMyContextFromRoot(self._simulator.get_context())
        regions = planner.GetOutputPort("safe_regions").Eval(context)
        status = planner.GetOutputPort("contact_status").Eval(context)
        p_WC = planner.GetOutputPort("p_WC").Eval(context).reshape(-1, 3)
        hold = planner.GetInputPort("hold_contacts")
        is_held = hold.HasValue(context) and hold.Eval(context)[0] > 0
        active = [] if is_held else np.flatnonzero(status > 0).tolist()
        p_OC = (X_WO.inverse() @ p_WC[active].T).T
        scene = self._station.scene_graph
        drawn_in = scene.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        source = plant.get_source_id()
        frame = plant.GetBodyFrameIdOrThrow(plant.GetBodyByName("object").index())
        for geometry in self._drawn:
            scene.RemoveGeometry(drawn_in, source, geometry)
        self._drawn = [
            scene.RegisterGeometry(drawn_in, source, frame, instance)
            for instance in pictures.goal_geometry(self._surface, regions.labels, p_OC, active)
        ]


def film_scenario(scenario: Scenario, name: str, out: Path) -> Path:
    """Writes the animated picture `out/NAME.webp` of a scenario, and returns its path.

    Like a recording, it has the run's story beside the scene, and is slow at events.

    Args:
        scenario: Checked scenario to simulate.
        name: Name of the scenario, for the title and the file.
        out: Folder of the picture.

    Raises:
        OutputError: If the picture cannot be written.
    """
    make_folder(out)
    rehearsal = make_story(scenario, name)
    SceneCamera(scenario, rehearsal).advance(scenario.simulation_duration)
    story = make_story(scenario, name)
    camera = SceneCamera(scenario, story)
    events = [time for time, _ in rehearsal.data()["events"] if time > 0]
    frames = [
        _with_story(camera.picture_at(time), story)
        for time in _picture_times(scenario.simulation_duration, events)
    ]
    return write_film(out / f"{name}.webp", frames)


def write_film(path: Path, frames: Sequence[Image.Image]) -> Path:
    """Writes an animated picture that repeats for ever, ten frames a second, and returns its path.

    Raises:
        OutputError: If the picture cannot be written.
    """
    first, *others = frames
    with writing(path):
        first.save(path, save_all=True, append_images=others, duration=_SHOWN, loop=0, quality=60)
    return path


def _picture_times(duration: float, events: list[float]) -> Iterator[float]:
    time, shown = 0.0, -np.inf
    while time <= duration:
        is_near = duration <= _SHORT or any(e - _BEFORE <= time < e + _AFTER for e in events)
        if is_near or time - shown >= _COARSE - _FINE / 2:
            shown = time
            yield time
        time += _FINE


def _with_story(image: ByteArray, story: RunStory) -> Image.Image:
    """Returns a picture with the present state of the story on its left."""
    now = story.now()
    height, width, _ = image.shape
    page = Image.new("RGB", (_PANEL + width, height), "white")
    page.paste(Image.fromarray(image), (_PANEL, 0))
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(13)
    rows = [(f"{now['title'].partition(':')[0]}   {now['time']:.2f} s", None), ("", None)]
    for _, row, text in now["changes"]:
        color = now["colors"][int(row)] if row.isdigit() else None
        rows.append((f"finger {row}   {text}" if color else f"{row}   {text}", color))
    events = [text for time, text in now["events"] if now["time"] - time < 2 * _AFTER]
    rows += [("", None), *((text, None) for text in events[-3:])]
    for index, (text, color) in enumerate(rows):
        y = _LINE * (index + 1)
        draw.text((2 * _LINE, y), text, "black", font, anchor="lm")
        if color:
            draw.circle((_LINE, y), _DOT, color)
    return page
