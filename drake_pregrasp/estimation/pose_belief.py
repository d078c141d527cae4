"""Belief on pose and twist of a moving object, and what the filter assumes about its motion.

W is the world with z up, O the object, CoM its centre of mass; all vectors are expressed in W, and
rotations come first, as in Drake's spatial vectors.
"""

import math
import sys
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from drake_pregrasp.arrays import FloatArray, number_or_nan
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.rotations import rotation_matrix, skew

# Least value of each assumption, and its range in words.
_POSITIVE = (math.ulp(0.0), "finite and above 0")
_NOT_NEGATIVE = (0.0, "finite and at least 0")
_FINITE = (-sys.float_info.max, "finite")
_LIMITS = dict.fromkeys(("position", "orientation", "bias_time"), _POSITIVE) | {"gravity": _FINITE}


@dataclass(frozen=True)
class PoseFilterNoise:
    """Noise and motion that the filter assumes; standard deviations are per axis.

    Attributes:
        position: Standard deviation of a measured position, in metres, above 0.
        orientation: Standard deviation of a measured orientation, as a rotation vector, in radians,
            above 0.
        acceleration: Square root of the white linear acceleration's density, in m/s²/sqrt(Hz), of
            the quietest model.
        angular_acceleration: Square root of the white angular acceleration's density, in
            rad/s²/sqrt(Hz), of the quietest model.
        initial_velocity: Standard deviation of the velocity before the first measurement, in m/s.
        initial_angular_velocity: Standard deviation of the angular velocity before the first
            measurement, in rad/s.
        gravity: Mean acceleration of the object, along -z of W, in m/s²: 0 for an object that
            something carries, about 9.81 for one in free flight, negative for one that rises.
        manoeuvre_acceleration: As `acceleration`, of the liveliest model.
        manoeuvre_angular_acceleration: As `angular_acceleration`, of the liveliest model.
        manoeuvre_rate: Number of times per second that the model is drawn anew; 0 for the quietest
            model alone.
        bias: Standard deviation of the offset of measured positions, per axis, in metres; 0 for
            none.
        bias_time: Time in which the correlation of the offset falls to 1/e, in seconds, above 0.

    Raises:
        InvalidArgumentError: If a value is not finite, if `position`, `orientation` or `bias_time`
            is not above 0, or if another value but `gravity` is below 0.
    """

    position: float
    orientation: float
    acceleration: float
    angular_acceleration: float
    initial_velocity: float
    initial_angular_velocity: float
    gravity: float = 0.0
    manoeuvre_acceleration: float = 0.0
    manoeuvre_angular_acceleration: float = 0.0
    manoeuvre_rate: float = 0.0
    bias: float = 0.0
    bias_time: float = 30.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            least, meant = _LIMITS.get(name, _NOT_NEGATIVE)
            if not least <= number_or_nan(value) < math.inf:
                raise InvalidArgumentError(f"{name} must be {meant}, not {value}")

    @cached_property
    def densities(self) -> FloatArray:
        """Spectral densities of angular and linear acceleration in each model, shape (K, 2).

        The models are `MODELS`, or the quietest one alone without manoeuvres.
        """
        quiet = np.array([self.angular_acceleration, self.acceleration])
        if not self.manoeuvre_rate:
            return quiet[None] ** 2
        most = (self.manoeuvre_angular_acceleration, self.manoeuvre_acceleration)
        lively, shares = np.maximum(quiet, most), np.array(MODELS)
        return np.asarray((quiet ** (1 - shares) * lively**shares) ** 2)

    @property
    def variances(self) -> FloatArray:
        """Variances of a measured orientation and position, shape (2,), in rad² and m²."""
        return np.square([self.orientation, self.position])

    def bias_step(self, dt: float) -> tuple[float, float]:
        """Returns what is left of the offset after dt, and the variance that is new.

        The offset is a Gauss-Markov process of first order: b(t + dt) = a b(t) + n with
        a = exp(-dt / bias_time), and with the variance (1 - a²) bias² of n.

        Args:
            dt: Length of the step, in seconds.
        """
        kept = math.exp(-dt / self.bias_time)
        return kept, (1 - kept**2) * self.bias**2

    @cached_property
    def liveliest(self) -> "PoseFilterNoise":
        """The same noise with the liveliest model alone.

        With it, the covariance of a prediction without measurements holds for an object that may
        start a manoeuvre at any moment.
        """
        rotation, translation = np.sqrt(self.densities[-1]).tolist()
        return replace(
            self, acceleration=translation, angular_acceleration=rotation, manoeuvre_rate=0.0
        )


