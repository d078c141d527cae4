"""Figure of one seed: rendered pictures of trials."""

import functools
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import trimesh
from matplotlib.figure import Figure
from matplotlib.image import imread, imsave
from pydrake.geometry import Rgba, Shape
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.simulation.output import writing
from drake_pregrasp.studies import pictures
from drake_pregrasp.studies.report_page import Heading, Part, Picture
from drake_pregrasp.studies.runner import OnProgress, StudyRows, run_jobs
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.grasp_outcome import TrialJob
from drake_pregrasp.studies.static_versus_dynamic.methods import METHODS
from drake_pregrasp.studies.static_versus_dynamic.trial import Trial, make_trial
from drake_pregrasp.systems.drawing import VOLUME_COLOR, contact_color, drawn_solid

PICTURES = "pictures.png"  # File of the figure.

HEADLINE = "headline"  # Condition of the figure.

PICTURED = ("fixed_plan", "stationary", "dynamic_reach")  # Methods with a row of pictures.

# Times of the pictures before the grasp, in seconds. The hand closes at the last one.
MOMENTS = (0.5, 4.0, 8.0)

# Camera of the pictures.
CAMERA = pictures.color_camera((600, 630), 0.55)
_TARGET = np.array([0.0, 0.0, 0.14])  # Camera's target from the turntable's centre.
_P_TK = np.array([0.514, -0.514, 0.222])  # Camera from its target, in metres.
_LIGHTS = (
    pictures.Light([0.0, 0.1, 1.0], 0.75),
    pictures.Light([0.9, 0.2, 0.4], 0.3),
    pictures.Light([-0.9, 0.2, 0.4], 0.45),
    pictures.Light([0.1, 0.1, -1.0], 0.4, "world"),
)
_DOT = (0.0, 0.0017, 4e-4, 10)  # Two radii and height in metres, number of corners.
_RING = (0.0055, 0.008, 1.2e-3, 36)
_PICTURES_TEXT = (
    "Brown: the wall. Rings: contacts of active fingers if the hand"
    " closed now. Dots, in the colours of the fingertips: safe regions of methods that plan anew."
)


def figures_of_one_seed(
    folder: Path, rows: pd.DataFrame, processes: int | None, on_progress: OnProgress
) -> list[Part]:
    """Makes the figure in the study's folder, and returns it as parts of the report.

    There is no figure unless some seed of the headline condition has all pictured methods.

    Args:
        folder: Folder of the study.
        rows: Rows of the study.
        processes: Number of local processes; the number of processors if not set.
        on_progress: Called with the number of finished trials of the figure and the number of all.

    Raises:
        OutputError: If a file cannot be read or written.
    """
    closed = rows[(rows["condition"] == HEADLINE) & (rows["close_at"] == MOMENTS[-1])]
    pictured = closed[closed["method"].isin(PICTURED)]
    seed, rule = representative_seed(pictured)
    if seed is None:
        return []
    shown = pictured[pictured["seed"] == seed]
    simulate = functools.partial(run_jobs, processes=processes, on_progress=on_progress)
    make_pictures(folder / PICTURES, shown, MOMENTS, simulate)
    return [
        Heading(f"{CONDITIONS[HEADLINE].label.capitalize()}: one seed"),
        Picture(folder / PICTURES, f"{rule} {_PICTURES_TEXT}"),
    ]


def representative_seed(closed: pd.DataFrame) -> tuple[int | None, str]:
    """Returns the first seed whose grasps have the majority's outcome for the most methods.

    Args:
        closed: Rows of one condition and closing time, with the methods to compare.

    Returns:
        The seed, or None if no seed has all methods; and the selection rule, for a caption.
    """
    clean = closed.pivot(index="seed", columns="method", values="clean")
    usual = 2 * clean.sum() >= clean.count()
    clean = clean.dropna().sort_index()
    if clean.empty:
        return None, ""
    typical = (clean.astype(bool) == usual).sum(axis="columns")
    seed, most = int(typical.idxmax()), typical.max()
    return seed, (
        f"Seed {seed} is the first of {len(clean)} for which, in {most} of {clean.shape[1]} rows"
        f" and in no seed in more, the grasp closed at {MOMENTS[-1]:g} s is clean, or is not, as"
        " most of that method's grasps at that time."
    )


