"""Measures of a hand, by its Jacobian."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.quality.grasp_quality import (
    distance_to_singularity,
    manipulability_volume,
    uniformity_of_transformation,
)

MEASURES = (distance_to_singularity, manipulability_volume, uniformity_of_transformation)


@given(seed=st.integers(0, 10**6), r=st.sampled_from([3, 6]), k=st.integers(1, 9))
def test_measures_are_their_definitions(seed, r, k):
    J = np.random.default_rng(seed).normal(size=(r, k))
    eigenvalues = np.maximum(np.linalg.eigvalsh(J @ J.T), 0)
    volume = np.sqrt(max(np.linalg.det(J @ J.T), 0))
    assert distance_to_singularity(J) == pytest.approx(np.sqrt(eigenvalues[0]), abs=1e-6)
    assert manipulability_volume(J) == pytest.approx(volume, rel=1e-6, abs=1e-4)
    ratio = np.sqrt(eigenvalues[0] / eigenvalues[-1])
    assert uniformity_of_transformation(J) == pytest.approx(ratio, abs=1e-6)


def test_a_planar_arm_is_singular_where_it_is_stretched():
    """Two links of length one, and a third row that an upright joint drives."""

    def arm(elbow):
        return np.array(
            [[-np.sin(elbow), -np.sin(elbow), 0], [1 + np.cos(elbow), np.cos(elbow), 0], [0, 0, 1]]
        )

    assert distance_to_singularity(arm(0.0)) == pytest.approx(0, abs=1e-12)
    assert distance_to_singularity(arm(0.5)) < distance_to_singularity(arm(1.5))
    assert manipulability_volume(arm(0.5)) == pytest.approx(np.sin(0.5))  # |sin elbow|, textbook.


def test_the_uniform_are_uniform_and_nothing_is_nothing():
    assert uniformity_of_transformation(np.eye(6)) == 1
    assert uniformity_of_transformation(np.zeros((3, 4))) == 0


@pytest.mark.parametrize("measure", MEASURES)
def test_many_at_once_are_as_one_by_one_and_too_few_joints_leave_a_velocity_out(measure):
    J = np.random.default_rng(0).normal(size=(2, 5, 6, 7))
    expected = [[measure(one) for one in row] for row in J]
    np.testing.assert_allclose(measure(J), expected, rtol=1e-12)
    np.testing.assert_array_equal(measure(J[..., :5]), 0)


@pytest.mark.parametrize("shape", [(6,), (4, 4), (6, 0)])
def test_other_shapes_are_refused(shape):
    with pytest.raises(InvalidArgumentError, match=r"must have shape .* not \("):
        manipulability_volume(np.zeros(shape))
