"""Pages with pictures of the shipped scenarios that are not from the paper, and films of hands."""

import functools
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from drake_pregrasp.grasping.grasp_state import GraspPhase
from drake_pregrasp.simulation.output import make_folder, writing
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.run import run
from drake_pregrasp.simulation.scenario_file import load_resolved, shipped_scenarios
from drake_pregrasp.studies.gallery.film import SceneCamera, write_film
from drake_pregrasp.studies.gallery.pictures import ByteArray, render_goals
from drake_pregrasp.studies.report_page import Heading, Part, write_report
from drake_pregrasp.studies.runner import OnProgress, run_jobs
from drake_pregrasp.systems.loggers import TickRecord

MOMENTS = (0.0, 0.5, 1.0)
"""Times of the pictures, as shares of the run's duration."""

VIEW_YAW = 0.7
"""Azimuth of the camera about z of W, in radians."""

_TITLES = {
    "objects": "Objects of any shape",
    "areas": "No-touch areas and obstacles",
    "limits": "Limits and coupling",
    "motions": "Motions",
    "measures": "Contact models and measures",
    "extensions": "Extensions that the paper names",
}


def make_gallery(out: str | Path, *, on_progress: OnProgress = lambda done, total: None) -> Path:
    """Runs the scenarios, draws them, and returns the path of the page.

    Args:
        out: Folder of the page and the pictures, `NAME.png`.
        on_progress: Called with the number of finished runs and the number of all runs.
    """
    folder = Path(out)
    make_folder(folder)
    shipped = shipped_scenarios()
    jobs = [{"name": name} for name, (file, _) in shipped.items() if file.stem in _TITLES]
    draw = functools.partial(_draw, folder=folder)
    run_jobs(draw, jobs, on_progress=on_progress)
    parts: list[Part] = [
        "    .venv/bin/drake-pregrasp gallery",
        "This command makes the pictures. Each shows a scenario at its start, half-way and at its"
        " end. A region has the colour of its contact; grey surface is in no region. Brown"
        " obstacles are bodies, translucent ones are no-touch volumes. `drake-pregrasp run NAME`"
        " makes a recording, and `drake-pregrasp grasps` makes pictures and films of the hands.",
    ]
    for stem, title in _TITLES.items():
        parts.append(Heading(title))
        for name, (file, description) in shipped.items():
            if file.stem == stem:
                picture = f"![{name}]({name}.png)"
                parts += [Heading(f"`{name}`: {description}", 3), picture]
    return write_report(folder, "Gallery", parts, name="gallery", formats=("md",))


def _draw(job: Mapping[str, str], folder: Path) -> dict[str, Any]:
    name, records = job["name"], list[TickRecord]()
    resolved = load_resolved(name)
    with TemporaryDirectory() as runs:
        run(resolved, name=name, out=runs, recording=False, on_tick=records.append)
    shown = [records[round(share * (len(records) - 1))] for share in MOMENTS]
    frames = [_frame(resolved, record) for record in shown]
    with writing(folder):
        picture = Image.fromarray(np.concatenate(frames, axis=1))
        picture.save(folder / f"{name}.png", optimize=True)
    return {}


def _frame(resolved: ResolvedScenario, record: TickRecord) -> ByteArray:
    """Returns the picture of a tick."""
    X_OW = record.X_WO_estimated.inverse()
    R_OW, p_OW = X_OW.rotation().matrix(), X_OW.translation()
    contacts, p_OC = record.active_contacts()
    bodies, volumes = (
        [moving.at(record.time).moved(R_OW, p_OW) for moving in obstacles]
        for obstacles in (resolved.obstacle_bodies, resolved.no_touch_volumes)
    )
    along = R_OW @ [np.cos(VIEW_YAW), np.sin(VIEW_YAW), 0.0]
    return render_goals(
        resolved.surface,
        record.regions.labels,
        p_OC,
        contacts.tolist(),
        yaw=float(np.arctan2(along[1], along[0])),
        bodies=bodies,
        volumes=volumes,
        pixels=(340, 340),
    )


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
    scenarios = {name: load_resolved(name) for name in hands}  # Fails before any picture is made.
    parts: list[Part] = ["`drake-pregrasp grasps` makes these pictures."]
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


def film_grasp(resolved: ResolvedScenario) -> Film:
    """Simulates a scenario with a hand, and returns its film."""
    camera, film = SceneCamera(resolved), Film([], [])
    for time in np.arange(0.0, resolved.scenario.simulation_duration + FRAME_TIME / 2, FRAME_TIME):
        film.frames.append(camera.picture_at(time))
        film.phases.append(camera.records[-1].report[0])
    return film
