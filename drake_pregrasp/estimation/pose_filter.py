"""Kalman filter on the centre of mass and error-state filter on the orientation of a moving object.

Both assume a constant velocity disturbed by white acceleration noise; the filter of the position
also knows gravity. W is the world with z up, O the object, CoM its centre of mass; all vectors are
expressed in W.
"""

import math
import sys
from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.arrays import FloatArray, number_or_nan
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.rotations import left_jacobian, rotation_matrix, rotation_vector

# Least value of each assumption, and its range in words.
_POSITIVE = (math.ulp(0.0), "finite and above 0")
_NOT_NEGATIVE = (0.0, "finite and at least 0")
_FINITE = (-sys.float_info.max, "finite")
_LIMITS = {"position": _POSITIVE, "orientation": _POSITIVE, "gravity": _FINITE}


@dataclass(frozen=True)
class PoseFilterNoise:
    """Noise and motion that the filter assumes; standard deviations are per axis.

    Attributes:
        position: Standard deviation of a measured position, in metres, above 0.
        orientation: Standard deviation of a measured orientation, as a rotation vector, in radians,
            above 0.
        acceleration: Square root of the white linear acceleration's density, in m/s²/sqrt(Hz).
        angular_acceleration: Square root of the white angular acceleration's density, in
            rad/s²/sqrt(Hz).
        initial_velocity: Standard deviation of the velocity before the first measurement, in m/s.
        initial_angular_velocity: Standard deviation of the angular velocity before the first
            measurement, in rad/s.
        gravity: Mean acceleration of the object, along -z of W, in m/s²: 0 for an object that
            something carries, about 9.81 for one in free flight, negative for one that rises.

    Raises:
        InvalidArgumentError: If a value is not finite, if `position` or `orientation` is not above
            0, or if another value but `gravity` is below 0.
    """

    position: float
    orientation: float
    acceleration: float
    angular_acceleration: float
    initial_velocity: float
    initial_angular_velocity: float
    gravity: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            least, meant = _LIMITS.get(name, _NOT_NEGATIVE)
            if not least <= number_or_nan(value) < math.inf:
                raise InvalidArgumentError(f"{name} must be {meant}, not {value}")


@dataclass(frozen=True, eq=False)
class PoseMeasurement:
    """A measured pose.

    Attributes:
        time: Time of the measurement, in seconds; -inf if there is none.
        p_WCoM: Centre of mass that the measured pose implies, shape (3,), in metres.
        R_WO: Measured orientation, shape (3, 3).
    """

    time: float
    p_WCoM: FloatArray
    R_WO: FloatArray


@dataclass(frozen=True, eq=False)
class PoseBelief:
    """Estimate of the object's pose and twist at one time.

    Attributes:
        time: Time of the estimate, in seconds; -inf before the first measurement.
        p_WCoM: Mean of the centre of mass, shape (3,), in metres.
        v_WCoM: Mean of its velocity, shape (3,), in m/s.
        R_WO: Mean orientation, shape (3, 3).
        w_WO: Mean angular velocity, shape (3,), in rad/s.
        P_position: Covariance of (p_WCoM, v_WCoM), shape (6, 6).
        P_orientation: Covariance of the errors (theta, w_WO), shape (6, 6), where the true
            orientation is Exp(theta) R_WO with theta expressed in W.
    """

    time: float
    p_WCoM: FloatArray
    v_WCoM: FloatArray
    R_WO: FloatArray
    w_WO: FloatArray
    P_position: FloatArray
    P_orientation: FloatArray


_I, _I6 = np.eye(3), np.eye(6)
_DRIFT, _MIXED, _RATE = (
    np.kron(np.array(block), _I) for block in ([[1, 0], [0, 0]], [[0, 1], [1, 0]], [[0, 0], [0, 1]])
)  # Places of dt³/3, dt²/2 and dt in the process noise.
_SHORTEST = 1e-6  # Seconds.
_BOOST_VARIANCE = 0.3**2  # Variance of a known change of twist, relative to its square.
_UPPER = np.kron(np.array([[0, 1], [0, 0]]), _I)  # Place of dt in a transition.

