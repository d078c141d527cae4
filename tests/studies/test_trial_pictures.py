"""Figure of one seed: choice of the seed, and content of the pictures."""

import numpy as np
import pandas as pd
import pytest
from drake_pregrasp.studies.static_versus_dynamic import trial_pictures
from drake_pregrasp.studies.static_versus_dynamic.comparison_command import trial_jobs
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.grasp_outcome import TrialJob
from drake_pregrasp.studies.static_versus_dynamic.methods import METHODS
from drake_pregrasp.studies.static_versus_dynamic.trial import make_trial
from hypothesis import given
from hypothesis import strategies as st
from made_up_trials import rows_of, state_of
from matplotlib.image import imread

from drake_pregrasp.systems.drawing import contact_color


@given(st.dictionaries(st.integers(0, 9), st.tuples(st.booleans(), st.booleans()), min_size=1))
def test_the_seed_is_the_first_that_represents_the_most_methods(clean):
    lines = [(seed, m, of[k]) for seed, of in clean.items() for k, m in enumerate("ab")]
    lines.append((50, "a", True))  # Not of both methods.
    rows = pd.DataFrame(lines[::-1], columns=["seed", "method", "clean"])
    shares = rows.groupby("method")["clean"].mean()
    usual = [bool(shares[method] >= 0.5) for method in "ab"]
    typical = {seed: sum(np.equal(of, usual)) for seed, of in clean.items()}
    seed, rule = trial_pictures.representative_seed(rows)
    assert typical[seed] == max(typical.values())
    assert all(count < typical[seed] for other, count in typical.items() if other < seed)
    assert f"Seed {seed} is the first of {len(clean)} for which, in {typical[seed]} of 2" in rule


def no_progress(done, total):
    pass


def test_without_a_seed_of_all_methods_there_are_no_figures(tmp_path):
    for jobs in (
        trial_jobs(["nominal"], METHODS, range(6)),
        trial_jobs(["headline"], ["dynamic", "reassigned"], range(6)),
        [TrialJob("headline", method, k) for k, method in enumerate(trial_pictures.PICTURED)],
    ):
        rows = rows_of(jobs)
        assert trial_pictures.figures_of_one_seed(tmp_path, rows, None, no_progress) == []
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("methods", [METHODS, ["reassigned", "stationary"]])
def test_the_figure_is_of_the_methods_there_are(tmp_path, monkeypatch, methods):
    pictured = []
    monkeypatch.setattr(trial_pictures, "make_pictures", lambda *given: pictured.append(given[1]))
    rows = rows_of(trial_jobs(CONDITIONS, methods, range(2)))
    _, picture = trial_pictures.figures_of_one_seed(tmp_path, rows, 3, no_progress)
    (shown,) = pictured
    (seed,) = set(shown["seed"])
    assert set(shown["method"]) == set(trial_pictures.PICTURED) & set(methods)
    assert f"Seed {seed}" in picture.caption


def pixels_of(X_WK, p_WQ):
    """Returns where points are seen, shape (k, 2), by the equations of a pinhole camera."""
    info = trial_pictures.CAMERA.core().intrinsics()
    p_KQ = (X_WK.inverse() @ np.atleast_2d(p_WQ).T).T
    centre, focal = [info.center_x(), info.center_y()], [info.focal_x(), info.focal_y()]
    return centre + np.array(focal) * p_KQ[:, :2] / p_KQ[:, 2:]


@pytest.fixture(scope="module")
def tracking():
    """A trial on its way, before fingers come down."""
    trial = make_trial(TrialJob("headline", "dynamic_reach", 0))
    trial.track(0.3)
    return trial


def likeness(pixels):
    """Returns how like colours are to those of the fingers, shape (k, 5): 1 if only lit else."""
    colors = [contact_color(finger) for finger in range(5)]
    hues = np.array([[color.r(), color.g(), color.b()] for color in colors])
    hues /= np.linalg.norm(hues, axis=1, keepdims=True)
    lengths = np.maximum(np.linalg.norm(pixels, axis=1, keepdims=True), 1)
    return pixels / lengths @ hues.T


@pytest.mark.slow
def test_a_picture_shows_contacts_and_regions_where_they_are(tracking):
    bare, marked = (
        trial_pictures.photograph(tracking, annotate=on).astype(int) for on in (False, True)
    )
    X_WK = trial_pictures.camera_over(tracking)
    X_WC = trial_pictures.closing_contacts(tracking)
    points = np.array([X.translation() for X in X_WC])
    normals = np.array([X.rotation().matrix()[:, 2] for X in X_WC])
    seen = np.sum((X_WK.translation() - points) * normals, axis=1) > 0.1
    assert seen.any()
    middles = pixels_of(X_WK, points[seen])
    black = np.argwhere((marked.max(axis=2) < 40) & (bare.min(axis=2) > 60))[:, ::-1]
    apart = np.linalg.norm(black[:, None] - middles, axis=2)
    assert np.all(apart.min(axis=1) < 20)
    assert np.all(apart.min(axis=0) < 12)
    station, surface = tracking.station, tracking.surface
    X_WO = station.GetOutputPort("X_WO").Eval(station.GetMyContextFromRoot(tracking.context))
    p_WQ = (X_WO @ surface.p_OQ.T).T
    port = tracking.planner.GetOutputPort("safe_regions")
    labels = port.Eval(tracking.planner.GetMyContextFromRoot(tracking.context)).labels
    nhat_WQ = surface.nhat_OQ @ X_WO.rotation().matrix().T
    owned = (np.sum((X_WK.translation() - p_WQ) * nhat_WQ, axis=1) > 0.2) & (labels >= 0)
    columns, rows = pixels_of(X_WK, p_WQ[owned]).round().astype(int).T
    found = likeness(marked[rows, columns])
    right = found[np.arange(len(found)), labels[owned]] > 0.97
    assert len(right) > 100
    assert np.mean(right & (np.argmax(found, axis=1) == labels[owned])) > 0.7  # Links hide some.


@pytest.mark.slow
def test_a_picture_leaves_no_trace(tracking):
    before, scene = state_of(tracking.context), tracking.station.scene_graph
    command = tracking.diagram.GetSubsystemByName("close_command")
    trial_pictures.photograph(tracking, annotate=True)
    assert scene.RendererCount(scene.GetMyContextFromRoot(tracking.context)) == 0
    np.testing.assert_array_equal(state_of(tracking.context), before)
    assert command.get_output_port().Eval(command.GetMyContextFromRoot(tracking.context)) == [0.0]


@pytest.mark.slow
def test_the_grid_has_a_row_for_each_method(tmp_path):
    jobs = [TrialJob("headline", method, 0) for method in ("fixed_plan", "stationary")]
    outcomes = rows_of(jobs).drop_duplicates("method")
    trial_pictures.make_pictures(tmp_path / "grid.png", outcomes, (0.1,))
    grid = imread(tmp_path / "grid.png")
    # One wall in each of the two rows and columns: what is dark and a little redder than blue.
    redder = grid[..., 0] - grid[..., 2]
    brown = (redder > 0.03) & (redder < 0.12) & (grid[..., 0] < 0.5)
    half_height, half_width = np.array(brown.shape) // 2
    for part in (brown[:half_height], brown[half_height:]):
        assert part[:, :half_width].sum() > 1000
        assert part[:, half_width:].sum() > 1000
