"""Kalman filter on the centre of mass and error-state filter on the orientation of a moving object.

Both assume a constant velocity disturbed by white acceleration noise, and the first one gravity, if
there is any. W is the world with z up, O the object, CoM its centre of mass; all vectors are
expressed in W.

W is the world with z up, O the object, CoM its centre of mass; all vectors are expressed in W.
"""

import math
import sys
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from drake_pregrasp.arrays import FloatArray, number_or_nan
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.rotations import (
    left_jacobian,
    rotation_matrix,
    rotation_vector,
)

# The least value of an assumption, and what it has to be in words.
_POSITIVE = (math.ulp(0.0), "finite and above 0")
_NOT_NEGATIVE = (0.0, "finite and at least 0")
_FINITE = (-sys.float_info.max, "finite")
_LIMITS = {"position": _POSITIVE, "orientation": _POSITIVE, "gravity": _FINITE}


@dataclass(frozen=True)
class PoseFilterNoise:
    """What the filter assumes of measurements and motion; standard deviations are per axis.

    Attributes:
        position: Of a measured position, in metres, above 0.
        orientation: Of a measured orientation, as a rotation vector, in radians, above 0.
        acceleration: Square root of the white linear acceleration's density, in m/s²/sqrt(Hz).
        angular_acceleration: The same for the angular acceleration, in rad/s²/sqrt(Hz).
        initial_velocity: Of the object's velocity before the first measurement, in m/s.
        initial_angular_velocity: The same for its angular velocity, in rad/s.
        gravity: Mean acceleration of the object, along -z of W, in m/s²: 0 for an object that
            something carries, about 9.81 for one in free flight, negative for one that rises.

    Raises:
        InvalidArgumentError: If one isn't finite, or `position` or `orientation` not above 0, or
            another one but `gravity` below 0.
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

    SIZE: ClassVar[int] = 91
    """How many numbers its vector form has."""

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

    @property
    def parts(self) -> list[FloatArray]:
        """What its vector form has, one after another; `SIZE` numbers in all."""
        return [
            np.array([self.time]),
            self.p_WCoM,
            self.v_WCoM,
            self.R_WO.ravel(),
            self.w_WO,
            self.P_position.ravel(),
            self.P_orientation.ravel(),
        ]

    def to_vector(self) -> FloatArray:
        """Returns the belief as one vector."""
        return np.concatenate(self.parts)

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


_I, _I6 = np.eye(3), np.eye(6)
_DRIFT, _MIXED, _RATE = (
    np.kron(np.array(block), _I) for block in ([[1, 0], [0, 0]], [[0, 1], [1, 0]], [[0, 0], [0, 1]])
)  # Where dt³/3, dt²/2 and dt stand in the process noise.
_UPPER = np.kron(np.array([[0, 1], [0, 0]]), _I)  # Where dt stands in a transition.
_TWO_I6 = np.array([_I6, _I6])


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
    p_WCoM, v_WCoM = belief.p_WCoM + belief.v_WCoM * dt, belief.v_WCoM
    if noise.gravity:
        fall = np.array([0.0, 0.0, -noise.gravity])
        p_WCoM, v_WCoM = p_WCoM + fall * (dt**2 / 2), v_WCoM + fall * dt
    turned = F_orientation[:3, :3]
    Q_position, Q_orientation = _process_noise(dt, noise)
    return PoseBelief(
        time=belief.time + dt,
        p_WCoM=p_WCoM,
        v_WCoM=v_WCoM,
        R_WO=turned @ belief.R_WO,
        w_WO=belief.w_WO,
        P_position=F_position @ belief.P_position @ F_position.T + Q_position,
        P_orientation=F_orientation @ belief.P_orientation @ F_orientation.T + Q_orientation,
    )


def transitions(belief: PoseBelief, dt: float) -> tuple[FloatArray, FloatArray]:
    """Returns the matrices that carry the two covariances `dt` seconds forward, each (6, 6)."""
    F_position, F_orientation = _I6 + dt * _UPPER, _I6.copy()
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


@dataclass(frozen=True, eq=False)
class Innovation:
    """How far a measured pose is from the prior, and how far it was to be expected.

    Position and orientation come one after the other in one array, so that one call solves both.

    Attributes:
        nu: How far the centre of mass is off, in metres, and the rotation vector from the prior
            orientation to the measured one, in radians, shape (2, 3).
        P: The prior's covariances, shape (2, 6, 6).
        R: Covariances of the measured position and orientation, shape (2, 3, 3), in m² and rad².
        S: Covariances of `nu`, the prior's and the measurement's, shape (2, 3, 3).
    """

    nu: FloatArray
    P: FloatArray
    R: FloatArray
    S: FloatArray

    @property
    def squared(self) -> FloatArray:
        """νᵀ S⁻¹ ν of position and orientation, shape (2,): each chi-square of 3 degrees."""
        solved = np.linalg.solve(self.S, self.nu[:, :, np.newaxis])[:, :, 0]
        return np.array([self.nu[0] @ solved[0], self.nu[1] @ solved[1]])


def innovation(
    belief: PoseBelief,
    p_WCoM_measured: FloatArray,
    R_WO_measured: FloatArray,
    noise: PoseFilterNoise,
    p_OCoM: FloatArray | None = None,
) -> Innovation:
    """Returns what a measured pose at the belief's own time has that is new; see `update`."""
    off, turn = p_WCoM_measured - belief.p_WCoM, rotation_vector(R_WO_measured @ belief.R_WO.T)
    P = np.array([belief.P_position, belief.P_orientation])
    R = _central_noise(noise)
    if p_OCoM is not None:
        R = np.array([measurement_covariance(belief.R_WO, noise, p_OCoM), R[1]])
    return Innovation(nu=np.array([off, turn]), P=P, R=R, S=P[:, :3, :3] + R)


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
    return corrected(belief, innovation(belief, p_WCoM_measured, R_WO_measured, noise, p_OCoM))