NO_MEASUREMENT = PoseMeasurement(-math.inf, np.zeros(3), _I)
"""Placeholder for a missing measurement."""

NO_BELIEF = PoseBelief(
    -math.inf, np.zeros(3), np.zeros(3), _I, np.zeros(3), np.zeros((6, 6)), np.zeros((6, 6))
)
"""Placeholder for the belief before the first measurement."""


def first_belief(
    measurement: PoseMeasurement, noise: PoseFilterNoise, p_OCoM: FloatArray | None = None
) -> PoseBelief:
    """Returns the belief after the first measurement: at rest, with the initial uncertainty.

    Args:
        measurement: The first measured pose.
        noise: Noise and motion that the filter assumes.
        p_OCoM: Centre of mass in O, shape (3,), in metres; the origin of O by default.
    """
    P_position = np.diag(np.repeat([0.0, noise.initial_velocity**2], 3))
    P_position[:3, :3] = position_covariance(measurement.R_WO, noise, p_OCoM)
    return PoseBelief(
        time=measurement.time,
        p_WCoM=measurement.p_WCoM,
        v_WCoM=np.zeros(3),
        R_WO=measurement.R_WO,
        w_WO=np.zeros(3),
        P_position=P_position,
        P_orientation=np.diag(
            np.repeat([noise.orientation**2, noise.initial_angular_velocity**2], 3)
        ),
    )


def two_point_belief(
    earlier: PoseBelief,
    measurement: PoseMeasurement,
    noise: PoseFilterNoise,
    p_OCoM: FloatArray | None = None,
) -> PoseBelief:
    """Returns the belief after two measured poses, without any earlier knowledge of the twist.

    The twist is the difference of the poses, by the shorter rotation, over the time dt between
    them. The covariance of v is then 2 R / dt², from two measurements, plus q² dt / 3, from white
    acceleration with the density q². The errors e_1 and e_2 of the two orientations cause the error
    J⁻¹ (e_2 - Exp(w dt) e_1) / dt of w, with the left Jacobian J of w dt. If the times differ only
    by rounding, the twist is the initial one.

    Args:
        earlier: Belief whose pose counts as the first measured pose.
        measurement: The second measured pose, later than the first.
        noise: Noise and motion that the filter assumes.
        p_OCoM: Centre of mass in O, shape (3,), in metres; the origin of O by default.
    """
    dt = measurement.time - earlier.time
    if not dt > _SHORTEST:
        return first_belief(measurement, noise, p_OCoM)
    fall = np.array([0.0, 0.0, -noise.gravity])
    theta = rotation_vector(measurement.R_WO @ earlier.R_WO.T)
    R_position = position_covariance(measurement.R_WO, noise, p_OCoM)
    R_orientation = noise.orientation**2 * _I
    covariances = []
    for R, J_inverse, density in (
        (R_position, _I, noise.acceleration),
        (R_orientation, np.linalg.inv(left_jacobian(theta)), noise.angular_acceleration),
    ):
        mixed = R @ J_inverse.T / dt
        rate = 2 * J_inverse @ mixed / dt + density**2 * dt / 3 * _I
        covariances.append(np.block([[R, mixed], [mixed.T, rate]]))
    return PoseBelief(
        time=measurement.time,
        p_WCoM=measurement.p_WCoM,
        v_WCoM=(measurement.p_WCoM - earlier.p_WCoM) / dt + fall * dt / 2,
        R_WO=measurement.R_WO,
        w_WO=theta / dt,
        P_position=covariances[0],
        P_orientation=covariances[1],
    )


