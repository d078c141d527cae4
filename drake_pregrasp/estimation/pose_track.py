"""State of the tracker: measurements, beliefs, and an alternative hypothesis; and its settings."""

import math
from dataclasses import dataclass, field, replace
from enum import IntEnum, unique
from functools import cached_property
from typing import Any

import numpy as np

from drake_pregrasp.arrays import SLACK, FloatArray, pack, unpacker
from drake_pregrasp.estimation.pose_filter import (
    NO_BELIEF,
    NO_MEASUREMENT,
    Innovation,
    PoseBelief,
    PoseFilterNoise,
    boosted,
    filter_step,
)


@unique
class TrackingStatus(IntEnum):
    """Quality of the estimate of an object's pose. A number without a status counts as `LOST`.

    Attributes:
        WAITING: No measurement was used yet.
        TRACKING: A recent measurement was used.
        COASTING: The estimate is a prediction that is still good enough to follow.
        LOST: The last measurement is too old to follow a prediction: the estimate stands still.
    """

    WAITING = 0
    TRACKING = 1
    COASTING = 2
    LOST = 3

    @classmethod
    def _missing_(cls, value: object) -> "TrackingStatus":
        return cls.LOST

    @property
    def is_followed(self) -> bool:
        """Whether goals may follow the estimate."""
        return self in FOLLOWED


FOLLOWED = (TrackingStatus.TRACKING, TrackingStatus.COASTING)
"""Values of `TrackingStatus` with which goals may follow the estimate."""


def tracking_status(
    since_measurement: float, period: float, coast_after: float, lost_after: float
) -> TrackingStatus:
    """Returns the status for the time by which the next measurement is overdue.

    Args:
        since_measurement: Seconds since the newest measurement that was used; inf if none was.
        period: Seconds between measurements.
        coast_after: Seconds overdue beyond which the status is `COASTING`.
        lost_after: Seconds overdue beyond which the status is `LOST`.
    """
    if since_measurement == math.inf:
        return TrackingStatus.WAITING
    overdue = since_measurement - (1 + SLACK) * period
    if overdue <= coast_after:
        return TrackingStatus.TRACKING
    return TrackingStatus.COASTING if overdue <= lost_after else TrackingStatus.LOST


@unique
class MeasurementVerdict(IntEnum):
    """Result of the check of a measurement.

    Attributes:
        NOTHING_NEW: There is no new measurement: its time is that of an earlier one.
        USED: The measurement corrected the newest belief.
        USED_LATE: The measurement corrected the belief of its own time, and the later measurements
            were used again.
        STARTED: The belief starts from this measurement: it is the first one, or the belief before
            it is too uncertain.
        REACQUIRED: The measurement and the refused ones before it refute the belief, which
            continues from them.
        UNUSABLE: Refused: its time or its pose is invalid.
        TOO_LATE: Refused: it is older than all measurements in memory.
        OUTLIER: Refused: it is too far from the prediction, or the alternative hypothesis explains
            it better than a belief that is not confirmed yet.
        REPEATED: Refused: a sensor with noise has repeated itself to the last bit.
    """

    NOTHING_NEW = 0
    USED = 1
    USED_LATE = 2
    STARTED = 3
    REACQUIRED = 4
    UNUSABLE = 5
    TOO_LATE = 6
    OUTLIER = 7
    REPEATED = 8


unpack_belief = unpacker(NO_BELIEF)
"""Returns the belief in a vector, such as an alternative hypothesis."""

unpack_measurement = unpacker(NO_MEASUREMENT)
"""Returns the measurement in a vector, such as a row of `PoseTrack.recent`."""

NO_ALTERNATIVE = pack(NO_BELIEF)
"""Placeholder for a missing alternative hypothesis."""

MEASUREMENT_SIZE = len(pack(NO_MEASUREMENT))
"""Number of columns of `PoseTrack.steps` that hold the measurement; the belief comes after it."""

RECENT = 16
"""Number of newest measurements in which a manoeuvre is searched for."""


