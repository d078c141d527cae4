"""Tracks a moving object by pose measurements that may be delayed, lost, repeated or wrong.

The pose filter estimates; the tracker decides which measurements it gets. Its state is a
`PoseTrack`, and `update_track` is the step from one to the next.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.arrays import (
    FloatArray,
    is_integer,
    is_valid_pose,
    number_or_nan,
    pack,
    unpack,
)
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.pose_filter import (
    NO_BELIEF,
    NO_MEASUREMENT,
    Innovation,
    PoseBelief,
    PoseFilterNoise,
    PoseMeasurement,
    corrected,
    first_belief,
    innovation,
    predict,
)
from drake_pregrasp.estimation.pose_track import (
    MEASUREMENT_SIZE,
    NO_ALTERNATIVE,
    MeasurementVerdict,
    PoseTrack,
)

OLDEST = 1e6
"""Largest age of a valid measurement, and longest prediction, in seconds."""

_SLACK = 1e-6  # Seconds by which rounding may put a time ahead of the clock.
_FORGETTING = 0.05  # Share of the newest innovation in the running means.
_LARGEST_EXCESS = 9.0  # Largest excess of a single innovation: it may be an outlier.
_VAGUE = 1.0  # Radians: with a larger deviation a small turn can't correct the orientation.
_NOISY = 0.25  # Noise level of a sensor without noise is below this.
_PATIENCE = 5  # Times `reacquire_after`: after so many outliers in a row the belief is dropped.
_AT_REST = 3.0  # Standard deviations up to which a velocity may be zero.


@dataclass(frozen=True)
class TrackerSettings:
    """Settings of the checks of measurements.

    Attributes:
        noise: Noise and motion that the filter assumes.
        p_OCoM: Centre of mass in O, shape (3,), in metres; the origin of O by default.
        gate: Mahalanobis distance from the prediction, of the position and of the orientation,
            beyond which a measurement is an outlier; 0 to use all measurements.
        reacquire_after: Number of refused measurements in a row, which agree with each other, that
            refute the belief.
        refuse_repeats: Whether to refuse measurements that repeat the one before to the last bit,
            while the object moves and the sensor has noise.

    Raises:
        InvalidArgumentError: If `gate` is below 0, or `reacquire_after` not an integer above 0.
    """

    noise: PoseFilterNoise
    p_OCoM: FloatArray | None = None
    gate: float = 7.0
    reacquire_after: int = 3
    refuse_repeats: bool = True

    @property
    def gate_squared(self) -> float:
        """Largest νᵀ S⁻¹ ν of a measurement that is used."""
        return self.gate * self.gate if self.gate > 0 else math.inf  # A power may overflow.

    def __post_init__(self) -> None:
        if not number_or_nan(self.gate) >= 0:
            raise InvalidArgumentError(f"gate must be at least 0, not {self.gate}")
        if not is_integer(self.reacquire_after, 1):
            raise InvalidArgumentError(
                f"reacquire_after must be a whole number, at least 1, not {self.reacquire_after}"
            )


def update_track(
    track: PoseTrack, measurement: PoseMeasurement, now: float, settings: TrackerSettings
) -> PoseTrack:
    """Returns the track after the sensor's output at a tick.

    A measurement counts for the time it was made at. An out-of-sequence measurement, one older than
    the newest that was used, corrects the belief of its own time, and the later ones are used
    again.

    Args:
        track: State of the tracker before the tick.
        measurement: Output of the sensor; it is not new if its time is that of an earlier one.
        now: Time of the tick, in seconds.
        settings: Settings of the checks.
    """
    time, last_seen, noise = measurement.time, track.last_seen, settings.noise
    if time == -math.inf or time == last_seen[0] or np.any(track.steps[:, 0] == time):
        return replace(track, verdict=MeasurementVerdict.NOTHING_NEW)
    is_recent = now - OLDEST <= time <= now + _SLACK
    if not (is_recent and is_valid_pose(measurement.R_WO, measurement.p_WCoM)):
        return replace(track, verdict=MeasurementVerdict.UNUSABLE)
    track, newest = replace(track, last_seen=pack(measurement)), track.newest
    if time - newest.time > OLDEST:  # Also without a belief, whose time is -inf.
        return _start(track, measurement, settings)
    is_repeated = settings.refuse_repeats and np.array_equal(track.last_seen[1:], last_seen[1:])
    if is_repeated and track.noise_level > _NOISY and _moves(newest):
        return replace(track, verdict=MeasurementVerdict.REPEATED)
    if time < newest.time:
        return _update_out_of_sequence(track, measurement, settings)
    prior = predict(newest, time - newest.time, noise)
    variance = prior.P_orientation.diagonal()[:3].max()
    if variance > _VAGUE**2 + noise.orientation**2:
        return _start(track, measurement, settings)
    new, after = _compare(track, prior, measurement, settings)
    if np.any(new.squared > settings.gate_squared):
        return _refuse(after, prior, measurement, settings, track.noise_factor)
    steps = np.empty_like(track.steps)
    steps[:-1] = track.steps[1:]
    steps[-1] = np.concatenate([track.last_seen, pack(corrected(prior, new))])
    # Noise makes an innovation differ from the one before it, by 2 S in the mean of the square. A
    # motion that the filter does not expect makes innovations that are like each other.
    changes = np.sum((new.nu - track.last_innovation) ** 2, axis=1)
    level = min(1.0, float(np.mean(changes / (2 * np.trace(new.S, axis1=1, axis2=2)))))
    return replace(
        after,
        steps=steps,
        alternative=NO_ALTERNATIVE,
        support=0,
        refused=0,
        last_innovation=new.nu,
        noise_level=(1 - _FORGETTING) * track.noise_level + _FORGETTING * level,
        verdict=MeasurementVerdict.USED,
    )


def _compare(
    track: PoseTrack, prior: PoseBelief, measurement: PoseMeasurement, settings: TrackerSettings
) -> tuple[Innovation, PoseTrack]:
    """Returns a measurement's innovation, and the track with new statistics of the innovations."""
    factor = track.noise_factor
    new = innovation(prior, measurement, settings.noise, settings.p_OCoM, factor)
    excess = min(sum((factor * new.squared).tolist()) / 6, _LARGEST_EXCESS)
    mean = (1 - _FORGETTING) * track.excess + _FORGETTING * excess
    return new, replace(track, excess=mean, innovation_squared=new.squared)


