import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.arrays import pack, unpack
from drake_pregrasp.estimation.pose_filter import (
    NO_BELIEF,
    PoseFilterNoise,
    PoseMeasurement,
    first_belief,
    predict,
    update,
)

NOISE = PoseFilterNoise(
    position=1e-3,
    orientation=5e-3,
    acceleration=1e-2,
    angular_acceleration=5e-2,
    initial_velocity=0.1,
    initial_angular_velocity=0.5,
)
DT = 0.05


def some_belief(seed=0):
    rng = np.random.default_rng(seed)
    belief = first_belief(
        PoseMeasurement(0.0, rng.normal(size=3), Rotation.random(rng=seed).as_matrix()), NOISE
    )
    for k in range(1, 5):
        belief = predict(belief, DT, NOISE)
        belief = update(belief, PoseMeasurement(0, belief.p_WCoM + 1e-3, belief.R_WO), NOISE)
        assert belief.time == pytest.approx(k * DT)
    return belief


def angle(R):
    return Rotation.from_matrix(R).magnitude()


def test_vector_form_loses_nothing():
    belief = some_belief()
    np.testing.assert_array_equal(pack(unpack(NO_BELIEF, pack(belief))), pack(belief))


def test_predicting_in_two_steps_is_predicting_in_one():
    belief = some_belief()
    once, twice = predict(belief, 0.1, NOISE), predict(predict(belief, 0.04, NOISE), 0.06, NOISE)
    # The orientation's covariance is to second order in the turn of a step.
    np.testing.assert_allclose(pack(once), pack(twice), rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(once.P_position, twice.P_position, rtol=1e-9)


def test_covariance_grows_while_predicting_and_shrinks_by_a_measurement():
    prior = predict(some_belief(), 0.5, NOISE)
    posterior = update(prior, PoseMeasurement(0, prior.p_WCoM, prior.R_WO), NOISE)
    for name in ("P_position", "P_orientation"):
        before, grown, after = (getattr(b, name) for b in (some_belief(), prior, posterior))
        for block in (slice(0, 3), slice(3, 6)):
            growth = (grown - before)[block, block]
            assert np.all(np.linalg.eigvalsh(growth) > 0)
        assert np.all(np.linalg.eigvalsh(grown - after) > -1e-15)
        np.testing.assert_allclose(after, after.T, atol=1e-18)


def test_position_filter_equals_weighted_least_squares():
    """Without process noise the posterior is that of fitting a line to all measurements."""
    rng = np.random.default_rng(4)
    still = PoseFilterNoise(1e-3, 5e-3, 1e-12, 1e-12, 0.1, 0.5)
    z = np.array([0.1, 0.2, 0.3]) + rng.normal(scale=1e-3, size=(8, 3))
    belief = first_belief(PoseMeasurement(0.0, z[0], np.eye(3)), still)
    for measured in z[1:]:
        belief = update(predict(belief, DT, still), PoseMeasurement(0, measured, np.eye(3)), still)
    t = DT * (np.arange(8) - 7)
    A = np.vstack([np.stack([np.ones(8), t], axis=1) / 1e-3, [0, 1 / 0.1]])
    for axis in range(3):
        p, v = np.linalg.lstsq(A, np.append(z[:, axis] / 1e-3, 0), rcond=None)[0]
        assert belief.p_WCoM[axis] == pytest.approx(p, rel=1e-6)
        assert belief.v_WCoM[axis] == pytest.approx(v, rel=1e-4, abs=1e-7)


def test_filter_is_equivariant_under_a_turn_of_the_world():
    turn = Rotation.from_rotvec([0.3, -1.0, 0.5])
    here = there = None
    rng = np.random.default_rng(2)
    for k in range(6):
        p, R = rng.normal(size=3), Rotation.from_rotvec(0.1 * k * np.array([0.2, 0.5, 1.0]))
        if here is None:
            here, there = (
                first_belief(PoseMeasurement(0, p, R.as_matrix()), NOISE),
                first_belief(PoseMeasurement(0, turn.apply(p), (turn * R).as_matrix()), NOISE),
            )
            continue
        here = update(predict(here, DT, NOISE), PoseMeasurement(0, p, R.as_matrix()), NOISE)
        there = update(
            predict(there, DT, NOISE),
            PoseMeasurement(0, turn.apply(p), (turn * R).as_matrix()),
            NOISE,
        )
    np.testing.assert_allclose(there.p_WCoM, turn.apply(here.p_WCoM), atol=1e-12)
    np.testing.assert_allclose(there.w_WO, turn.apply(here.w_WO), atol=1e-12)
    assert angle(there.R_WO.T @ turn.as_matrix() @ here.R_WO) < 1e-12


def test_errors_are_as_large_as_the_covariance_says():
    """The mean normalised squared error of many runs lies in its chi-square band."""
    position, orientation = [], []
    runs, steps = 60, 40
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        v = rng.normal(scale=NOISE.initial_velocity, size=3)
        w = rng.normal(scale=NOISE.initial_angular_velocity, size=3)
        p, R, belief = np.zeros(3), Rotation.identity(), None
        for _ in range(steps):
            z = p + rng.normal(scale=NOISE.position, size=3)
            R_z = Rotation.from_rotvec(rng.normal(scale=NOISE.orientation, size=3)) * R
            if belief is None:
                belief = first_belief(PoseMeasurement(0.0, z, R_z.as_matrix()), NOISE)
            else:
                belief = update(
                    predict(belief, DT, NOISE), PoseMeasurement(0, z, R_z.as_matrix()), NOISE
                )
            e = np.concatenate([p - belief.p_WCoM, v - belief.v_WCoM])
            p, v = white_acceleration_step(rng, p, v, NOISE.acceleration)
            turn, w_next = white_acceleration_step(rng, np.zeros(3), w, NOISE.angular_acceleration)
            theta = (R * Rotation.from_matrix(belief.R_WO).inv()).as_rotvec()
            e_R = np.concatenate([theta, w - belief.w_WO])
            R, w = Rotation.from_rotvec(turn) * R, w_next
        position.append(e @ np.linalg.solve(belief.P_position, e))
        orientation.append(e_R @ np.linalg.solve(belief.P_orientation, e_R))
    low, high = chi2.ppf([0.0005, 0.9995], 6 * runs) / runs
    assert low < np.mean(position) < high
    assert low < np.mean(orientation) < high


def test_a_fast_turn_carries_the_errors_with_it():
    """The predicted covariance of a tumbling object is that of a cloud of samples."""
    rng = np.random.default_rng(8)
    quiet = PoseFilterNoise(1e-3, 5e-3, 1e-12, 1e-12, 0.1, 0.5)
    A = rng.normal(scale=1e-4, size=(6, 6))
    w = np.array([4.0, -5.0, 3.0])  # 0.35 rad in one step.
    belief = dataclasses.replace(
        first_belief(PoseMeasurement(0.0, np.zeros(3), np.eye(3)), quiet),
        w_WO=w,
        P_orientation=A @ A.T,
    )
    predicted = predict(belief, DT, quiet)
    e = rng.normal(size=(40000, 6)) @ A.T
    truth = Rotation.from_rotvec((w + e[:, 3:]) * DT) * Rotation.from_rotvec(e[:, :3])
    theta = (truth * Rotation.from_matrix(predicted.R_WO).inv()).as_rotvec()
    cloud = np.cov(np.hstack([theta, e[:, 3:]]).T)
    scale = np.sqrt(np.diag(cloud))
    np.testing.assert_allclose(
        predicted.P_orientation / np.outer(scale, scale), cloud / np.outer(scale, scale), atol=0.03
    )


def test_a_belief_is_not_carried_back_in_time():
    with pytest.raises(InvalidArgumentError, match="back in time"):
        predict(some_belief(), -0.1, NOISE)


def white_acceleration_step(rng, x, v, density):
    L = np.linalg.cholesky(density**2 * np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]]))
    dx, dv = L @ rng.normal(size=(2, 3))
    return x + v * DT + dx, v + dv