@dataclass(frozen=True, eq=False)
class PoseTrack:
    """State of the tracker. Measurements and beliefs in it are packed into vectors.

    Attributes:
        steps: Newest measurements that were used, each with the belief after it, oldest first,
            shape (memory, 104); empty rows come first and have the time -inf.
        recent: Newest valid measurements, whether used or not, oldest first, each with νᵀ S⁻¹ ν of
            position and orientation, shape (`RECENT`, 15); empty rows come first and have the time
            -inf.
        alternative: Alternative hypothesis, shape (91,): the belief that follows from refused
            measurements that agree with each other; its time is -inf if there are none.
        support: Number of measurements that support the alternative hypothesis.
        refused: Number of outliers in excess of measurements that were used, at least 0; again 0
            once enough measurements in a row were used.
        confirmed: Number of measurements that were used since the last outlier.
        is_locked: Whether the measurements since the belief's start confirm its twist. The first
            measurement of all counts as confirmed until another one contradicts it.
        noise_level: Measurement-noise estimate, as a share of the expected noise, from 0 to 1.
        excess: Measured variance of recent innovations, relative to their expected variance.
        noise_factor: Measurement-noise estimate: variance of the sensor's noise over the assumed
            one. It is the excess, or 1 if the excess may be chance.
        verdict: Result of the check of the last measurement.
        last_innovation: Innovation of the newest measurement that was used in time, shape (2, 3).
        innovation_squared: νᵀ S⁻¹ ν of position and orientation of the last measurement that was
            compared with a prediction, shape (2,).
        V_held: Twist of the object that was known at the last tick, because a hand held it: angular
            velocity in rad/s and velocity of the centre of mass in m/s, in W, shape (2, 3); NaN if
            none was known.
    """

    steps: FloatArray
    recent: FloatArray
    alternative: FloatArray
    support: int
    refused: int
    confirmed: int
    is_locked: bool
    noise_level: float
    excess: float
    noise_factor: float
    verdict: MeasurementVerdict
    last_innovation: FloatArray
    innovation_squared: FloatArray
    V_held: FloatArray

    @property
    def last_seen(self) -> FloatArray:
        """Last valid measurement, whether used or not, shape (13,)."""
        return self.recent[-1, :MEASUREMENT_SIZE]

    @cached_property
    def newest(self) -> PoseBelief:
        """Belief after the newest measurement that was used, which ends the last step."""
        return unpack_belief(self.steps[-1, MEASUREMENT_SIZE:])

    def with_twist(self, V_held: FloatArray, time: float) -> "PoseTrack":
        """Returns the track after a known change of the object's twist.

        Beliefs continue with the new twist. Measurements from before it can no longer be used.

        Args:
            V_held: Present twist, shape (2, 3), as the attribute; NaN if none is known.
            time: Time at which the twist changed, in seconds.
        """
        if V_held.tobytes() == self.V_held.tobytes():  # Also if both are unknown.
            return self
        dV, after = V_held - self.V_held, replace(self, V_held=V_held)
        if np.any(np.isnan(dV)) or not np.any(dV) or self.newest.time == -math.inf:
            return after
        steps = PoseTrack.empty(len(self.steps)).steps
        newest = pack(boosted(self.newest, dV, time))
        steps[-1] = np.append(self.steps[-1, :MEASUREMENT_SIZE], newest)
        alternative = self.alternative
        if alternative[0] > -math.inf:
            alternative = pack(boosted(unpack_belief(alternative), dV, time))
        return replace(after, steps=steps, alternative=alternative)

    @staticmethod
    def empty(memory: int) -> "PoseTrack":
        """Returns the track before the first measurement.

        Args:
            memory: Number of steps in memory, at least 1.
        """
        return PoseTrack(
            steps=np.tile(np.concatenate([pack(NO_MEASUREMENT), NO_ALTERNATIVE]), (memory, 1)),
            recent=np.tile(np.append(pack(NO_MEASUREMENT), np.zeros(2)), (RECENT, 1)),
            alternative=NO_ALTERNATIVE,
            support=0,
            refused=0,
            confirmed=0,
            is_locked=True,
            noise_level=0.0,
            excess=1.0,
            noise_factor=1.0,
            verdict=MeasurementVerdict.NOTHING_NEW,
            last_innovation=np.zeros((2, 3)),
            innovation_squared=np.zeros(2),
            V_held=np.full((2, 3), np.nan),
        )


