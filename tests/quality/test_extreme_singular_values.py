import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_pregrasp.quality.contact_models import grasp_matrix
from drake_pregrasp.quality.singular_values import extreme_singular_values


def check(r):
    """Compares with numpy's decomposition; r has shape (k, n, 3)."""
    n = r.shape[1]
    B = np.sum(r**2, axis=(1, 2))[:, None, None] * np.eye(3) - np.einsum("kni,knj->kij", r, r)
    low, high = extreme_singular_values(r.sum(axis=1), B, n)
    exact = np.array(
        [np.linalg.svd(grasp_matrix(a, None, "complete"), compute_uv=False) for a in r]
    )
    np.testing.assert_allclose(low, exact[:, -1], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(high, exact[:, 0], rtol=1e-9)


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 10),
    scale=st.sampled_from([1e-4, 0.01, 0.05, 0.2, 0.5]),
)
def test_equals_numpys_decomposition(seed, n, scale):
    check(np.random.default_rng(seed).normal(scale=scale, size=(40, n, 3)))


def test_on_a_cubes_faces():
    rng = np.random.default_rng(0)
    r = rng.uniform(-0.05, 0.05, (2000, 5, 3))
    face = rng.integers(0, 2, (2000, 5))
    sign = rng.choice([-0.05, 0.05], (2000, 5))
    np.put_along_axis(r, face[..., None], sign[..., None], axis=2)
    check(r)


@pytest.mark.parametrize("scale", [1e-9, 1e-4, 0.05])
def test_balanced_contacts(scale):
    rng = np.random.default_rng(1)
    half = rng.normal(scale=scale, size=(50, 2, 3))
    check(np.concatenate([half, -half], axis=1))
    nearly = np.concatenate([half, -half + rng.normal(scale=1e-9, size=half.shape)], axis=1)
    check(nearly)


def test_collinear_coincident_and_symmetric_contacts():
    line = np.linspace(-0.05, 0.08, 5)[:, None] * np.array([0.6, 0.0, 0.8])
    same = np.tile([0.03, 0.02, 0.01], (5, 1))
    plane = 0.05 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 0]])
    lifted = plane + np.array([0, 0, 0.02])
    check(np.stack([line, same, plane, lifted, np.zeros((5, 3))]))


def test_metre_sized_arms():
    check(np.random.default_rng(2).normal(scale=1.0, size=(300, 5, 3)))
