"""Validation of port inputs: results are finite, and valid inputs are unchanged."""

import numpy as np
import pytest
from broken_values import BAD_NUMBERS
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform
from scipy.spatial.transform import Rotation

from drake_pregrasp import arrays
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.systems.ports import is_valid

ANY_NUMBER = st.one_of(st.floats(), st.floats(-1.0, 1.0), st.sampled_from(BAD_NUMBERS))
SYMMETRIC = st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6)
SCALES = st.sampled_from([1e-12, 1e-6, 1e-3, 1.0, 1e3, 1e12])
SPREADS = st.sampled_from([1e-3, 0.04, 1.0])
R = Rotation.from_rotvec([0.3, -0.4, 1.0]).as_matrix()


@given(st.lists(ANY_NUMBER, min_size=4, max_size=4))
def test_weights_are_bounded_or_those_of_lost_fingers(numbers):
    given_weights = np.array(numbers)
    usable = arrays.validated_weights(given_weights)
    lost = np.isnan(given_weights) | (given_weights == -np.inf)
    np.testing.assert_array_equal(usable == -np.inf, lost)
    assert np.all(np.abs(usable[~lost]) <= arrays.LARGEST_WEIGHT)
    inside = np.abs(given_weights) <= arrays.LARGEST_WEIGHT
    np.testing.assert_array_equal(usable[inside], given_weights[inside])
    order = np.argsort(given_weights[~lost], kind="stable")
    assert np.all(np.diff(usable[~lost][order]) >= 0)


@given(st.lists(ANY_NUMBER, min_size=9, max_size=9), SPREADS)
def test_any_matrix_makes_a_covariance(numbers, spread):
    usable = arrays.validated_covariance(np.array(numbers).reshape(3, 3), R, spread)
    np.linalg.cholesky(usable)
    variances = np.linalg.eigvalsh(usable)
    assert np.min(variances) >= 0.9 * spread**2 - 1e-12 * arrays.LARGEST_VARIANCE
    assert np.max(variances) <= 3 * arrays.LARGEST_VARIANCE + 2 * spread**2


def assert_symmetric_and_definite(usable):
    np.testing.assert_allclose(usable, usable.T, rtol=0, atol=1e-9 * np.max(np.abs(usable)))
    assert np.min(np.linalg.eigvalsh((usable + usable.T) / 2)) > 0


@given(SYMMETRIC, SCALES, SPREADS)
def test_a_symmetric_matrix_makes_a_covariance_whether_or_not_it_is_one(numbers, scale, spread):
    matrix = np.zeros((3, 3))
    matrix[np.triu_indices(3)] = scale * np.array(numbers)
    matrix += np.triu(matrix, 1).T
    assert_symmetric_and_definite(arrays.validated_covariance(matrix, R, spread))


@given(SYMMETRIC, st.sampled_from([1e-8, 1e-4, 1e-2, 1.0]), SCALES, SPREADS)
def test_a_definite_matrix_that_is_not_symmetric_makes_a_symmetric_one(
    numbers, skewed, scale, spread
):
    root, x = np.diag(numbers[:3]) + np.eye(3), np.array(numbers[3:])
    skew = skewed * np.cross(np.eye(3), x)
    usable = arrays.validated_covariance(scale * (root @ root.T + skew), R, spread)
    assert_symmetric_and_definite(usable)


@given(st.lists(st.floats(-0.1, 0.1), min_size=9, max_size=9))
def test_a_covariance_is_used_as_it_is(numbers):
    root = np.array(numbers).reshape(3, 3)
    covariance = root @ root.T
    usable = arrays.validated_covariance(covariance, R, 0.04)
    np.testing.assert_array_equal(usable, R.T @ covariance @ R + 0.04**2 * np.eye(3))


def test_a_nan_covariance_leaves_only_the_spread():
    unknown = np.full((3, 3), np.nan)
    np.testing.assert_allclose(arrays.validated_covariance(unknown, R, 0.04), 0.04**2 * np.eye(3))


@pytest.mark.parametrize("bad", [*BAD_NUMBERS, 2 * arrays.FARTHEST])
@pytest.mark.parametrize("index", range(3))
def test_invalid_poses_are_recognized(bad, index):
    p = np.array([0.1, -0.2, 0.3])
    assert is_valid(RigidTransform(np.column_stack([R, p])))
    assert is_valid(RigidTransform(np.column_stack([R.astype(np.float32).astype(float), 1e6 * p])))
    far, turned = p.copy(), R.copy()
    far[index] = turned[index, 0] = bad
    assert not is_valid(RigidTransform(np.column_stack([R, far])))
    assert not is_valid(RigidTransform(np.column_stack([turned, p])))


@pytest.mark.parametrize("matrix", [0 * R, 1.001 * R, -R, np.diag([1.0, 1, -1]), np.ones((3, 3))])
def test_invalid_rotations_are_recognized(matrix):
    assert not is_valid(RigidTransform(np.column_stack([matrix, np.zeros(3)])))


@given(st.lists(ANY_NUMBER, min_size=6, max_size=6))
def test_rates_are_used_all_or_none(numbers):
    rates = np.array(numbers)
    usable = arrays.validated_rates(rates)
    assert np.all(np.abs(usable) <= arrays.FARTHEST)
    expected = rates if np.all(np.abs(rates) <= arrays.FARTHEST) else 0 * np.ones(6)
    np.testing.assert_array_equal(usable, expected)


@given(ANY_NUMBER)
def test_an_invalid_tracking_status_counts_as_lost(number):
    status = TrackingStatus(number)
    assert status == (number if number in list(TrackingStatus) else TrackingStatus.LOST)