class FilterStep:
    """Implementation of `filter_step`, and of several steps; a subclass may be faster."""

    __call__ = staticmethod(filter_step)

    def replay(
        self,
        belief: PoseBelief,
        seen: FloatArray,
        first: tuple[float, float],
        noise: PoseFilterNoise,
        *assumed: Any,
    ) -> list[tuple[PoseBelief, Innovation]]:
        """Returns the belief after each of several measurements, and the innovation.

        Args:
            belief: Belief before the first measurement.
            seen: The measurements in vectors, in the order of their times, shape (k, 13).
            first: `acceleration` and `angular_acceleration` of the noise until the first one.
            noise: Assumed noise and motion after the first one.
            assumed: The last two arguments of `filter_step`.
        """
        steps, own = [], replace(noise, acceleration=first[0], angular_acceleration=first[1])
        for row in seen:
            _, new, belief = self(belief, unpack_measurement(row), own, *assumed)
            steps.append((belief, new))
            own = noise
        return steps

    def squares(self, *replayed: Any) -> FloatArray:
        """Returns νᵀ S⁻¹ ν of position and orientation, and log det S, in a replay.

        Args:
            replayed: Arguments of `replay`.

        Returns:
            Both for each measurement, shape (k, 2, 2): squares first, then logarithms.
        """
        innovations = [new for _, new in self.replay(*replayed)]
        log_det = np.linalg.slogdet([new.S for new in innovations])[1]
        return np.stack([[new.squared for new in innovations], log_det], axis=1)


FIRST_GATE = 4.0
"""Gate of a velocity that was never measured, in standard deviations of its prior."""


@dataclass(frozen=True)
class TrackerSettings:
    """Settings of the checks of measurements.

    Attributes:
        noise: Noise and motion that the filter assumes.
        sudden: The same with the accelerations of a sudden manoeuvre; see `find_manoeuvre`.
        gate: Mahalanobis distance from the prediction, of the position and of the orientation,
            beyond which a measurement is an outlier; 0 to use all measurements.
        reacquire_after: Number of refused measurements in a row, which agree with each other, that
            refute the belief.
        refuse_repeats: Whether to refuse measurements that repeat the one before to the last bit,
            while the object moves and the sensor has noise.
        p_OCoM: Centre of mass in O, shape (3,), in metres; the origin of O by default.
        step: Implementation of the filter's steps.
    """

    noise: PoseFilterNoise
    sudden: PoseFilterNoise
    gate: float
    reacquire_after: int
    refuse_repeats: bool
    p_OCoM: FloatArray | None = None
    step: FilterStep = field(default_factory=FilterStep)

    @cached_property
    def gate_squared(self) -> float:
        """Largest νᵀ S⁻¹ ν of a measurement that is used."""
        return self.gate * self.gate if self.gate > 0 else math.inf  # A power may overflow.

    @cached_property
    def first_gate_squared(self) -> float:
        """Largest νᵀ S⁻¹ ν that is used while the velocity has not been measured.

        The difference of two poses, which tells a velocity of any size, explains larger ones.
        """
        return min(self.gate_squared, FIRST_GATE**2) if self.gate > 0 else math.inf

    def gates_squared(self, belief: PoseBelief) -> FloatArray:
        """Returns the largest νᵀ S⁻¹ ν of a position and an orientation that a belief expects.

        A velocity of exactly zero was never measured.
        """
        unknown = [not belief.v_WCoM.any(), not belief.w_WO.any()]
        return np.where(unknown, self.first_gate_squared, self.gate_squared)
