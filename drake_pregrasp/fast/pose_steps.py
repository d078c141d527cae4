"""Step of the pose filter, from a belief to its correction by the next measured pose."""

from math import exp, log

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.pose_belief import PoseBelief, PoseFilterNoise, PoseMeasurement
from drake_pregrasp.estimation.pose_filter import Correction
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.geometry.rotations import rotation_components, rotation_rows

_ZERO, _ONE = np.zeros(3), np.ones(1)
_NO_BIAS = 1.0, 0.0

exponential, logarithm = compiled()(rotation_rows), compiled()(rotation_components)


@compiled()
def multiply(A, B, product):  # type: ignore[no-untyped-def]
    """Writes the product of two matrices of shape (3, 3)."""
    for row in range(3):
        for column in range(3):
            product[row, column] = (
                A[row, 0] * B[0, column] + A[row, 1] * B[1, column] + A[row, 2] * B[2, column]
            )


@compiled()
def rotate(theta, order, R):  # type: ignore[no-untyped-def]
    """Writes `rotation_matrix`, shape (3, 3)."""
    (a, b, c), (d, e, f), (g, h, i) = exponential(theta[0], theta[1], theta[2], order)
    R[0, 0], R[0, 1], R[0, 2] = a, b, c
    R[1, 0], R[1, 1], R[1, 2] = d, e, f
    R[2, 0], R[2, 1], R[2, 2] = g, h, i


@compiled()
def turn_between(A, B, work, theta):  # type: ignore[no-untyped-def]
    """Writes the rotation vector of A Bᵀ, shape (3,)."""
    multiply(A, B.T, work)
    a, b, c = work[0], work[1], work[2]
    theta[0], theta[1], theta[2] = logarithm(a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2])


@compiled()
def write_joint(weights, R, x, P, work, mean, joint):  # type: ignore[no-untyped-def]
    """Writes the mean and the covariance of a mixture; the arguments are as in `write_mixed`.

    Afterwards x has the differences from the mean, and work[1] the orientation from which theta is
    counted.
    """
    models, size, likeliest = len(weights), len(mean), 0
    for k in range(1, models):
        if weights[k] > weights[likeliest]:
            likeliest = k
    mean[:] = 0.0
    joint[:] = 0.0
    work[1, :, :] = R[likeliest]
    for k in range(models):
        turn_between(R[k], work[1], work[0], x[k])
        for i in range(size):
            mean[i] += weights[k] * x[k, i]
    for k in range(models):
        for i in range(size):
            x[k, i] -= mean[i]
        for i in range(size):
            for j in range(size):
                joint[i, j] += weights[k] * (P[k, i, j] + x[k, i] * x[k, j])


@compiled()
def write_mixed(weights, R, x, P, kept, work, mean, joint):  # type: ignore[no-untyped-def]
    """Mixes the beliefs of models in their places, as `mixed` does.

    Args:
        weights: Probabilities, shape (K,).
        R: Orientations, shape (K, 3, 3).
        x: Memory (3), and then p, w, v and b, shape (K, n).
        P: Covariances, shape (K, n, n).
        kept: Probability that the model is not drawn anew.
        work: Memory, shape (4, 3, 3).
        mean: Memory, shape (n,).
        joint: Memory, shape (n, n).
    """
    models, size = len(weights), len(mean)
    write_joint(weights, R, x, P, work, mean, joint)
    for k in range(models):
        own = kept * weights[k]
        weights[k] = own + (1 - kept) / models
        own /= weights[k]
        for i in range(size):
            for j in range(size):
                spread = own * (1 - own) * x[k, i] * x[k, j]
                P[k, i, j] = own * P[k, i, j] + (1 - own) * joint[i, j] + spread
        for i in range(size):
            x[k, i] = mean[i] + own * x[k, i]
        rotate(x[k], 0, work[0])
        multiply(work[0], work[1], R[k])


