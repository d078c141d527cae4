"""Kalman filter on the centre of mass and error-state filter on the orientation of a moving object.

Both assume a constant velocity disturbed by white acceleration noise. W is the world, O the object,
CoM its centre of mass; all vectors are expressed in W.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.contact_models import skew


@dataclass(frozen=True, eq=False)
class PoseFilterNoise:
    """Noise the filter assumes; standard deviations, per axis.

    Attributes:
        position: Of a measured position, in metres.
        orientation: Of a measured orientation, as a rotation vector, in radians.
        acceleration: Square root of the white linear acceleration's density, in m/s²/sqrt(Hz).
        angular_acceleration: The same for the angular acceleration, in rad/s²/sqrt(Hz).
        initial_velocity: Of the object's velocity before the first measurement, in m/s.
        initial_angular_velocity: The same for its angular velocity, in rad/s.
    """

    position: float
    orientation: float
    acceleration: float
    angular_acceleration: float
    initial_velocity: float
    initial_angular_velocity: float


@dataclass(frozen=True, eq=False)
class PoseBelief:
    """What is believed of the object's pose and twist at one time.

    Attributes:
        time: Time the belief is for, in seconds; -inf before the first measurement.
        p_WCoM: Mean of the centre of mass, shape (3,), in metres.
        v_WCoM: Mean of its velocity, shape (3,), in m/s.
        R_WO: Mean orientation.
        w_WO: Mean angular velocity, shape (3,), in rad/s.
        P_position: Covariance of (p_WCoM, v_WCoM), shape (6, 6).
        P_orientation: Covariance of the errors (theta, w_WO), shape (6, 6), where the true
            orientation is Exp(theta) R_WO with theta expressed in W.
    """

    time: float
    p_WCoM: FloatArray
    v_WCoM: FloatArray
    R_WO: Rotation
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
        return PoseBelief(-np.inf, zero, zero, Rotation.identity(), zero, covariance, covariance)

    def to_vector(self) -> FloatArray:
        """Returns the belief as one vector, for a discrete state."""
        return np.concatenate(
            [
                [self.time],
                self.p_WCoM,
                self.v_WCoM,
                self.R_WO.as_quat(),
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
            R_WO=Rotation.from_quat(vector[7:11]),
            w_WO=vector[11:14],
            P_position=vector[14:50].reshape(6, 6),
            P_orientation=vector[50:86].reshape(6, 6),
        )


def first_belief(
    time: float, p_WCoM: FloatArray, R_WO: Rotation, noise: PoseFilterNoise
) -> PoseBelief:
    """Returns the belief after the first measurement: at rest, with the stated uncertainty."""
    return PoseBelief(
        time=time,
        p_WCoM=p_WCoM,
        v_WCoM=np.zeros(3),
        R_WO=R_WO,
        w_WO=np.zeros(3),
        P_position=_diagonal(noise.position, noise.initial_velocity),
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
    turn = belief.w_WO * dt
    R_step = Rotation.from_rotvec(turn)
    # The error turns with the step, and an error of w_WO adds up to the step's left Jacobian.
    F = np.eye(6)
    F[:3, :3] = R_step.as_matrix()
    F[:3, 3:] = dt * _left_jacobian(turn)
    P_orientation = F @ belief.P_orientation @ F.T + _process_noise(dt, noise.angular_acceleration)
    F = np.eye(6)
    F[:3, 3:] = dt * np.eye(3)
    return PoseBelief(
        time=belief.time + dt,
        p_WCoM=belief.p_WCoM + belief.v_WCoM * dt,
        v_WCoM=belief.v_WCoM,
        R_WO=R_step * belief.R_WO,
        w_WO=belief.w_WO,
        P_position=F @ belief.P_position @ F.T + _process_noise(dt, noise.acceleration),
        P_orientation=P_orientation,
    )


def update(
    belief: PoseBelief, p_WCoM_measured: FloatArray, R_WO_measured: Rotation, noise: PoseFilterNoise
) -> PoseBelief:
    """Returns the posterior after a measured pose at the belief's own time."""
    dx, P_position = _correct(belief.P_position, p_WCoM_measured - belief.p_WCoM, noise.position)
    theta = (R_WO_measured * belief.R_WO.inv()).as_rotvec()
    de, P_orientation = _correct(belief.P_orientation, theta, noise.orientation)
    return PoseBelief(
        time=belief.time,
        p_WCoM=belief.p_WCoM + dx[:3],
        v_WCoM=belief.v_WCoM + dx[3:],
        R_WO=Rotation.from_rotvec(de[:3]) * belief.R_WO,
        w_WO=belief.w_WO + de[3:],
        P_position=P_position,
        P_orientation=P_orientation,
    )


def _correct(P: FloatArray, innovation: FloatArray, std: float) -> tuple[FloatArray, FloatArray]:
    """Kalman correction for a measurement of the first three states, with Joseph's covariance."""
    S = P[:3, :3] + std**2 * np.eye(3)
    K = np.linalg.solve(S, P[:3]).T
    A = np.eye(6)
    A[:, :3] -= K
    return K @ innovation, A @ P @ A.T + std**2 * K @ K.T


def _process_noise(dt: float, density: float) -> FloatArray:
    """Covariance that white acceleration of that density adds to (position, velocity) in dt."""
    block = density**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    covariance: FloatArray = (block[:, None, :, None] * np.eye(3)[:, None, :]).reshape(6, 6)
    return covariance


def _diagonal(first: float, second: float) -> FloatArray:
    return np.diag(np.repeat([first**2, second**2], 3))


def _left_jacobian(theta: FloatArray) -> FloatArray:
    """Left Jacobian of SO(3) to second order in the turn of one step, shape (3, 3)."""
    X = skew(theta[None])[0]
    jacobian: FloatArray = np.eye(3) + X / 2 + X @ X / 6
    return jacobian
