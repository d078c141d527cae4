"""Follows a moving object by pose measurements that may be late, lost, repeated or wrong.

The pose filter does the estimating; this decides which measurements it gets, and when. What it
remembers is a `PoseTrack`; `take` is the step from one to the next.

Both are running means, and 1 on average if the filter's assumptions hold.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.arrays import FloatArray, is_whole, number_or_nan
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.pose_filter import (
    Innovation,
    PoseBelief,
    PoseFilterNoise,
    corrected,
    first_belief,
    innovation,
    predict,
)
from drake_pregrasp.estimation.pose_track import (
    OLDEST,
    MeasurementVerdict,
    PoseMeasurement,
    PoseTrack,
    Step,
)

_MEMORY = 0.05  # Share of the newest innovation in the means.
_LARGEST = 9.0  # What a single one can count for: it may be an outlier.


def noisiness_after(before: float, new: Innovation, last: FloatArray) -> float:
    """Returns how much noise there is, at most 1: near 0 for a sensor without noise.

    Noise makes an innovation differ from the one before it, by 2 S in the mean of the square; what
    the object does, and the filter doesn't expect, makes innovations that are like each other.

    Args:
        before: The mean so far.
        new: The newest innovation.
        last: The one before it, `nu`, shape (2, 3).
    """
    changes = ((new.nu - last) ** 2).tolist()
    variances = new.S.diagonal(axis1=1, axis2=2).tolist()
    shares = [
        sum(change) / (2 * sum(variance))
        for change, variance in zip(changes, variances, strict=True)
    ]
    return _mean(before, min(1.0, sum(shares) / len(shares)))


def excess_after(before: float, innovation_squared: FloatArray) -> float:
    """Returns how much larger innovations are than assumed, as a variance.

    Args:
        before: The mean so far.
        innovation_squared: νᵀ S⁻¹ ν of position and orientation, by the assumed noise, shape (2,).
    """
    newest = sum(innovation_squared.tolist()) / (3 * len(innovation_squared))
    return _mean(before, min(newest, _LARGEST))


def _mean(before: float, newest: float) -> float:
    return (1 - _MEMORY) * before + _MEMORY * newest


_VAGUE = 1.0  # Radians: a prior less certain of its orientation can't tell which way it turned.
_NOISY = 0.25  # Of what an innovation is on average: with less than that a sensor has no noise.
_TOLERATED = 2.0  # Excess of the sensor's noise, as a variance, that may be chance.
_PATIENCE = 5  # Times `reacquire_after`: so many outliers in a row leave nothing to believe.
_AT_REST = 3.0  # Standard deviations: slower ones may be none.
_NO_RIVAL = PoseBelief.empty()


@dataclass(frozen=True)
class TrackerSettings:
    """What measurements have to be like.

    A sensor that turns out to be noisier than assumed is believed less: once its innovations have
    been larger than expected for a while, its noise is taken to be as much larger, up to threefold.

    Attributes:
        noise: What the filter assumes.
        p_OCoM: See `measurement_covariance`.
        gate: Mahalanobis distance from the prediction, of the position and of the orientation,
            beyond which a measurement is an outlier; 0 to take all.
        reacquire_after: How many refused measurements in a row, which agree with each other,
            refute the belief.
        refuse_repeats: Whether to refuse measurements that repeat the one before to the last bit,
            while the object moves and the sensor has shown noise.

    Raises:
        InvalidArgumentError: If `gate` is below 0, or `reacquire_after` no whole number above 0.
    """

    noise: PoseFilterNoise
    p_OCoM: FloatArray | None = None
    gate: float = 7.0
    reacquire_after: int = 3
    refuse_repeats: bool = True

    def __post_init__(self) -> None:
        if not number_or_nan(self.gate) >= 0:
            raise InvalidArgumentError(f"gate must be at least 0, not {self.gate}")
        if not is_whole(self.reacquire_after, 1):
            raise InvalidArgumentError(
                f"reacquire_after must be a whole number, at least 1, not {self.reacquire_after}"
            )

    def expects(self, innovation_squared: FloatArray) -> bool:
        """Whether a measurement is as near to the prediction as the gate asks."""
        limit = self.gate * self.gate if self.gate > 0 else math.inf  # A power may overflow.
        return all(squared <= limit for squared in innovation_squared.tolist())


def take(
    track: PoseTrack, measurement: PoseMeasurement, now: float, settings: TrackerSettings
) -> PoseTrack:
    """Returns the track after what the sensor says at a tick.

    A measurement counts for the time it was made at. One that is older than the newest used
    corrects the belief of its time, and those used since then are used again.

    Args:
        track: What is remembered.
        measurement: What the sensor says; nothing new if its time is that of one before.
        now: The tick's time, in seconds.
        settings: What measurements have to be like.
    """
    if not measurement.is_there or measurement.time in track.times_seen:
        return track.judged(MeasurementVerdict.NOTHING_NEW)
    if not measurement.is_usable(now):
        return track.judged(MeasurementVerdict.UNUSABLE)
    seen, newest = track.last_seen, track.newest
    track = replace(track, last_seen=measurement)
    if track.is_empty:
        return _started(track, measurement, settings)
    if settings.refuse_repeats and measurement.repeats(seen) and _is_suspicious(track):
        return track.judged(MeasurementVerdict.REPEATED)
    if measurement.time < newest.time:
        return _taken_late(track, measurement, settings)
    silence = measurement.time - newest.time
    if silence > OLDEST:
        return _started(track, measurement, settings)
    prior = predict(newest, silence, settings.noise)
    if _is_vague(prior, settings.noise):
        return _started(track, measurement, settings)
    factor = _variance_factor(track)
    new = _innovation(prior, measurement, settings, factor)
    squared = new.squared
    excess = excess_after(track.excess, factor * squared)
    if settings.expects(squared):
        step = Step(measurement, corrected(prior, new))
        return replace(
            track,
            steps=track.steps_with(step),
            rival=_NO_RIVAL,
            rival_count=0,
            refused=0,
            last_innovation=new.nu,
            noisiness=noisiness_after(track.noisiness, new, track.last_innovation),
            excess=excess,
            verdict=MeasurementVerdict.USED,
            innovation_squared=squared,
        )
    track = replace(track, excess=excess, innovation_squared=squared)
    return _rivalled(track, prior, measurement, settings, factor)


def _started(
    track: PoseTrack, measurement: PoseMeasurement, settings: TrackerSettings
) -> PoseTrack:
    belief = _first_belief(measurement, settings)
    return track.begun(Step(measurement, belief), MeasurementVerdict.STARTED)


def _taken_late(
    track: PoseTrack, measurement: PoseMeasurement, settings: TrackerSettings
) -> PoseTrack:
    before, after = track.divided(measurement.time)
    if not len(before):
        return track.judged(MeasurementVerdict.TOO_LATE)
    belief = Step.from_vector(before[-1]).belief
    prior = predict(belief, measurement.time - belief.time, settings.noise)
    factor = _variance_factor(track)
    new = _innovation(prior, measurement, settings, factor)
    squared = new.squared
    excess = excess_after(track.excess, factor * squared)
    track = replace(track, excess=excess, innovation_squared=squared)
    if not settings.expects(squared):
        return track.judged(MeasurementVerdict.OUTLIER)
    step = Step(measurement, corrected(prior, new))
    steps = [step]
    for row in after:
        again = Step.from_vector(row).measurement
        prior = predict(step.belief, again.time - step.belief.time, settings.noise)
        step = Step(again, corrected(prior, _innovation(prior, again, settings, factor)))
        steps.append(step)
    return track.rewritten(before, steps).judged(MeasurementVerdict.USED_LATE)


def _rivalled(
    track: PoseTrack,
    prior: PoseBelief,
    measurement: PoseMeasurement,
    settings: TrackerSettings,
    factor: float,
) -> PoseTrack:
    """Returns the track after an outlier: a rival belief grows from those that agree.

    The first rival has jumped but moves on as before; if that doesn't hold, the next knows nothing
    of velocities. When so many in a row were outliers and still no rival held, nothing that is
    known is worth keeping.
    """
    rival, count = _jumped(prior, measurement, settings), 1
    if not track.rival.is_empty and track.rival.time < measurement.time:
        other = predict(track.rival, measurement.time - track.rival.time, settings.noise)
        new = _innovation(other, measurement, settings, factor)
        if settings.expects(new.squared):
            rival, count = corrected(other, new), track.rival_count + 1
        else:
            rival = _first_belief(measurement, settings)
    if count >= settings.reacquire_after:
        return track.begun(Step(measurement, rival), MeasurementVerdict.REACQUIRED)
    refused = track.refused + 1
    if refused >= _PATIENCE * settings.reacquire_after:
        return _started(track, measurement, settings)
    return replace(
        track,
        rival=rival,
        rival_count=count,
        refused=refused,
        verdict=MeasurementVerdict.OUTLIER,
    )


def _jumped(
    prior: PoseBelief, measurement: PoseMeasurement, settings: TrackerSettings
) -> PoseBelief:
    """Returns a prior that is moved to a measured pose, with its velocities."""
    jumped = _first_belief(measurement, settings)
    for P, of_prior in (
        (jumped.P_position, prior.P_position),
        (jumped.P_orientation, prior.P_orientation),
    ):
        P[3:, 3:] = of_prior[3:, 3:]
    return replace(jumped, v_WCoM=prior.v_WCoM, w_WO=prior.w_WO)


def _first_belief(measurement: PoseMeasurement, settings: TrackerSettings) -> PoseBelief:
    return first_belief(
        measurement.time, measurement.p_WCoM, measurement.R_WO, settings.noise, settings.p_OCoM
    )


def _variance_factor(track: PoseTrack) -> float:
    """Returns by how much the variance of the sensor's noise is larger than assumed."""
    return track.excess if track.excess > _TOLERATED else 1.0


def _innovation(
    prior: PoseBelief,
    measurement: PoseMeasurement,
    settings: TrackerSettings,
    variance_factor: float,
) -> Innovation:
    """Returns what is new in a measurement whose noise has that many times the assumed variance."""
    noise = settings.noise
    if variance_factor != 1:
        std = math.sqrt(variance_factor)
        noise = replace(noise, position=std * noise.position, orientation=std * noise.orientation)
    return innovation(prior, measurement.p_WCoM, measurement.R_WO, noise, settings.p_OCoM)


def _is_vague(prior: PoseBelief, noise: PoseFilterNoise) -> bool:
    """Whether its orientation is too uncertain to be corrected by a small turn."""
    variance = prior.P_orientation.diagonal()[:3].max()
    return bool(variance > _VAGUE**2 + noise.orientation**2)


def _is_suspicious(track: PoseTrack) -> bool:
    """Whether a repeated value can't be what the sensor saw."""
    belief = track.newest
    moves = any(
        rate @ np.linalg.solve(P[3:, 3:], rate) > _AT_REST**2
        for rate, P in ((belief.v_WCoM, belief.P_position), (belief.w_WO, belief.P_orientation))
    )
    return moves and track.noisiness > _NOISY
