"""Filter on pose and twist of a moving object, with several models of its motion.

Each model is a Kalman filter with the error state (theta, p, w, v, b) that assumes a constant twist
disturbed by white accelerations of its own density, and optionally a slowly changing offset b of
measured positions. The interacting-multiple-model algorithm
(Blom and Bar-Shalom, IEEE Transactions on Automatic Control 33(8), 1988; Bar-Shalom, Li and
Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section 11.6) weighs
the models by the likelihoods of the measurements, and mixes them before each prediction. With a
single model it is the plain filter.

A measurement is a residual with its Jacobian and its noise (`correct`); a measured pose is one kind
(`pose_residual`).
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.pose_belief import (
    PoseBelief,
    PoseFilterNoise,
    PoseMeasurement,
    shifted,
)
from drake_pregrasp.geometry.rotations import (
    rotation_matrix,
    rotation_vector,
    skew,
)

_I = np.eye(3)
_DRIFT, _MIXED, _RATE = (
    np.kron(np.array(block), np.eye(6))
    for block in ([[1, 0], [0, 0]], [[0, 1], [1, 0]], [[0, 0], [0, 1]])
)  # Places of dt³/3, dt²/2 and dt in the process noise.


def merged(belief: PoseBelief) -> PoseBelief:
    """Returns the mean and the covariance of the mixture as a belief of one model.

    The covariance contains the spread of the models' means.
    """
    if len(belief.weights) == 1:
        return belief
    R = belief.R_WO[belief.weights.argmax()]
    x = coordinates(belief, R)
    mean = belief.weights @ x
    d = x - mean
    P = np.einsum("k,kij->ij", belief.weights, belief.P + d[:, :, None] * d[:, None, :])
    return PoseBelief(
        belief.time,
        np.ones(1),
        (rotation_matrix(mean[:3]) @ R)[None],
        mean[None, 3:6],
        mean[None, 6:12],
        P[None],
        mean[None, 12:],
    )


def coordinates(belief: PoseBelief, R: FloatArray) -> FloatArray:
    """Returns the means (theta, p, w, v, b), shape (K, 12 + m), with theta from R, shape (3, 3)."""
    theta = rotation_vector(belief.R_WO @ R.T)
    return np.hstack([theta, belief.p_WCoM, belief.V_WCoM, belief.b_W])


def mixed(belief: PoseBelief, dt: float, noise: PoseFilterNoise) -> PoseBelief:
    """Returns the belief with which each model starts a prediction.

    At the rate λ of manoeuvres the model is drawn anew, each with the same probability, so that the
    transition matrix is exp(-λ dt) I + (1 - exp(-λ dt)) / K. Each model then starts from the
    mixture of its own belief and of the mean of all.

    Args:
        belief: Belief of the K models.
        dt: Length of the prediction, in seconds.
        noise: Noise and motion that the filter assumes.
    """
    k = len(belief.weights)
    if k == 1:
        return belief
    kept = math.exp(-noise.manoeuvre_rate * dt) * belief.weights
    weights = kept + -math.expm1(-noise.manoeuvre_rate * dt) / k
    own = kept / weights
    R = belief.R_WO[belief.weights.argmax()]
    x = coordinates(belief, R)
    mean = belief.weights @ x
    d = x - mean
    spread = d[:, :, None] * d[:, None, :]
    P = np.einsum("k,kij->ij", belief.weights, belief.P + spread)
    x = mean + own[:, None] * d
    own = own[:, None, None]
    return PoseBelief(
        belief.time,
        weights,
        rotation_matrix(x[:, :3]) @ R,
        x[:, 3:6],
        x[:, 6:12],
        own * belief.P + (1 - own) * P + own * (1 - own) * spread,
        x[:, 12:],
    )


def predict(belief: PoseBelief, dt: float, noise: PoseFilterNoise) -> PoseBelief:
    """Returns the belief `dt` seconds later, without a measurement.

    Raises:
        InvalidArgumentError: If `dt` is negative.
    """
    if dt < 0:
        raise InvalidArgumentError(f"a belief cannot be predicted {dt} s back in time")
    if dt == 0:
        return belief
    belief = mixed(belief, dt, noise)
    F = transitions(belief, dt, noise)
    p_WCoM, V_WCoM = belief.p_WCoM + belief.V_WCoM[:, 3:] * dt, belief.V_WCoM
    if noise.gravity:
        fall = np.array([0.0, 0.0, -noise.gravity])
        p_WCoM = p_WCoM + fall * (dt**2 / 2)
        V_WCoM = V_WCoM + np.append(np.zeros(3), fall * dt)
    return PoseBelief(
        belief.time + dt,
        belief.weights,
        F[:, :3, :3] @ belief.R_WO,
        p_WCoM,
        V_WCoM,
        F @ belief.P @ F.transpose(0, 2, 1) + process_noise(noise, dt),
        noise.bias_step(dt)[0] * belief.b_W if noise.bias else belief.b_W,
    )


def predicted_mean(
    belief: PoseBelief, dt: float, gravity: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns the mean of `predict` for a belief of one model: R_WO, p_WCoM and V_WCoM.

    Args:
        belief: Belief of one model.
        dt: Length of the prediction, in seconds.
        gravity: Mean acceleration along -z of W, in m/s².
    """
    V_WCoM = belief.V_WCoM[0].copy()
    R_WO = rotation_matrix(V_WCoM[:3] * dt) @ belief.R_WO[0]
    p_WCoM = belief.p_WCoM[0] + V_WCoM[3:] * dt
    p_WCoM[2] -= gravity * (dt**2 / 2)
    V_WCoM[5] -= gravity * dt
    return R_WO, p_WCoM, V_WCoM