MODELS = ((0.0, 0.0), (0.0, 0.75), (0.75, 0.0), (1.0, 1.0))
"""Models of the motion: place of the densities of angular and linear acceleration between those of
the quietest and of the liveliest model, on the scale of logarithms.

The models between them are for slow changes. Rotation and translation have one each, so that noise
of both parts together does not look like a manoeuvre.
"""


_WHOLE = np.eye(6)


@dataclass(frozen=True, eq=False)
class PoseMeasurement:
    """A measured pose, or the part of it that was measured.

    Attributes:
        time: Time of the measurement, in seconds; -inf if there is none.
        p_WO: Measured position, shape (3,), in metres.
        R_WO: Measured orientation, shape (3, 3).
        directions: Combinations of the errors (theta, p) of this pose in W that were measured, one
            each row, shape (6, 6). The errors of the first three have the assumed variance of an
            orientation, those of the others that of a position, and they are independent. The
            identity is a measured pose; a row of zeros measures nothing.
    """

    time: float
    p_WO: FloatArray
    R_WO: FloatArray
    directions: FloatArray = field(default_factory=lambda: _WHOLE)

    @property
    def is_whole(self) -> bool:
        """Whether all directions were measured."""
        return bool((np.abs(self.directions.diagonal()) > _LEAST_MEASURED).all())


@dataclass(frozen=True, eq=False)
class PoseBelief:
    """Estimate of the object's pose and twist at one time, by each of K models.

    Attributes:
        time: Time of the estimate, in seconds; -inf before the first measurement.
        weights: Probability of each model, shape (K,).
        R_WO: Mean orientations, shape (K, 3, 3).
        p_WCoM: Means of the centre of mass, shape (K, 3), in metres.
        V_WCoM: Mean angular velocity in rad/s and mean velocity of the centre of mass in m/s,
            shape (K, 6).
        P: Covariances of the errors (theta, p, w, v, b), shape (K, 12 + m, 12 + m), where the true
            orientation is Exp(theta) R_WO with theta expressed in W.
        b_W: Mean offsets of measured positions from the true ones, which change slowly, in W, shape
            (K, m), in metres: m is 3, or 0 if none is assumed.
    """

    time: float
    weights: FloatArray
    R_WO: FloatArray
    p_WCoM: FloatArray
    V_WCoM: FloatArray
    P: FloatArray
    b_W: FloatArray


_I = np.eye(3)
_LEAST_MEASURED = 1e-3  # Share of a direction that counts as measured.
_LEAST_SEEN = 0.01  # Share of the information of a measured orientation that shows a turn.
_UNKNOWN = 1000.0  # Standard deviation of a direction that was not measured, over the assumed one.
_BOOST_VARIANCE = 0.3**2  # Variance of a known change of twist, relative to its square.
_PARTS = np.kron(np.ones((2, 2)), np.kron(np.eye(2), np.ones((3, 3))))  # 1 within each part.

NO_MEASUREMENT = PoseMeasurement(-math.inf, np.zeros(3), _I)
"""Placeholder for a missing measurement."""


def no_belief(models: int = 1, offset: int = 0) -> PoseBelief:
    """Returns the placeholder for the belief before the first measurement.

    Args:
        models: Number of models.
        offset: Number of components of the offset of measured positions, 0 or 3.
    """
    k, n = models, 12 + offset
    weights, R_WO = np.full(k, 1 / k), np.tile(_I, (k, 1, 1))
    p_WCoM, V_WCoM, P = np.zeros((k, 3)), np.zeros((k, 6)), np.zeros((k, n, n))
    return PoseBelief(-math.inf, weights, R_WO, p_WCoM, V_WCoM, P, np.zeros((k, offset)))