def predict(belief: PoseBelief, dt: float, noise: PoseFilterNoise) -> PoseBelief:
    """Returns the belief `dt` seconds later, without a measurement: its covariance grows.

    Raises:
        InvalidArgumentError: If `dt` is negative.
    """
    if dt < 0:
        raise InvalidArgumentError(f"a belief cannot be predicted {dt} s back in time")
    if dt == 0:
        return belief
    F_position, F_orientation = transitions(belief, dt)
    p_WCoM, v_WCoM = belief.p_WCoM + belief.v_WCoM * dt, belief.v_WCoM
    if noise.gravity:
        fall = np.array([0.0, 0.0, -noise.gravity])
        p_WCoM, v_WCoM = p_WCoM + fall * (dt**2 / 2), v_WCoM + fall * dt
    # The covariance that white accelerations of unit density add in dt.
    Q: FloatArray = dt**3 / 3 * _DRIFT + dt**2 / 2 * _MIXED + dt * _RATE
    Q_position, Q_orientation = noise.acceleration**2 * Q, noise.angular_acceleration**2 * Q
    return PoseBelief(
        time=belief.time + dt,
        p_WCoM=p_WCoM,
        v_WCoM=v_WCoM,
        R_WO=F_orientation[:3, :3] @ belief.R_WO,
        w_WO=belief.w_WO,
        P_position=F_position @ belief.P_position @ F_position.T + Q_position,
        P_orientation=F_orientation @ belief.P_orientation @ F_orientation.T + Q_orientation,
    )


def boosted(belief: PoseBelief, dV: FloatArray, time: float) -> PoseBelief:
    """Returns the belief after a known change of the twist, as if it had always been larger by dV.

    The pose predicted for `time` stays the same. The change is known to 30 %, which adds to the
    covariance.

    Args:
        belief: Belief before the change.
        dV: Change of the angular velocity, in rad/s, and of the velocity of the centre of mass, in
            m/s, in W, shape (2, 3).
        time: Time of the change, in seconds.
    """
    dt, (dw, dv) = belief.time - time, dV
    position, orientation = np.append(dt * dv, dv), np.append(dt * dw, dw)
    added = [_BOOST_VARIANCE * np.outer(error, error) for error in (position, orientation)]
    P = np.array([belief.P_position, belief.P_orientation]) + added
    return shifted(belief, position, orientation, P)


def transitions(belief: PoseBelief, dt: float) -> tuple[FloatArray, FloatArray]:
    """Returns the transition matrices of (p, v) and (theta, w) over `dt` seconds, each (6, 6).

    With Exp(turn) the rotation of the step, an error theta turns with it, and an error e of w_WO
    adds J(turn) e dt to theta, with the left Jacobian J of Exp.
    """
    F_position, F_orientation = _I6 + dt * _UPPER, _I6.copy()
    turn = belief.w_WO * dt
    F_orientation[:3, :3] = rotation_matrix(turn)
    F_orientation[:3, 3:] = dt * left_jacobian(turn)
    return F_position, F_orientation


def position_covariance(
    R_WO: FloatArray, noise: PoseFilterNoise, p_OCoM: FloatArray | None = None
) -> FloatArray:
    """Returns the covariance of a measured pose's centre of mass, shape (3, 3), in m².

    With a = R_WO p_OCoM it is σ² I + σ_R² (|a|² I - a aᵀ), to first order in the orientation's
    error, which moves the centre of mass across a.

    Args:
        R_WO: Estimated orientation, shape (3, 3).
        noise: Assumed noise: σ is its `position`, σ_R its `orientation`.
        p_OCoM: Centre of mass in O, shape (3,), in metres; the origin of O by default.
    """
    covariance: FloatArray = noise.position**2 * _I
    if p_OCoM is not None:
        a = R_WO @ p_OCoM
        covariance += noise.orientation**2 * (a @ a * _I - np.outer(a, a))
    return covariance


@dataclass(frozen=True, eq=False)
class Innovation:
    """Difference of a measured pose from the prior, and its covariance.

    Position and orientation are stacked in one array, so that one call solves for both.

    Attributes:
        nu: Difference of the centre of mass, in metres, and rotation vector from the prior to the
            measured orientation, in radians, shape (2, 3).
        P: Covariances of the prior, shape (2, 6, 6).
        R: Covariances of the measured position and orientation, shape (2, 3, 3), in m² and rad².
        S: Covariances of `nu`, of prior and measurement together, shape (2, 3, 3).
        K_T: Transposed Kalman gains S⁻¹ P[:, :3], shape (2, 3, 6).
        squared: νᵀ S⁻¹ ν of position and orientation, shape (2,): each chi-square of 3 degrees.
    """

    nu: FloatArray
    P: FloatArray
    R: FloatArray
    S: FloatArray
    K_T: FloatArray
    squared: FloatArray


