import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_pregrasp.planning.grasp_quality import (
    complete_grasp_matrix,
    grasp_quality,
    hard_finger_grasp_matrix,
    skew,
)

cases = given(seed=st.integers(0, 10**6), n=st.integers(1, 8))


def lever_arms(seed, n, scale=0.05):
    return np.random.default_rng(seed).normal(scale=scale, size=(n, 3))


@cases
def test_complete_matrix_maps_contact_wrenches_to_the_wrench_about_the_centre(seed, n):
    r = lever_arms(seed, n)
    w = np.random.default_rng(seed + 1).normal(size=(n, 6))
    force = w[:, :3].sum(axis=0)
    torque = w[:, 3:].sum(axis=0) + np.cross(r, w[:, :3]).sum(axis=0)
    expected = np.concatenate([force, torque])
    np.testing.assert_allclose(complete_grasp_matrix(r) @ w.ravel(), expected, atol=1e-12)


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


def test_hard_finger_model_is_the_force_part_with_scaled_torques():
    r = lever_arms(5, 4)
    length = np.max(np.linalg.norm(r, axis=1))
    expected = np.hstack([np.vstack([np.eye(3), skew(a[None])[0] / length]) for a in r])
    np.testing.assert_allclose(hard_finger_grasp_matrix(r), expected, atol=1e-15)


def test_no_contact_has_no_quality():
    quality = grasp_quality(np.empty((0, 3)))
    assert (quality.q_msv, quality.q_gii, quality.q_vew) == (0, 0, 0)
