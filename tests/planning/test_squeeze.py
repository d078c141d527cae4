"""Squeezes balance what acts on the object, inside their cones, and with no more than it takes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.planning.squeeze import squeeze_forces

WEIGHT = np.array([0, 0, -4.0, 0, 0, 0])
AROUND = 2 * np.pi * np.arange(5) / 5
RING = 0.05 * np.stack([np.cos(AROUND), np.sin(AROUND), 0 * AROUND], axis=1)
OUTWARD = RING / 0.05
ONE_SIDE = np.array([[0.05, 0.03, 0.0], [0.05, -0.03, 0.0], [0.05, 0.0, 0.03]])

heights = st.lists(st.floats(-0.03, 0.03), min_size=5, max_size=5).map(np.array)


def net_wrench(p, forces):
    return np.concatenate([forces.sum(axis=0), np.cross(p, forces).sum(axis=0)])


@given(heights, st.floats(0, 20))
def test_forces_balance_a_weight_from_all_sides(z, weight):
    p = RING + z[:, None] * [0, 0, 1]
    forces, residual = squeeze_forces(
        p, OUTWARD, weight / 4 * WEIGHT, friction=0.5, least_normal=2.0
    )
    assert residual < 1e-2 * (1 + weight)
    np.testing.assert_allclose(
        net_wrench(p, forces) + weight / 4 * WEIGHT, 0, atol=0.02 * (1 + weight)
    )


@given(heights, st.floats(0.1, 1.0), st.floats(0, 3))
def test_forces_lie_in_their_cones(z, friction, least):
    p = RING + z[:, None] * [0, 0, 1]
    forces, _ = squeeze_forces(p, OUTWARD, WEIGHT, friction=friction, least_normal=least)
    normal = -np.sum(forces * OUTWARD, axis=1)
    across = np.linalg.norm(forces + normal[:, None] * OUTWARD, axis=1)
    assert np.all(normal >= least - 1e-9)
    assert np.all(across <= friction * normal + 1e-9)


@given(st.floats(-3, 3), st.floats(-1, 1), st.floats(-3, 3))
def test_forces_turn_with_the_scene(roll, pitch, yaw):
    # Of three contacts, whose forces the balance leaves no choice but how hard they press.
    p, nhat = RING[[0, 2, 3]], OUTWARD[[0, 2, 3]]
    R = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
    pressed = np.array([0, 0, 0, 0, 0, 0.0])
    upright, _ = squeeze_forces(p, nhat, pressed, friction=0.5, least_normal=1.0)
    turned, _ = squeeze_forces(p @ R.T, nhat @ R.T, pressed, friction=0.5, least_normal=1.0)
    np.testing.assert_allclose(turned, upright @ R.T, atol=0.05)


def test_more_friction_never_needs_more_force():
    sizes = [
        np.sum(squeeze_forces(RING, OUTWARD, 4 * WEIGHT, friction=mu, least_normal=0.0).forces ** 2)
        for mu in (0.2, 0.4, 0.8, 1.6)
    ]
    assert np.all(np.diff(sizes) < 0)


def test_what_nothing_balances_is_told():
    planned = squeeze_forces(
        ONE_SIDE, np.tile([1.0, 0, 0], (3, 1)), WEIGHT, friction=0.5, least_normal=2.5
    )
    assert planned.residual > 1


def test_bad_arguments_are_refused():
    with pytest.raises(InvalidArgumentError, match="one contact at least"):
        squeeze_forces(np.empty((0, 3)), np.empty((0, 3)), WEIGHT, friction=0.5, least_normal=1)
    with pytest.raises(InvalidArgumentError, match="least_normal must be at least 0 N, not -1"):
        squeeze_forces(RING, OUTWARD, WEIGHT, friction=0.5, least_normal=-1)
