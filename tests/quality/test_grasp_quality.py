import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_pregrasp.quality.grasp_quality import CONTACT_MODELS, grasp_quality

cases = given(seed=st.integers(0, 10**6), n=st.integers(1, 8))


def lever_arms(seed, n, scale=0.05):
    return np.random.default_rng(seed).normal(scale=scale, size=(n, 3))


def normals(seed, n):
    nhat = np.random.default_rng(seed + 7).normal(size=(n, 3))
    return nhat / np.linalg.norm(nhat, axis=1, keepdims=True)


@cases
def test_measures_do_not_depend_on_the_frame(seed, n):
    r = lever_arms(seed, n)
    R = np.linalg.qr(np.random.default_rng(seed + 2).normal(size=(3, 3)))[0]
    R *= np.sign(np.linalg.det(R))
    np.testing.assert_allclose(
        grasp_quality(r @ R.T).to_vector(), grasp_quality(r).to_vector(), rtol=1e-9
    )


@cases
def test_bounds_of_the_measures(seed, n):
    quality = grasp_quality(lever_arms(seed, n))
    assert 0 < quality.q_msv <= np.sqrt(n) * (1 + 1e-12)
    assert 0 < quality.q_gii <= 1 + 1e-12
    assert quality.q_vew >= n**3 * (1 - 1e-12)


@cases
def test_volume_has_the_closed_form_of_the_spread(seed, n):
    r = lever_arms(seed, n)
    rho = r - r.mean(axis=0)
    inertia = np.sum(rho**2) * np.eye(3) - rho.T @ rho
    determinant = n**3 * np.linalg.det(n * np.eye(3) + inertia)
    assert grasp_quality(r).q_vew == pytest.approx(np.sqrt(determinant), rel=1e-10)


def test_contacts_about_the_centre_are_isotropic():
    quality = grasp_quality(1e-6 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]))
    assert quality.q_msv == pytest.approx(2, rel=1e-6)
    assert quality.q_gii == pytest.approx(1, rel=1e-6)


@pytest.mark.parametrize(
    ("r", "graspable", "indeterminate"),
    [
        ([], 0, 1),
        ([[0.05, 0, 0]], 0, 1),  # The object can turn about the one point.
        ([[0.05, 0, 0], [-0.05, 0, 0]], 1, 1),  # Squeezed, but free to turn about the line.
        ([[0.05, 0, 0], [0, 0.05, 0], [-0.05, 0, 0]], 1, 0),
        ([[-0.05, 0, 0], [0, 0, 0], [0.05, 0, 0]], 1, 1),  # Collinear.
    ],
)
def test_classification_by_the_hard_finger_model(r, graspable, indeterminate):
    quality = grasp_quality(np.array(r, dtype=float).reshape(-1, 3))
    assert (quality.graspable, quality.indeterminate) == (graspable, indeterminate)


@given(seed=st.integers(0, 10**6), scale=st.sampled_from([1e-6, 1e-3, 1.0, 1e3]))
def test_classification_does_not_depend_on_the_unit_of_length(seed, scale):
    r = lever_arms(seed, 3)
    assert grasp_quality(r).indeterminate == grasp_quality(scale * r).indeterminate == 0


@cases
def test_a_model_that_passes_on_more_grasps_no_worse(seed, n):
    r, nhat = lever_arms(seed, n), normals(seed, n)
    frictionless, hard, soft, complete = (
        grasp_quality(r, nhat, model=model, length=0.05)
        for model in ("frictionless", "hard_finger", "soft_finger", "complete")
    )
    for less, more in ((frictionless, hard), (hard, soft), (soft, complete)):
        assert less.q_msv <= more.q_msv + 1e-12
        assert less.q_vew <= more.q_vew * (1 + 1e-9) + 1e-12
    assert frictionless.indeterminate >= hard.indeterminate >= soft.indeterminate


@cases
def test_each_model_but_the_complete_one_is_classified_by_itself(seed, n):
    r, nhat = lever_arms(seed, n), normals(seed, n)
    for model, columns in (("frictionless", 1), ("hard_finger", 3), ("soft_finger", 4)):
        quality = grasp_quality(r, nhat, model=model)
        assert quality.graspable == (columns * n > 6 or (model == "hard_finger" and n == 2))
        assert (quality.q_msv > 1e-12) == (quality.indeterminate == 0)


def test_a_soft_finger_holds_what_two_hard_ones_let_turn():
    r = np.array([[0.05, 0, 0], [-0.05, 0, 0]])
    hard, soft = (
        grasp_quality(r, r / 0.05, model=model) for model in ("hard_finger", "soft_finger")
    )
    assert (hard.indeterminate, soft.indeterminate) == (1, 0)


def test_the_length_trades_moments_for_forces():
    r, nhat = lever_arms(3, 4), normals(3, 4)
    metres, millimetres = (
        grasp_quality(r * scale, nhat, model="hard_finger", length=0.05 * scale).to_vector()
        for scale in (1, 1000)
    )
    np.testing.assert_allclose(metres, millimetres, rtol=1e-9)


def test_no_contact_has_no_quality():
    for model in CONTACT_MODELS:
        quality = grasp_quality(np.empty((0, 3)), np.empty((0, 3)), model=model)
        assert (quality.q_msv, quality.q_gii, quality.q_vew) == (0, 0, 0)
