"""Films and pictures of the shipped hands, with regions and goals on the object."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from drake_pregrasp.grasping.grasp_state import GraspPhase
from drake_pregrasp.simulation.output import make_folder, writing
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_scenario, shipped_scenarios
from drake_pregrasp.studies.film import SceneCamera, write_film
from drake_pregrasp.studies.pictures import ByteArray
from drake_pregrasp.studies.report_page import Heading, Part, write_report
from drake_pregrasp.studies.runner import OnProgress

PHASES = (GraspPhase.TRACK, GraspPhase.SQUEEZE, GraspPhase.HOLD)
"""Phases whose ends are pictured, besides the start."""

FRAME_TIME = 0.1
"""Time between the pictures of a film, in seconds; `write_film` shows them in real time."""

_GAP = 8  # White pixels between pictures.


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
        with writing(folder):
            Image.fromarray(film.at_phases()).save(folder / f"{name}.png", optimize=True)
        write_film(folder / f"{name}.webp", [*map(Image.fromarray, film.frames)])
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


def film_grasp(scenario: Scenario) -> Film:
    """Simulates a scenario with a hand, and returns its film."""
    camera, film = SceneCamera(scenario), Film([], [])
    for time in np.arange(0.0, scenario.simulation_duration + FRAME_TIME / 2, FRAME_TIME):
        film.frames.append(camera.picture_at(time))
        film.phases.append(camera.records[-1].report[0])
    return film
