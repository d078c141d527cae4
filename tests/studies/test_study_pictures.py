"""What the study's report shows of trials, and how the seed it shows is chosen."""

import dataclasses
import functools
import json

import numpy as np
import pytest
from drake_pregrasp.studies.drawn_mesh import camera_pose
from hypothesis import given
from hypothesis import strategies as st
from made_up_trials import at_once, made_up_strip, made_up_trial
from matplotlib.image import imread, imsave
from pydrake.geometry import (
    GeometryInstance,
    MakeRenderEngineVtk,
    PerceptionProperties,
    RenderEngineVtkParams,
    Rgba,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.sampling import unit_normals
from drake_pregrasp.simulation.output import without_solver_chatter
from drake_pregrasp.studies import processes
from drake_pregrasp.studies.static_versus_dynamic import closings, figures, picture_figure, trials
from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS
from drake_pregrasp.studies.static_versus_dynamic.closings import CLOSINGS, strips_of
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.experiment import Experiment, ReportFigure
from drake_pregrasp.studies.static_versus_dynamic.marks import ring_triangles
from drake_pregrasp.studies.static_versus_dynamic.outcome import TrialJob
from drake_pregrasp.studies.static_versus_dynamic.photograph import (
    CAMERA,
    camera_over,
    photograph,
    shown_goals,
)
from drake_pregrasp.studies.static_versus_dynamic.picture_figure import (
    PICTURES,
    in_few_words,
    make_pictures,
)
from drake_pregrasp.studies.static_versus_dynamic.report import REPORT
from drake_pregrasp.studies.static_versus_dynamic.representative import representative_seed
from drake_pregrasp.studies.static_versus_dynamic.study import (
    NAME,
    study_static_versus_dynamic,
    trial_jobs,
)
from drake_pregrasp.studies.static_versus_dynamic.trial import Trial
from drake_pregrasp.systems.drawing import contact_color

(SOME, *_) = made_up_trial(TrialJob("headline", "still", 0))
CLEAN = dataclasses.replace(
    SOME,
    lifted=True,
    level=True,
    pushed_before_mm=0.0,
    turned_before_deg=0.0,
    pushed_closing_mm=0.0,
    slip_mm=0.1,
    tilt_deg=0.0,
    gave_up="",
)


def grasp(arm, seed, clean, close_at=8.0):
    return dataclasses.replace(CLEAN, arm=arm, seed=seed, close_at=close_at, lifted=clean)


def grasps(conditions, arms, seeds):
    return [o for job in trial_jobs(conditions, arms, seeds) for o in made_up_trial(job)]


@given(st.dictionaries(st.integers(0, 9), st.tuples(st.booleans(), st.booleans()), min_size=1))
def test_the_seed_is_the_first_that_stands_for_the_most_arms(clean):
    arms = ("frozen", "still")
    rows = [grasp(arm, seed, of[k]) for seed, of in clean.items() for k, arm in enumerate(arms)]
    distractors = [
        grasp("still", 50, True, close_at=4.0),
        grasp("world", 0, True),
        dataclasses.replace(grasp("still", 1, True), condition="wall"),
    ]
    chosen = representative_seed([*rows[::-1], *distractors], "headline", arms, 8.0)
    usual = [2 * sum(of[k] for of in clean.values()) >= len(clean) for k in range(2)]
    typical = {seed: sum(np.equal(of, usual)) for seed, of in clean.items()}
    assert chosen.typical == typical[chosen.seed] == max(typical.values())
    assert all(count < chosen.typical for seed, count in typical.items() if seed < chosen.seed)
    assert (chosen.arms, chosen.seeds) == (2, len(clean))


def test_only_a_seed_of_all_arms_is_chosen():
    rows = [grasp("still", 0, True), grasp("still", 3, False), grasp("frozen", 3, False)]
    assert representative_seed(rows, "headline", ["frozen", "still"], 8.0).seed == 3
    assert representative_seed(rows[:1], "headline", ["frozen", "still"], 8.0) is None
    assert representative_seed(rows, "headline", [], 8.0) is None


def test_words_below_a_picture_say_what_a_grasp_lacks():
    for change, words in (
        ({}, "clean grasp with"),
        ({"lifted": False}, "not lifted"),
        ({"lifted": False, "gave_up": "why"}, "gave up: why"),
        ({"pushed_before_mm": 65.2}, "lifted, but pushed 65 mm"),
        ({"turned_before_deg": 7.0}, "lifted, but turned 7°"),
        ({"pushed_closing_mm": 6.0}, "lifted, but pushed 6 mm in closing"),
        ({"level": False, "tilt_deg": 31.0}, "lifted, but tilted 31°"),
        ({"slip_mm": 8.0}, "lifted, but slipped 8 mm"),
        ({"slip_mm": np.nan}, "lifted, but not clean"),
    ):
        outcome = dataclasses.replace(CLEAN, **change)
        assert in_few_words(outcome).startswith(words)
        assert outcome.clean == ("clean grasp" in words)


@given(st.integers(0, 100), st.integers(3, 40), st.sampled_from([0.0, 0.3]))
def test_marks_are_flat_rings_that_face_outward(seed, sides, inner):
    rng = np.random.default_rng(seed)
    points, normals = rng.normal(size=(2, 3, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[0] = [0, 0, 1]
    triangles = ring_triangles(points, normals, radii=(inner, 0.5), sides=sides)
    crosses = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    polygon = sides / 2 * np.sin(2 * np.pi / sides)
    area = 3 * polygon * (0.5**2 - inner**2)
    np.testing.assert_allclose(np.linalg.norm(crosses, axis=1).sum() / 2, area)
    for point, normal in zip(points, normals, strict=True):
        mine = np.all(np.linalg.norm(triangles - point, axis=2) < 0.51, axis=1)
        own = triangles[mine & (np.abs((triangles[:, 0] - point) @ normal) < 1e-9)]
        assert len(own) >= sides * (2 if inner else 1)
    found = unit_normals(triangles)
    assert np.all(np.max(found @ normals.T, axis=1) > 1 - 1e-9)


def pixels_of(X_WK, p_WQ):
    """Returns where points are seen, shape (k, 2), by the equations of a pinhole camera."""
    info = CAMERA.core().intrinsics()
    p_KQ = (X_WK.inverse() @ np.atleast_2d(p_WQ).T).T
    centre, focal = [info.center_x(), info.center_y()], [info.focal_x(), info.focal_y()]
    return centre + np.array(focal) * p_KQ[:, :2] / p_KQ[:, 2:]


@pytest.mark.parametrize("p_WQ", [[0.0, 0.0, 0.0], [0.1, -0.05, 0.12], [-0.13, 0.07, 0.02]])
def test_the_camera_sees_a_ball_where_it_is(p_WQ):
    scene = SceneGraph()
    parameters = RenderEngineVtkParams(default_clear_color=[1.0, 1.0, 1.0])
    scene.AddRenderer(CAMERA.core().renderer_name(), MakeRenderEngineVtk(parameters))
    properties = PerceptionProperties()
    properties.AddProperty("phong", "diffuse", Rgba(0, 0, 0))
    ball = GeometryInstance(RigidTransform(p_WQ), Sphere(0.008), "ball")
    ball.set_perception_properties(properties)
    scene.RegisterAnchoredGeometry(scene.RegisterSource("test"), ball)
    X_WK = camera_pose(np.array([0.02, 0.01, 0.05]), np.array([0.5, -0.4, 0.3]))
    query = scene.get_query_output_port().Eval(scene.CreateDefaultContext())
    image = query.RenderColorImage(CAMERA, scene.world_frame_id(), X_WK).data
    dark = np.argwhere(image[:, :, 0] < 100)[:, ::-1]
    assert len(dark) > 50
    np.testing.assert_allclose(np.mean(dark, axis=0), pixels_of(X_WK, p_WQ)[0], atol=1.0)


@pytest.fixture(scope="module")
def tracking():
    """A trial on its way, before fingers come down."""
    with without_solver_chatter():
        trial = Trial(TrialJob("headline", "dynamic_reach", 0))
        trial.track(0.3)
    return trial


def likeness(pixels):
    """Returns how like colours are to those of the fingers, shape (k, 5): 1 if only lit else."""
    colors = [contact_color(finger) for finger in range(5)]
    hues = np.array([[color.r(), color.g(), color.b()] for color in colors])
    hues /= np.linalg.norm(hues, axis=1, keepdims=True)
    lengths = np.maximum(np.linalg.norm(pixels, axis=1, keepdims=True), 1)
    return pixels / lengths @ hues.T


def test_a_picture_shows_goals_and_regions_where_they_are(tracking):
    bare, marked = (photograph(tracking, marks=marks).astype(int) for marks in (False, True))
    X_WK = camera_over(tracking)
    points, normals = shown_goals(tracking)
    seen = np.sum((X_WK.translation() - points) * normals, axis=1) > 0.1
    assert seen.any()
    middles = pixels_of(X_WK, points[seen])
    black = np.argwhere((marked.max(axis=2) < 40) & (bare.min(axis=2) > 60))[:, ::-1]
    apart = np.linalg.norm(black[:, None] - middles, axis=2)
    assert np.all(apart.min(axis=1) < 20)
    assert np.all(apart.min(axis=0) < 12)
    hidden = pixels_of(X_WK, points[~seen])
    assert not len(hidden) or np.all(np.linalg.norm(black[:, None] - hidden, axis=2) > 3)
    changed = np.argwhere(np.abs(marked - bare).max(axis=2) > 0)[:, ::-1]
    context = tracking.parts.station.GetMyContextFromRoot(tracking.context)
    X_WO = tracking.parts.station.GetOutputPort("X_WO").Eval(context)
    of_object = pixels_of(X_WK, (X_WO @ tracking.surface.p_OQ.T).T)
    inside = (changed > of_object.min(axis=0) - 5) & (changed < of_object.max(axis=0) + 5)
    assert np.mean(inside.all(axis=1)) > 0.98  # All but the smoothing of some edges.
    planner, surface = tracking.parts.planner, tracking.surface
    port = planner.GetOutputPort("safe_regions")
    labels = port.Eval(planner.GetMyContextFromRoot(tracking.context)).labels
    p_WQ = (X_WO @ surface.p_OQ.T).T
    nhat_WQ = surface.nhat_OQ @ X_WO.rotation().matrix().T
    facing = np.sum((X_WK.translation() - p_WQ) * nhat_WQ, axis=1) > 0.2
    owned = facing & (labels >= 0)
    columns, rows = pixels_of(X_WK, p_WQ[owned]).round().astype(int).T
    found = likeness(marked[rows, columns])
    right = found[np.arange(len(found)), labels[owned]] > 0.97
    assert len(right) > 100
    assert np.mean(right & (np.argmax(found, axis=1) == labels[owned])) > 0.7  # Links hide some.


def test_a_picture_shows_the_hand_where_it_is(tracking):
    picture = photograph(tracking, marks=False).astype(float)
    plant = tracking.parts.station.plant
    context = plant.GetMyContextFromRoot(tracking.context)
    frames = [plant.GetFrameByName(f"finger_{finger}_tip") for finger in range(5)]
    p_WT = [frame.CalcPoseInWorld(context).translation() for frame in frames]
    pixels = pixels_of(camera_over(tracking), p_WT).round().astype(int)
    columns, rows = pixels.T
    own = np.diag(likeness(picture[rows, columns]))
    assert np.median(own) > 0.97  # Of most; links may be before some.


def test_a_picture_leaves_no_trace(tracking):
    before = tracking.context.Clone()
    photograph(tracking, marks=True)
    scene = tracking.parts.station.scene_graph
    assert scene.RendererCount(scene.GetMyContextFromRoot(tracking.context)) == 0
    assert tracking.context.get_time() == before.get_time()
    for index in range(before.num_discrete_state_groups()):
        np.testing.assert_array_equal(
            tracking.context.get_discrete_state(index).value(),
            before.get_discrete_state(index).value(),
        )
    assert tracking.parts.diagram.GetInputPort("close").Eval(tracking.context) == [0.0]


def test_the_grid_has_a_row_for_each_trial(tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "as_they_end", at_once)
    jobs = [TrialJob("headline", arm, 0) for arm in ("frozen", "still")]
    outcomes = {job: grasp(job.arm, 0, True, close_at=0.1) for job in jobs}
    path = make_pictures(tmp_path, outcomes, moments=(0.1,))
    assert path == tmp_path / PICTURES
    grid = imread(path)
    info = CAMERA.core().intrinsics()
    assert 0.8 < grid.shape[0] / grid.shape[1] * info.width() / info.height() < 1.2
    # One wall in each of the two rows and columns: what is much redder than green.
    red = grid[..., 0] - grid[..., 1] > 0.15
    half_height, half_width = np.array(red.shape) // 2
    for part in (red[:half_height], red[half_height:]):
        assert part[:, :half_width].sum() > 1000
        assert part[:, half_width:].sum() > 1000


def test_closings_on_the_way_change_nothing():
    job = TrialJob("headline", "dynamic_reach", 1)
    with without_solver_chatter():
        some, none = Trial(job), Trial(job)
        first, last = some.outcomes((0.2, 0.4))
        (alone,) = none.outcomes((0.4,))
    assert (first.close_at, last.close_at) == (0.2, 0.4)
    assert some.looks == none.looks
    assert repr(last) == repr(alone)  # In which nan is as nan is.


def test_what_is_kept_is_not_made_again(tmp_path, monkeypatch):
    folder, made = tmp_path / "study", tmp_path / "made"
    folder.mkdir()
    made.mkdir()
    jobs = [TrialJob("headline", arm, 3) for arm in ("still", "frozen")]
    make = functools.partial(made_up_strip, made)
    monkeypatch.setattr(closings, "as_they_end", at_once)
    made_now = strips_of(folder, jobs, make)
    again = strips_of(folder, jobs[::-1], make)[::-1]  # Making one twice raises.
    assert [strip.arm for strip in again] == ["still", "frozen"]
    for strip, other in zip(made_now, again, strict=True):
        for one, two in zip(strip, other, strict=True):
            np.testing.assert_array_equal(np.asarray(one), np.asarray(two))
    assert sorted(path.name for path in made.iterdir()) == ["frozen_3", "still_3"]
    kept = json.loads((folder / CLOSINGS).read_text())
    (folder / CLOSINGS).write_text(json.dumps({f"{key}0": strip for key, strip in kept.items()}))
    (made / "still_3").unlink()
    strips_of(folder, jobs[:1], make)
    assert (made / "still_3").exists()  # Of other settings is as not there.
    (folder / CLOSINGS).write_text('{"a": ')
    (made / "frozen_3").unlink()
    strips_of(folder, jobs[1:], make)
    assert (made / "frozen_3").exists()


@pytest.mark.parametrize(
    ("conditions", "arms", "seeds"),
    [(["nominal", "wall"], ARMS, 6), (["headline"], ["world", "carried"], 6), ([], [], 0)],
)
def test_without_the_headline_nothing_is_made(tmp_path, conditions, arms, seeds):
    assert figures.make_figures(tmp_path, grasps(conditions, arms, range(seeds))) == []
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("seeds", "arms"), [(2, ARMS), (6, ARMS), (6, ["world", "still"])])
def test_figures_are_of_the_arms_there_are(tmp_path, monkeypatch, seeds, arms):
    rows = grasps(CONDITIONS, arms, range(seeds))
    asked = {}

    def make_pictures(folder, outcomes, *, processes, on_progress):
        asked["pictures"], asked["processes"] = outcomes, [processes]
        for done in range(len(outcomes) + 1):
            on_progress(done, len(outcomes))
        return folder / "pictures.png"

    def strips(folder, jobs, *, processes, on_progress):
        asked["strips"] = jobs
        asked["processes"].append(processes)
        (folder / "made").mkdir()
        on_progress(0, len(jobs))
        on_progress(len(jobs), len(jobs))
        return [made_up_strip(folder / "made", job) for job in jobs]

    monkeypatch.setattr(figures, "make_pictures", make_pictures)
    monkeypatch.setattr(figures, "strips_of", strips)
    steps = []
    made = figures.make_figures(
        tmp_path, rows, processes=3, on_progress=lambda *step: steps.append(step)
    )
    assert set(asked["processes"]) == {3}
    assert steps == sorted(steps)
    assert steps[-1] == (len(asked["pictures"]) + len(asked.get("strips", [])),) * 2
    assert all(isinstance(figure, ReportFigure) for figure in made)
    shown = [arm for arm in figures.ROWS if arm in arms]
    assert [job.arm for job in asked["pictures"]] == shown
    assert all(o.job == job and o.close_at == 8.0 for job, o in asked["pictures"].items())
    (seed,) = {job.seed for job in asked["pictures"]}
    assert f"Seed {seed} is the first of {seeds}" in made[0].caption
    assert ("Dots" in made[0].caption) == ("dynamic_reach" in arms)
    assert ("strips" in asked) == (len(made) == 2) == (seeds >= figures.SEEDS_FOR_STRIPS)
    if "strips" in asked:
        assert asked["strips"] == [TrialJob("headline", a, seed) for a in ARMS if a in arms]
        assert made[1].path.exists()


def test_a_report_is_there_before_its_figures(tmp_path):
    def make_figures(folder, outcomes, **options):
        raise InvalidArgumentError("no picture")

    with pytest.raises(InvalidArgumentError, match="no picture"):
        study_static_versus_dynamic(tmp_path, Experiment(made_up_trial, {}, make_figures), [])
    assert (tmp_path / NAME / REPORT).exists()


def test_figures_are_made_with_the_processes_asked_for_and_the_bar_goes_on(tmp_path, monkeypatch):
    asked = {}

    def make_figures(folder, outcomes, *, processes, on_progress):
        asked["processes"] = processes
        on_progress(1, 2)
        on_progress(2, 2)
        return []

    monkeypatch.setattr(trials, "as_they_end", at_once)
    steps = []
    study_static_versus_dynamic(
        tmp_path,
        Experiment(made_up_trial, {}, make_figures),
        trial_jobs(["wall"], ["still", "frozen"], [0]),
        processes=3,
        on_progress=lambda *step: steps.append(step),
    )
    assert asked["processes"] == 3
    assert steps == [(0, 2), (1, 2), (2, 2), (3, 4), (4, 4)]


def test_processes_are_as_many_as_asked_for_wherever_figures_start_some(tmp_path, monkeypatch):
    asked = []

    def noted(function, jobs, *, processes):
        asked.append(processes)
        return at_once(function, jobs)

    monkeypatch.setattr(closings, "as_they_end", noted)
    monkeypatch.setattr(processes, "as_they_end", noted)
    monkeypatch.setattr(picture_figure, "_take", photographed)
    jobs = [TrialJob("headline", arm, 3) for arm in ("still", "frozen")]
    made = tmp_path / "made"
    made.mkdir()
    steps = []

    def on_progress(*step):
        steps.append(step)

    make = functools.partial(made_up_strip, made)
    strips_of(tmp_path, jobs, make, processes=2, on_progress=on_progress)
    strips_of(tmp_path, jobs, make, processes=2, on_progress=on_progress)
    outcomes = {job: grasp(job.arm, 3, True) for job in jobs}
    make_pictures(tmp_path, outcomes, moments=(0.1,), processes=4, on_progress=on_progress)
    assert asked == [2, 2, 4]
    assert steps == [(0, 2), (1, 2), (2, 2), (0, 0), (0, 2), (1, 2), (2, 2)]


def photographed(sitting):
    for file in sitting.files:
        imsave(file, np.zeros((4, 3, 3)))
    return [5] * len(sitting.moments)
