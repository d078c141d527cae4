"""Pictures of the shipped hands: above the object, following it, closed, and with it lifted."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    QueryObject,
    RenderCameraCore,
)
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.sensors import CameraInfo

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.hand_description import Arm
from drake_pregrasp.diagrams.hand_station import HandStation
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.grasping.grasp_state import GraspPhase
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.simulation.output import without_solver_chatter, write_text, writing
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_scenario, shipped_scenarios
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.studies.drawn_mesh import camera_pose
from drake_pregrasp.studies.vtk_picture import ByteArray, Light, lit_renderer, take_picture
from drake_pregrasp.systems.loggers import GraspRecord

PHASES = (GraspPhase.TRACK, GraspPhase.SQUEEZE, GraspPhase.HOLD)
"""At whose ends pictures are taken, after one at the start."""

_PIXELS = (400, 400)
_GAP = 8  # White pixels between pictures.
_FIELD = 0.6  # Of view, in radians.
_FROM = {True: np.array([0.45, -1.0, 0.5]), False: np.array([0.75, 0.65, 0.5])}
"""Where the camera is over the target, with an arm and without, in metres."""
_RAISED = np.array([0.0, 0.0, 0.13])  # The target over the object, in metres.
_LIGHTS = (Light([0.3, 0.5, 0.8], 0.85), Light([-0.6, 0.3, 0.7], 0.4), Light([0.0, 1.0, 0.1], 0.3))
_BACKGROUND = (0.93, 0.94, 0.96)


def picture_grasps(
    out: str | Path, *, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> Path:
    """Runs the shipped scenarios with a hand, and returns the page with their pictures.

    Args:
        out: Folder of the page and the pictures, `NAME.png`.
        on_progress: Called with how many scenarios are done, and how many there are.

    Raises:
        ScenarioError: If a hand's model isn't installed.
        OutputError: If the folder can't be written.
    """
    folder = Path(out)
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    shipped = shipped_scenarios()
    names = [name for name, (file, _) in shipped.items() if file.stem == "hands"]
    lines = ["# Hands", "", "Pictures are made by `drake-pregrasp study grasps`."]
    scenarios = [load_scenario(name) for name in names]  # All of them, before a picture is made.
    for done, (name, scenario) in enumerate(zip(names, scenarios, strict=True)):
        on_progress(done, len(names))
        image = picture_grasp(scenario)
        with writing(folder):
            Image.fromarray(image).save(folder / f"{name}.png", optimize=True)
        description = shipped[name][1]
        lines += ["", f"## `{name}`: {description}", "", f"![{description}]({name}.png)"]
    on_progress(len(names), len(names))
    write_text(folder / "grasps.md", "\n".join(lines) + "\n")
    return folder / "grasps.md"


def picture_grasp(scenario: Scenario) -> ByteArray:
    """Returns a scenario's hand at four moments side by side, shape (height, width, 3), of bytes.

    The camera goes along with the object.
    """
    surface = scenario.make_surface()
    diagram = make_diagram(scenario, surface)
    station: HandStation = diagram.GetSubsystemByName("object_plant")
    station.scene_graph.AddRenderer("vtk", lit_renderer(_LIGHTS, _BACKGROUND))
    view = _FROM[isinstance(load_hand(scenario.grasp.hand).base, Arm)]
    gap: ByteArray = np.full((_PIXELS[1], _GAP, 3), 255, dtype=np.uint8)
    simulator = Simulator(diagram)
    pictures: list[ByteArray] = []
    with without_solver_chatter():
        for time in _moments(scenario, surface):
            simulator.AdvanceTo(time)
            context = station.GetMyContextFromRoot(simulator.get_context())
            pictures += [gap, _look(station, context, view)]
    return np.concatenate(pictures[1:], axis=1)


def _moments(scenario: Scenario, surface: ObjectSurface) -> list[float]:
    """Returns when the phases end, by a run that nobody watches."""
    records: list[GraspRecord] = []
    simulator = Simulator(make_diagram(scenario, surface, grasp_sink=records.append))
    with without_solver_chatter():
        simulator.AdvanceTo(scenario.simulation_duration)
    return [0.0] + [max(r.time for r in records if r.report[0] <= phase) for phase in PHASES]


def _look(station: HandStation, context: object, view: FloatArray) -> ByteArray:
    query: QueryObject = station.GetOutputPort("query_object").Eval(context)
    p_WO: FloatArray = station.GetOutputPort("X_WO").Eval(context).translation()
    target = p_WO * [1.0, 1.0, 0.0] + _RAISED
    camera = ColorRenderCamera(
        RenderCameraCore(
            "vtk", CameraInfo(*_PIXELS, _FIELD), ClippingRange(0.05, 10.0), RigidTransform()
        )
    )
    return take_picture(query, camera, camera_pose(target, view))
