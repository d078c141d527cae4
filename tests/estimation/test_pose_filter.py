"""The filter's mean and covariance as laws: least squares, equivariance, and sampled motions."""

from dataclasses import replace

import numpy as np
import pytest
from sampled_motion import measured, normalized_squares, sampled_motion
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from drake_pregrasp import InvalidArgumentError, PoseFilterNoise
from drake_pregrasp.arrays import pack
from drake_pregrasp.estimation.pose_filter import PoseMeasurement, first_belief, predict, update
from drake_pregrasp.estimation.pose_smoother import filter_poses

NOISE = PoseFilterNoise(
    position=1e-3,
    orientation=5e-3,
    acceleration=1e-2,
    angular_acceleration=5e-2,
    initial_velocity=0.1,
    initial_angular_velocity=0.5,
)
FLIGHT = replace(NOISE, gravity=9.81, acceleration=1e-6, initial_velocity=3, orientation=0.01)
DT = 0.05


def filtered(times, p, R, noise=NOISE, p_OCoM=None):
    return filter_poses(np.asarray(times), np.asarray(p), R.as_matrix(), noise, p_OCoM)[-1]


def some_belief(turn=None):
    rng = np.random.default_rng(2)
    p = rng.normal(size=(6, 3))
    R = Rotation.from_rotvec(0.1 * np.arange(6)[:, None] * [0.2, 0.5, 1.0])
    if turn is not None:
        p, R = turn.apply(p), turn * R
    return filtered(DT * np.arange(6), p, R)


def test_predicting_in_two_steps_is_predicting_in_one():
    belief = some_belief()
    once, twice = predict(belief, 0.1, NOISE), predict(predict(belief, 0.04, NOISE), 0.06, NOISE)
    # The orientation's covariance is to second order in the turn of a step.
    np.testing.assert_allclose(pack(once), pack(twice), rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(once.P_position, twice.P_position, rtol=1e-9)
    with pytest.raises(InvalidArgumentError, match="back in time"):
        predict(belief, -0.1, NOISE)


def test_filter_is_equivariant_under_a_turn_of_the_world():
    turn = Rotation.from_rotvec([0.3, -1.0, 0.5])
    here, there = some_belief(), some_belief(turn)
    np.testing.assert_allclose(there.p_WCoM, turn.apply(here.p_WCoM), atol=1e-12)
    np.testing.assert_allclose(there.w_WO, turn.apply(here.w_WO), atol=1e-12)
    np.testing.assert_allclose(there.R_WO, turn.as_matrix() @ here.R_WO, atol=1e-12)


@pytest.mark.parametrize("rate", [0.0, 4.0, 10.0, 40.0])
def test_errors_of_orientation_and_angular_velocity_are_carried_on_exactly(rate):
    """The predicted covariance against finite differences of the motion, by scipy's rotations."""
    w, A = rate * np.array([0.6, -0.64, 0.48]), np.random.default_rng(8).normal(size=(6, 6))
    P, steady = 1e-4 * A @ A.T, replace(NOISE, angular_acceleration=0)
    first = first_belief(PoseMeasurement(0.0, np.zeros(3), np.eye(3)), steady)
    predicted = predict(replace(first, w_WO=w, P_orientation=P), DT, steady)
    step, columns = 1e-5, []
    for axis in np.eye(3):
        after, before = (Rotation.from_rotvec((w + s * axis) * DT) for s in (step, -step))
        columns.append((after * before.inv()).as_rotvec() / (2 * step))
    turn = Rotation.from_rotvec(w * DT).as_matrix()
    F = np.block([[turn, np.array(columns).T], [np.zeros((3, 3)), np.eye(3)]])
    np.testing.assert_allclose(predicted.P_orientation, F @ P @ F.T, rtol=0, atol=1e-11)


RUNS = 60
BAND = chi2.ppf([0.0005, 0.9995], 6 * RUNS) / RUNS


@pytest.mark.parametrize(
    ("noise", "p_OCoM"), [(NOISE, np.zeros(3)), (FLIGHT, np.array([0.3, -0.2, 0.1]))]
)
def test_errors_are_as_large_as_the_covariance_says(noise, p_OCoM):
    """The mean normalised squared error of many runs lies in its chi-square band.

    Also in flight, with the centre of mass far from the frame that is measured; a filter that
    does not know how far is too sure of itself.
    """
    squares, unaware = [], []
    for seed in range(RUNS):
        rng = np.random.default_rng(seed)
        p, v, R, w = sampled_motion(rng, noise, DT)
        z = (DT * np.arange(40), *measured(rng, p, R, noise, p_OCoM), noise)
        truth = p[-1], v[-1], R[-1], w[-1]
        squares.append(normalized_squares(filtered(*z, p_OCoM), *truth))
        if np.any(p_OCoM) and seed < 10:
            unaware.append(normalized_squares(filtered(*z, None), *truth))
    means = np.mean(squares, axis=0)
    assert np.all((BAND[0] < means) & (means < BAND[1]))
    assert not np.any(p_OCoM) or np.mean(unaware, axis=0)[0] > 2 * BAND[1]


def test_in_free_flight_without_noise_the_parabola_is_followed_exactly():
    flight = replace(NOISE, gravity=9.81, initial_velocity=10)
    v, w, p_OCoM = np.array([1.0, -2, 4]), np.array([2.0, 3, -1]), np.array([0.02, 0, -0.03])
    first = first_belief(PoseMeasurement(0.0, np.zeros(3), np.eye(3)), flight, p_OCoM)
    belief = replace(first, v_WCoM=v, w_WO=w)
    for t in DT / 10 * np.arange(1, 400):
        p = t * v + np.array([0, 0, -9.81 * t**2 / 2])
        R = Rotation.from_rotvec(t * w).as_matrix()
        belief = predict(belief, t - belief.time, flight)
        np.testing.assert_allclose(belief.p_WCoM, p, atol=1e-12)
        belief = update(belief, PoseMeasurement(t, p, R), flight, p_OCoM)
    np.testing.assert_allclose(belief.v_WCoM, v - [0, 0, 9.81 * t], atol=1e-11)
    np.testing.assert_allclose(belief.R_WO, R, atol=1e-7)


MEASURED = ("position", "orientation")


@pytest.mark.parametrize("name", vars(NOISE))
def test_assumptions_out_of_range_are_refused_by_name(name):
    for value in (np.nan, np.inf, -np.inf, "abc", None, 1j, 10**400):
        with pytest.raises(InvalidArgumentError, match=f"^{name} must be finite.*not {value}"):
            replace(NOISE, **{name: value})
    for value in (-1.0, 0.0):
        if name in MEASURED or (name != "gravity" and value < 0):
            wanted = "finite and above 0" if name in MEASURED else "finite and at least 0"
            with pytest.raises(InvalidArgumentError, match=f"^{name} must be {wanted}, not"):
                replace(NOISE, **{name: value})
        else:
            assert getattr(replace(NOISE, **{name: value}), name) == value
