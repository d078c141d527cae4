"""Films and pictures of the shipped hands, with regions and goals on the object."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from drake_pregrasp.config.hand_description import Arm
from drake_pregrasp.diagrams.hand_station import HandStation
from drake_pregrasp.diagrams.pregrasp_planner import PregraspPlanner
from drake_pregrasp.grasping.grasp_state import GraspPhase
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.simulation.output import make_folder, writing
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_scenario, shipped_scenarios
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.studies import pictures
from drake_pregrasp.studies.pictures import ByteArray, Light
from drake_pregrasp.studies.report_page import Heading, Part, write_report
from drake_pregrasp.studies.runner import OnProgress
from drake_pregrasp.systems.loggers import GraspRecord

PHASES = (GraspPhase.TRACK, GraspPhase.SQUEEZE, GraspPhase.HOLD)
"""Phases whose ends are pictured, besides the start."""

FRAME_TIME = 0.1
"""Time between the pictures of a film, in seconds."""

_CAMERA = pictures.color_camera((400, 400), 0.46)
_GAP = 8  # White pixels between pictures.
_FROM_ARM, _FROM_HAND = np.array([0.45, -1.0, 0.5]), np.array([0.75, 0.65, 0.5])
"""Position of the camera relative to its target in W, with and without an arm, in metres."""
_ABOVE = np.array([0.0, 0.0, 0.12])  # Target of the camera above the object, in metres.
_LIGHTS = (Light([0.3, 0.5, 0.8], 0.85), Light([-0.6, 0.3, 0.7], 0.6), Light([0.0, 1.0, 0.1], 0.3))
_BACKGROUND = (0.93, 0.94, 0.96)


def picture_grasps(out: str | Path, *, on_progress: OnProgress = lambda done, total: None) -> Path:
    """Runs the shipped scenarios with a hand, and returns the page with their pictures.

    Args:
        out: Folder of the page, the films, `NAME.webp`, and the pictures, `NAME.png`.
        on_progress: Called with the number of finished scenarios and the number of all.

    Raises:
        ScenarioError: If the model of a hand is not installed.
        OutputError: If the folder cannot be written.
    """
    folder = Path(out)
    make_folder(folder)
    hands = {
        name: text for name, (file, text) in shipped_scenarios().items() if file.stem == "hands"
    }
    scenarios = {name: load_scenario(name) for name in hands}  # Fails before any picture is made.
    parts: list[Part] = ["`drake-pregrasp study grasps` makes these pictures."]
    for done, (name, scenario) in enumerate(scenarios.items()):
        on_progress(done, len(hands))
        film = film_grasp(scenario)
        first, *others = map(Image.fromarray, film.frames)
        with writing(folder):
            Image.fromarray(film.at_phases()).save(folder / f"{name}.png", optimize=True)
            first.save(
                folder / f"{name}.webp",
                save_all=True,
                append_images=others,
                duration=round(1000 * FRAME_TIME),
                loop=0,
                quality=60,
            )
        pictures_of = [f"![{hands[name]}]({name}.{kind})" for kind in ("webp", "png")]
        parts += [Heading(f"`{name}`: {hands[name]}"), *pictures_of]
    on_progress(len(hands), len(hands))
    return write_report(folder, "Hands", parts, name="grasps", formats=("md",))


class Film(NamedTuple):
    """Pictures of a hand.

    Attributes:
        frames: Pictures every `FRAME_TIME`, each of shape (height, width, 3).
        phases: `GraspPhase` of each picture.
    """

    frames: list[ByteArray]
    phases: list[float]

    def at_phases(self) -> ByteArray:
        """Returns the first picture and those at the ends of `PHASES`, side by side."""
        ends = [max(k for k, now in enumerate(self.phases) if now <= phase) for phase in PHASES]
        gaps = [(0, 0), (_GAP, 0), (0, 0)]
        others = [np.pad(self.frames[k], gaps, constant_values=255) for k in ends]
        return np.concatenate([self.frames[0], *others], axis=1)


class GraspCamera:
    """Takes pictures of a scenario with a hand, with regions and goals on the object.

    The camera moves with the object.

    Args:
        scenario: Scenario with a hand.

    Attributes:
        records: Records of all control ticks so far.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.records: list[GraspRecord] = []
        self._surface, self._drawn = scenario.make_surface(), list[GeometryId]()
        diagram = make_diagram(scenario, self._surface, grasp_sink=self.records.append)
        self._station: HandStation = diagram.GetSubsystemByName("object_plant")
        self._planner: PregraspPlanner = diagram.GetSubsystemByName("pregrasp_planner")
        self._station.scene_graph.AddRenderer(
            pictures.RENDERER, pictures.lit_renderer(_LIGHTS, _BACKGROUND)
        )
        has_arm = isinstance(load_hand(scenario.grasp.hand).base, Arm)
        self._p_TK_W = _FROM_ARM if has_arm else _FROM_HAND
        self._simulator = Simulator(diagram)

    def picture_at(self, time: float) -> ByteArray:
        """Returns the picture at a time, shape (height, width, 3).

        Args:
            time: Simulated time in seconds, not before that of the last picture.
        """
        self._simulator.AdvanceTo(time)
        context = self._station.GetMyContextFromRoot(self._simulator.get_context())
        X_WO: RigidTransform = self._station.GetOutputPort("X_WO").Eval(context)
        self._draw_goals(X_WO)
        target = X_WO.translation() * [1.0, 1.0, 0.0] + _ABOVE
        query = self._station.GetOutputPort("query_object").Eval(context)
        return pictures.take_picture(query, _CAMERA, pictures.camera_pose(target, self._p_TK_W))

    def _draw_goals(self, X_WO: RigidTransform) -> None:
        """Replaces regions and goals in the scene by those of this tick; a closed hand has none."""
        planner, plant = self._planner, self._station.plant
        context = planner.GetMyContextFromRoot(self._simulator.get_context())
        regions = planner.GetOutputPort("safe_regions").Eval(context)
        status = planner.GetOutputPort("contact_status").Eval(context)
        p_WC = planner.GetOutputPort("p_WC").Eval(context).reshape(-1, 3)
        hold = planner.GetInputPort("hold_contacts").Eval(context)[0]
        active = [] if hold > 0 else np.flatnonzero(status > 0).tolist()
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


def film_grasp(scenario: Scenario) -> Film:
    """Simulates a scenario with a hand, and returns its film."""
    camera, film = GraspCamera(scenario), Film([], [])
    for time in np.arange(0.0, scenario.simulation_duration + FRAME_TIME / 2, FRAME_TIME):
        film.frames.append(camera.picture_at(time))
        film.phases.append(camera.records[-1].report[0])
    return film
