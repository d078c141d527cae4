"""One step of the pose filter, from a belief to the posterior of the next measurement."""

import math

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.estimation.pose_filter import (
    Innovation,
    PoseBelief,
    PoseFilterNoise,
    PoseMeasurement,
)
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.geometry.rotations import SMALL


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


@compiled(
    "Tuple((f8[:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,:,::1],"
    " f8[::1], f8[:,::1], f8[:,::1], f8[:,:,::1]))"
    "(f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[:,::1], f8, f8, f8[::1], f8[::1],"
    " f8[::1])"
)
def step(  # type: ignore[no-untyped-def]
    means,
    R_WO,
    P_position,
    P_orientation,
    measured,
    measured_R,
    dt,
    gravity,
    densities,
    variances,
    p_OCoM,
):
    """Returns the prior, the innovation and the posterior, as `filter_step` does.

    Args:
        means: p_WCoM, v_WCoM and w_WO, shape (3, 3).
        R_WO: Mean orientation, shape (3, 3).
        P_position: Covariance of (p_WCoM, v_WCoM), shape (6, 6).
        P_orientation: Covariance of (theta, w_WO), shape (6, 6).
        measured: Measured p_WCoM, shape (3,), in metres.
        measured_R: Measured orientation, shape (3, 3).
        dt: Seconds from the belief to the measurement.
        gravity: Mean acceleration along -z of W, in m/s².
        densities: Densities of linear and angular acceleration, shape (2,).
        variances: Variances of measured position and orientation, shape (2,), in m² and rad².
        p_OCoM: Centre of mass in O, shape (3,), in metres.
    """
    eye = np.eye(3)
    turn = means[2] * dt
    prior, F = means.copy(), np.zeros((2, 6, 6))
    prior[0] += means[1] * dt
    prior[0, 2] -= gravity * (dt * dt / 2)
    prior[1, 2] -= gravity * dt
    F[0], F[1] = np.eye(6), np.eye(6)
    F[0, :3, 3:] = dt * eye
    F[1, :3, :3] = exponential(turn[0], turn[1], turn[2], 0)
    F[1, :3, 3:] = dt * exponential(turn[0], turn[1], turn[2], 1)
    prior_R = np.ascontiguousarray(F[1, :3, :3]) @ R_WO
    P = np.empty((2, 6, 6))
    P[0], P[1] = F[0] @ P_position @ F[0].T, F[1] @ P_orientation @ F[1].T
    for part in range(2):
        density = densities[part] ** 2
        for k in range(3):
            P[part, k, k] += density * (dt**3 / 3)
            P[part, k, 3 + k] += density * (dt**2 / 2)
            P[part, 3 + k, k] += density * (dt**2 / 2)
            P[part, 3 + k, 3 + k] += density * dt
    nu, R = np.empty((2, 3)), np.empty((2, 3, 3))
    nu[0], nu[1] = measured - prior[0], logarithm(measured_R @ prior_R.T)
    a = prior_R @ p_OCoM
    R[0] = variances[0] * eye + variances[1] * (np.dot(a, a) * eye - np.outer(a, a))
    R[1] = variances[1] * eye
    S, K_T, squared = P[:, :3, :3] + R, np.empty((2, 3, 6)), np.empty(2)
    posterior, posterior_P = prior.copy(), np.empty((2, 6, 6))
    posterior_R = prior_R
    for part in range(2):
        inverse = np.linalg.inv(S[part])
        K_T[part] = inverse @ np.ascontiguousarray(P[part, :3])
        squared[part] = nu[part] @ (inverse @ nu[part])
        K = np.ascontiguousarray(K_T[part].T)
        A = np.eye(6)
        A[:, :3] -= K
        posterior_P[part] = A @ P[part] @ A.T + K @ R[part] @ K_T[part]
        shift = K @ nu[part]
        if part == 0:
            posterior[0] += shift[:3]
            posterior[1] += shift[3:]
        else:
            posterior_R = exponential(shift[0], shift[1], shift[2], 0) @ prior_R
            posterior[2] += shift[3:]
    return prior, prior_R, P, nu, R, S, K_T, squared, posterior, posterior_R, posterior_P


def compiled_filter_step(
    earlier: PoseBelief,
    measurement: PoseMeasurement,
    noise: PoseFilterNoise,
    p_OCoM: FloatArray | None = None,
    noise_factor: float = 1.0,
) -> tuple[PoseBelief, Innovation, PoseBelief]:
    """Returns the prior, the innovation and the posterior, as `filter_step` does."""
    time = measurement.time
    prior, prior_R, P, nu, R, S, K_T, squared, posterior, posterior_R, posterior_P = step(
        np.array([earlier.p_WCoM, earlier.v_WCoM, earlier.w_WO]),
        np.ascontiguousarray(earlier.R_WO),
        np.ascontiguousarray(earlier.P_position),
        np.ascontiguousarray(earlier.P_orientation),
        measurement.p_WCoM,
        np.ascontiguousarray(measurement.R_WO),
        time - earlier.time,
        noise.gravity,
        np.array([noise.acceleration, noise.angular_acceleration]),
        noise_factor * np.array([noise.position**2, noise.orientation**2]),
        np.zeros(3) if p_OCoM is None else p_OCoM,
    )
    return (
        PoseBelief(time, prior[0], prior[1], prior_R, prior[2], P[0], P[1]),
        Innovation(nu, P, R, S, K_T, squared),
        PoseBelief(
            time,
            posterior[0],
            posterior[1],
            posterior_R,
            posterior[2],
            posterior_P[0],
            posterior_P[1],
        ),
    )