@compiled()
def write_prior(R, x, P, dt, gravity, densities, bias_step, work, rows):  # type: ignore[no-untyped-def]
    """Predicts the belief of one model in its place, as `predict` does.

    Args:
        R: Orientation, shape (3, 3).
        x: Memory (3), and then p, w, v and b, shape (n,).
        P: Covariance, shape (n, n).
        dt: Length of the prediction, in seconds.
        gravity: Mean acceleration along -z of W, in m/s².
        densities: Densities of angular and linear acceleration, shape (2,).
        bias_step: `PoseFilterNoise.bias_step`.
        work: Memory, shape (4, 3, 3).
        rows: Memory, shape (3, n).
    """
    size, (bias_kept, bias_added) = len(x), bias_step
    turn, jacobian = work[0], work[1]
    for i in range(3):
        x[i] = x[6 + i] * dt
        x[3 + i] += x[9 + i] * dt
    x[5] -= gravity * (dt * dt / 2)
    x[11] -= gravity * dt
    rotate(x, 0, turn)
    rotate(x, 1, jacobian)
    work[2, :, :] = R
    multiply(turn, work[2], R)
    for part in range(2):  # F P, and then its transpose by Fᵀ, since P is symmetric.
        M = P if part == 0 else P.T
        for i in range(3):
            for j in range(size):
                total = 0.0
                for k in range(3):
                    total += turn[i, k] * M[k, j] + dt * jacobian[i, k] * M[6 + k, j]
                rows[i, j] = total
        for i in range(3):
            for j in range(size):
                M[i, j] = rows[i, j]
                M[3 + i, j] += dt * M[9 + i, j]
        for i in range(12, size):
            for j in range(size):
                M[i, j] *= bias_kept
    for i in range(6):
        density = densities[i // 3] * dt
        P[i, i] += density * (dt * dt / 3)
        P[i, 6 + i] += density * (dt / 2)
        P[6 + i, i] += density * (dt / 2)
        P[6 + i, 6 + i] += density
    for i in range(12, size):
        x[i] *= bias_kept
        P[i, i] += bias_added


@compiled()
def write_correction(R, x, P, squares, com, measured, directions, variances, work, rows):  # type: ignore[no-untyped-def]
    """Corrects the prior of one model in its place, and returns the logarithm of its likelihood.

    The six components of the residual are used one after another, which is the same as `correct`.

    Args:
        R: Orientation, shape (3, 3).
        x: Memory (3), and then p, w, v and b, shape (n,).
        P: Covariance, shape (n, n).
        squares: As in `Correction`, shape (6,).
        com: Centre of mass in O, shape (3,), in metres.
        measured: Measured orientation, and position, shape (12,).
        directions: As in `PoseMeasurement`, shape (6, 6).
        variances: Variances of measured orientation and position.
        work: Memory, shape (4, 3, 3).
        rows: Memory, shape (3, n).
    """
    size = len(x)
    cross, shift, row, residual, h = work[3], rows[0], rows[1], rows[2, :6], rows[2, 6:12]
    turn_between(measured[:9].reshape(3, 3), R, work[0], residual)
    a = R[0, 0] * com[0] + R[0, 1] * com[1] + R[0, 2] * com[2]
    b = R[1, 0] * com[0] + R[1, 1] * com[1] + R[1, 2] * com[2]
    c = R[2, 0] * com[0] + R[2, 1] * com[1] + R[2, 2] * com[2]
    cross[0, 0], cross[0, 1], cross[0, 2] = 0.0, -c, b
    cross[1, 0], cross[1, 1], cross[1, 2] = c, 0.0, -a
    cross[2, 0], cross[2, 1], cross[2, 2] = -b, a, 0.0
    residual[3] = measured[9] - x[3] + a
    residual[4] = measured[10] - x[4] + b
    residual[5] = measured[11] - x[5] + c
    for i in range(12, size):
        residual[i - 9] -= x[i]
    shift[:] = 0.0
    score = 0.0
    for m in range(6):
        error, variance = 0.0, variances[m // 3]
        row[:] = 0.0
        for k in range(6):
            h[k] = directions[m, k]
            if k < 3:
                for i in range(3):
                    h[k] += directions[m, 3 + i] * cross[i, k]
            error += directions[m, k] * residual[k] - h[k] * shift[k]
            for j in range(size):
                row[j] += h[k] * P[k, j]
        for k in range(12, size):  # An offset moves what is measured as the position does.
            error -= directions[m, k - 9] * shift[k]
            for j in range(size):
                row[j] += directions[m, k - 9] * P[k, j]
        for k in range(6):
            variance += h[k] * row[k]
        for k in range(12, size):
            variance += directions[m, k - 9] * row[k]
        squares[m] = error * error / variance
        score -= (squares[m] + log(variance)) / 2
        for i in range(size):
            gain = row[i] / variance
            shift[i] += gain * error
            for j in range(size):
                P[i, j] -= gain * row[j]
    rotate(shift, 0, work[0])
    work[1, :, :] = R
    multiply(work[0], work[1], R)
    for i in range(3, size):
        x[i] += shift[i]
    return score


@compiled("void(f8[::1], f8[:,:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1], f8[::1], f8[:,::1])")
def write_merged(weights, R, x, P, R_mean, mean, joint):  # type: ignore[no-untyped-def]
    """Writes `merged`; the arguments are as in `write_mixed`, and the mean orientation."""
    work = np.empty((3, 3, 3))
    write_joint(weights, R, x, P, work, mean, joint)
    rotate(mean, 0, work[0])
    multiply(work[0], work[1], R_mean)


@compiled(
    "void(f8[:,::1], f8[:,:,:,::1], f8[:,:,::1], f8[:,:,:,::1], f8[:,::1], f8[::1], f8[::1],"
    " f8[:,::1], f8, f8, f8, f8[:,::1], UniTuple(f8, 2), UniTuple(f8, 2))"
)
def write_step(  # type: ignore[no-untyped-def]
    weights,
    R,
    x,
    P,
    squares,
    com,
    measured,
    directions,
    dt,
    rate,
    gravity,
    densities,
    variances,
    bias_step,
):
    """Writes the prior and its correction, as `filter_step` does.

    Args:
        weights: Probabilities of prior and posterior, shape (2, K). The belief before the step is
            in the place of the prior, here and in the next three.
        R: Orientations, shape (2, K, 3, 3).
        x: Memory (3), and p, w, v and b, shape (2, K, n).
        P: Covariances, shape (2, K, n, n).
        squares: As in `Correction`, shape (K, 6).
        com: Centre of mass in O, shape (3,), in metres.
        measured: Measured orientation, and position, shape (12,).
        directions: As in `PoseMeasurement`, shape (6, 6).
        dt: Seconds from the belief to the measurement.
        rate: Rate of manoeuvres, in 1/s.
        gravity: Mean acceleration along -z of W, in m/s².
        densities: Densities of angular and linear acceleration, shape (K, 2).
        variances: Variances of measured orientation and position, in rad² and m².
        bias_step: `PoseFilterNoise.bias_step` of dt.
    """
    models, size = weights.shape[1], x.shape[2]
    work, rows, joint = np.empty((4, 3, 3)), np.empty((3, size)), np.empty((size, size))
    if models > 1 and dt > 0:
        write_mixed(weights[0], R[0], x[0], P[0], exp(-rate * dt), work, rows[0], joint)
    largest, total = -np.inf, 0.0
    for k in range(models):
        if dt > 0:
            own = R[0, k], x[0, k], P[0, k]
            write_prior(*own, dt, gravity, densities[k], bias_step, work, rows)
        for i in range(size):
            x[1, k, i] = x[0, k, i]
            for j in range(size):
                P[1, k, i, j] = P[0, k, i, j]
        R[1, k] = R[0, k]
        after = R[1, k], x[1, k], P[1, k], squares[k]
        score = write_correction(*after, com, measured, directions, variances, work, rows)
        weights[1, k] = log(weights[0, k]) + score
        largest = max(largest, weights[1, k])
    for k in range(models):
        weights[1, k] = exp(weights[1, k] - largest)
        total += weights[1, k]
    for k in range(models):
        weights[1, k] /= total


def compiled_filter_step(
    earlier: PoseBelief,
    measurement: PoseMeasurement,
    noise: PoseFilterNoise,
    p_OCoM: FloatArray | None = None,
    noise_factors: FloatArray | None = None,
) -> tuple[PoseBelief, Correction]:
    """See `filter_step`."""
    k, dt = len(earlier.weights), measurement.time - earlier.time
    if dt < 0:
        raise InvalidArgumentError(f"a belief cannot be predicted {dt} s back in time")
    size = earlier.P.shape[-1]
    weights, R, x = np.empty((2, k)), np.empty((2, k, 3, 3)), np.empty((2, k, size))
    P, squares = np.empty((2, k, size, size)), np.empty((k, 6))
    variances = noise.variances if noise_factors is None else noise_factors * noise.variances
    weights[0], R[0], P[0] = earlier.weights, earlier.R_WO, earlier.P
    x[0, :, 3:6], x[0, :, 6:12], x[0, :, 12:] = earlier.p_WCoM, earlier.V_WCoM, earlier.b_W
    write_step(
        weights,
        R,
        x,
        P,
        squares,
        _ZERO if p_OCoM is None else p_OCoM,
        np.concatenate([measurement.R_WO.ravel(), measurement.p_WO]),
        np.ascontiguousarray(measurement.directions),
        dt,
        noise.manoeuvre_rate,
        noise.gravity,
        noise.densities,
        tuple(variances.tolist()),
        noise.bias_step(dt) if noise.bias else _NO_BIAS,
    )
    prior, posterior = (
        PoseBelief(measurement.time, w, R, x[:, 3:6], x[:, 6:12], P, x[:, 12:])
        for w, R, x, P in zip(weights, R, x, P, strict=True)
    )
    return prior, Correction(posterior, squares)


def compiled_merged(belief: PoseBelief) -> PoseBelief:
    """See `merged`."""
    k = len(belief.weights)
    if k == 1:
        return belief
    n = belief.P.shape[-1]
    x, R, mean, P = np.empty((k, n)), np.empty((1, 3, 3)), np.empty((1, n)), np.empty((1, n, n))
    x[:, 3:6], x[:, 6:12], x[:, 12:] = belief.p_WCoM, belief.V_WCoM, belief.b_W
    write_merged(belief.weights, belief.R_WO, x, belief.P, R[0], mean[0], P[0])
    return PoseBelief(belief.time, _ONE, R, mean[:, 3:6], mean[:, 6:12], P, mean[:, 12:])
