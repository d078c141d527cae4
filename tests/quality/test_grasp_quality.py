"""Grasp matrices of the contact models, the measures of a grasp, and its classification."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_contacts import anywhere, seeds

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.quality.grasp_quality import (
    CONTACT_MODELS,
    contact_axes,
    contact_blocks,
    grasp_matrix,
    grasp_quality,
    skew,
)

cases = seeds(1, 8)
COLUMNS = {"frictionless": 1, "hard_finger": 3, "soft_finger": 4}


@cases
def test_measures_do_not_depend_on_the_frame(seed, n):
    r, _ = anywhere(seed, n)
    R = np.linalg.qr(np.random.default_rng(seed + 2).normal(size=(3, 3)))[0]
    R *= np.sign(np.linalg.det(R))
    turned = grasp_quality(r @ R.T).to_vector()
    np.testing.assert_allclose(turned, grasp_quality(r).to_vector(), rtol=1e-9)


@cases
def test_measures_have_bounds_and_the_volume_is_the_closed_form_of_the_spread(seed, n):
    r, _ = anywhere(seed, n)
    quality = grasp_quality(r)
    assert 0 < quality.q_msv <= np.sqrt(n) * (1 + 1e-12)
    assert 0 < quality.q_gii <= 1 + 1e-12
    assert quality.q_vew >= n**3 * (1 - 1e-12)
    rho = r - r.mean(axis=0)
    inertia = np.sum(rho**2) * np.eye(3) - rho.T @ rho
    determinant = n**3 * np.linalg.det(n * np.eye(3) + inertia)
    assert quality.q_vew == pytest.approx(np.sqrt(determinant), rel=1e-10)


@given(seed=st.integers(0, 2**32), n=st.integers(1, 8), flat=st.floats(-12, 0))
def test_measures_are_those_of_the_singular_values_also_of_flat_sets(seed, n, flat):
    r, _ = anywhere(seed, n)
    r[:, 2] *= 10**flat
    for length in (1.0, 1e-3):
        sigma = np.linalg.svd(grasp_matrix(r, None, "complete", length=length), compute_uv=False)
        expected = sigma[-1], sigma[-1] / sigma[0], np.prod(sigma)
        quality = grasp_quality(r, length=length).to_vector()
        np.testing.assert_allclose(quality[:3], expected, rtol=1e-10)


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


@given(seed=st.integers(0, 10**6), scale=st.sampled_from([1e-9, 1e-3, 1.0, 1e3]))
def test_only_lever_arms_over_the_unit_of_length_matter(seed, scale):
    r, nhat = anywhere(seed, 3)
    assert grasp_quality(scale * r).indeterminate == 0
    one, scaled = (
        grasp_quality(k * r, nhat, model="hard_finger", length=0.05 * k).to_vector()
        for k in (1.0, scale)
    )
    np.testing.assert_allclose(one, scaled, rtol=1e-9)


@cases
def test_a_model_that_passes_on_more_grasps_no_worse_and_is_classified_by_itself(seed, n):
    r, nhat = anywhere(seed, n)
    models = [*COLUMNS, "complete"]
    qualities = [grasp_quality(r, nhat, model=model, length=0.05) for model in models]
    for less, more in pairwise(qualities):
        assert less.q_msv <= more.q_msv + 1e-12
        assert less.q_vew <= more.q_vew * (1 + 1e-9) + 1e-12
    for quality, (model, columns) in zip(qualities[:-1], COLUMNS.items(), strict=True):
        assert quality.graspable == (columns * n > 6 or (model == "hard_finger" and n == 2))
        assert (quality.q_msv > 1e-12) == (quality.indeterminate == 0)


@pytest.mark.parametrize("model", CONTACT_MODELS)
def test_no_contact_has_no_quality(model):
    quality = grasp_quality(np.empty((0, 3)), np.empty((0, 3)), model=model)
    np.testing.assert_array_equal(quality.to_vector(), [0, 0, 0, 0, 1])


@pytest.mark.parametrize("model", CONTACT_MODELS)
def test_contacts_at_the_centre_of_mass_have_no_lever_arms(model):
    nhat = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    quality = grasp_quality(np.zeros((3, 3)), nhat, model=model, length=0.05)
    by_moments = {"soft_finger": 1.0, "complete": np.sqrt(3)}
    assert quality.q_msv == pytest.approx(by_moments.get(model, 0.0))
    assert quality.indeterminate == (model != "soft_finger")


few = seeds(1, 6)


@few
def test_complete_matrix_maps_contact_wrenches_to_the_wrench_about_the_centre(seed, n):
    r, _ = anywhere(seed, n)
    w = np.random.default_rng(seed + 1).normal(size=(n, 6))
    force = w[:, :3].sum(axis=0)
    torque = w[:, 3:].sum(axis=0) + np.cross(r, w[:, :3]).sum(axis=0)
    expected = np.concatenate([force, torque])
    np.testing.assert_allclose(grasp_matrix(r, None, "complete") @ w.ravel(), expected, atol=1e-12)


@few
def test_each_model_is_a_selection_from_the_complete_one_in_the_contact_frames(seed, n):
    r, nhat = anywhere(seed, n)
    turned = np.zeros((n, 6, 6))
    turned[:, :3, :3] = turned[:, 3:, 3:] = contact_axes(nhat)
    in_frames = contact_blocks(r / 0.05, None, "complete") @ turned
    selected = {"hard_finger": [0, 1, 2], "soft_finger": [0, 1, 2, 3], "frictionless": [0]}
    for model, columns in selected.items():
        expected = np.hstack([block[:, columns] for block in in_frames])
        actual = grasp_matrix(r, nhat, model, length=0.05)
        np.testing.assert_allclose(actual, expected, atol=1e-12)
    without_normals, with_normals = (
        np.linalg.svd(grasp_matrix(r, normals, "hard_finger"), compute_uv=False)
        for normals in (None, nhat)
    )
    np.testing.assert_allclose(without_normals, with_normals, atol=1e-12)


@few
def test_contact_frames_are_rotations_that_start_with_the_inward_normal(seed, n):
    _, nhat = anywhere(seed, n)
    R = contact_axes(nhat)
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (n, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1, rtol=1e-12)
    np.testing.assert_allclose(R[:, :, 0], -nhat, atol=1e-15)


@pytest.mark.parametrize("model", CONTACT_MODELS)
def test_many_sets_at_once_are_as_one_by_one(model):
    sets = [anywhere(seed, 4) for seed in range(5)]
    r, nhat = (np.stack(arrays) for arrays in zip(*sets, strict=True))
    expected = [contact_blocks(*one, model) for one in sets]
    np.testing.assert_array_equal(contact_blocks(r, nhat, model), np.stack(expected))


def test_skew_is_the_cross_product():
    a, b = np.random.default_rng(0).normal(size=(2, 9, 3))
    np.testing.assert_allclose(np.einsum("kij,kj->ki", skew(a), b), np.cross(a, b), atol=1e-15)


@pytest.mark.parametrize(
    ("model", "length", "message"),
    [
        ("glue", 1.0, "no contact model 'glue'; there are: complete"),
        ("soft_finger", 1.0, "soft_finger needs the normals"),
        ("frictionless", 1.0, "frictionless needs the normals"),
        ("complete", 0.0, "length must be greater than 0 m, not 0"),
    ],
)
def test_missing_or_unknown_arguments_are_named(model, length, message):
    with pytest.raises(InvalidArgumentError, match=message):
        grasp_matrix(anywhere(0, 3)[0], None, model, length=length)
