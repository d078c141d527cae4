"""One step of the pose filter, from a belief to the posterior of the next measurement."""

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.estimation import pose_filter
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.geometry.rotations import rotation_components, rotation_rows

_ZERO = np.zeros((3, 1))

exponential, logarithm = compiled()(rotation_rows), compiled()(rotation_components)


@compiled("void(f8[:,:], f8[:,:], f8[:,:])")
def multiply(A, B, product):  # type: ignore[no-untyped-def]
    """Writes the product of two matrices."""
    for row in range(A.shape[0]):
        for column in range(B.shape[1]):
            total = 0.0
            for k in range(A.shape[1]):
                total += A[row, k] * B[k, column]
            product[row, column] = total


@compiled("void(f8[::1], i8, f8[:,::1])")
def rotate(theta, order, R):  # type: ignore[no-untyped-def]
    """Writes `rotation_matrix`, shape (3, 3)."""
    (a, b, c), (d, e, f), (g, h, i) = exponential(theta[0], theta[1], theta[2], order)
    R[0, 0], R[0, 1], R[0, 2] = a, b, c
    R[1, 0], R[1, 1], R[1, 2] = d, e, f
    R[2, 0], R[2, 1], R[2, 2] = g, h, i


@compiled()
def invert(A):  # type: ignore[no-untyped-def]
    """Inverts a positive definite matrix in its place, shape (3, 3), by elimination."""
    for k in range(3):
        pivot = A[k, k]
        A[k, k] = 1.0
        for column in range(3):
            A[k, column] /= pivot
        for row in range(3):
            factor = A[row, k] if row != k else 0.0
            A[row, k] = 0.0 if row != k else A[row, k]
            for column in range(3):
                A[row, column] -= factor * A[k, column]


