"""Kalman filter on the centre of mass and error-state filter on the orientation of a moving object.

Both assume a constant velocity disturbed by white acceleration noise, and the first one gravity, if
there is any. W is the world with z up, O the object, CoM its centre of mass; all vectors are
expressed in W.
"""

from dataclasses import dataclass

import numpy as np

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.rotation_vectors import (
    left_jacobian,
    rotation_matrix,
    rotation_vector,
)

_I = np.eye(3)
_DRIFT, _MIXED, _RATE = (
    np.kron(np.array(block), _I) for block in ([[1, 0], [0, 0]], [[0, 1], [1, 0]], [[0, 0], [0, 1]])
)  # Where dt³/3, dt²/2 and dt stand in the process noise.


@dataclass(frozen=True, eq=False)
class PoseFilterNoise:
    """What the filter assumes of measurements and motion; standard deviations are per axis.

    Attributes:
        position: Of a measured position, in metres.
        orientation: Of a measured orientation, as a rotation vector, in radians.
        acceleration: Square root of the white linear acceleration's density, in m/s²/sqrt(Hz).
        angular_acceleration: The same for the angular acceleration, in rad/s²/sqrt(Hz).
        initial_velocity: Of the object's velocity before the first measurement, in m/s.
        initial_angular_velocity: The same for its angular velocity, in rad/s.
        gravity: Mean acceleration of the object, along -z of W, in m/s²: 0 for an object that
            something carries, about 9.81 for one in free flight.
    """

    position: float
    orientation: float
    acceleration: float
    angular_acceleration: float
    initial_velocity: float
    initial_angular_velocity: float
    gravity: float = 0.0


