"""The motion of an object that a hand holds: it stops, or yields to the object's push."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_pregrasp.grasping.held_motion import COMPLIANCE, INVERTANCE, HeldMotion, common_shift

PERIOD, STIFFNESS, FRICTION = 0.02, 2000.0, 1.0
D, M = STIFFNESS * PERIOD / COMPLIANCE, STIFFNESS * PERIOD**2 / INVERTANCE
ALONG, ACROSS = STIFFNESS * np.eye(2), np.array([[2000.0, 900.0], [900.0, 1e5]])
FORCES = st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=1, max_size=40)


def moving(turn=0.0):
    V = np.array([[0, 0, turn], [0.05, 0.01, 0]])
    return HeldMotion(0.0, np.eye(3), np.zeros(3), V, V)


def pushed(motion, f, friction=FRICTION, K=ALONG):
    shift = np.append(np.linalg.solve(K, f[:2]), f[2] / STIFFNESS)
    return motion.yielding(shift, K, friction, PERIOD, PERIOD)


def after_a_period(motion):
    return motion.at(motion.time + PERIOD)


@given(st.floats(0, 2), st.floats(0.1, 0.5), st.floats(-1, 1))
def test_a_hand_that_stops_moves_by_its_twist_and_comes_to_rest(elapsed, duration, turn):
    first, h = moving(turn), 1e-6
    now, then = (first.stopping(time, duration) for time in (elapsed, elapsed + h))
    np.testing.assert_allclose((then.p_WG - now.p_WG) / h, now.V_WG[1], atol=1e-5)
    assert (then.R_WG @ now.R_WG.T)[1, 0] / h == pytest.approx(now.V_WG[0, 2], abs=1e-4)
    if elapsed >= duration:
        np.testing.assert_allclose(now.p_WG, first.V_WG[1] * duration / 2, atol=1e-12)
        np.testing.assert_allclose(now.V_WG, 0, atol=1e-12)


@pytest.mark.parametrize("K", [ALONG, ACROSS])
@given(st.floats(0, 2 * np.pi), st.floats(0, 0.999))
def test_a_push_below_the_friction_does_not_move_the_frame_beside_the_belt(K, angle, share):
    f = share * FRICTION * np.array([np.cos(angle), np.sin(angle), 0.0])
    now = pushed(moving(0.2), f, K=K)
    np.testing.assert_array_equal(now.p_WG, 0)
    np.testing.assert_array_equal(now.V_WG, moving(0.2).V_WG)


@given(st.floats(1.001, 20), st.floats(-0.1, 0.1))
def test_a_push_moves_the_frame_by_the_equations_of_a_damper_and_of_a_mass_with_friction(f, v):
    motion = moving()
    motion = replace(motion, V_WG=motion.V_WG + np.array([[0, 0, 0], [v, 0, 0]]))
    now = pushed(motion, [f, 0.0, 0.0])
    assert now.p_WG[0] == pytest.approx(PERIOD * (f - FRICTION) / D)
    u = v + PERIOD * f / M
    expected = np.sign(u) * max(0.0, abs(u) - PERIOD * FRICTION / M)
    assert now.V_WG[1, 0] - motion.V_WB[1, 0] == pytest.approx(expected)
    np.testing.assert_allclose(now.p_WG[1:], 0)


@pytest.mark.parametrize("K", [ALONG, ACROSS])
@given(FORCES)
def test_the_frame_takes_energy_from_the_object_and_its_way_is_limited_by_this_energy(K, forces):
    """In the frame of the belt, where G begins at rest."""
    motion, energy, way = moving(), 0.0, 0.0
    for x, y in forces:
        f = np.array([x, y, 0.0])
        jumped = pushed(motion, f, K=K)
        v = jumped.V_WG[1] - motion.V_WB[1]
        energy += float(f @ (jumped.p_WG - motion.p_WG + PERIOD * v))
        way += PERIOD * float(np.linalg.norm(v))
        kinetic = PERIOD**2 / INVERTANCE / 2 * float(v[:2] @ K @ v[:2])
        assert energy >= kinetic + FRICTION * way - 1e-9
        motion = after_a_period(jumped)


def test_without_a_push_a_frame_that_was_pushed_comes_to_rest_on_the_belt():
    motion = pushed(moving(), [5.0, 0.0, 0.0])
    for _ in range(20):
        motion = pushed(after_a_period(motion), np.zeros(3))
    np.testing.assert_allclose(motion.V_WG, motion.V_WB, atol=1e-12)


@pytest.mark.parametrize("friction", [0.0, FRICTION])
def test_an_object_that_nothing_moves_brings_the_frame_to_rest(friction):
    object_at, motion, errors = 0.003, moving(), []
    motion = replace(motion, V_WG=np.zeros((2, 3)), V_WB=np.zeros((2, 3)))
    for _ in range(30):
        errors.append(object_at - motion.p_WG[0])
        f = STIFFNESS * errors[-1]
        motion = after_a_period(pushed(motion, [f, 0.0, 0.0], friction))
    assert abs(errors[6]) < 0.1 * object_at + friction / STIFFNESS
    assert abs(errors[-1]) <= friction / STIFFNESS + 1e-9


@pytest.mark.parametrize("acceleration", [1.5, -1.5])
def test_the_frame_follows_a_belt_that_suddenly_accelerates(acceleration):
    motion, errors = moving(), []
    for time in PERIOD * np.arange(1, 26):
        shift = 0.05 * time + acceleration * time**2 / 2 - motion.at(time).p_WG[0]
        motion = pushed(motion.at(time), [STIFFNESS * shift, 0.0, 0.0])
        errors.append(shift)
    # Its force is the friction and that which accelerates the mass.
    assert max(np.abs(errors)) < 1.5 * (FRICTION + M * abs(acceleration)) / STIFFNESS


def test_a_push_that_was_yielded_to_is_not_yielded_to_again():
    once = pushed(moving(), [5.0, 0.0, 0.0])
    again = once.yielding(np.array([5e-3, 0.0, 0.0]), ALONG, FRICTION, 0.0, PERIOD)
    np.testing.assert_array_equal(again.p_WG, once.p_WG)
    np.testing.assert_array_equal(again.V_WG, once.V_WG)


@pytest.mark.parametrize("sign", [1, -1])
def test_fingertips_that_would_lift_the_object_lower_the_frame_without_moving_it(sign):
    shifted = pushed(moving(), [0.0, 0.0, sign * 2.0])
    assert shifted.p_WG[2] < 0 if sign < 0 else shifted.p_WG[2] == 0
    np.testing.assert_array_equal(shifted.V_WG, moving().V_WG)


@given(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(1e-4, 0.02))
def test_the_frame_stays_within_a_distance_of_the_estimate(x, y, distance):
    p_W = np.array([x, y, 0.0])
    tied = moving().within(p_W, distance)
    assert np.linalg.norm(tied.p_WG - p_W) <= distance + 1e-12
    if np.linalg.norm(p_W) <= distance:
        np.testing.assert_array_equal(tied.p_WG, 0)


def test_fingers_in_parallel_on_a_carrier_in_series_resist_a_common_shift():
    """Two jaws of 1000 N/m along x, on a carrier of 1e5 N/m along x and y."""
    stiffness = np.array([1e5, 1e5, 1000.0, 1000.0])
    J = np.zeros((2, 3, 4))
    J[:, 0, 0] = J[:, 1, 1] = J[0, 0, 2] = J[1, 0, 3] = 1.0
    moved = np.array([3e-4, 2e-5, -1e-4])
    shift, K = common_shift(np.tile(moved, (2, 1)), J, stiffness)
    np.testing.assert_allclose(shift, moved, rtol=1e-9)
    both = 1 / (1 / 2000 + 1 / 1e5)
    np.testing.assert_allclose(K, np.diag([both, 1e5]), rtol=0.01, atol=1e-6)


@given(st.integers(1, 5), st.integers(0, 1000))
def test_the_shift_tells_the_net_force_that_deflected_the_joints(n, seed):
    """The joints that carry all fingers deflect by all forces, and a finger's own ones by its."""
    random = np.random.default_rng(seed)
    nq = 3 + 3 * n
    J = np.zeros((n, 3, nq))
    J[:, :, :3] = random.normal(size=(n, 3, 3))
    for finger in range(n):
        J[finger, :, 3 + 3 * finger : 6 + 3 * finger] = random.normal(size=(3, 3))
    stiffness, f = random.uniform(100, 1000, nq), random.normal(size=(n, 3)) * [1, 1, 0]
    deflections = sum(J[i].T @ f[i] for i in range(n)) / stiffness
    shift, K = common_shift(J @ deflections, J, stiffness)
    np.testing.assert_allclose(K @ shift[:2], f.sum(axis=0)[:2], rtol=0.02, atol=0.02)


@pytest.mark.parametrize("direction", [0, 1, 2])
def test_a_finger_whose_joint_moves_it_along_one_line_alone_gives_finite_values(direction):
    J = np.zeros((2, 3, 2))
    J[:, direction] = np.eye(2)
    shift, K = common_shift(np.array([[1e-4, 0, 0], [0, 1e-4, 1e-4]]), J, np.full(2, 500.0))
    assert np.isfinite(shift).all()
    moved = moving().yielding(shift, K, FRICTION, PERIOD, PERIOD)
    assert np.isfinite(moved.p_WG).all()
    assert np.isfinite(moved.V_WG).all()
    assert np.linalg.norm(moved.p_WG) < 1e-3