@compiled(
    "void(f8[:,:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,::1], f8[::1], f8[:,::1],"
    " f8[:,::1], f8, f8, f8[::1], f8[::1])"
)
def write_step(means, R, P, K, nu, squared, measured, com, dt, gravity, densities, variances):  # type: ignore[no-untyped-def]
    """Writes the prior, the innovation and the posterior, as `filter_step` does.

    Position and orientation are stacked, in this order.

    Args:
        means: p_WCoM, v_WCoM and w_WO of prior and posterior, shape (2, 3, 3). The belief before
            the step is in the place of the posterior, here and in R and P.
        R: Orientations of prior and posterior; covariances of the measurement (2) and of `nu` (2);
            and memory, shape (9, 3, 3).
        P: Covariances of prior (2) and posterior (2), and zeros, shape (8, 6, 6).
        K: Transposed gains (2), and memory, shape (4, 3, 6).
        nu: Measured p_WCoM and memory; overwritten by the innovation, shape (2, 3).
        squared: Its squares relative to its covariances, which are written, shape (2,).
        measured: Measured orientation, shape (3, 3).
        com: Centre of mass in O, shape (3, 1), in metres.
        dt: Seconds from the belief to the measurement.
        gravity: Mean acceleration along -z of W, in m/s².
        densities: Densities of linear and angular acceleration, shape (2,).
        variances: Variances of measured position and orientation, shape (2,), in m² and rad².
    """
    prior, after, turn, jacobian, inverse = means[0], means[1], R[6], R[7], R[8]
    F, A, product, square = P[4:6], P[6], P[7], 0.0
    for k in range(3):
        prior[0, k] = after[0, k] + after[1, k] * dt
        prior[1, k], prior[2, k] = after[1, k], after[2, k]
        nu[0, k], nu[1, k] = nu[0, k] - prior[0, k], after[2, k] * dt
    nu[0, 2] += gravity * (dt * dt / 2)
    prior[0, 2] -= gravity * (dt * dt / 2)
    prior[1, 2] -= gravity * dt
    rotate(nu[1], 0, turn)
    rotate(nu[1], 1, jacobian)
    multiply(turn, R[1], R[0])
    multiply(measured, R[0].T, inverse)
    a, b, c = inverse[0], inverse[1], inverse[2]
    nu[1, 0], nu[1, 1], nu[1, 2] = logarithm(a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2])
    multiply(R[0], com, product)
    for k in range(3):
        square += product[k, 0] * product[k, 0]
    for row in range(3):
        for column in range(3):
            R[2, row, column] = -variances[1] * product[row, 0] * product[column, 0]
            R[3, row, column] = variances[1] if row == column else 0.0
            F[1, row, column], F[1, row, 3 + column] = turn[row, column], dt * jacobian[row, column]
        R[2, row, row] += variances[0] + variances[1] * square
        F[0, row, row] = F[0, 3 + row, 3 + row] = F[1, 3 + row, 3 + row] = 1.0
        F[0, row, 3 + row] = dt
    for part in range(2):
        own, gain, shift, posterior = P[part], K[part], K[2], P[2 + part]
        multiply(F[part], posterior, product)
        multiply(product, F[part].T, own)
        density = densities[part] * densities[part] * dt
        for k in range(3):
            own[k, k] += density * (dt * dt / 3)
            own[k, 3 + k] += density * (dt / 2)
            own[3 + k, k] += density * (dt / 2)
            own[3 + k, 3 + k] += density
        for row in range(3):
            for column in range(3):
                inverse[row, column] = own[row, column] + R[2 + part, row, column]
                R[4 + part, row, column] = inverse[row, column]
        invert(inverse)
        multiply(inverse, own[:3], gain)
        multiply(nu[part : part + 1], gain, shift)
        multiply(inverse, nu[part : part + 1].T, product)
        squared[part] = 0.0
        for k in range(3):
            squared[part] += nu[part, k] * product[k, 0]
        for row in range(6):
            for column in range(6):
                A[row, column] = 1.0 if row == column else 0.0
            for column in range(3):
                A[row, column] -= gain[column, row]
        multiply(A, own, product)
        multiply(product, A.T, posterior)
        multiply(R[2 + part], gain, K[3])
        multiply(gain.T, K[3], product)
        for row in range(6):
            for column in range(6):
                posterior[row, column] += product[row, column]
        for k in range(3):
            after[1 + part, k] = prior[1 + part, k] + shift[0, 3 + k]
            if part == 0:
                after[0, k] = prior[0, k] + shift[0, k]
    rotate(K[2, 0], 0, turn)
    multiply(turn, R[0], R[1])


def compiled_filter_step(
    earlier: pose_filter.PoseBelief,
    measurement: pose_filter.PoseMeasurement,
    noise: pose_filter.PoseFilterNoise,
    p_OCoM: FloatArray | None = None,
    noise_factor: float = 1.0,
) -> tuple[pose_filter.PoseBelief, pose_filter.Innovation, pose_filter.PoseBelief]:
    """Returns the prior, the innovation and the posterior, as `filter_step` does."""
    time = measurement.time
    means, nu, squared = np.empty((2, 3, 3)), np.empty((2, 3)), np.empty(2)
    R, P, K = np.empty((9, 3, 3)), np.zeros((8, 6, 6)), np.empty((4, 3, 6))
    means[1] = earlier.p_WCoM, earlier.v_WCoM, earlier.w_WO
    R[1], P[2], P[3] = earlier.R_WO, earlier.P_position, earlier.P_orientation
    nu[0] = measurement.p_WCoM
    measured = np.ascontiguousarray(measurement.R_WO)
    com = _ZERO if p_OCoM is None else np.reshape(p_OCoM, (3, 1))
    densities = np.array([noise.acceleration, noise.angular_acceleration])
    variances = noise_factor * np.array([noise.position**2, noise.orientation**2])
    inputs = measured, com, time - earlier.time, noise.gravity, densities, variances
    write_step(means, R, P, K, nu, squared, *inputs)
    beliefs = [
        pose_filter.PoseBelief(time, mean[0], mean[1], R[k], mean[2], P[2 * k], P[2 * k + 1])
        for k, mean in enumerate(means)
    ]
    return beliefs[0], pose_filter.Innovation(nu, P[:2], R[2:4], R[4:6], K[:2], squared), beliefs[1]
