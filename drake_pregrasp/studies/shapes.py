"""Whether contacts stay where they may be, on ten shapes: a study with a table."""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import trimesh

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.goal_limits import ROUNDING, tip_gaps
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.geometry.surface import CONTACT_TOLERANCE, ObjectSurface
from drake_pregrasp.quality.force_closure import min_weight_margin
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.regions.constraints import OPPOSITE
from drake_pregrasp.simulation.output import write_text, writing
from drake_pregrasp.simulation.run import run
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_scenario
from drake_pregrasp.studies.processes import in_processes
from drake_pregrasp.systems.loggers import TickRecord

SHIPPED = ("box", "can", "ball", "bowling_pin", "mug", "bracket")
"""Scenarios that are part of the study."""

FRICTION = 0.7
"""Coulomb's coefficient of the margins."""

_COLUMNS = (
    "shape",
    "ticks",
    "worst off the mesh [mm]",
    "ticks on forbidden ground",
    "overlaps",
    "crossings",
    "Q_MSV static",
    "Q_MSV final",
    "margin static",
    "margin final",
)


class ShapeResult(NamedTuple):
    """What became of the contacts on one shape, over all seeds.

    Attributes:
        name: Of the shape.
        ticks: How many were looked at.
        off_mesh: Farthest that an active contact was off the mesh, in metres.
        forbidden: At how many ticks one was off the allowed ground.
        overlaps: At how many ticks two fingertips overlapped.
        crossings: At how many ticks one had gone to the other side of a wall since it was last
            active.
        q_msv: Least over the seeds of the static and of the final Q_MSV, in O as it is estimated.
        margin: The same of the force-closure margin.
        worse: How many seeds ended with a Q_MSV below their static one.
    """

    name: str
    ticks: int
    off_mesh: float
    forbidden: int
    overlaps: int
    crossings: int
    q_msv: tuple[float, float]
    margin: tuple[float, float]
    worse: int


def unseen_meshes() -> dict[str, trimesh.Trimesh]:
    """Returns meshes that no scenario has, by their names, in metres."""
    capsule = trimesh.creation.capsule(height=0.07, radius=0.025, count=(32, 32))
    cone = trimesh.creation.cone(radius=0.045, height=0.11, sections=64)
    tube = trimesh.creation.annulus(r_min=0.036, r_max=0.04, height=0.09, sections=64)
    generator = np.random.default_rng(0)
    directions = generator.normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    stone = trimesh.convex.convex_hull(directions * [0.05, 0.04, 0.06])
    return {"capsule": capsule, "cone": cone, "tube": tube, "stone": stone}