def make_pictures(
    path: Path,
    outcomes: pd.DataFrame,
    moments: tuple[float, ...],
    simulate: Callable[..., StudyRows] = run_jobs,
) -> None:
    """Writes a grid of pictures: a row for each method, a column for each moment and the end.

    Args:
        path: Path of the PNG to write.
        outcomes: Rows of the grasps, one for each method.
        moments: Times of the pictures before the grasp, in seconds, at ticks of the planner. The
            hand closes at the last one.
        simulate: Function that runs another function for jobs, like `run_jobs`.
    """
    shown = []
    rows = {row.method: row for row in outcomes.itertuples()}
    for method, row in ((key, rows[key]) for key in METHODS if key in rows):
        text = f"clean grasp with {row.fingers} fingers" if row.clean else row.gave_up
        job = TrialJob(row.condition, method, int(row.seed))
        shown.append(Grasp(job, METHODS[method].label, text or "not clean"))
    picture_grid(path, shown, moments, make_trial, simulate)


class Grasp(NamedTuple):
    """A pictured grasp.

    Attributes:
        job: Job of its trial.
        label: Text beside its pictures.
        text: Text under the last picture.
    """

    job: Any
    label: str
    text: str


def picture_grid(
    path: Path,
    grasps: Sequence[Grasp],
    moments: tuple[float, ...],
    make: Callable[[Any], Trial],
    simulate: Callable[..., StudyRows] = run_jobs,
) -> None:
    """Writes a grid of pictures: a row for each grasp, a column for each moment and the end.

    Args:
        path: Path of the PNG to write.
        grasps: The grasps.
        moments: Times of the pictures before the grasp, as for `make_pictures`.
        make: Function that returns the trial of a job.
        simulate: Function that runs another function for jobs, like `run_jobs`.
    """
    titles = [*(f"t = {moment:g} s" for moment in moments), "end of the grasp"]
    figure = Figure((0.6 + 3 * len(titles), 0.3 + 3.6 * len(grasps)), layout="constrained")
    axes = figure.subplots(len(grasps), len(titles), squeeze=False)
    with TemporaryDirectory() as folder, writing(path):
        take = functools.partial(_take_pictures, Path(folder), moments, make)
        jobs = [{"place": place, "job": grasp.job} for place, grasp in enumerate(grasps)]
        taken = simulate(take, jobs).rows
        for place, (grasp, of_row) in enumerate(zip(grasps, axes, strict=True)):
            own = taken[taken["place"] == place].itertuples()
            for axis, title, picture in zip(of_row, titles, own, strict=True):
                axis.imshow(imread(picture.file))
                axis.set(xticks=[], yticks=[], title=title if place == 0 else "")
                axis.set_xlabel(f"{picture.active} of {picture.fingers} fingers active")
            of_row[0].set_ylabel(grasp.label)
            of_row[-1].set_xlabel(textwrap.fill(grasp.text, 34), parse_math=False)
        figure.savefig(path, dpi=130)


def _take_pictures(
    folder: Path, moments: tuple[float, ...], make: Callable[[Any], Trial], job: Mapping[str, Any]
) -> list[dict[str, object]]:
    """Takes the pictures of a trial, and returns their files and numbers of active fingers."""
    rows: list[dict[str, object]] = []
    trial = make(job["job"])
    for moment in (*moments, None):
        if moment is None:
            trial.grasp(moments[-1])
        else:
            trial.track(moment)
        file = folder / f"{job['place']}_{len(rows)}.png"
        imsave(file, photograph(trial, annotate=moment is not None))
        last = trial.samples[-1]
        rows.append({"file": str(file), "active": last.active, "fingers": len(last.status)})
    return rows


