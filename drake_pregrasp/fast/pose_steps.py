"""One step of the pose filter, from a belief to the posterior of the next measurement."""

import math

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.estimation import pose_filter
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.geometry.rotations import SMALL

_ZERO = np.zeros(3)


@compiled()
def exponential(x, y, z, order):  # type: ignore[no-untyped-def]
    """Returns Exp of a rotation vector, or its left Jacobian for order 1, as `rotation_matrix`."""
    square = x * x + y * y + z * z
    if square < SMALL * SMALL:
        sinc = 1 - square / 6 * (1 - square / 20 * (1 - square / 42))
        versine = (1 - square / 12 * (1 - square / 30 * (1 - square / 56))) / 2
        third = (1 - square / 20 * (1 - square / 42 * (1 - square / 72))) / 6
    else:
        angle = math.sqrt(square)
        sinc = math.sin(angle) / angle
        versine = 2 * math.sin(angle / 2) ** 2 / square
        third = (angle - math.sin(angle)) / (square * angle)
    a, b = (versine, third) if order else (sinc, versine)
    M = np.empty((3, 3))
    M[0, 0], M[0, 1], M[0, 2] = 1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y
    M[1, 0], M[1, 1], M[1, 2] = b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x
    M[2, 0], M[2, 1], M[2, 2] = b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y)
    return M


@compiled()
def logarithm(M):  # type: ignore[no-untyped-def]
    """Returns the shortest rotation vector of a rotation matrix, as `rotation_vector`."""
    a, e, i = M[0, 0], M[1, 1], M[2, 2]
    x, y, z = M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]
    xy, xz, yz = M[0, 1] + M[1, 0], M[0, 2] + M[2, 0], M[1, 2] + M[2, 1]
    largest = max(a + e + i, a, e, i)
    if largest == a + e + i:
        w = 1 + a + e + i
    elif largest == a:
        w, x, y, z = x, 1 + a - e - i, xy, xz
    elif largest == e:
        w, x, y, z = y, xy, 1 + e - a - i, yz
    else:
        w, x, y, z = z, xz, yz, 1 + i - a - e
    sine = math.sqrt(x * x + y * y + z * z)
    half = math.atan2(sine, abs(w))
    scale = 2 * half / sine if sine > 0 else 0.0
    if w < 0:
        scale = -scale
    return np.array([scale * x, scale * y, scale * z])


@compiled()
def multiply(M, left, right, to, transposed):  # type: ignore[no-untyped-def]
    """Writes the product of two places of M, the second one transposed or not, to a third."""
    for row in range(6):
        for column in range(6):
            M[to, row, column] = 0.0
            for k in range(6):
                factor = M[right, column, k] if transposed else M[right, k, column]
                M[to, row, column] += M[left, row, k] * factor


@compiled()
def rotated(A, B, transposed):  # type: ignore[no-untyped-def]
    """Returns the product of two matrices, the second one transposed or not, shape (3, 3)."""
    product = np.zeros((3, 3))
    for row in range(3):
        for column in range(3):
            for k in range(3):
                factor = B[column, k] if transposed else B[k, column]
                product[row, column] += A[row, k] * factor
    return product


@compiled()
def inverted(A):  # type: ignore[no-untyped-def]
    """Returns the inverse of a matrix, shape (3, 3), by its cofactors."""
    inverse, determinant = np.empty((3, 3)), 0.0
    for row in range(3):
        i, j = (row + 1) % 3, (row + 2) % 3
        for column in range(3):
            k, m = (column + 1) % 3, (column + 2) % 3
            inverse[column, row] = A[i, k] * A[j, m] - A[i, m] * A[j, k]
    for k in range(3):
        determinant += A[0, k] * inverse[k, 0]
    for row in range(3):
        for column in range(3):
            inverse[row, column] /= determinant
    return inverse