def first_belief(
    measurement: PoseMeasurement,
    noise: PoseFilterNoise,
    p_OCoM: FloatArray | None = None,
    earlier: PoseBelief | None = None,
) -> PoseBelief:
    """Returns the belief after the first measurement: at rest, with the initial uncertainty.

    A direction that was not measured is a thousand times as uncertain as a measured one, and the
    object is taken not to turn about an axis about which its orientation was not measured.

    Args:
        measurement: The first measured pose.
        noise: Noise and motion that the filter assumes.
        p_OCoM: Centre of mass in O, shape (3,), in metres; the origin of O by default.
        earlier: Belief before the object was lost, which knows the offset of measured positions;
            none by default.
    """
    initial = np.square([noise.initial_angular_velocity, noise.initial_velocity])
    P = np.diag(np.repeat(np.append([0.0, 0.0], initial), 3))
    std = np.sqrt(np.repeat(noise.variances, 3))
    W = measurement.directions * std / std[:, None]
    squares, axes = np.linalg.eigh(W.T @ W)
    P[:6, :6] = (axes / np.maximum(squares, _UNKNOWN**-2)) @ axes.T * std * std[:, None]
    # What is not seen to turn, such as a can about its axis, is not taken to do so.
    seen, turns = np.linalg.eigh(W[:, :3].T @ W[:, :3])
    P[6:9, 6:9] = initial[0] * (turns * np.minimum(1.0, seen / _LEAST_SEEN)) @ turns.T
    p_WCoM, b_W = measurement.p_WO, np.zeros(0)
    if noise.bias:
        b_W, P_b = _known_offset(earlier, measurement.time, noise)
        p_WCoM = p_WCoM - b_W
        T = np.vstack([np.eye(12, 15), np.eye(3, 15, 12)])
        T[3:6, 12:] = -_I  # The position is the measured one without the offset.
        P = T @ np.block([[P, np.zeros((12, 3))], [np.zeros((3, 12)), P_b]]) @ T.T
    if p_OCoM is not None:
        a = measurement.R_WO @ p_OCoM
        p_WCoM = p_WCoM + a
        T = np.eye(len(P))  # An error theta moves the centre of mass by theta x a.
        T[3:6, :3] = -skew(a)
        P = T @ P @ T.T
    k = len(noise.densities)
    return replace(
        no_belief(k),
        time=measurement.time,
        R_WO=np.tile(measurement.R_WO, (k, 1, 1)),
        p_WCoM=np.tile(p_WCoM, (k, 1)),
        P=np.tile(P, (k, 1, 1)),
        b_W=np.tile(b_W, (k, 1)),
    )


def _known_offset(
    earlier: PoseBelief | None, time: float, noise: PoseFilterNoise
) -> tuple[FloatArray, FloatArray]:
    """Returns mean, shape (3,), and covariance, shape (3, 3), of the offset at a time."""
    if earlier is None or earlier.time == -math.inf:
        return np.zeros(3), noise.bias**2 * _I
    kept, added = noise.bias_step(max(0.0, time - earlier.time))
    mean = earlier.weights @ earlier.b_W
    d = earlier.b_W - mean
    P = np.einsum("k,kij->ij", earlier.weights, earlier.P[:, 12:, 12:] + d[:, :, None] * d[:, None])
    return kept * mean, kept**2 * P + added * _I


def boosted(belief: PoseBelief, dV: FloatArray, time: float) -> PoseBelief:
    """Returns the belief after a known change of the twist, as if it had always been larger by dV.

    The pose predicted for `time` stays the same. The change is known to 30 %, which adds to the
    covariance.

    Args:
        belief: Belief before the change.
        dV: Change of the angular velocity, in rad/s, and of the velocity of the centre of mass, in
            m/s, in W, shape (6,).
        time: Time of the change, in seconds.
    """
    dx, P = np.zeros(belief.P.shape[-1]), belief.P.copy()
    dx[:12] = np.concatenate([(belief.time - time) * dV, dV])
    P[:, :12, :12] += _BOOST_VARIANCE * np.outer(dx[:12], dx[:12]) * _PARTS
    return shifted(belief, np.tile(dx, (len(belief.weights), 1)), P)


def shifted(belief: PoseBelief, dx: FloatArray, P: FloatArray) -> PoseBelief:
    """Returns a belief at the same time with corrected means and other covariances.

    Args:
        belief: Belief before the correction.
        dx: Corrections of (theta, p, w, v, b), shape (K, 12 + m).
        P: Covariances, shape (K, 12 + m, 12 + m).
    """
    return PoseBelief(
        belief.time,
        belief.weights,
        rotation_matrix(dx[:, :3]) @ belief.R_WO,
        belief.p_WCoM + dx[:, 3:6],
        belief.V_WCoM + dx[:, 6:12],
        P,
        belief.b_W + dx[:, 12:],
    )
