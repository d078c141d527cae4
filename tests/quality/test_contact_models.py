"""Grasp matrices of the contact models."""

import numpy as np
import pytest
from made_contacts import anywhere, seeds

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.quality.grasp_quality import (
    CONTACT_MODELS,
    contact_axes,
    contact_blocks,
    grasp_matrix,
    skew,
)

cases = seeds(1, 6)


@cases
def test_complete_matrix_maps_contact_wrenches_to_the_wrench_about_the_centre(seed, n):
    r, _ = anywhere(seed, n)
    w = np.random.default_rng(seed + 1).normal(size=(n, 6))
    force = w[:, :3].sum(axis=0)
    torque = w[:, 3:].sum(axis=0) + np.cross(r, w[:, :3]).sum(axis=0)
    expected = np.concatenate([force, torque])
    np.testing.assert_allclose(grasp_matrix(r, None, "complete") @ w.ravel(), expected, atol=1e-12)


@cases
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


@cases
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
