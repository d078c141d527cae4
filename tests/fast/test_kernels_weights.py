"""The kernels' weights themselves, against Eq. 3 and decomposed matrices."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import IMPLEMENTATIONS, SHAPES, Case, slow_weights

from drake_pregrasp.kernels import KINDS, Weighting

SAME = 1e-9  # Of the weights' range over the points.


def compare(case, implementation, kind, points=None):
    kernel = case.kernel(implementation)
    partition = case.partition(kernel)
    active = partition.sizes > 0
    points = case.p_OQ if points is None else points
    contact = int(np.flatnonzero(active)[0])
    covariance = case.covariance(0.4 * case.size)
    found = kernel.weights(
        partition, case.p_OC, contact, Weighting(kind, False, covariance), points
    )
    if kind == "position":
        away = points - case.p_OCoM
        expected = np.exp(-0.5 * np.einsum("ki,ij,kj->k", away, np.linalg.inv(covariance), away))
    else:
        expected = slow_weights(case, kind, contact, points, active)
    # With one contact a volume is the same everywhere, to the rounding of its size.
    tolerance = max(SAME * np.ptp(expected), 1e-13 * np.max(expected))
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 32),
    size=st.sampled_from([0.03, 0.1, 0.25, 1.0, 3.0]),
    shape=st.sampled_from(SHAPES),
)
def test_weights_are_those_of_decomposed_matrices(implementation, kind, seed, n, size, shape):
    lost = min(seed % 3, n - 1)
    compare(Case(seed, n, 15, size=size, N=200, lost=lost, shape=shape), implementation, kind)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("kind", KINDS)
def test_also_where_contacts_coincide(implementation, kind):
    compare(Case(1, 6, 10, coincident=True), implementation, kind)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-9, 1e-6, 1e-3])
def test_also_at_and_near_double_singular_values(implementation, kind, off):
    """A regular cross: with the contact in its place t is zero, and singular values are double."""
    case = Case(4, 4, 0)
    half = case.size / 2
    case.p_OC = half * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    case.p_OCoM, case.h = np.zeros(3), np.zeros(4)
    near = case.p_OC[0] + off * np.random.default_rng(0).normal(size=(64, 3))
    compare(case, implementation, kind, np.vstack([near, case.p_OQ[:50]]))
