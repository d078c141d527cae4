"""The filter's mean and covariance as laws: least squares, equivariance, and sampled motions."""

from dataclasses import replace

import numpy as np
import pytest
from sampled_motion import measured, normalized_squares, sampled_motion
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, multivariate_normal

from drake_pregrasp import InvalidArgumentError, PoseFilterNoise
from drake_pregrasp.arrays import pack
from drake_pregrasp.config.planner_config import EstimatorConfig, filter_noise
from drake_pregrasp.estimation.pose_belief import (
    MODELS,
    PoseMeasurement,
    boosted,
    first_belief,
)
from drake_pregrasp.estimation.pose_filter import (
    correct,
    filter_step,
    merged,
    mixed,
    pose_residual,
    predict,
    predicted_mean,
)

NOISE = PoseFilterNoise(
    position=1e-3,
    orientation=5e-3,
    acceleration=1e-2,
    angular_acceleration=5e-2,
    initial_velocity=0.1,
    initial_angular_velocity=0.5,
)
MIXTURE = replace(filter_noise(EstimatorConfig()), manoeuvre_rate=2.0)
FLIGHT = replace(NOISE, gravity=9.81, acceleration=1e-6, initial_velocity=3, orientation=0.01)
DT = 0.05


def filtered(times, p, R, noise=NOISE, p_OCoM=None):
    belief = None
    for measurement in map(PoseMeasurement, times, p, R.as_matrix()):
        if belief is None:
            belief = first_belief(measurement, noise, p_OCoM)
        else:
            belief = filter_step(belief, measurement, noise, p_OCoM)[1].belief
    return belief


def some_belief(turn=None, noise=NOISE, shift=(0.0, 0.0, 0.0), p_OCoM=None):
    """The belief after a few random poses, in a frame that is turned and shifted."""
    rng = np.random.default_rng(2)
    p = 3 * noise.position * rng.normal(size=(6, 3))
    R = Rotation.from_rotvec(0.1 * np.arange(6)[:, None] * [0.2, 0.5, 1.0])
    if turn is not None:
        p, R = turn.apply(p) + shift, turn * R
    return filtered(DT * np.arange(6), p, R, noise, p_OCoM)