def process_noise(noise: PoseFilterNoise, dt: float) -> FloatArray:
    """Returns the covariance that dt adds, by white accelerations and changes of the offset.

    Its shape is (K, 12 + m, 12 + m), with the m components of the offset.
    """
    Q = dt**3 / 3 * _DRIFT + dt**2 / 2 * _MIXED + dt * _RATE
    densities = np.repeat(noise.densities, 3, axis=1)  # Of rotation, and of translation.
    added = np.asarray(Q * np.hstack([densities, densities])[:, None, :])
    if not noise.bias:
        return added
    whole = np.tile(noise.bias_step(dt)[1] * np.eye(15), (len(added), 1, 1))
    whole[:, :12, :12] = added
    return whole


def transitions(belief: PoseBelief, dt: float, noise: PoseFilterNoise) -> FloatArray:
    """Returns the transition matrices of the error state over `dt` seconds.

    Their shape is (K, 12 + m, 12 + m), with the m components of the offset.

    With Exp(turn) the rotation of the step, an error theta turns with it, and an error e of w_WO
    adds J(turn) e dt to theta, with the left Jacobian J of Exp.
    """
    size = belief.P.shape[-1]
    F, turns = np.tile(np.eye(size), (len(belief.weights), 1, 1)), belief.V_WCoM[:, :3] * dt
    F[:, :3, :3], F[:, :3, 6:9] = rotation_matrix(turns), dt * rotation_matrix(turns, order=1)
    F[:, 3:6, 9:12] = dt * _I
    if noise.bias:
        F[:, 12:, 12:] *= noise.bias_step(dt)[0]
    return F


@dataclass(frozen=True, eq=False)
class Correction:
    """A belief corrected by a measurement.

    Attributes:
        belief: Belief after the measurement.
        squares: Squares of the residual in units of its standard deviation, shape (K, m), each
            given those before it. Their sum over any leading block is νᵀ S⁻¹ ν of that block, which
            is chi-square distributed.
    """

    belief: PoseBelief
    squares: FloatArray


def correct(prior: PoseBelief, residual: FloatArray, H: FloatArray, R: FloatArray) -> Correction:
    """Returns the belief after a measurement.

    The measurement is z = h(x) + n, with the noise n of the covariance R. With S = H P Hᵀ + R and
    its factor L Lᵀ = S, the gain is P Hᵀ S⁻¹, and the weights are multiplied by N(ν; 0, S).

    Args:
        prior: Belief before the measurement, at its time.
        residual: Difference ν = z - h(x) for each model's mean, shape (K, m).
        H: Jacobians of h with respect to the error state of size n, shape (K, m, n).
        R: Covariance of the noise, shape (m, m), positive definite; or of each model, (K, m, m).
    """
    HP = H @ prior.P
    L = np.linalg.cholesky(HP @ H.transpose(0, 2, 1) + R)
    whitened = np.linalg.solve(L, np.concatenate([HP, residual[:, :, None]], axis=2))
    A, y = whitened[:, :, :-1], whitened[:, :, -1]
    A_T = A.transpose(0, 2, 1)
    squares = y * y
    with np.errstate(divide="ignore"):  # A model may have become impossible.
        scores = np.log(prior.weights) - squares.sum(axis=1) / 2
    scores -= np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1)
    weights = np.exp(scores - scores.max())
    moved = shifted(prior, (A_T @ y[:, :, None])[:, :, 0], prior.P - A_T @ A)
    return Correction(replace(moved, weights=weights / weights.sum()), squares)


