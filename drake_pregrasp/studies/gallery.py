"""A page of pictures of the shipped scenarios, but for the paper's."""

import functools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from PIL import Image

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.selection_input import ContactStatus, describe_status, is_active
from drake_pregrasp.simulation.obstacle_config import moving_solid
from drake_pregrasp.simulation.output import write_text, writing
from drake_pregrasp.simulation.run import run
from drake_pregrasp.simulation.scenario_file import load_scenario, shipped_scenarios
from drake_pregrasp.studies.processes import in_processes
from drake_pregrasp.studies.rendered_goals import render_goals
from drake_pregrasp.systems.loggers import TickRecord

MOMENTS = (0.0, 0.5, 1.0)
"""Which moments are shown, as shares of the run."""

VIEW_YAW = 0.7
"""Direction in W from which the pictures are taken, in radians about z."""

_PIXELS = (340, 340)
_PAGE = "gallery.md"
_FILES = ("objects", "areas", "limits", "motions", "measures")
_TITLES = {
    "objects": "Objects of any shape",
    "areas": "No-touch areas and obstacles",
    "limits": "Limits and coupling",
    "motions": "Motions",
    "measures": "Contact models and measures",
}


class Exhibit(NamedTuple):
    """What the page says of a scenario.

    Attributes:
        name: Of the scenario.
        static: Its Q_MSV in the static phase, or None if there is none.
        final: Its Q_MSV at the end.
        margin: Its force-closure margin at the end.
        limited: What has limited contacts at some time, in words.
    """

    name: str
    static: float | None
    final: float
    margin: float
    limited: list[str]


def make_gallery(
    out: str | Path, *, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> Path:
    """Runs the scenarios, draws them, and returns the path of the page.

    Args:
        out: Folder of the page; the pictures go into its folder `gallery`.
        on_progress: Called with how many runs are done, and how many there are.
    """
    folder = Path(out)
    with writing(folder):
        (folder / "gallery").mkdir(parents=True, exist_ok=True)
    shipped = shipped_scenarios()
    names = [name for name, (file, _) in shipped.items() if file.stem in _FILES]
    done = 0

    def on_done() -> None:
        nonlocal done
        done += 1
        on_progress(done, len(names))

    draw = functools.partial(_exhibit, folder=folder / "gallery")
    exhibits = {e.name: e for e in in_processes(draw, names, on_done=on_done)}
    lines = [
        "# Gallery",
        "",
        "Pictures and numbers are made by `drake-pregrasp study gallery`; each row shows a shipped"
        " scenario at its start, half-way and at its end, seen from one place in the world. Regions"
        " have their contact's colour, grey ground is nobody's. `drake-pregrasp run NAME` leaves a"
        " recording of it.",
    ]
    for stem in _FILES:
        lines += ["", f"## {_TITLES[stem]}"]
        for name, (file, description) in shipped.items():
            if file.stem == stem:
                lines += _entry(exhibits[name], description)
    write_text(folder / _PAGE, "\n".join(lines) + "\n")
    return folder / _PAGE


def _entry(exhibit: Exhibit, description: str) -> list[str]:
    static = "—" if exhibit.static is None else f"{exhibit.static:.4f}"
    numbers = (
        f"Q_MSV {static} static, {exhibit.final:.4f} at the end;"
        f" force-closure margin {exhibit.margin:.2f} at the end."
    )
    limited = f" Limited: {'; '.join(exhibit.limited)}." if exhibit.limited else ""
    return [
        "",
        f"### `{exhibit.name}`: {description}",
        "",
        f"![{description}](gallery/{exhibit.name}.png)",
        "",
        numbers + limited,
    ]


def _exhibit(name: str, folder: Path) -> Exhibit:
    scenario = load_scenario(name)
    surface = scenario.make_surface()
    records: list[TickRecord] = []
    with TemporaryDirectory() as runs:
        summary = run(
            scenario, name=name, out=runs, recording=False, on_tick=records.append
        ).summary
    frames = []
    for share in MOMENTS:
        record = records[round(share * (len(records) - 1))]
        X_OW = record.X_WO_estimated.inverse()
        active = np.flatnonzero(is_active(record.contact_status))
        p_OC: FloatArray = (X_OW @ record.p_WC[active].T).T
        obstacles = [
            m.solid.moved(np.eye(3), record.time * m.velocity).moved(
                X_OW.rotation().matrix(), X_OW.translation()
            )
            for m in map(moving_solid, scenario.obstacles)
        ]
        along = X_OW.rotation() @ np.array([np.cos(VIEW_YAW), np.sin(VIEW_YAW), 0.0])
        frames.append(
            render_goals(
                surface,
                record.regions.labels,
                p_OC,
                active.tolist(),
                yaw=float(np.arctan2(along[1], along[0])),
                obstacles=obstacles,
                pixels=_PIXELS,
            )
        )
    with writing(folder):
        picture = Image.fromarray(np.concatenate(frames, axis=1))
        picture.save(folder / f"{name}.png", optimize=True)
    return Exhibit(
        name,
        summary["static"]["q_msv"],
        summary["final"]["q_msv"],
        summary["force_closure_margin"]["final"],
        limits_in_words(records, scenario.obstacle_names),
    )


def limits_in_words(records: Sequence[TickRecord], obstacle_names: Mapping[int, str]) -> list[str]:
    """Returns what has limited contacts, in the order in which it first did, and how often.

    Args:
        records: Of all ticks of a run.
        obstacle_names: What obstacles are called, by their index, that have a name.
    """
    counts = Counter(
        f"contact {contact} {describe_status(status, cause, obstacle_names)}"
        for record in records
        for contact, (status, cause) in enumerate(
            zip(record.contact_status, record.contact_causes, strict=True)
        )
        if status != ContactStatus.ACTIVE
    )
    return [f"{text} ({count / len(records):.0%} of the ticks)" for text, count in counts.items()]
