"""Hand-centric measures of Jacobians."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_pregrasp.quality.grasp_quality import posture_measures


@given(seed=st.integers(0, 10**6), k=st.integers(3, 6))
def test_measures_are_their_definitions(seed, k):
    J = np.random.default_rng(seed).normal(size=(2, 3, k))
    squares = np.linalg.eigvalsh(J @ J.swapaxes(1, 2))
    volume = np.sqrt(np.linalg.det(J @ J.swapaxes(1, 2)))
    expected = [np.sqrt(squares[:, 0]), volume, np.sqrt(squares[:, 0] / squares[:, -1])]
    np.testing.assert_allclose(posture_measures(J), np.array(expected).T, rtol=1e-6)


def test_a_planar_arm_is_singular_where_it_is_stretched():
    """Two links of length one, and a third row that an upright joint drives."""

    def arm(elbow):
        s, c = np.sin(elbow), np.cos(elbow)
        return posture_measures(np.array([[-s, -s, 0], [1 + c, c, 0], [0, 0, 1]]))

    np.testing.assert_allclose(arm(0.0), 0, atol=1e-12)
    assert np.all(arm(0.5) < arm(1.5))
    assert arm(0.5)[1] == pytest.approx(np.sin(0.5))  # |sin elbow|, textbook.
    np.testing.assert_allclose(posture_measures(np.eye(3)), 1)
