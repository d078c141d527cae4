"""The lower bound of the margin of force closure."""

import numpy as np
import pytest
from hypothesis import settings
from made_contacts import SURFACE, on_box, seeds

from drake_pregrasp.quality.force_closure import (
    CONE_MODELS,
    least_norm_margin,
    min_weight_margin,
    moved_least_norm_margin,
    primitive_wrenches,
)

CUBE = 0.05 * np.vstack([np.eye(3), -np.eye(3)])
models = pytest.mark.parametrize("model", CONE_MODELS)
cases = seeds(3, 6)


def by_pseudoinverse(r, nhat, model):
    W = primitive_wrenches(r, nhat, 0.7, model=model, torsional_friction=0.004)
    A = np.vstack([W, np.ones(W.shape[1])])
    A[3:6] /= 0.05
    if np.linalg.matrix_rank(A, tol=1e-9) < 7:
        return -np.inf
    return A.shape[1] * np.min(np.linalg.pinv(A) @ np.eye(7)[6])


@models
@cases
def test_it_equals_its_definition_and_is_a_lower_bound(model, seed, n):
    r, nhat = on_box(seed, n)
    bound = least_norm_margin(r, nhat, 0.7, model=model)
    assert bound == pytest.approx(by_pseudoinverse(r, nhat, model), rel=1e-6, abs=1e-9)
    assert bound <= 1 + 1e-12
    assert max(bound, 0) <= min_weight_margin(r, nhat, 0.7, model=model) + 1e-9


def test_it_certifies_a_good_share_of_good_grasps_and_no_bad_one():
    known = [on_box(seed, 5) for seed in range(200)]
    margins = np.array([min_weight_margin(*one, 0.7) for one in known])
    bounds = np.array([least_norm_margin(*one, 0.7) for one in known])
    assert np.mean(bounds[margins > 0.5] > 0) > 0.4
    assert not np.any(bounds[margins == 0] > 0)


@pytest.mark.parametrize("model", ["hard_finger", "soft_finger"])
@pytest.mark.parametrize("margin", [least_norm_margin, min_weight_margin])
def test_where_wrenches_add_up_to_zero_margins_are_one(margin, model):
    assert margin(CUBE, CUBE / 0.05, 0.7, model=model) == pytest.approx(1)


@models
@settings(max_examples=30)
@cases
def test_neither_the_unit_of_length_nor_the_reference_point_matters(model, seed, n):
    r, nhat = on_box(seed, n)
    expected = least_norm_margin(r, nhat, 0.7, model=model)
    scaled = least_norm_margin(1e3 * r, nhat, 0.7, model=model, torsional_friction=4.0)
    moved = least_norm_margin(r + np.array([0.01, -0.02, 0.03]), nhat, 0.7, model=model)
    np.testing.assert_allclose([scaled, moved], expected, rtol=1e-6)


@models
@pytest.mark.parametrize("n", [1, 2, 5])
def test_moving_one_contact_and_many_sets_at_once_are_as_one_by_one(model, n):
    grasp, places = on_box(4, n), (SURFACE.p_OQ[::3], SURFACE.nhat_OQ[::3])
    for moved in {0, n // 2}:
        sets = [np.repeat(values[None], len(places[0]), axis=0) for values in grasp]
        for values, place in zip(sets, places, strict=True):
            values[:, moved] = place
        expected = [least_norm_margin(*one, 0.7, model=model) for one in zip(*sets, strict=True)]
        at_once = least_norm_margin(*sets, 0.7, model=model)
        np.testing.assert_allclose(at_once, expected, rtol=1e-9)
        p_CoMQ, nhat_Q = places
        values = moved_least_norm_margin(
            *grasp, 0.7, moved=moved, p_CoMQ=p_CoMQ, nhat_Q=nhat_Q, model=model
        )
        np.testing.assert_allclose(values, expected, rtol=1e-6)


def test_grasps_that_leave_a_wrench_out_are_not_certified():
    pair = CUBE[[0, 3]]
    assert least_norm_margin(pair, pair / 0.05, 0.7) == -np.inf
    assert least_norm_margin(pair, pair / 0.05, 0.7, model="soft_finger") == pytest.approx(1)