def corrected(belief: PoseBelief, new: Innovation) -> PoseBelief:
    """Returns the posterior after what is new in a measurement, with Joseph's covariance."""
    K_T = np.linalg.solve(new.S, new.P[:, :3])
    K = K_T.transpose(0, 2, 1)
    A = _TWO_I6.copy()
    A[:, :, :3] -= K
    dx, de = K[0] @ new.nu[0], K[1] @ new.nu[1]
    P_position, P_orientation = A @ new.P @ A.transpose(0, 2, 1) + K @ new.R @ K_T
    return PoseBelief(
        time=belief.time,
        p_WCoM=belief.p_WCoM + dx[:3],
        v_WCoM=belief.v_WCoM + dx[3:],
        R_WO=rotation_matrix(de[:3]) @ belief.R_WO,
        w_WO=belief.w_WO + de[3:],
        P_position=P_position,
        P_orientation=P_orientation,
    )


@lru_cache
def _central_noise(noise: PoseFilterNoise) -> FloatArray:
    """Covariances of a measured pose with the centre of mass at O's origin, shape (2, 3, 3).

    They are kept for the next tick: not to be written to.
    """
    return np.array([noise.position**2 * _I, noise.orientation**2 * _I])


@lru_cache(maxsize=256)  # As many differences as rounding makes between times a period apart.
def _process_noise(dt: float, noise: PoseFilterNoise) -> tuple[FloatArray, FloatArray]:
    """Covariances that white accelerations add to (position, velocity) in dt, linear and angular.

    They are kept for the next tick: not to be written to.
    """
    spread: FloatArray = dt**3 / 3 * _DRIFT + dt**2 / 2 * _MIXED + dt * _RATE
    return noise.acceleration**2 * spread, noise.angular_acceleration**2 * spread


def _diagonal(first: float, second: float) -> FloatArray:
    return np.diag(np.repeat([first**2, second**2], 3))
