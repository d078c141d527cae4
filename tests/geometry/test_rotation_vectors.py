"""Rotation vectors against scipy's rotations, from no turn to half a turn."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drake_pregrasp.geometry.rotations import (
    angle_about_z,
    rotation_matrix,
    rotation_vector,
    turn_about_z,
)

seeds = st.integers(0, 2**32 - 1)
angles = st.one_of(
    st.floats(0, np.pi),
    st.sampled_from([0.0, 1e-300, 1e-12, 1e-5, 0.00999, 0.01001, np.pi - 1e-9, np.pi]),
)


def turn(seed, angle):
    axis = np.random.default_rng(seed).normal(size=3)
    if seed % 3 == 0:  # Along an axis.
        axis[seed % 2 :] = 0
        axis[seed % 2] = 1
    return angle * axis / np.linalg.norm(axis)


@given(seeds, angles)
def test_matrices_are_those_of_scipy(seed, angle):
    theta = turn(seed, angle)
    expected = Rotation.from_rotvec(theta).as_matrix()
    np.testing.assert_allclose(rotation_matrix(theta), expected, rtol=0, atol=4e-16 + 1e-16 * angle)


@given(seeds, angles)
def test_vectors_are_the_inverse(seed, angle):
    theta = turn(seed, angle)
    R = Rotation.from_rotvec(theta).as_matrix()
    found = rotation_vector(R)
    assert np.linalg.norm(found) <= np.pi + 1e-15
    if np.pi - angle < 1e-7:  # Half a turn one way is half a turn the other way.
        found *= np.sign(found @ theta)
    np.testing.assert_allclose(found, theta, rtol=0, atol=1e-15 + 1e-15 * angle)


@given(seeds, angles)
def test_the_left_jacobian_is_the_derivative(seed, angle):
    theta, step = turn(seed, angle), 1e-5
    J = rotation_matrix(theta, order=1)
    for axis in np.eye(3):
        # scipy's own, so that an error in the exponential cannot hide one here.
        after, before = (Rotation.from_rotvec(theta + s * axis) for s in (step, -step))
        difference = (after * before.inv()).as_rotvec() / (2 * step)
        np.testing.assert_allclose(J @ axis, difference, rtol=0, atol=1e-9)


@given(st.floats(-np.pi, np.pi), st.floats(0, 3.0), st.floats(-np.pi, np.pi))
def test_a_tilt_leaves_the_angle_about_z(angle, tilt, azimuth):
    tilting = Rotation.from_rotvec(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
    found = angle_about_z(tilting.as_matrix() @ turn_about_z(angle))
    np.testing.assert_allclose(turn_about_z(found), turn_about_z(angle), atol=1e-9)
