"""The forces with which fingers keep an object in its place."""

import numpy as np
import pytest

from drake_pregrasp.geometry.rotations import rotation_matrix
from drake_pregrasp.grasping.object_stiffness import LARGEST_GAIN, holding_gain, restoring_forces

GAIN = 3.0


def made(n, seed):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 3)) * 0.04, rng.uniform(50.0, 900.0, n), rng


@pytest.mark.parametrize("n", [2, 3, 5])
@pytest.mark.parametrize("seed", range(5))
def test_a_rigid_motion_is_felt_as_springs_would_feel_it(n, seed):
    p, k, rng = made(n, seed)
    t, theta = 0.003 * rng.normal(size=(2, 3))
    moved = t + np.cross(theta, p)
    forces = restoring_forces(p, moved, k, GAIN)
    np.testing.assert_allclose(forces, -GAIN * k[:, None] * moved, atol=1e-9)


@pytest.mark.parametrize("n", [2, 3, 5])
@pytest.mark.parametrize("seed", range(5))
def test_they_oppose_any_motion_and_never_exceed_the_springs(n, seed):
    p, k, rng = made(n, seed)
    d = 0.003 * rng.normal(size=(n, 3))
    forces = restoring_forces(p, d, k, GAIN)
    against = -np.sum(forces * d)
    assert 0 < against <= GAIN * np.sum(k * np.sum(d**2, axis=1))
    # What is left of the springs' forces is a strain, which exerts no wrench.
    left = GAIN * k[:, None] * d + forces
    np.testing.assert_allclose(left.sum(axis=0), 0, atol=1e-9)
    np.testing.assert_allclose(np.cross(p, left).sum(axis=0), 0, atol=1e-9)
    np.testing.assert_allclose(
        restoring_forces(p, left / k[:, None], k, GAIN), 0, atol=1e-9 * np.abs(left).max() + 1e-12
    )


def test_they_turn_with_the_axes():
    p, k, rng = made(4, 7)
    d, R = 0.003 * rng.normal(size=(4, 3)), rotation_matrix(rng.normal(size=3))
    np.testing.assert_allclose(
        restoring_forces(p @ R.T, d @ R.T, k, GAIN),
        restoring_forces(p, d, k, GAIN) @ R.T,
        atol=1e-9,
    )


def test_no_finger_and_one_finger_have_their_forces_too():
    assert restoring_forces(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), GAIN).shape == (0, 3)
    p, k, rng = made(1, 3)
    d = 0.003 * rng.normal(size=(1, 3))
    np.testing.assert_allclose(restoring_forces(p, d, k, GAIN), -GAIN * k * d, atol=1e-9)


def test_slower_control_presses_back_less():
    gains = [holding_gain(h) for h in (0.002, 0.01, 0.02, 0.04)]
    assert gains[:2] == [LARGEST_GAIN, LARGEST_GAIN]
    np.testing.assert_allclose(gains[2] / gains[3], 2.0)
    assert gains[2] == pytest.approx(2.0)
