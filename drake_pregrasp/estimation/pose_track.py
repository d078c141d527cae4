"""State of the tracker: measurements, beliefs, and an alternative hypothesis; and its settings."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum, unique
from functools import cached_property

import numpy as np

from drake_pregrasp.arrays import SLACK, FloatArray, pack, unpacker
from drake_pregrasp.estimation.noise_estimate import NoiseEstimate
from drake_pregrasp.estimation.pose_belief import (
    MODELS,
    NO_MEASUREMENT,
    PoseBelief,
    PoseFilterNoise,
    boosted,
    no_belief,
)
from drake_pregrasp.estimation.pose_filter import Correction, filter_step


@unique
class TrackingStatus(IntEnum):
    """Quality of the estimate of an object's pose. A number without a status counts as `LOST`.

    Attributes:
        WAITING: No measurement was used yet.
        TRACKING: The last measurements confirm the estimate: its error is within its covariance.
        COASTING: The estimate is a prediction, or no further measurement has confirmed it yet.
        LOST: The last confirmation is too old to follow a prediction: the estimate stands still.
    """

    WAITING = 0
    TRACKING = 1
    COASTING = 2
    LOST = 3

    @classmethod
    def _missing_(cls, value: object) -> "TrackingStatus":
        return cls.LOST


FOLLOWED = (TrackingStatus.TRACKING, TrackingStatus.COASTING)
"""Values of `TrackingStatus` with which goals may follow the estimate."""


@unique
class MeasurementVerdict(IntEnum):
    """Result of the check of a measurement.

    Attributes:
        NOTHING_NEW: There is no new measurement: its time is that of an earlier one.
        USED: The measurement corrected the newest belief.
        USED_LATE: The measurement corrected the belief of its own time, and the later measurements
            were used again.
        STARTED: The belief starts from this measurement: it is the first one, or the first one
            after 100 s of silence.
        REACQUIRED: The measurement and the two refused ones before it agree with each other: the
            belief continues from them.
        UNUSABLE: Refused, at each tick that reads it: it is not finite or not a valid rotation, its
            time is in the future or more than eleven days ago, or it is farther away than 10,000
            km.
        TOO_LATE: Refused: more than `late_measurements` used ones are newer, or it is older than a
            jump or than a change of the velocity at the port `V_WO_held`.
        OUTLIER: Refused: it is farther than `gate` standard deviations (Mahalanobis) from the
            prediction of each model. If it is nearer only to models with less than 10 % of the
            weight, it is held back; if the next one agrees with it, both are used, as the start of
            a manoeuvre.
        REPEATED: Refused: a sensor with noise has repeated itself to the last bit while the object
            moved.
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


unpack_measurement = unpacker(NO_MEASUREMENT)
"""Returns the measurement in a vector, such as in a row of `PoseTrack.steps`."""

MEASUREMENT_SIZE = len(pack(NO_MEASUREMENT))
"""Number of columns of `PoseTrack.steps` that hold the measurement; the belief comes after it."""

CONFIRMATIONS = 2
"""Number of consecutive measurements that confirm a belief."""

SUPPORT = 3
"""Number of refused measurements in a row that refute a belief if they agree with each other. The
first two only tell a twist."""