def pose_residual(
    prior: PoseBelief,
    measurement: PoseMeasurement,
    noise: PoseFilterNoise,
    p_OCoM: FloatArray | None = None,
    noise_factors: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns residual, Jacobian and noise of a measured pose, for `correct`.

    The residual is the rotation vector from the predicted to the measured orientation, and the
    difference of the origins of O, shape (K, 6), or their combinations that were measured.

    Args:
        prior: Belief before the measurement, at its time.
        measurement: The measured pose.
        noise: Noise that the filter assumes.
        p_OCoM: Centre of mass in O, shape (3,), in metres; the origin of O by default.
        noise_factors: Factors on the assumed variances of a measured orientation and position,
            shape (2,); 1 by default.
    """
    thetas = rotation_vector(measurement.R_WO @ prior.R_WO.transpose(0, 2, 1))
    H = np.tile(np.eye(6, prior.P.shape[-1]), (len(thetas), 1, 1))
    offset = measurement.p_WO - prior.p_WCoM
    if p_OCoM is not None:
        offset = offset + prior.R_WO @ p_OCoM
        H[:, 3:6] = origin_jacobian(prior, p_OCoM)
    if noise.bias:
        offset = offset - prior.b_W
        H[:, 3:6, 12:] = _I
    variances = noise.variances if noise_factors is None else noise_factors * noise.variances
    Z = measurement.directions
    return np.hstack([thetas, offset]) @ Z.T, Z @ H, np.diag(np.repeat(variances, 3))


def origin_jacobian(belief: PoseBelief, p_OCoM: FloatArray) -> FloatArray:
    """Returns the Jacobians of p_WO with respect to the error state of size n, shape (K, 3, n).

    With a = R_WO p_OCoM the origin of O is at p_WCoM - a, so that an error theta moves it by
    a x theta.
    """
    H = np.zeros((*belief.P.shape[:1], 3, belief.P.shape[-1]))
    H[:, :, :3], H[:, :, 3:6] = skew(belief.R_WO @ p_OCoM), _I
    return H


def origin_covariance(belief: PoseBelief, p_OCoM: FloatArray | None = None) -> FloatArray:
    """Returns the covariance of p_WO of a belief of one model, shape (3, 3), in m²."""
    if p_OCoM is None:
        return belief.P[0, 3:6, 3:6]
    H = origin_jacobian(belief, p_OCoM)[0]
    return np.asarray(H @ belief.P[0] @ H.T)


def shown_covariance(belief: PoseBelief) -> FloatArray:
    """Returns the covariances of the errors of theta and of p + b, which sensors show.

    Their shape is (K, 6, 6).
    """
    P = belief.P[:, :6, :6]
    if not belief.b_W.size:
        return P
    P, mixed_part = P.copy(), belief.P[:, :6, 12:]
    P[:, :, 3:] += mixed_part
    P[:, 3:, :] += mixed_part.transpose(0, 2, 1)
    P[:, 3:, 3:] += belief.P[:, 12:, 12:]
    return P


def filter_step(
    earlier: PoseBelief,
    measurement: PoseMeasurement,
    noise: PoseFilterNoise,
    p_OCoM: FloatArray | None = None,
    noise_factors: FloatArray | None = None,
) -> tuple[PoseBelief, Correction]:
    """Returns the prior at a measurement's time, and its correction.

    Args:
        earlier: Belief at an earlier time.
        measurement: The measured pose; this and the other arguments are as for `pose_residual`.
        noise: Noise and motion that the filter assumes.
        p_OCoM: Centre of mass in O, shape (3,), in metres.
        noise_factors: Factors on the assumed variances of a measured orientation and position,
            shape (2,); 1 by default.

    Raises:
        InvalidArgumentError: If the measurement is older than the belief.
    """
    prior = predict(earlier, measurement.time - earlier.time, noise)
    return prior, correct(prior, *pose_residual(prior, measurement, noise, p_OCoM, noise_factors))
