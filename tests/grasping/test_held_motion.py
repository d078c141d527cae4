"""The motion of an object that a hand holds: it stops, or follows the fingertips."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_pregrasp.geometry.rotations import rotation_matrix
from drake_pregrasp.grasping.held_motion import HeldMotion

PERIOD = 0.02
TIPS = np.array([[0.06, 0.02, 0.01], [-0.06, 0.0, 0.02], [0.01, 0.06, 0.0], [0.0, -0.06, 0.01]])
ALONG = np.array([0.001, 0.0, 0.0])


def moving(turn=0.0):
    V = np.array([[0, 0, turn], [0.05, 0.01, 0]])
    return HeldMotion(0.0, np.eye(3), np.zeros(3), V, np.zeros((2, 3)))


@given(st.floats(0, 2), st.floats(0.1, 0.5), st.floats(-1, 1))
def test_a_hand_that_stops_moves_by_its_twist_and_comes_to_rest(elapsed, duration, turn):
    first, h = moving(turn), 1e-6
    now, then = (first.stopping(time, duration) for time in (elapsed, elapsed + h))
    np.testing.assert_allclose((then.p_WG - now.p_WG) / h, now.V_WG[1], atol=1e-5)
    assert (then.R_WG @ now.R_WG.T)[1, 0] / h == pytest.approx(now.V_WG[0, 2], abs=1e-4)
    if elapsed >= duration:
        np.testing.assert_allclose(now.p_WG, first.V_WG[1] * duration / 2, atol=1e-12)
        np.testing.assert_allclose(now.V_WG, 0, atol=1e-12)


@pytest.mark.parametrize("acceleration", [[1.5, 0, 0], [-1.5, 0.5, 0]])
def test_the_frame_follows_an_object_that_suddenly_accelerates(acceleration):
    motion, errors = moving(0.5), []
    for time in PERIOD * np.arange(1, 26):
        shift = motion_of(np.array([0.05, 0.01, 0]), np.array(acceleration), time)
        p_WT = shift + TIPS @ rotation_matrix(np.array([0, 0, 0.5 * time])).T
        motion = motion.at(time).following(p_WT, TIPS, PERIOD, PERIOD)
        p_WT_found = motion.p_WG + TIPS @ motion.R_WG.T
        errors.append(np.abs(p_WT_found - p_WT).max())
    assert max(errors) < 4e-4
    assert errors[-1] < 2e-4


def motion_of(v, a, time):
    return v * time + a * time**2 / 2


def test_a_frame_that_fingertips_have_corrected_is_not_corrected_again():
    p_WT = TIPS + ALONG
    once = moving().following(p_WT, TIPS, PERIOD, PERIOD)
    np.testing.assert_array_equal(once.following(p_WT, TIPS, 0.0, PERIOD).p_WG, once.p_WG)


@pytest.mark.parametrize("sign", [1, -1])
def test_fingertips_that_would_lift_the_object_lower_the_frame_without_moving_it(sign):
    shifted = moving().following(TIPS + sign * ALONG[::-1], TIPS, PERIOD, PERIOD)
    assert shifted.p_WG[2] < 0 if sign < 0 else shifted.p_WG[2] == 0
    np.testing.assert_allclose(shifted.V_WG, moving().V_WG, atol=1e-12)
    np.testing.assert_allclose(shifted.A_WG, 0, atol=1e-12)


@given(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-0.02, 0.02))
def test_fingers_whose_strain_looks_like_a_turn_or_a_tilt_do_not_turn_the_frame(x, y, z):
    motion, turned = moving(0.2), TIPS @ rotation_matrix(np.array([x, y, z])).T
    now = motion.following(turned, TIPS, PERIOD, PERIOD)
    np.testing.assert_array_equal(now.R_WG, np.eye(3))
    np.testing.assert_array_equal(now.V_WG[0], [0, 0, 0.2])
