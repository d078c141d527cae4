import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_pregrasp import box_surface
from drake_pregrasp.quality.force_closure import FRICTION, least_norm_margin
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.studies.continuous_selection import (
    evolved_choice,
    least_eigenvalue,
    side_faces,
    slsqp_choice,
)
from drake_pregrasp.studies.global_selection import (
    closed_form_score,
    eigenvalue_score,
    exchanged,
    greedy,
    margin_score,
)

EDGE, CLEARANCE = 0.1, 0.005
SURFACE = box_surface([EDGE] * 3, spacing=0.02)
Q, NHAT = SURFACE.p_OQ, SURFACE.nhat_OQ
SEEDS = st.integers(0, 2**32 - 1)


def random_sets(seed, contacts=5):
    return np.random.default_rng(seed).choice(len(Q), contacts, replace=False)


def q_msv(indices):
    return grasp_quality(Q[indices]).q_msv


@pytest.mark.parametrize("make_score", [eigenvalue_score, closed_form_score])
@given(seed=SEEDS)
def test_scores_are_the_measure_with_each_candidate_beside_those_held(make_score, seed):
    held = random_sets(seed, 3)
    values = make_score(Q)(held)
    for k in (0, 7, len(Q) - 1):
        assert values[k] == pytest.approx(q_msv([*held, k]) ** 2, rel=1e-9)


@given(seed=SEEDS, contacts=st.integers(0, 4))
def test_the_margins_score_is_its_bound(seed, contacts):
    held = random_sets(seed, contacts)
    values = margin_score(Q, NHAT)(held)
    for k in (3, len(Q) - 1):
        chosen = [*held, k]
        assert values[k] == pytest.approx(least_norm_margin(Q[chosen], NHAT[chosen], FRICTION))


@given(seed=SEEDS)
def test_exchange_never_lowers_the_score_and_ends_where_no_exchange_gains(seed):
    score, start = eigenvalue_score(Q), random_sets(seed)
    chosen = exchanged(score, start)
    assert q_msv(start) <= q_msv(chosen) + 1e-12
    for i in range(len(chosen)):
        best = np.sqrt(np.max(score(np.delete(chosen, i))))
        assert best == pytest.approx(q_msv(chosen), rel=1e-9)


@given(seed=SEEDS)
def test_each_greedy_contact_is_the_best_beside_those_before_it(seed):
    score = closed_form_score(Q)
    first = seed % len(Q)
    chosen = greedy(score, first, 5)
    assert chosen[0] == first
    for k in range(1, 5):
        assert score(chosen[:k])[chosen[k]] == np.max(score(chosen[:k]))


@given(seed=SEEDS)
def test_no_method_exceeds_the_root_of_n(seed):
    contacts = 2 + seed % 5
    faces, rng = side_faces(EDGE, CLEARANCE), np.random.default_rng(seed)
    chosen = exchanged(closed_form_score(Q), greedy(closed_form_score(Q), seed % len(Q), contacts))
    assert q_msv(chosen) <= np.sqrt(contacts) + 1e-12
    p_OC = slsqp_choice(faces, contacts, rng, starts=2)
    assert grasp_quality(p_OC).q_msv <= np.sqrt(contacts) + 1e-12


@given(seed=SEEDS)
def test_the_gradient_is_that_of_differences(seed):
    p = Q[random_sets(seed)] + np.random.default_rng(seed).normal(0, 0.01, (5, 3))
    _, gradient = least_eigenvalue(p)
    h = 1e-6
    for i, axis in ((0, 0), (2, 1), (4, 2)):
        step = np.zeros((5, 3))
        step[i, axis] = h
        slope = (least_eigenvalue(p + step)[0] - least_eigenvalue(p - step)[0]) / (2 * h)
        assert gradient[i, axis] == pytest.approx(slope, abs=1e-6)


@pytest.mark.parametrize("gradient", [True, False])
def test_slsqp_stays_on_the_faces_and_finds_what_is_known(gradient):
    """With contacts around the centre of mass, the bound sqrt(n) is reached."""
    rng = np.random.default_rng(3)
    p_OC = slsqp_choice(side_faces(EDGE, CLEARANCE), 5, rng, starts=4, gradient=gradient)
    assert_on_faces(p_OC)
    assert grasp_quality(p_OC).q_msv > 0.9999 * np.sqrt(5)


def test_evolution_stays_on_the_faces_and_finds_what_is_known():
    p_OC = evolved_choice(side_faces(EDGE, CLEARANCE), 4, np.random.default_rng(1))
    assert_on_faces(p_OC)
    assert grasp_quality(p_OC).q_msv > 0.9999 * np.sqrt(4)


def test_faces_are_the_sides_without_their_strips():
    faces, corners = side_faces(EDGE, CLEARANCE), np.array([[1.0, 1.0], [-1.0, -1.0]])
    points = np.concatenate(
        [faces.points(np.full(2, face), corners * faces.halves) for face in range(4)]
    )
    assert_on_faces(points)
    np.testing.assert_allclose(np.abs(points[:, 2]), EDGE / 2 - CLEARANCE)
    centres = {tuple(np.round(p, 9)) for p in faces.centers}
    assert centres == {(0.05, 0, 0), (-0.05, 0, 0), (0, 0.05, 0), (0, -0.05, 0)}
    for face in range(4):  # Where one ends the next begins.
        end, begin = np.array([[[1.0, 0.0]], [[-1.0, 0.0]]]) * faces.halves
        here = faces.points(np.array([face]), end)
        np.testing.assert_allclose(here, faces.points(np.array([(face + 1) % 4]), begin))


def assert_on_faces(points):
    np.testing.assert_allclose(np.max(np.abs(points[:, :2]), axis=1), EDGE / 2, atol=1e-12)
    assert np.all(np.abs(points[:, 2]) <= EDGE / 2 - CLEARANCE + 1e-12)
