"""The measures of a grasp, and its classification."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_contacts import anywhere, seeds

from drake_pregrasp.quality.grasp_quality import CONTACT_MODELS, grasp_quality

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