def study_shapes(
    out: str | Path,
    *,
    seeds: Sequence[int] = (0, 1, 2),
    duration: float = 8.0,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Runs all shapes, and returns the path of the report.

    Args:
        out: Folder of the report.
        seeds: Of the measurement noise, and of the surface's sampling.
        duration: Of a run, in seconds.
        on_progress: Called with how many shapes are done, and how many there are.
    """
    report = Path(out) / "shapes.md"
    with writing(report.parent):
        report.parent.mkdir(parents=True, exist_ok=True)
    names = [*SHIPPED, *unseen_meshes()]
    done = 0

    def on_done() -> None:
        nonlocal done
        done += 1
        on_progress(done, len(names))

    job = functools.partial(shape_result, seeds=seeds, duration=duration)
    results = in_processes(job, names, on_done=on_done)
    write_text(report, _report(results, seeds, duration))
    return report


def shape_result(name: str, *, seeds: Sequence[int], duration: float) -> ShapeResult:
    """Runs one shape with each seed, and looks at every tick.

    Args:
        name: Out of `SHIPPED` and `unseen_meshes`.
        seeds: Of the measurement noise, and of the surface's sampling.
        duration: Of a run, in seconds.
    """
    parts = []
    for seed in seeds:
        with TemporaryDirectory() as folder:
            scenario = _scenario(name, seed, duration, Path(folder))
            records: list[TickRecord] = []
            run(scenario, name=name, out=folder, recording=False, on_tick=records.append)
            parts.append(_look_at(name, scenario, scenario.make_surface(), records))
    return ShapeResult(
        name,
        ticks=sum(part.ticks for part in parts),
        off_mesh=max(part.off_mesh for part in parts),
        forbidden=sum(part.forbidden for part in parts),
        overlaps=sum(part.overlaps for part in parts),
        crossings=sum(part.crossings for part in parts),
        q_msv=(min(part.q_msv[0] for part in parts), min(part.q_msv[1] for part in parts)),
        margin=(min(part.margin[0] for part in parts), min(part.margin[1] for part in parts)),
        worse=sum(part.worse for part in parts),
    )


def _scenario(name: str, seed: int, duration: float, folder: Path) -> Scenario:
    text = f"simulation_duration: {duration}\nrandom_seed: {seed}\nsurface: {{seed: {seed}}}\n"
    if name in SHIPPED:
        return load_scenario(name, text=text)
    file = folder / f"{name}.stl"
    unseen_meshes()[name].export(file)
    # All but the object is as for the can.
    text += f"object: !Mesh {{file: {file}, mass: 0.3}}\n"
    return load_scenario("can", text=text, folders=[folder])


def _look_at(
    name: str, scenario: Scenario, surface: ObjectSurface, records: list[TickRecord]
) -> ShapeResult:
    tip_radii = np.array(scenario.planner.limits.tip_radii)
    off_mesh, forbidden, overlaps, crossings = 0.0, 0, 0, 0
    normals_before: dict[int, FloatArray] = {}
    for record in records:
        contacts, p_OC = _active(record)
        nearest, normals = surface.project(p_OC)
        off_mesh = max(off_mesh, float(np.max(np.abs(surface.distance(p_OC)), initial=0.0)))
        off_ground = np.linalg.norm(nearest - p_OC, axis=1)
        forbidden += bool(np.any(off_ground > CONTACT_TOLERANCE))
        overlaps += bool(np.any(tip_gaps(p_OC, normals, tip_radii[contacts]) < -2 * ROUNDING))
        now = dict(zip(contacts, normals, strict=True))
        crossings += any(
            contact in normals_before and normal @ normals_before[contact] < OPPOSITE
            for contact, normal in now.items()
        )
        normals_before |= now  # Those that are inactive for a while are still to come back.
    static_ticks = [r for r in records if r.time < scenario.planner.static_duration]
    (msv_static, margin_static), (msv_final, margin_final) = (
        _quality(surface, r) for r in (static_ticks[-1], records[-1])
    )
    return ShapeResult(
        name,
        len(records),
        off_mesh,
        forbidden,
        overlaps,
        crossings,
        (msv_static, msv_final),
        (margin_static, margin_final),
        worse=int(msv_final < msv_static),
    )


def _active(record: TickRecord) -> tuple[list[int], FloatArray]:
    active = np.flatnonzero(is_active(record.contact_status))
    p_OC: FloatArray = (record.X_WO_estimated.inverse() @ record.p_WC[active].T).T
    return active.tolist(), p_OC


def _quality(surface: ObjectSurface, record: TickRecord) -> tuple[float, float]:
    _, p_OC = _active(record)
    r = p_OC - surface.p_OCoM
    return grasp_quality(r).q_msv, min_weight_margin(r, surface.project(p_OC)[1], FRICTION)


def _report(results: Sequence[ShapeResult], seeds: Sequence[int], duration: float) -> str:
    closed = sum(result.margin[1] > 0 for result in results)
    rows = [
        f"| {r.name} | {r.ticks} | {1e3 * r.off_mesh:.1e} | {r.forbidden} | {r.overlaps}"
        f" | {r.crossings} | {r.q_msv[0]:.4f} | {r.q_msv[1]:.4f} | {r.margin[0]:.2f}"
        f" | {r.margin[1]:.2f} |"
        for r in results
    ]
    lines = [
        "# Ten shapes",
        "",
        "Made by `drake-pregrasp study shapes`: five contacts with fingertips of 18 mm, noise on,"
        f" {len(seeds)} seeds of {duration:g} s each; worst values over the seeds, friction"
        f" {FRICTION}. Seeds are of the noise and of the surface's sampling. The last four shapes"
        " are meshes that no shipped scenario has. It takes some three minutes on two cores.",
        "",
        "| " + " | ".join(_COLUMNS) + " |",
        "|---" * len(_COLUMNS) + "|",
        *rows,
        "",
        f"Runs that end with a lower Q_MSV than their static contacts have:"
        f" {sum(r.worse for r in results)} of {len(results) * len(seeds)}. Shapes that end"
        f" force-closed with every seed: {closed} of {len(results)}.",
    ]
    return "\n".join(lines) + "\n"
