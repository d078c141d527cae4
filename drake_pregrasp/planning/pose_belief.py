"""What is believed of a moving object's pose and twist, and what the belief assumes.

W is the world with z up, O the object, CoM its centre of mass; all vectors are expressed in W.
"""

import math
import sys
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.given_numbers import number_or_nan

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