@dataclass(frozen=True, eq=False)
class PoseTrack:
    """State of the tracker. Measurements and beliefs in it are packed into vectors.

    Attributes:
        steps: Newest measurements that were used, each with the belief after it, oldest first,
            shape (memory, 49 + b); empty rows come first and have the time -inf.
        last_seen: Last valid measurement, whether used or not, shape (49,).
        alternative: Alternative hypothesis, shape (b,): the belief that follows from refused
            measurements that agree with each other, or from one that is held back; its time is -inf
            if there are none.
        support: Number of measurements that support the alternative hypothesis.
        refused: Number of outliers since the newest measurement that was used.
        begun_at: Time up to which measurements can no longer be used, in seconds.
        confirmations: Number of measurements in a row that confirmed the belief, at most
            `CONFIRMATIONS`.
        confirmed_at: Time at which a measurement or a touch last confirmed the belief, or that of
            the first measurement if none did yet, in seconds.
        noise: Measurement-noise estimate.
        verdict: Result of the check of the last measurement.
        innovation_squared: νᵀ S⁻¹ ν of position and orientation of the last measurement that was
            compared with a prediction, in the mean over the models, shape (2,).
        V_held: Twist of the object that was known at the last tick, because a hand held it: angular
            velocity in rad/s and velocity of the centre of mass in m/s, in W, shape (6,); NaN if
            none was known.
    """

    steps: FloatArray
    last_seen: FloatArray
    alternative: FloatArray
    support: int
    refused: int
    begun_at: float
    confirmations: int
    confirmed_at: float
    noise: NoiseEstimate
    verdict: MeasurementVerdict
    innovation_squared: FloatArray
    V_held: FloatArray

    @cached_property
    def newest(self) -> PoseBelief:
        """Belief after the newest measurement that was used, which ends the last step."""
        return unpack_belief(self.steps[-1, MEASUREMENT_SIZE:])

    def before(self, time: float) -> PoseBelief:
        """Returns the newest belief from before a time, in seconds, or else the oldest one."""
        index = max(int(np.count_nonzero(self.steps[:, 0] < time)) - 1, 0)
        return unpack_belief(self.steps[index, MEASUREMENT_SIZE:])

    @property
    def none(self) -> FloatArray:
        """Placeholder for a missing alternative hypothesis, with the time -inf."""
        return np.full_like(self.alternative, -np.inf)

    def with_newest(self, belief: PoseBelief, confirmed_at: float) -> "PoseTrack":
        """Returns the track with another belief after the newest measurement that was used.

        Args:
            belief: The belief.
            confirmed_at: Time at which it was last confirmed, in seconds.
        """
        steps = self.steps.copy()
        steps[-1, MEASUREMENT_SIZE:] = pack(belief)
        return replace(self, steps=steps, confirmed_at=confirmed_at)

    def status(
        self, now: float, period: float, coast_after: float, lost_after: float
    ) -> TrackingStatus:
        """Returns the status at a time.

        Args:
            now: Time, in seconds.
            period: Seconds between measurements.
            coast_after: Seconds by which a measurement is overdue at most while it is `TRACKING`.
            lost_after: Seconds by which a confirmation is overdue at most before it is `LOST`.
        """
        newest = float(self.steps[-1, 0])
        if newest == -math.inf:
            return TrackingStatus.WAITING
        due = now - (1 + SLACK) * period
        if due - self.confirmed_at > lost_after:
            return TrackingStatus.LOST
        is_confirmed = self.confirmations == CONFIRMATIONS and not self.refused
        if is_confirmed and due - newest <= coast_after:
            return TrackingStatus.TRACKING
        return TrackingStatus.COASTING

    def with_twist(self, V_held: FloatArray, time: float) -> "PoseTrack":
        """Returns the track after a known change of the object's twist.

        Beliefs continue with the new twist. Measurements from before it can no longer be used.

        Args:
            V_held: Present twist, shape (6,), as the attribute; NaN if none is known.
            time: Time at which the twist changed, in seconds.
        """
        if V_held.tobytes() == self.V_held.tobytes():  # Also if both are unknown.
            return self
        dV, after = V_held - self.V_held, replace(self, V_held=V_held)
        if np.any(np.isnan(dV)) or not np.any(dV) or self.newest.time == -math.inf:
            return after
        steps = np.full_like(self.steps, -np.inf)
        newest = pack(boosted(self.newest, dV, time))
        steps[-1] = np.append(self.steps[-1, :MEASUREMENT_SIZE], newest)
        alternative = self.alternative
        if alternative[0] > -math.inf:
            alternative = pack(boosted(unpack_belief(alternative), dV, time))
        return replace(after, steps=steps, alternative=alternative, begun_at=self.newest.time)

    @staticmethod
    def empty(memory: int, models: int = 1, offset: int = 0) -> "PoseTrack":
        """Returns the track before the first measurement.

        Args:
            memory: Number of steps in memory, at least 1.
            models: Number of models of the motion.
            offset: Number of components of the offset of measured positions, 0 or 3.
        """
        belief, measurement = pack(no_belief(models, offset)), pack(NO_MEASUREMENT)
        return PoseTrack(
            steps=np.tile(np.concatenate([measurement, belief]), (memory, 1)),
            last_seen=measurement,
            alternative=belief,
            support=0,
            refused=0,
            begun_at=-math.inf,
            confirmations=0,
            confirmed_at=-math.inf,
            noise=NoiseEstimate.empty(),
            verdict=MeasurementVerdict.NOTHING_NEW,
            innovation_squared=np.zeros(2),
            V_held=np.full(6, np.nan),
        )


def unpack_belief(vector: FloatArray) -> PoseBelief:
    """Returns the belief in a vector, such as an alternative hypothesis.

    Args:
        vector: Packed belief of K models, shape (1 + (19 + m + (12 + m)²) K,), with the m
            components of the offset.
    """
    return _UNPACKERS[len(vector)](vector)


_UNPACKERS = {
    len(pack(belief)): unpacker(belief)
    for belief in (no_belief(k, m) for k in (1, len(MODELS)) for m in (0, 3))
}

FilterStep = Callable[..., tuple[PoseBelief, Correction]]
"""Function with the arguments and the result of `filter_step`."""


@dataclass(frozen=True)
class TrackerSettings:
    """Settings of the checks of measurements.

    Attributes:
        noise: Noise and motion that the filter assumes.
        gate: Mahalanobis distance of a measured pose from the prediction of each model beyond which
            it is an outlier; 0 to use all measurements.
        symmetry: Rotations of O that leave the object unchanged, with the identity, shape
            (s, 3, 3).
        p_OCoM: Centre of mass in O, shape (3,), in metres; the origin of O by default.
        step: Implementation of the filter's steps.
    """

    noise: PoseFilterNoise
    gate: float
    symmetry: FloatArray
    p_OCoM: FloatArray | None = None
    step: FilterStep = filter_step

    @cached_property
    def gate_squared(self) -> float:
        """Largest νᵀ S⁻¹ ν of a measurement that is used."""
        return self.gate * self.gate if self.gate > 0 else math.inf  # A power may overflow.