@dataclass(frozen=True, eq=False)
class PoseBelief:
    """What is believed of the object's pose and twist at one time.

    Attributes:
        time: Time the belief is for, in seconds; -inf before the first measurement.
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

    @property
    def p_WCoM_covariance(self) -> FloatArray:
        """Covariance Sigma of the centre of mass, shape (3, 3), in m² (Eq. 3)."""
        return self.P_position[:3, :3]

    @property
    def is_empty(self) -> bool:
        """Whether no measurement has been taken yet."""
        return bool(self.time == -np.inf)

    @staticmethod
    def empty() -> "PoseBelief":
        """Returns the belief before the first measurement."""
        zero, covariance = np.zeros(3), np.zeros((6, 6))
        return PoseBelief(-np.inf, zero, zero, np.eye(3), zero, covariance, covariance)

    def to_vector(self) -> FloatArray:
        """Returns the belief as one vector, for a discrete state."""
        return np.concatenate(
            [
                [self.time],
                self.p_WCoM,
                self.v_WCoM,
                self.R_WO.ravel(),
                self.w_WO,
                self.P_position.ravel(),
                self.P_orientation.ravel(),
            ]
        )

    @staticmethod
    def from_vector(vector: FloatArray) -> "PoseBelief":
        """Inverse of `to_vector`."""
        return PoseBelief(
            time=float(vector[0]),
            p_WCoM=vector[1:4],
            v_WCoM=vector[4:7],
            R_WO=vector[7:16].reshape(3, 3),
            w_WO=vector[16:19],
            P_position=vector[19:55].reshape(6, 6),
            P_orientation=vector[55:91].reshape(6, 6),
        )


def first_belief(
    time: float,
    p_WCoM: FloatArray,
    R_WO: FloatArray,
    noise: PoseFilterNoise,
    p_OCoM: FloatArray | None = None,
) -> PoseBelief:
    """Returns the belief after the first measurement: at rest, with the stated uncertainty.

    Args:
        time: When it was measured, in seconds.
        p_WCoM: Where the measured pose puts the centre of mass, shape (3,), in metres.
        R_WO: The measured orientation, shape (3, 3).
        noise: What the filter assumes.
        p_OCoM: See `measurement_covariance`.
    """
    P_position = _diagonal(0.0, noise.initial_velocity)
    P_position[:3, :3] = measurement_covariance(R_WO, noise, p_OCoM)
    return PoseBelief(
        time=time,
        p_WCoM=p_WCoM,
        v_WCoM=np.zeros(3),
        R_WO=R_WO,
        w_WO=np.zeros(3),
        P_position=P_position,
        P_orientation=_diagonal(noise.orientation, noise.initial_angular_velocity),
    )


def predict(belief: PoseBelief, dt: float, noise: PoseFilterNoise) -> PoseBelief:
    """Carries a belief `dt` seconds forward; its covariance grows accordingly.

    Raises:
        InvalidArgumentError: If `dt` is negative: knowledge can't be taken back.
    """
    if dt < 0:
        raise InvalidArgumentError(f"a belief can't be carried {dt} s back in time")
    if dt == 0:
        return belief
    F_position, F_orientation = transitions(belief, dt)
    fall = np.array([0.0, 0.0, -noise.gravity])
    return PoseBelief(
        time=belief.time + dt,
        p_WCoM=belief.p_WCoM + belief.v_WCoM * dt + fall * (dt**2 / 2),
        v_WCoM=belief.v_WCoM + fall * dt,
        R_WO=rotation_matrix(belief.w_WO * dt) @ belief.R_WO,
        w_WO=belief.w_WO,
        P_position=F_position @ belief.P_position @ F_position.T
        + _process_noise(dt, noise.acceleration),
        P_orientation=F_orientation @ belief.P_orientation @ F_orientation.T
        + _process_noise(dt, noise.angular_acceleration),
    )


def transitions(belief: PoseBelief, dt: float) -> tuple[FloatArray, FloatArray]:
    """Returns the matrices that carry the two covariances `dt` seconds forward, each (6, 6)."""
    F_position, F_orientation = np.eye(6), np.eye(6)
    F_position[:3, 3:] = dt * _I
    # The error turns with the step, and an error of w_WO adds up to the step's left Jacobian.
    turn = belief.w_WO * dt
    F_orientation[:3, :3] = rotation_matrix(turn)
    F_orientation[:3, 3:] = dt * left_jacobian(turn)
    return F_position, F_orientation


def measurement_covariance(
    R_WO: FloatArray, noise: PoseFilterNoise, p_OCoM: FloatArray | None = None
) -> FloatArray:
    """Covariance of where a measured pose puts the centre of mass, shape (3, 3), in m².

    With a = R_WO p_OCoM, to first order in the orientation's error, which moves the centre of mass
    across a, it is σ² I + σ_R² (|a|² I - a aᵀ).

    Args:
        R_WO: The orientation, as well as it is known, shape (3, 3).
        noise: σ is its `position`, σ_R its `orientation`.
        p_OCoM: The centre of mass in O, shape (3,), in metres; at O's origin if left out.
    """
    covariance: FloatArray = noise.position**2 * _I
    if p_OCoM is not None:
        a = R_WO @ p_OCoM
        covariance += noise.orientation**2 * (a @ a * _I - np.outer(a, a))
    return covariance


def update(
    belief: PoseBelief,
    p_WCoM_measured: FloatArray,
    R_WO_measured: FloatArray,
    noise: PoseFilterNoise,
    p_OCoM: FloatArray | None = None,
) -> PoseBelief:
    """Returns the posterior after a measured pose at the belief's own time.

    Args:
        belief: The prior.
        p_WCoM_measured: Where the measured pose puts the centre of mass, shape (3,), in metres.
        R_WO_measured: The measured orientation, shape (3, 3).
        noise: What the filter assumes.
        p_OCoM: See `measurement_covariance`.
    """
    dx, P_position = _correct(
        belief.P_position,
        p_WCoM_measured - belief.p_WCoM,
        measurement_covariance(belief.R_WO, noise, p_OCoM),
    )
    theta = rotation_vector(R_WO_measured @ belief.R_WO.T)
    de, P_orientation = _correct(belief.P_orientation, theta, noise.orientation**2 * _I)
    return PoseBelief(
        time=belief.time,
        p_WCoM=belief.p_WCoM + dx[:3],
        v_WCoM=belief.v_WCoM + dx[3:],
        R_WO=rotation_matrix(de[:3]) @ belief.R_WO,
        w_WO=belief.w_WO + de[3:],
        P_position=P_position,
        P_orientation=P_orientation,
    )


def _correct(P: FloatArray, innovation: FloatArray, R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Kalman correction for a measurement of the first three states, with Joseph's covariance."""
    S = P[:3, :3] + R
    K = np.linalg.solve(S, P[:3]).T
    A = np.eye(6)
    A[:, :3] -= K
    return K @ innovation, A @ P @ A.T + K @ R @ K.T


def _process_noise(dt: float, density: float) -> FloatArray:
    """Covariance that white acceleration of that density adds to (position, velocity) in dt."""
    covariance: FloatArray = density**2 * (dt**3 / 3 * _DRIFT + dt**2 / 2 * _MIXED + dt * _RATE)
    return covariance


def _diagonal(first: float, second: float) -> FloatArray:
    return np.diag(np.repeat([first**2, second**2], 3))
