"""Validity and quality of contacts on ten shapes."""

import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import trimesh

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.goal_limits import ROUNDING, tip_gaps
from drake_pregrasp.geometry.surface import CONTACT_TOLERANCE, ObjectSurface
from drake_pregrasp.quality.force_closure import min_weight_margin
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.regions.constraints import OPPOSITE
from drake_pregrasp.simulation.output import make_folder
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.run import run
from drake_pregrasp.simulation.scenario_file import load_resolved
from drake_pregrasp.studies.report_page import Part, Table, write_report
from drake_pregrasp.studies.runner import OnProgress, run_jobs
from drake_pregrasp.systems.loggers import TickRecord

SHIPPED = ("box", "can", "ball", "bowling_pin", "mug", "bracket")
"""Shipped scenarios that are part of the study."""

FRICTION = 0.7
"""Coulomb friction coefficient of the margins."""

_WORST = {
    "ticks": "sum",
    "off the mesh [mm]": "max",
    "not allowed": "sum",
    "overlaps": "sum",
    "crossings": "sum",
    "Q_MSV static": "min",
    "Q_MSV final": "min",
    "margin static": "min",
    "margin final": "min",
    "worse": "sum",
}
"""Columns of the report, and their aggregation over the seeds."""


def unseen_meshes() -> dict[str, trimesh.Trimesh]:
    """Returns the meshes that no shipped scenario uses, in metres, by name."""
    directions = np.random.default_rng(0).normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return {
        "capsule": trimesh.creation.capsule(height=0.07, radius=0.025, count=(32, 32)),
        "cone": trimesh.creation.cone(radius=0.045, height=0.11, sections=64),
        "tube": trimesh.creation.annulus(r_min=0.036, r_max=0.04, height=0.09, sections=64),
        "stone": trimesh.convex.convex_hull(directions * [0.05, 0.04, 0.06]),
    }


def study_shapes(
    out: str | Path,
    *,
    seeds: Sequence[int] = (0, 1, 2),
    duration: float = 8.0,
    on_progress: OnProgress = lambda done, total: None,
) -> Path:
    """Runs all shapes, and returns the path of the report.

    Args:
        out: Folder of the report.
        seeds: Seeds of the measurement noise and of the surface's sampling.
        duration: Simulated seconds of each run.
        on_progress: Called with the number of finished runs and the number of all runs.
    """
    make_folder(Path(out))
    shapes = [*SHIPPED, *unseen_meshes()]
    jobs = [{"shape": shape, "seed": seed} for shape in shapes for seed in seeds]
    rows = run_jobs(
        functools.partial(run_shape, duration=duration), jobs, on_progress=on_progress
    ).rows
    table = rows.groupby("shape").agg(_WORST).loc[shapes]
    digits = {"off": "{:.1e}", "Q_MSV": "{:.4f}", "margin": "{:.2f}"}
    for name in table:
        table[name] = table[name].map(digits.get(name.split()[0], "{}").format)
    parts: list[Part] = [
        "`drake-pregrasp study shapes` makes this page, in some three minutes on two cores. Each"
        f" shape has five contacts with fingertips of 18 mm and measurement noise, in {len(seeds)}"
        f" runs of {duration:g} s with different seeds of the noise and of the surface's sampling."
        " The last four shapes are meshes that no shipped scenario has.",
        "Values are the worst of the runs, and numbers of ticks in all of them. *Not allowed*"
        ": an active contact was on forbidden surface. *Overlaps*: two fingertips"
        " overlapped. *Crossings*: a contact went through a wall since it was last active. *Worse*:"
        f" runs whose final Q_MSV is below their static one. Margins are at friction {FRICTION}.",
        Table(table.reset_index()),
    ]
    return write_report(Path(out), "Ten shapes", parts, name="shapes", formats=("md",))


def run_shape(job: Mapping[str, Any], *, duration: float) -> dict[str, float]:
    """Simulates a shape, and returns its row of the report from every tick.

    Args:
        job: A `shape`, one of `SHIPPED` or `unseen_meshes`, and a `seed`.
        duration: Simulated time in seconds.
    """
    shape, seed, records = job["shape"], job["seed"], list[TickRecord]()
    text = f"simulation_duration: {duration}\nrandom_seed: {seed}\nsurface: {{seed: {seed}}}\n"
    with TemporaryDirectory() as folder:
        if shape in SHIPPED:
            resolved = load_resolved(shape, text=text)
        else:
            file = Path(folder) / f"{shape}.stl"
            unseen_meshes()[shape].export(file)
            text += f"object: !Mesh {{file: {file}, mass: 0.3}}\n"  # Other keys: the can's.
            resolved = load_resolved("can", text=text, folders=[Path(folder)])
        run(resolved, name=shape, out=folder, recording=False, on_tick=records.append)
        return _row(resolved, records)


def _row(resolved: ResolvedScenario, records: Sequence[TickRecord]) -> dict[str, float]:
    scenario, surface = resolved.scenario, resolved.surface
    tip_radii = np.array(scenario.planner.limits.tip_radii)
    off_mesh, counts = 0.0, np.zeros(3, dtype=int)
    last_normals: dict[int, FloatArray] = {}
    for record in records:
        contacts, p_OC = record.active_contacts()
        nearest, normals = surface.project(p_OC)
        off_mesh = max(off_mesh, float(np.max(np.abs(surface.distance(p_OC)), initial=0.0)))
        now = dict(zip(contacts.tolist(), normals, strict=True))
        counts += (
            np.any(np.linalg.norm(nearest - p_OC, axis=1) > CONTACT_TOLERANCE),
            np.any(tip_gaps(p_OC, normals, tip_radii[contacts]) < -2 * ROUNDING),
            any(now[i] @ last_normals[i] < OPPOSITE for i in now.keys() & last_normals.keys()),
        )
        last_normals |= now
    static = [record for record in records if record.time < scenario.planner.static_duration][-1]
    (msv_static, margin_static), (msv_final, margin_final) = (
        _quality(surface, record) for record in (static, records[-1])
    )
    off_mesh_mm = 1e3 * off_mesh
    values = (len(records), off_mesh_mm, *counts.tolist(), msv_static, msv_final)
    values += (margin_static, margin_final, int(msv_final < msv_static))
    return dict(zip(_WORST, values, strict=True))


def _quality(surface: ObjectSurface, record: TickRecord) -> tuple[float, float]:
    """Returns Q_MSV and the force-closure margin of the active contacts in the estimated O."""
    _, p_OC = record.active_contacts()
    r = p_OC - surface.p_OCoM
    return grasp_quality(r).q_msv, min_weight_margin(r, surface.project(p_OC)[1], FRICTION)
