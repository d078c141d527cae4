"""Steps of the pose filter, each from a belief to the posterior of the next measurement."""

from math import log
from typing import Any

import numpy as np

from drake_pregrasp.arrays import FloatArray, pack
from drake_pregrasp.estimation import pose_filter as pf
from drake_pregrasp.estimation.pose_track import FilterStep
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.geometry.rotations import rotation_components, rotation_rows

_ZERO = np.zeros((3, 1))

exponential, logarithm = compiled()(rotation_rows), compiled()(rotation_components)


@compiled()
def multiply(A, B, product):  # type: ignore[no-untyped-def]
    """Writes the product of two matrices."""
    for row in range(A.shape[0]):
        for column in range(B.shape[1]):
            total = 0.0
            for k in range(A.shape[1]):
                total += A[row, k] * B[k, column]
            product[row, column] = total


@compiled()
def rotate(theta, order, R):  # type: ignore[no-untyped-def]
    """Writes `rotation_matrix`, shape (3, 3)."""
    (a, b, c), (d, e, f), (g, h, i) = exponential(theta[0], theta[1], theta[2], order)
    R[0, 0], R[0, 1], R[0, 2] = a, b, c
    R[1, 0], R[1, 1], R[1, 2] = d, e, f
    R[2, 0], R[2, 1], R[2, 2] = g, h, i


@compiled()
def invert(A):  # type: ignore[no-untyped-def]
    """Inverts a positive definite matrix in its place, shape (3, 3), and returns log det."""
    determinant = 1.0
    for k in range(3):
        pivot = A[k, k]
        determinant *= pivot
        A[k, k] = 1.0
        for column in range(3):
            A[k, column] /= pivot
        for row in range(3):
            factor = A[row, k] if row != k else 0.0
            A[row, k] = 0.0 if row != k else A[row, k]
            for column in range(3):
                A[row, column] -= factor * A[k, column]
    return log(determinant)


@compiled()
def write_step(means, R, P, K, nu, squares, measured, com, dt, gravity, densities, variances):  # type: ignore[no-untyped-def]
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
        squares: As in `FilterStep.squares`, for one measurement, shape (2, 2).
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
        squares[1, part] = invert(inverse)
        multiply(inverse, own[:3], gain)
        multiply(nu[part : part + 1], gain, shift)
        multiply(inverse, nu[part : part + 1].T, product)
        squares[0, part] = 0.0
        for k in range(3):
            squares[0, part] += nu[part, k] * product[k, 0]
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


@compiled(
    "void(f8[:,:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1],"
    " f8[:,::1], f8, f8, UniTuple(UniTuple(f8, 2), 2), UniTuple(f8, 2))"
)
def write_steps(means, R, P, K, nu, squares, seen, com, time, gravity, densities, variances):  # type: ignore[no-untyped-def]
    """Writes the steps of `FilterStep.replay`.

    Args:
        means: As the next four, see `write_step`.
        R: See `write_step`.
        P: See `write_step`.
        K: See `write_step`.
        nu: See `write_step`; only memory before.
        squares: Result of `FilterStep.squares`.
        seen: Measurements in vectors, shape (k, 13).
        com: See `write_step`.
        time: Time before the first step, in seconds.
        gravity: See `write_step`.
        densities: Those in the first step, and those in the others.
        variances: See `write_step`.
    """
    for k in range(len(seen)):
        for i in range(3):
            nu[0, i] = seen[k, 1 + i]
        own = com, seen[k, 0] - time, gravity, densities[min(k, 1)], variances
        write_step(means, R, P, K, nu, squares[k], seen[k, 4:].reshape(3, 3), *own)
        time = seen[k, 0]


class CompiledFilterStep(FilterStep):
    """Compiled steps of the filter."""

    def __call__(
        self,
        earlier: pf.PoseBelief,
        measurement: pf.PoseMeasurement,
        noise: pf.PoseFilterNoise,
        p_OCoM: FloatArray | None = None,
        noise_factor: float = 1.0,
    ) -> tuple[pf.PoseBelief, pf.Innovation, pf.PoseBelief]:
        """See `filter_step`."""
        time, seen = measurement.time, pack(measurement)[None]
        first = noise.acceleration, noise.angular_acceleration
        written = _run(earlier, seen, first, noise, p_OCoM, noise_factor)
        means, R, P, K, nu, squares = written
        prior, posterior = (
            pf.PoseBelief(time, mean[0], mean[1], R[k], mean[2], P[2 * k], P[2 * k + 1])
            for k, mean in enumerate(means)
        )
        return prior, pf.Innovation(nu, P[:2], R[2:4], R[4:6], K[:2], squares[0, 0]), posterior

    def squares(self, *replayed: Any) -> FloatArray:
        """See `FilterStep`."""
        return _run(*replayed)[-1]


def _run(
    belief: pf.PoseBelief,
    seen: FloatArray,
    first: tuple[float, float],
    noise: pf.PoseFilterNoise,
    p_OCoM: FloatArray | None,
    noise_factor: float,
) -> tuple[FloatArray, ...]:
    """Returns what `write_steps` writes."""
    memory = np.empty((2, 3, 3)), np.empty((9, 3, 3)), np.zeros((8, 6, 6)), np.empty((4, 3, 6))
    means, R, P, _ = memory
    means[1] = belief.p_WCoM, belief.v_WCoM, belief.w_WO
    R[1], P[2], P[3] = belief.R_WO, belief.P_position, belief.P_orientation
    written = *memory, np.empty((2, 3)), np.empty((len(seen), 2, 2))
    com = _ZERO if p_OCoM is None else np.reshape(p_OCoM, (3, 1))
    variances = noise_factor * noise.position**2, noise_factor * noise.orientation**2
    densities = first, (noise.acceleration, noise.angular_acceleration)
    motion = belief.time, noise.gravity, densities, variances
    write_steps(*written, np.ascontiguousarray(seen), com, *motion)
    return written