def _moves(belief: PoseBelief) -> bool:
    rates = ((belief.v_WCoM, belief.P_position), (belief.w_WO, belief.P_orientation))
    return any(rate @ np.linalg.solve(P[3:, 3:], rate) > _AT_REST**2 for rate, P in rates)


def _begin(track: PoseTrack, belief: PoseBelief, verdict: MeasurementVerdict) -> PoseTrack:
    """Returns a track with one step, of the last measurement and the belief after it."""
    steps = PoseTrack.empty(len(track.steps)).steps
    steps[-1] = np.concatenate([track.last_seen, pack(belief)])
    return replace(
        track, steps=steps, alternative=NO_ALTERNATIVE, support=0, refused=0, verdict=verdict
    )


def _start(track: PoseTrack, measurement: PoseMeasurement, settings: TrackerSettings) -> PoseTrack:
    belief = first_belief(measurement, settings.noise, settings.p_OCoM)
    return _begin(track, belief, MeasurementVerdict.STARTED)


def _update_out_of_sequence(
    track: PoseTrack, measurement: PoseMeasurement, settings: TrackerSettings
) -> PoseTrack:
    steps, noise = track.steps[track.steps[:, 0] > -np.inf], settings.noise
    count = int(np.searchsorted(steps[:, 0], measurement.time, side="right"))
    if count == 0:
        return replace(track, verdict=MeasurementVerdict.TOO_LATE)
    belief = unpack(NO_BELIEF, steps[count - 1, MEASUREMENT_SIZE:])
    prior = predict(belief, measurement.time - belief.time, noise)
    new, after = _compare(track, prior, measurement, settings)
    if np.any(new.squared > settings.gate_squared):
        return replace(after, verdict=MeasurementVerdict.OUTLIER)
    belief = corrected(prior, new)
    rows = [np.concatenate([track.last_seen, pack(belief)])]
    for seen in steps[count:, :MEASUREMENT_SIZE]:
        later = unpack(NO_MEASUREMENT, seen)
        prior = predict(belief, later.time - belief.time, noise)
        new = innovation(prior, later, noise, settings.p_OCoM, track.noise_factor)
        belief = corrected(prior, new)
        rows.append(np.concatenate([seen, pack(belief)]))
    memory = len(track.steps)
    kept = np.vstack([PoseTrack.empty(memory).steps, steps[:count], *rows])[-memory:]
    return replace(after, steps=kept, verdict=MeasurementVerdict.USED_LATE)


def _refuse(
    track: PoseTrack,
    prior: PoseBelief,
    measurement: PoseMeasurement,
    settings: TrackerSettings,
    noise_factor: float,
) -> PoseTrack:
    """Returns the track after an outlier, which starts or supports an alternative hypothesis.

    The first alternative has jumped but moves on as before. If it does not hold, the next one
    starts without knowledge of velocities. If so many measurements in a row were outliers and still
    no alternative held, the belief starts anew.
    """
    noise, p_OCoM = settings.noise, settings.p_OCoM
    fresh = first_belief(measurement, noise, p_OCoM)
    alternative, support = _jumped(prior, fresh), 1
    other = unpack(NO_BELIEF, track.alternative)
    if -math.inf < other.time < measurement.time:
        other = predict(other, measurement.time - other.time, noise)
        new = innovation(other, measurement, noise, p_OCoM, noise_factor)
        if np.any(new.squared > settings.gate_squared):
            alternative = fresh
        else:
            alternative, support = corrected(other, new), track.support + 1
    if support >= settings.reacquire_after:
        return _begin(track, alternative, MeasurementVerdict.REACQUIRED)
    refused = track.refused + 1
    if refused >= _PATIENCE * settings.reacquire_after:
        return _begin(track, fresh, MeasurementVerdict.STARTED)
    return replace(
        track,
        alternative=pack(alternative),
        support=support,
        refused=refused,
        verdict=MeasurementVerdict.OUTLIER,
    )


def _jumped(prior: PoseBelief, fresh: PoseBelief) -> PoseBelief:
    """Returns the pose of a fresh belief with the velocities of a prior."""
    P_position, P_orientation = fresh.P_position.copy(), fresh.P_orientation.copy()
    P_position[3:, 3:] = prior.P_position[3:, 3:]
    P_orientation[3:, 3:] = prior.P_orientation[3:, 3:]
    return replace(
        fresh,
        v_WCoM=prior.v_WCoM,
        w_WO=prior.w_WO,
        P_position=P_position,
        P_orientation=P_orientation,
    )
