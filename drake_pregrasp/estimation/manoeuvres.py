"""Search for a sudden change of an object's motion in its newest measurements.

The hypothesis "no change" is that of the track; the others say when the motion changed. They are
compared by their likelihoods, as in the generalised likelihood-ratio test of Willsky and Jones
(IEEE Transactions on Automatic Control 21(1), 1976).
"""

from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, pack, unpacker
from drake_pregrasp.estimation.pose_filter import (
    NO_MEASUREMENT,
    Innovation,
    PoseBelief,
    PoseFilterNoise,
    PoseMeasurement,
)
from drake_pregrasp.estimation.pose_track import (
    FIRST_GATE,
    MEASUREMENT_SIZE,
    PoseTrack,
    TrackerSettings,
    unpack_belief,
)

TELLING = 3.0
"""Standard deviations from its prediction beyond which a measurement may tell of a manoeuvre."""

_LONGEST_SURPRISE = 0.2  # Seconds for which a sudden acceleration is assumed at most.
_SHORTEST = 1e-6  # Seconds.
_WINDOWS = (3, 4, 5, 6, 8, 10, 12, 16)  # Numbers of measurements since a change.
_LARGEST_SQUARE = 20.0  # Largest squared distance that counts, since one may be of an outlier.
_ALERT = 20.0  # Sum of the last three squared distances; by chance one of 60 is larger.
_COST_OF_CHANGE = 8.0  # Least price of a change of any amount, 3 log(1 + gate²/3).
_EVIDENCE = 16.0  # Least difference of minus twice the logarithms of the likelihoods.

unpack_measurement = unpacker(NO_MEASUREMENT)
"""Returns the measurement in a vector, such as a row of `PoseTrack.recent`."""


@dataclass(frozen=True, eq=False)
class Replay:
    """Measurements that were applied once more, with other assumptions.

    Attributes:
        pairs: Each measurement with the belief after it.
        squared: νᵀ S⁻¹ ν of position and orientation, shape (k, 2).
        log_det: Sum of the logarithms of det S of each part, shape (2,).
        last: Innovation of the last one.
    """

    pairs: list[tuple[PoseMeasurement, PoseBelief]]
    squared: FloatArray
    log_det: FloatArray
    last: Innovation

    def steps(self) -> FloatArray:
        """Returns the pairs as rows of `PoseTrack.steps`."""
        return np.array([np.append(pack(seen), pack(after)) for seen, after in self.pairs])


def find_manoeuvre(
    track: PoseTrack, new: Innovation, is_outlier: bool, settings: TrackerSettings
) -> Replay | None:
    """Returns the newest measurements with a sudden change of motion before them, or None.

    Two laws tell of one. An acceleration within `settings.sudden`: the last measurement would be an
    outlier, the one before was off its prediction too, and predicts the last one once its velocity
    counts. A single outlier is no evidence, and two outliers seldom agree. And a change of the
    velocity, the angular velocity, or both, by any amount, in the interval before one of the
    `_WINDOWS` of newest measurements: it explains all of them, and makes them likelier by far. The
    change of a part is a white acceleration over that interval, which moves the object by
    `settings.gate` standard deviations of a measurement per interval.

    Args:
        track: Track before the last measurement, which is in `recent` already.
        new: Innovation of the last measurement. The earlier ones count as if they had the same S.
        is_outlier: Whether the last measurement would be an outlier.
        settings: Settings of the checks.
    """
    rows, factor = track.recent[:, :MEASUREMENT_SIZE], track.noise_factor
    recent, start = [unpack_measurement(row) for row in rows], _start_of(track, 2)
    if start and is_outlier and track.innovation_squared.max() > TELLING**2:
        pair = _replayed(start, recent[-2:], settings, factor, settings.sudden, settings.sudden)
        first, second = pair.squared.max(axis=1)
        is_short = track.last_seen[0] - start.time <= _LONGEST_SURPRISE
        if is_short and first <= settings.gate_squared and second <= TELLING**2:
            return pair
    squared = np.minimum(track.recent[:, MEASUREMENT_SIZE:], _LARGEST_SQUARE)
    best, found = _EVIDENCE, None
    if not squared[-3:].sum(axis=0).max() > _ALERT:
        return None
    log_det = np.linalg.slogdet(new.S)[1]
    for count in _WINDOWS:
        start = _start_of(track, count)
        if start is None:
            break
        if squared[-count:].sum(axis=0).max() - 2 * count < _EVIDENCE + _COST_OF_CHANGE:
            continue  # Even noise would leave a new motion squares of 2 a measurement.
        dt = track.recent[-count, 0] - start.time
        parts, likelier = np.zeros(2, dtype=bool), np.ones(2, dtype=bool)
        while likelier.any() and np.any(likelier != parts):  # Only likelier parts change.
            parts = likelier
            sudden = _sudden(settings, parts, dt)
            replay = _replayed(start, recent[-count:], settings, factor, sudden, settings.noise)
            # Differences of minus twice the logarithm of the likelihood.
            gains = (squared[-count:] - replay.squared).sum(axis=0)
            gains += count * log_det - replay.log_det
            likelier = parts & (gains > _EVIDENCE)
        gain = gains[likelier].sum()
        if gain > best and replay.squared.max() <= FIRST_GATE**2:
            best, found = gain, replay
    return found


def _start_of(track: PoseTrack, count: int) -> PoseBelief | None:
    """Returns the belief before that many newest measurements, or None without a recent one."""
    times = track.recent[-count:, 0]
    before = track.steps[track.steps[:, 0] < times[0]]
    if len(before) == 0 or np.any(np.diff(times) <= 0):
        return None
    is_recent = _SHORTEST < times[0] - before[-1, 0] <= _LONGEST_SURPRISE
    return unpack_belief(before[-1, MEASUREMENT_SIZE:]) if is_recent else None


def _sudden(settings: TrackerSettings, parts: BoolArray, dt: float) -> PoseFilterNoise:
    """Returns the noise with which parts change their velocity by any amount within dt."""
    noise, sudden = settings.noise, settings.sudden
    rate = settings.gate * dt**-1.5
    linear = max(sudden.acceleration, rate * noise.position)
    angular = max(sudden.angular_acceleration, rate * noise.orientation)
    return replace(
        noise,
        acceleration=linear if parts[0] else noise.acceleration,
        angular_acceleration=angular if parts[1] else noise.angular_acceleration,
    )


def _replayed(
    belief: PoseBelief,
    measurements: list[PoseMeasurement],
    settings: TrackerSettings,
    factor: float,
    noise: PoseFilterNoise,
    later_noise: PoseFilterNoise,
) -> Replay:
    """Returns measurements after a belief, with other noise until the first of them."""
    pairs, innovations = [], []
    for measurement in measurements:
        _, new, belief = settings.step(belief, measurement, noise, settings.p_OCoM, factor)
        pairs.append((measurement, belief))
        innovations.append(new)
        noise = later_noise
    log_det = np.linalg.slogdet([new.S for new in innovations])[1].sum(axis=0)
    squared = np.array([new.squared for new in innovations])
    return Replay(pairs, squared, log_det, new)