def innovation(
    prior: PoseBelief,
    measurement: PoseMeasurement,
    noise: PoseFilterNoise,
    p_OCoM: FloatArray | None = None,
    noise_factor: float = 1.0,
) -> Innovation:
    """Returns the innovation of a measured pose at the prior's own time.

    Args:
        prior: The belief before the measurement.
        measurement: The measured pose.
        noise: Noise that the filter assumes.
        p_OCoM: Centre of mass in O, shape (3,), in metres; the origin of O by default.
        noise_factor: Variance of the measurement's noise over the assumed one.
    """
    if noise_factor != 1:
        std = math.sqrt(noise_factor)
        noise = replace(noise, position=std * noise.position, orientation=std * noise.orientation)
    off = measurement.p_WCoM - prior.p_WCoM
    nu = np.array([off, rotation_vector(measurement.R_WO @ prior.R_WO.T)])
    P = np.array([prior.P_position, prior.P_orientation])
    R = np.array([noise.position**2 * _I, noise.orientation**2 * _I])
    if p_OCoM is not None:
        R[0] = position_covariance(prior.R_WO, noise, p_OCoM)
    S = P[:, :3, :3] + R
    solved = np.linalg.solve(S, np.concatenate([P[:, :3], nu[:, :, np.newaxis]], axis=2))
    squared = np.einsum("ij,ij->i", nu, solved[:, :, 6])
    return Innovation(nu, P, R, S, solved[:, :, :6], squared)


def update(
    prior: PoseBelief,
    measurement: PoseMeasurement,
    noise: PoseFilterNoise,
    p_OCoM: FloatArray | None = None,
) -> PoseBelief:
    """Returns the posterior after a measured pose at the prior's own time; see `innovation`."""
    return corrected(prior, innovation(prior, measurement, noise, p_OCoM))


def corrected(prior: PoseBelief, new: Innovation) -> PoseBelief:
    """Returns the posterior for an innovation, with Joseph's form of the covariance."""
    K = new.K_T.transpose(0, 2, 1)
    A = np.array([_I6, _I6])
    A[:, :, :3] -= K
    P = A @ new.P @ A.transpose(0, 2, 1) + K @ new.R @ new.K_T
    return shifted(prior, K[0] @ new.nu[0], K[1] @ new.nu[1], P)


def filter_step(
    earlier: PoseBelief,
    measurement: PoseMeasurement,
    noise: PoseFilterNoise,
    p_OCoM: FloatArray | None = None,
    noise_factor: float = 1.0,
) -> tuple[PoseBelief, Innovation, PoseBelief]:
    """Returns the prior at a measurement's time, the innovation, and the posterior.

    Args:
        earlier: Belief at an earlier time.
        measurement: The measured pose; this and the other arguments are as for `innovation`.
        noise: Noise and motion that the filter assumes.
        p_OCoM: Centre of mass in O, shape (3,), in metres.
        noise_factor: Variance of the measurement's noise over the assumed one.

    Raises:
        InvalidArgumentError: If the measurement is older than the belief.
    """
    prior = predict(earlier, measurement.time - earlier.time, noise)
    new = innovation(prior, measurement, noise, p_OCoM, noise_factor)
    return prior, new, corrected(prior, new)


def shifted(belief: PoseBelief, dx: FloatArray, de: FloatArray, P: FloatArray) -> PoseBelief:
    """Returns a belief at the same time with a corrected mean and other covariances.

    Args:
        belief: Belief before the correction.
        dx: Correction of (p_WCoM, v_WCoM), shape (6,).
        de: Correction (theta, dw) of the orientation and of w_WO, shape (6,).
        P: Covariances of position and orientation, shape (2, 6, 6).
    """
    return PoseBelief(
        time=belief.time,
        p_WCoM=belief.p_WCoM + dx[:3],
        v_WCoM=belief.v_WCoM + dx[3:],
        R_WO=rotation_matrix(de[:3]) @ belief.R_WO,
        w_WO=belief.w_WO + de[3:],
        P_position=P[0],
        P_orientation=P[1],
    )