@compiled(
    "Tuple((f8[:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,:,::1],"
    " f8[::1], f8[:,::1], f8[:,::1], f8[:,:,::1]))"
    "(f8[:,::1], f8[:,::1], f8[:,:,::1], f8[::1], f8[:,::1], f8, f8, f8[::1], f8[::1], f8[::1])"
)
def step(  # type: ignore[no-untyped-def]
    means, R_WO, P_last, measured, measured_R, dt, gravity, densities, variances, p_OCoM
):
    """Returns the prior, the innovation and the posterior, as `filter_step` does.

    Args:
        means: p_WCoM, v_WCoM and w_WO, shape (3, 3).
        R_WO: Mean orientation, shape (3, 3).
        P_last: Covariances of (p_WCoM, v_WCoM) and of (theta, w_WO), shape (2, 6, 6).
        measured: Measured p_WCoM, shape (3,), in metres.
        measured_R: Measured orientation, shape (3, 3).
        dt: Seconds from the belief to the measurement.
        gravity: Mean acceleration along -z of W, in m/s².
        densities: Densities of linear and angular acceleration, shape (2,).
        variances: Variances of measured position and orientation, shape (2,), in m² and rad².
        p_OCoM: Centre of mass in O, shape (3,), in metres.
    """
    # Matrices of 6 x 6 are places of one array: F (0, 1), P before (2, 3), the prior's (4, 5), the
    # posterior's (6, 7), I - K H (8), and an intermediate product (9).
    M, prior = np.zeros((10, 6, 6)), means.copy()
    for k in range(3):
        prior[0, k] += means[1, k] * dt
    prior[0, 2] -= gravity * (dt * dt / 2)
    prior[1, 2] -= gravity * dt
    x, y, z = means[2, 0] * dt, means[2, 1] * dt, means[2, 2] * dt
    turn, jacobian = exponential(x, y, z, 0), exponential(x, y, z, 1)
    for row in range(6):
        M[0, row, row] = M[1, row, row] = 1.0
        for column in range(6):
            M[2, row, column], M[3, row, column] = P_last[0, row, column], P_last[1, row, column]
    for row in range(3):
        M[0, row, 3 + row] = dt
        for column in range(3):
            M[1, row, column], M[1, row, 3 + column] = turn[row, column], dt * jacobian[row, column]
    prior_R, R = rotated(turn, R_WO, False), np.zeros((2, 3, 3))
    turned = logarithm(rotated(measured_R, prior_R, True))
    nu, a, square = np.empty((2, 3)), np.zeros(3), 0.0
    for row in range(3):
        nu[0, row], nu[1, row] = measured[row] - prior[0, row], turned[row]
        for column in range(3):
            a[row] += prior_R[row, column] * p_OCoM[column]
        square += a[row] * a[row]
    for row in range(3):
        for column in range(3):
            R[0, row, column] = -variances[1] * a[row] * a[column]
        R[0, row, row] += variances[0] + variances[1] * square
        R[1, row, row] = variances[1]
    S, K_T, squared = np.empty((2, 3, 3)), np.zeros((2, 3, 6)), np.zeros(2)
    posterior, posterior_R = prior.copy(), prior_R
    for part in range(2):
        P, P_posterior = 4 + part, 6 + part
        multiply(M, part, 2 + part, 9, False)
        multiply(M, 9, part, P, True)
        density = densities[part] ** 2
        for k in range(3):
            M[P, k, k] += density * (dt**3 / 3)
            M[P, k, 3 + k] += density * (dt**2 / 2)
            M[P, 3 + k, k] += density * (dt**2 / 2)
            M[P, 3 + k, 3 + k] += density * dt
        for row in range(3):
            for column in range(3):
                S[part, row, column] = M[P, row, column] + R[part, row, column]
        inverse = inverted(S[part])
        for row in range(6):
            for column in range(6):
                M[8, row, column] = 1.0 if row == column else 0.0
        shift = np.zeros(6)
        for row in range(3):
            along = 0.0
            for k in range(3):
                along += inverse[row, k] * nu[part, k]
                for column in range(6):
                    K_T[part, row, column] += inverse[row, k] * M[P, k, column]
            squared[part] += nu[part, row] * along
            for column in range(6):
                M[8, column, row] -= K_T[part, row, column]
                shift[column] += K_T[part, row, column] * nu[part, row]
        multiply(M, 8, P, 9, False)
        multiply(M, 9, 8, P_posterior, True)
        for row in range(6):
            for column in range(6):
                for k in range(3):
                    for m in range(3):
                        noise = K_T[part, k, row] * R[part, k, m] * K_T[part, m, column]
                        M[P_posterior, row, column] += noise
        for k in range(3):
            posterior[1 + part, k] += shift[3 + k]
        if part == 0:
            for k in range(3):
                posterior[0, k] += shift[k]
        else:
            correction = exponential(shift[0], shift[1], shift[2], 0)
            posterior_R = rotated(correction, prior_R, False)
    return prior, prior_R, M[4:6], nu, R, S, K_T, squared, posterior, posterior_R, M[6:8]


def compiled_filter_step(
    earlier: pose_filter.PoseBelief,
    measurement: pose_filter.PoseMeasurement,
    noise: pose_filter.PoseFilterNoise,
    p_OCoM: FloatArray | None = None,
    noise_factor: float = 1.0,
) -> tuple[pose_filter.PoseBelief, pose_filter.Innovation, pose_filter.PoseBelief]:
    """Returns the prior, the innovation and the posterior, as `filter_step` does."""
    time = measurement.time
    prior, prior_R, P, nu, R, S, K_T, squared, after, after_R, after_P = step(
        np.array([earlier.p_WCoM, earlier.v_WCoM, earlier.w_WO]),
        np.ascontiguousarray(earlier.R_WO),
        np.array([earlier.P_position, earlier.P_orientation]),
        measurement.p_WCoM,
        np.ascontiguousarray(measurement.R_WO),
        time - earlier.time,
        noise.gravity,
        np.array([noise.acceleration, noise.angular_acceleration]),
        noise_factor * np.array([noise.position**2, noise.orientation**2]),
        _ZERO if p_OCoM is None else p_OCoM,
    )
    return (
        pose_filter.PoseBelief(time, prior[0], prior[1], prior_R, prior[2], P[0], P[1]),
        pose_filter.Innovation(nu, P, R, S, K_T, squared),
        pose_filter.PoseBelief(time, after[0], after[1], after_R, after[2], after_P[0], after_P[1]),
    )
