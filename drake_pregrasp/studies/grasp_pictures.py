"""Pictures of the shipped hands: above the object, following it, closed, and lifting it."""

from pathlib import Path

import numpy as np
from PIL import Image
from pydrake.systems.analysis import Simulator

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.hand_description import Arm
from drake_pregrasp.diagrams.hand_station import HandStation
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.grasping.grasp_state import GraspPhase
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.simulation.output import make_folder, writing
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_scenario, shipped_scenarios
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.studies import pictures
from drake_pregrasp.studies.pictures import ByteArray, Light, camera_pose, take_picture
from drake_pregrasp.studies.report_page import Heading, Part, write_report
from drake_pregrasp.studies.runner import OnProgress
from drake_pregrasp.systems.loggers import GraspRecord

PHASES = (GraspPhase.TRACK, GraspPhase.SQUEEZE, GraspPhase.HOLD)
"""Phases with a picture at their end, besides the picture at the start."""

_CAMERA = pictures.color_camera((400, 400), 0.6)
_GAP = 8  # White pixels between pictures.
_FROM_ARM, _FROM_HAND = np.array([0.45, -1.0, 0.5]), np.array([0.75, 0.65, 0.5])
"""Position of the camera relative to its target in W, with and without an arm, in metres."""
_ABOVE = np.array([0.0, 0.0, 0.13])  # Target of the camera above the object, in metres.
_LIGHTS = (Light([0.3, 0.5, 0.8], 0.85), Light([-0.6, 0.3, 0.7], 0.4), Light([0.0, 1.0, 0.1], 0.3))
_BACKGROUND = (0.93, 0.94, 0.96)


def picture_grasps(out: str | Path, *, on_progress: OnProgress = lambda done, total: None) -> Path:
    """Runs the shipped scenarios with a hand, and returns the page with their pictures.

    Args:
        out: Folder of the page and of the pictures, `NAME.png`.
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
        image = Image.fromarray(picture_grasp(scenario))
        with writing(folder):
            image.save(folder / f"{name}.png", optimize=True)
        parts += [Heading(f"`{name}`: {hands[name]}"), f"![{hands[name]}]({name}.png)"]
    on_progress(len(hands), len(hands))
    return write_report(folder, "Hands", parts, name="grasps", formats=("md",))


def picture_grasp(scenario: Scenario) -> ByteArray:
    """Returns four pictures of a hand side by side, shape (height, width, 3).

    The camera moves with the object.

    Args:
        scenario: Scenario with a hand.
    """
    surface = scenario.make_surface()
    diagram = make_diagram(scenario, surface)
    station: HandStation = diagram.GetSubsystemByName("object_plant")
    station.scene_graph.AddRenderer(pictures.RENDERER, pictures.lit_renderer(_LIGHTS, _BACKGROUND))
    has_arm = isinstance(load_hand(scenario.grasp.hand).base, Arm)
    simulator, taken = Simulator(diagram), list[ByteArray]()
    for time in _moments(scenario, surface):
        simulator.AdvanceTo(time)
        context = station.GetMyContextFromRoot(simulator.get_context())
        p_WO: FloatArray = station.GetOutputPort("X_WO").Eval(context).translation()
        target = p_WO * [1.0, 1.0, 0.0] + _ABOVE
        X_WK = camera_pose(target, _FROM_ARM if has_arm else _FROM_HAND)
        query = station.GetOutputPort("query_object").Eval(context)
        taken.append(take_picture(query, _CAMERA, X_WK))
    gaps = [(0, 0), (_GAP, 0), (0, 0)]
    return np.concatenate(
        [taken[0], *(np.pad(p, gaps, constant_values=255) for p in taken[1:])], axis=1
    )


def _moments(scenario: Scenario, surface: ObjectSurface) -> list[float]:
    """Returns the start and the ends of `PHASES` in seconds, from a run without pictures."""
    records: list[GraspRecord] = []
    simulator = Simulator(make_diagram(scenario, surface, grasp_sink=records.append))
    simulator.AdvanceTo(scenario.simulation_duration)
    return [0.0] + [max(r.time for r in records if r.report[0] <= phase) for phase in PHASES]
