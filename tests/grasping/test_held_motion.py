"""The motion of an object that a hand holds: it stops, or yields to the object's push."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_pregrasp.grasping.held_motion import DAMPING_RATIO, MASS_RATIO, HeldMotion

PERIOD, STIFFNESS, FRICTION = 0.02, 2000.0, 1.0
D, M = STIFFNESS * PERIOD / DAMPING_RATIO, STIFFNESS * PERIOD**2 / MASS_RATIO
FORCES = st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=1, max_size=40)


def moving(turn=0.0):
    V = np.array([[0, 0, turn], [0.05, 0.01, 0]])
    return HeldMotion(0.0, np.eye(3), np.zeros(3), V, V, np.zeros(3))


def pushed(motion, f, friction=FRICTION):
    return motion.yielding(np.array(f), STIFFNESS, friction, PERIOD, PERIOD)


def after_a_period(motion):
    return motion.at(motion.time + PERIOD, np.zeros(3))


@given(st.floats(0, 2), st.floats(0.1, 0.5), st.floats(-1, 1))
def test_a_hand_that_stops_moves_by_its_twist_and_comes_to_rest(elapsed, duration, turn):
    first, h = moving(turn), 1e-6
    now, then = (first.stopping(time, duration) for time in (elapsed, elapsed + h))
    np.testing.assert_allclose((then.p_WG - now.p_WG) / h, now.V_WG[1], atol=1e-5)
    assert (then.R_WG @ now.R_WG.T)[1, 0] / h == pytest.approx(now.V_WG[0, 2], abs=1e-4)
    if elapsed >= duration:
        np.testing.assert_allclose(now.p_WG, first.V_WG[1] * duration / 2, atol=1e-12)
        np.testing.assert_allclose(now.V_WG, 0, atol=1e-12)


@given(st.floats(0, 2 * np.pi), st.floats(0, 0.999))
def test_a_push_below_the_friction_does_not_move_the_frame_beside_the_belt(angle, share):
    f = share * FRICTION * np.array([np.cos(angle), np.sin(angle), 0.0])
    now = pushed(moving(0.2), f)
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
    assert now.V_WG[1, 0] - motion.V_WBelt[1, 0] == pytest.approx(expected)
    np.testing.assert_allclose(now.p_WG[1:], 0)


@given(FORCES)
def test_the_frame_takes_energy_from_the_object_and_its_way_is_limited_by_this_energy(forces):
    """In the frame of the belt, where G begins at rest."""
    motion, energy, way = moving(), 0.0, 0.0
    for x, y in forces:
        f = np.array([x, y, 0.0])
        jumped = pushed(motion, f)
        v = jumped.V_WG[1] - motion.V_WBelt[1]
        energy += float(f @ (jumped.p_WG - motion.p_WG + PERIOD * v))
        way += PERIOD * float(np.linalg.norm(v))
        assert energy >= M / 2 * float(v @ v) + FRICTION * way - 1e-9
        motion = after_a_period(jumped)


def test_without_a_push_a_frame_that_was_pushed_comes_to_rest_on_the_belt():
    motion = pushed(moving(), [5.0, 0.0, 0.0])
    for _ in range(20):
        motion = pushed(after_a_period(motion), np.zeros(3))
    np.testing.assert_allclose(motion.V_WG, motion.V_WBelt, atol=1e-12)


@pytest.mark.parametrize("friction", [0.0, FRICTION])
def test_an_object_that_nothing_moves_brings_the_frame_to_rest(friction):
    object_at, motion, errors = 0.003, moving(), []
    motion = replace(motion, V_WG=np.zeros((2, 3)), V_WBelt=np.zeros((2, 3)))
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
        shift = 0.05 * time + acceleration * time**2 / 2 - motion.at(time, np.zeros(3)).p_WG[0]
        motion = pushed(motion.at(time, np.zeros(3)), [STIFFNESS * shift, 0.0, 0.0])
        errors.append(shift)
    # Its force is the friction and that which accelerates the mass.
    assert max(np.abs(errors)) < 1.5 * (FRICTION + M * abs(acceleration)) / STIFFNESS


def test_a_push_that_was_yielded_to_is_not_yielded_to_again():
    once = pushed(moving(), [5.0, 0.0, 0.0])
    again = once.yielding(np.array([5.0, 0.0, 0.0]), STIFFNESS, FRICTION, 0.0, PERIOD)
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


@given(st.floats(0, 1), st.floats(0.05, 0.5))
def test_in_the_air_the_frame_falls_and_stops_along_its_velocity_within_v_squared_over_2a(t, T):
    fall = np.array([0.0, 0.0, -9.81])
    first = replace(moving(), a_W=fall)
    now, V = first.at(t, np.zeros(3)), first.V_WG[1]
    np.testing.assert_allclose(now.p_WG, t * V + t * t / 2 * fall, atol=1e-12)
    np.testing.assert_allclose(now.V_WG[1], V + t * fall, atol=1e-12)
    speed = np.linalg.norm(now.V_WG[1])
    way, a = now.stopping(t + T, T).p_WG - now.p_WG, speed / T
    np.testing.assert_allclose(way, now.V_WG[1] / speed * speed**2 / (2 * a), atol=1e-12)


VECTORS = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array)


@given(VECTORS, VECTORS, st.floats(0, 1), st.floats(0, 1))
def test_in_the_air_a_centre_of_mass_beside_the_origin_falls_and_the_origin_turns(r, w, t, later):
    fall = np.array([0.0, 0.0, -9.81])
    first = replace(moving(), V_WG=np.array([10 * w, [1.0, 0.2, 3.0]]), a_W=fall)
    now = first.at(t, r)
    v_CoM = first.V_WG[1] + np.cross(10 * w, r)
    np.testing.assert_allclose(
        now.p_WG + now.R_WG @ r, r + t * v_CoM + t * t / 2 * fall, atol=1e-12
    )
    np.testing.assert_allclose(
        now.V_WG[1] + np.cross(10 * w, now.R_WG @ r), v_CoM + t * fall, atol=1e-12
    )
    step = 1e-6
    velocity = (first.at(t + step, r).p_WG - now.p_WG) / step
    np.testing.assert_allclose(velocity, now.V_WG[1], atol=1e-3)
    # It makes no difference whether the motion is stored on the way.
    for part in ("p_WG", "R_WG", "V_WG"):
        stored, at_once = (getattr(m.at(t + later, r), part) for m in (now, first))
        np.testing.assert_allclose(stored, at_once, atol=1e-9)


def beside_the_belt(motion):
    return motion.V_WG[1] - motion.V_WBelt[1]


@given(VECTORS, VECTORS, st.floats(1e-3, 0.5))
def test_a_taut_tether_takes_energy_and_leaves_no_way_out(p_WQ, v, distance):
    motion = moving()
    motion = replace(motion, V_WG=motion.V_WG + np.array([np.zeros(3), v]))
    now, far = motion.within(p_WQ, distance), float(np.linalg.norm(p_WQ))
    if far <= distance:
        assert now is motion
        return
    assert np.linalg.norm(now.p_WG - p_WQ) == pytest.approx(distance)
    assert beside_the_belt(now) @ (now.p_WG - p_WQ) <= 1e-9
    assert np.linalg.norm(beside_the_belt(now)) <= np.linalg.norm(beside_the_belt(motion)) + 1e-12
    np.testing.assert_array_equal(now.V_WG[0], motion.V_WG[0])
    again = now.within(p_WQ, distance)
    np.testing.assert_allclose(again.p_WG, now.p_WG, atol=1e-12)
    np.testing.assert_allclose(again.V_WG, now.V_WG, atol=1e-12)


def test_a_tether_does_not_stop_what_comes_back_or_goes_round():
    motion, p_WQ = moving(), np.array([0.1, 0.0, 0.0])
    for v in ([0.2, 0.0, 0.0], [0.0, -0.3, 0.1]):
        there = replace(motion, V_WG=motion.V_WG + np.array([np.zeros(3), v]))
        np.testing.assert_allclose(there.within(p_WQ, 0.01).V_WG, there.V_WG, atol=1e-12)
    nowhere = motion.within(np.full(3, np.nan), 0.01)
    np.testing.assert_array_equal(nowhere.p_WG, motion.p_WG)


@given(st.floats(0.006, 0.1))
def test_fingers_that_lag_behind_a_tethered_frame_do_not_make_it_faster_without_end(lag):
    """The estimate is ahead of the fingers, and stays there: their push cannot move the frame."""
    motion, p_WQ = moving(), np.zeros(3)
    speeds = []
    for _ in range(100):
        p_WT = p_WQ - [lag, 0, 0]
        motion = pushed(after_a_period(motion), STIFFNESS * (p_WT - motion.p_WG) * [1, 1, 0])
        speeds.append(np.linalg.norm(motion.V_WG[1] - motion.V_WBelt[1]))
        p_WQ = p_WQ + PERIOD * motion.V_WBelt[1]
        motion = motion.within(p_WQ, 0.005)
    assert max(speeds) < 2 * PERIOD * STIFFNESS * lag / M