def test_predicting_in_two_steps_is_predicting_in_one():
    belief = some_belief()
    once, twice = predict(belief, 0.1, NOISE), predict(predict(belief, 0.04, NOISE), 0.06, NOISE)
    # The orientation's covariance is to second order in the turn of a step.
    np.testing.assert_allclose(pack(once), pack(twice), rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(once.P[0, 3:6, 3:6], twice.P[0, 3:6, 3:6], rtol=1e-9)
    with pytest.raises(InvalidArgumentError, match="back in time"):
        predict(belief, -0.1, NOISE)


@pytest.mark.parametrize("p_OCoM", [None, np.array([0.03, -0.02, 0.05])])
def test_a_mixture_is_equivariant_under_a_rigid_motion_of_the_world(p_OCoM):
    turn, shift = Rotation.from_rotvec([0.3, -1.0, 0.5]), np.array([1.0, -2.0, 0.5])
    here = some_belief(noise=MIXTURE, p_OCoM=p_OCoM)
    there = some_belief(turn, MIXTURE, shift, p_OCoM)
    T = np.kron(np.eye(4), turn.as_matrix())
    np.testing.assert_allclose(there.weights, here.weights, atol=1e-9)
    for k in range(len(MODELS)):
        np.testing.assert_allclose(there.p_WCoM[k], turn.apply(here.p_WCoM[k]) + shift, atol=1e-11)
        np.testing.assert_allclose(there.R_WO[k], turn.as_matrix() @ here.R_WO[k], atol=1e-11)
        np.testing.assert_allclose(there.V_WCoM[k], T[:6, :6] @ here.V_WCoM[k], atol=1e-9)
        np.testing.assert_allclose(there.P[k], T @ here.P[k] @ T.T, atol=1e-11)


@pytest.mark.parametrize("rate", [0.0, 4.0, 10.0, 40.0])
def test_errors_of_orientation_and_angular_velocity_are_carried_on_exactly(rate):
    """The predicted covariance against finite differences of the motion, by scipy's rotations."""
    w, A = rate * np.array([0.6, -0.64, 0.48]), np.random.default_rng(8).normal(size=(6, 6))
    part = np.ix_(*2 * [np.r_[0:3, 6:9]])
    steady = replace(NOISE, angular_acceleration=0)
    first = first_belief(PoseMeasurement(0.0, np.zeros(3), np.eye(3)), steady)
    first.P[0][part] = P = 1e-4 * A @ A.T
    first.V_WCoM[0, :3] = w
    predicted = predict(first, DT, steady)
    step, columns = 1e-5, []
    for axis in np.eye(3):
        after, before = (Rotation.from_rotvec((w + s * axis) * DT) for s in (step, -step))
        columns.append((after * before.inv()).as_rotvec() / (2 * step))
    turn = Rotation.from_rotvec(w * DT).as_matrix()
    F = np.block([[turn, np.array(columns).T], [np.zeros((3, 3)), np.eye(3)]])
    np.testing.assert_allclose(predicted.P[0][part], F @ P @ F.T, rtol=0, atol=1e-11)


RUNS = 60
BAND = chi2.ppf([0.0005, 0.9995], 6 * RUNS) / RUNS


@pytest.mark.slow
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
            a = R[-1].apply(p_OCoM)
            at_origin = p[-1] - a, v[-1] - np.cross(w[-1], a), R[-1], w[-1]
            unaware.append(normalized_squares(filtered(*z, None), *at_origin))
    means = np.mean(squares, axis=0)
    assert np.all((BAND[0] < means) & (means < BAND[1]))
    assert not np.any(p_OCoM) or np.mean(unaware, axis=0)[0] > 2 * BAND[1]


@pytest.mark.parametrize("dt", [0.0, 0.01, 0.7])
def test_the_predicted_mean_is_that_of_the_predicted_belief(dt):
    belief = some_belief()
    expected = predict(belief, dt, FLIGHT)
    mean = predicted_mean(belief, dt, FLIGHT.gravity)
    for name, found in zip(("R_WO", "p_WCoM", "V_WCoM"), mean, strict=True):
        np.testing.assert_allclose(found, getattr(expected, name)[0], atol=1e-14, err_msg=name)


def test_in_free_flight_without_noise_the_parabola_is_followed_exactly():
    flight = replace(NOISE, gravity=9.81, initial_velocity=10)
    v, w, p_OCoM = np.array([1.0, -2, 4]), np.array([2.0, 3, -1]), np.array([0.02, 0, -0.03])
    first = first_belief(PoseMeasurement(0.0, -p_OCoM, np.eye(3)), flight, p_OCoM)
    belief = replace(first, V_WCoM=np.append(w, v)[None])
    for t in DT / 10 * np.arange(1, 400):
        p = t * v + np.array([0, 0, -9.81 * t**2 / 2])
        R = Rotation.from_rotvec(t * w).as_matrix()
        prior, new = filter_step(belief, PoseMeasurement(t, p - R @ p_OCoM, R), flight, p_OCoM)
        np.testing.assert_allclose(prior.p_WCoM[0], p, atol=1e-11)
        belief = new.belief
    np.testing.assert_allclose(belief.V_WCoM[0, 3:], v - [0, 0, 9.81 * t], atol=1e-10)
    np.testing.assert_allclose(belief.R_WO[0], R, atol=1e-7)


def test_a_correction_is_the_joint_gaussian_given_the_measurement():
    """By conditioning in the textbook form, and weights by scipy's density."""
    rng, prior = np.random.default_rng(3), predict(some_belief(noise=MIXTURE), DT, MIXTURE)
    models = len(MODELS)
    H, R = rng.normal(size=(models, 2, 12)), np.diag([1e-6, 4e-6])
    residual = 1e-3 * rng.normal(size=(models, 2))
    after = correct(prior, residual, H, R)
    likelihoods = []
    for k in range(models):
        S = H[k] @ prior.P[k] @ H[k].T + R
        K = prior.P[k] @ H[k].T @ np.linalg.inv(S)
        np.testing.assert_allclose(after.belief.P[k], prior.P[k] - K @ S @ K.T, atol=1e-12)
        dx = K @ residual[k]
        np.testing.assert_allclose(after.belief.V_WCoM[k], prior.V_WCoM[k] + dx[6:], atol=1e-10)
        squared = residual[k] @ np.linalg.solve(S, residual[k])
        assert after.squares[k].sum() == pytest.approx(squared)
        assert after.squares[k, 0] == pytest.approx(residual[k, 0] ** 2 / S[0, 0])
        likelihoods.append(multivariate_normal(cov=S).pdf(residual[k]))
    weights = prior.weights * likelihoods
    np.testing.assert_allclose(after.belief.weights, weights / weights.sum(), rtol=1e-9)


def test_residuals_of_a_pose_one_by_one_correct_as_the_whole():
    """A measurement is a residual with its Jacobian, whatever measures it."""
    p_OCoM = np.array([0.03, 0.0, -0.02])
    prior = predict(some_belief(noise=MIXTURE, p_OCoM=p_OCoM), DT, MIXTURE)
    pose = PoseMeasurement(prior.time, merged(prior).p_WCoM[0] + 2e-3, merged(prior).R_WO[0])
    residual, H, R = pose_residual(prior, pose, MIXTURE, p_OCoM)
    whole = correct(prior, residual, H, R).belief
    parts, moved = prior, np.zeros((len(MODELS), 12))
    for m in range(6):
        row, offset = H[:, m : m + 1], np.einsum("kj,kj->k", H[:, m], moved)[:, None]
        before = parts
        parts = correct(parts, residual[:, m : m + 1] - offset, row, R[m : m + 1, m : m + 1]).belief
        S = row @ before.P @ row.transpose(0, 2, 1) + R[m, m]
        gain = (before.P @ row.transpose(0, 2, 1) / S)[:, :, 0]
        moved += gain * (residual[:, m : m + 1] - offset)
    np.testing.assert_allclose(parts.weights, whole.weights, rtol=1e-9)
    np.testing.assert_allclose(parts.P, whole.P, atol=1e-14)
    np.testing.assert_allclose(parts.p_WCoM, whole.p_WCoM, atol=1e-12)


def test_mixing_keeps_the_mean_and_the_covariance_of_the_mixture():
    belief = some_belief(noise=MIXTURE)
    belief = replace(belief, weights=np.array([0.4, 0.3, 0.2, 0.1]))
    before, after = merged(belief), merged(mixed(belief, 0.1, MIXTURE))
    np.testing.assert_allclose(pack(after), pack(before), atol=1e-9)
    spread = belief.P[0, 3:6, 3:6].trace() * 0.4
    assert before.P[0, 3:6, 3:6].trace() > spread
    apart = replace(belief, p_WCoM=np.arange(4.0)[:, None] * np.eye(3)[:1])
    x = np.arange(4.0)
    variance = belief.weights @ (x - belief.weights @ x) ** 2
    inner = belief.weights @ belief.P[:, 3, 3]
    assert merged(apart).P[0, 3, 3] == pytest.approx(variance + inner)


def test_the_covariance_of_a_prediction_holds_for_any_manoeuvre_and_only_grows():
    belief = merged(some_belief(noise=MIXTURE))
    traces = [
        predict(belief, t, MIXTURE.liveliest).P[0, 3:6, 3:6].trace() for t in DT * np.arange(9)
    ]
    assert np.all(np.diff(traces) > 0)
    mixture = merged(predict(some_belief(noise=MIXTURE), 0.2, MIXTURE))
    assert predict(belief, 0.2, MIXTURE.liveliest).P[0, 3, 3] > mixture.P[0, 3, 3]


def test_a_known_change_of_the_twist_keeps_the_pose_of_its_time():
    belief, dV = some_belief(), np.array([0.1, 0.2, -0.3, 1.0, 0.5, -2.0])
    after = boosted(belief, dV, belief.time - 0.1)
    np.testing.assert_allclose(after.V_WCoM[0], belief.V_WCoM[0] + dV)
    np.testing.assert_allclose(after.p_WCoM[0], belief.p_WCoM[0] + 0.1 * dV[3:])
    added = after.P[0] - belief.P[0]
    assert added[11, 11] == pytest.approx((0.3 * 2.0) ** 2)
    assert not added[:3, 3:6].any()


MEASURED = ("position", "orientation", "bias_time")


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