def test_in_free_flight_without_noise_the_parabola_is_followed_exactly():
    flight = dataclasses.replace(NOISE, gravity=9.81, initial_velocity=10)
    v, w, p_OCoM = np.array([1.0, -2, 4]), np.array([2.0, 3, -1]), np.array([0.02, 0, -0.03])
    belief = None
    for k in range(400):
        t = k * DT / 10
        p = t * v + np.array([0, 0, -9.81 * t**2 / 2])
        R = Rotation.from_rotvec(t * w).as_matrix()
        if belief is None:
            belief = dataclasses.replace(
                first_belief(PoseMeasurement(t, p, R), flight, p_OCoM), v_WCoM=v, w_WO=w
            )
            continue
        belief = predict(belief, t - belief.time, flight)
        np.testing.assert_allclose(belief.p_WCoM, p, atol=1e-12)
        belief = update(belief, PoseMeasurement(t, p, R), flight, p_OCoM)
        np.testing.assert_allclose(belief.p_WCoM, p, atol=1e-12)
        np.testing.assert_allclose(belief.v_WCoM, v - [0, 0, 9.81 * t], atol=1e-11)
        assert angle(belief.R_WO.T @ R) < 1e-7
    unaware = predict(belief, 0.1, NOISE)
    fall = predict(belief, 0.1, flight).p_WCoM - unaware.p_WCoM
    np.testing.assert_allclose(fall, [0, 0, -9.81 * 0.01 / 2], atol=1e-15)


def test_errors_of_a_thrown_object_are_as_large_as_the_covariance_says():
    """Also where the centre of mass is far from the frame that is measured."""
    p_OCoM = np.array([0.3, -0.2, 0.1])
    flight = dataclasses.replace(
        NOISE, gravity=9.81, acceleration=1e-6, initial_velocity=3, orientation=0.01
    )
    normalised = {True: [], False: []}
    runs, steps = 60, 15
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        v, w = rng.normal(scale=3, size=3), rng.normal(scale=0.5, size=3)
        R_start = Rotation.random(rng=rng)
        for modelled in normalised:
            rng = np.random.default_rng(seed)
            belief = None
            for k in range(steps):
                t = k * DT
                p_WCoM = t * v + np.array([0, 0, -9.81 * t**2 / 2])
                R_WO = Rotation.from_rotvec(t * w) * R_start
                R_z = Rotation.from_rotvec(rng.normal(scale=0.01, size=3)) * R_WO
                p_WO = p_WCoM - R_WO.apply(p_OCoM) + rng.normal(scale=NOISE.position, size=3)
                z = p_WO + R_z.apply(p_OCoM)
                told = p_OCoM if modelled else None
                if belief is None:
                    belief = first_belief(PoseMeasurement(t, z, R_z.as_matrix()), flight, told)
                else:
                    belief = update(
                        predict(belief, DT, flight),
                        PoseMeasurement(t, z, R_z.as_matrix()),
                        flight,
                        told,
                    )
            e = np.concatenate([p_WCoM - belief.p_WCoM, v - [0, 0, 9.81 * t] - belief.v_WCoM])
            normalised[modelled].append(e @ np.linalg.solve(belief.P_position, e))
    low, high = chi2.ppf([0.0005, 0.9995], 6 * runs) / runs
    assert low < np.mean(normalised[True]) < high
    assert np.mean(normalised[False]) > 2 * high
