import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_pregrasp import box_surface
from drake_pregrasp.quality.force_closure import (
    CONE_MODELS,
    least_norm_margin,
    min_weight_margin,
    moved_least_norm_margin,
    primitive_wrenches,
)

SURFACE = box_surface([0.1, 0.08, 0.12], spacing=0.01)
CUBE = 0.05 * np.vstack([np.eye(3), -np.eye(3)])
models = pytest.mark.parametrize("model", CONE_MODELS)
seeds = given(seed=st.integers(0, 10**6), n=st.integers(3, 6))


def contacts(seed, n):
    q = np.random.default_rng(seed).choice(len(SURFACE.p_OQ), n, replace=False)
    return SURFACE.p_OQ[q], SURFACE.nhat_OQ[q]


def by_pseudoinverse(r, nhat, model):
    W = primitive_wrenches(r, nhat, 0.7, model=model, torsional_friction=0.004)
    A = np.vstack([W, np.ones(W.shape[1])])
    A[3:6] /= 0.05
    if np.linalg.matrix_rank(A, tol=1e-9) < 7:
        return -np.inf
    return A.shape[1] * np.min(np.linalg.pinv(A) @ np.eye(7)[6])


@models
@seeds
def test_it_equals_its_definition_and_is_a_lower_bound(model, seed, n):
    r, nhat = contacts(seed, n)
    bound = least_norm_margin(r, nhat, 0.7, model=model)
    assert bound == pytest.approx(by_pseudoinverse(r, nhat, model), rel=1e-6, abs=1e-9)
    assert bound <= 1 + 1e-12
    assert max(bound, 0) <= min_weight_margin(r, nhat, 0.7, model=model) + 1e-9


def test_it_certifies_a_good_share_of_good_grasps_and_no_bad_one():
    known = [contacts(seed, 5) for seed in range(200)]
    margins = np.array([min_weight_margin(*one, 0.7) for one in known])
    bounds = np.array([least_norm_margin(*one, 0.7) for one in known])
    assert np.mean(bounds[margins > 0.5] > 0) > 0.4
    assert not np.any(bounds[margins == 0] > 0)


def test_where_wrenches_add_up_to_zero_both_margins_are_one():
    for model in ("hard_finger", "soft_finger"):
        assert least_norm_margin(CUBE, CUBE / 0.05, 0.7, model=model) == pytest.approx(1)
        assert min_weight_margin(CUBE, CUBE / 0.05, 0.7, model=model) == pytest.approx(1)


@models
@settings(max_examples=30)
@seeds
def test_neither_the_unit_of_length_nor_the_reference_point_matters(model, seed, n):
    r, nhat = contacts(seed, n)
    expected = least_norm_margin(r, nhat, 0.7, model=model)
    scaled = least_norm_margin(1e3 * r, nhat, 0.7, model=model, torsional_friction=4.0)
    moved = least_norm_margin(r + np.array([0.01, -0.02, 0.03]), nhat, 0.7, model=model)
    np.testing.assert_allclose([scaled, moved], expected, rtol=1e-6)


@models
@pytest.mark.parametrize("n", [1, 2, 5])
def test_moving_one_contact_is_measuring_the_grasp_with_it_there(model, n):
    r, nhat = contacts(4, n)
    places = {"p_CoMQ": SURFACE.p_OQ[::3], "nhat_Q": SURFACE.nhat_OQ[::3]}
    for moved in {0, n // 2}:
        values = moved_least_norm_margin(r, nhat, 0.7, moved=moved, **places, model=model)
        for value, *place in zip(values, *places.values(), strict=True):
            there, normals = r.copy(), nhat.copy()
            there[moved], normals[moved] = place
            expected = least_norm_margin(there, normals, 0.7, model=model)
            assert value == pytest.approx(expected, rel=1e-6)


def test_many_sets_at_once_are_as_one_by_one():
    sets = [contacts(seed, 4) for seed in range(12)]
    r, nhat = (np.stack(arrays).reshape(3, 4, 4, 3) for arrays in zip(*sets, strict=True))
    expected = np.reshape([least_norm_margin(*one, 0.7) for one in sets], (3, 4))
    np.testing.assert_allclose(least_norm_margin(r, nhat, 0.7), expected, rtol=1e-9)


def test_grasps_that_leave_a_wrench_out_are_not_certified():
    pair = CUBE[[0, 3]]
    assert least_norm_margin(pair, pair / 0.05, 0.7) == -np.inf
    assert least_norm_margin(pair, pair / 0.05, 0.7, model="soft_finger") == pytest.approx(1)
    assert least_norm_margin(np.empty((0, 3)), np.empty((0, 3)), 0.7) == -np.inf