def photograph(trial: Trial, *, annotate: bool) -> pictures.ByteArray:
    """Returns a picture of a trial at its present time, shape (height, width, 3).

    All geometry is added to a copy of the trial's context, so the trial is not changed.

    Args:
        trial: Trial to picture.
        annotate: Whether to draw a black ring at the contact of each active finger, and the safe
            regions of methods that plan at every tick as dots.
    """
    context = trial.context.Clone()
    plant, scene = trial.station.plant, trial.station.scene_graph
    scene_context = scene.GetMyMutableContextFromRoot(context)
    for index, (X_WS, shape, color) in enumerate(_shapes(trial, context, annotate=annotate)):
        instance = pictures.coloured(X_WS, shape, color, f"drawn_{index}")
        frame = scene.world_frame_id()
        scene.RegisterGeometry(scene_context, plant.get_source_id(), frame, instance)
    scene.AddRenderer(scene_context, pictures.RENDERER, pictures.lit_renderer(_LIGHTS))
    # Setting the positions makes Drake compute the poses of the added geometry.
    plant_context = plant.GetMyMutableContextFromRoot(context)
    plant.SetPositions(plant_context, plant.GetPositions(plant_context))
    query = scene.get_query_output_port().Eval(scene_context)
    return pictures.take_picture(query, CAMERA, camera_over(trial))


def camera_over(trial: Trial) -> RigidTransform:
    """Returns X_WK of the camera K, which translates with the turntable but does not turn."""
    return pictures.camera_pose(
        _pose(trial, trial.context, "turntable").translation() + _TARGET, _P_TK
    )


def closing_contacts(trial: Trial) -> list[RigidTransform]:
    """Returns X_WC of the contacts C of active fingers if the hand closed now, z outward."""
    context = trial.context.Clone()
    trial.command(context, context.get_time())
    own = trial.goals.GetMyContextFromRoot(context)
    active = is_active(np.asarray(trial.goals.GetOutputPort("contact_status").Eval(own)))
    targets = trial.goals.GetOutputPort("fingertip_targets").Eval(own)
    outward = RigidTransform(RotationMatrix.MakeXRotation(np.pi))
    frames = np.array(trial.hand.kinematics.tip_frames)[active]
    return [targets.Find(frame) @ outward for frame in frames]


def _shapes(
    trial: Trial, context: Context, *, annotate: bool
) -> Iterator[tuple[RigidTransform, Shape, Rgba]]:
    """Yields the drawn shapes besides the simulated geometry: X_WS, the shape S, its colour."""
    for volume in trial.resolved.no_touch_volumes:
        shape, X_WS = drawn_solid(volume.at(context.get_time()))
        yield X_WS, shape, VOLUME_COLOR
    if not annotate:
        return
    if X_WC := closing_contacts(trial):
        yield RigidTransform(), pictures.drawn_mesh(_rings(X_WC, *_RING)), Rgba(0, 0, 0)
    if trial.method.replans:
        port, surface = trial.planner.GetOutputPort("safe_regions"), trial.surface
        labels = port.Eval(trial.planner.GetMyContextFromRoot(context)).labels
        for finger in set(labels[labels >= 0].tolist()):
            X_OQ = [
                RigidTransform(RotationMatrix.MakeFromOneVector(surface.nhat_OQ[k], 2), p_OQ)
                for k, p_OQ in enumerate(surface.p_OQ)
                if labels[k] == finger
            ]
            dots = pictures.drawn_mesh(_rings(X_OQ, *_DOT))
            yield _pose(trial, context, "object"), dots, contact_color(finger)


def _rings(
    X_FR: list[RigidTransform], inner: float, outer: float, height: float, sections: int
) -> FloatArray:
    """Returns flat rings at a height over the xy-planes of frames R, shape (k, 3, 3)."""
    ring = trimesh.creation.annulus(inner, outer, height=2 * height, sections=sections)
    flat = ring.triangles[ring.face_normals[:, 2] > 0.9]
    return np.concatenate([X.translation() + flat @ X.rotation().matrix().T for X in X_FR])


def _pose(trial: Trial, context: Context, body: str) -> RigidTransform:
    plant = trial.station.plant
    of_body = plant.GetBodyByName(body)
    return of_body.EvalPoseInWorld(plant.GetMyContextFromRoot(context))
