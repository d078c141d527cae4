"""Search for a sudden change of an object's motion in its newest measurements.

The hypothesis "no change" is that of the track; the others say when the motion changed. They are
compared by their likelihoods, as in the generalised likelihood-ratio test of Willsky and Jones
(IEEE Transactions on Automatic Control 21(1), 1976).
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import FloatArray, pack
from drake_pregrasp.estimation.pose_filter import Innovation, PoseBelief
from drake_pregrasp.estimation.pose_track import (
    FIRST_GATE,
    MEASUREMENT_SIZE,
    PoseTrack,
    TrackerSettings,
    unpack_belief,
)

MANOEUVRE_GATE = 3.0
"""Standard deviations from its prediction beyond which a measurement may tell of a manoeuvre."""

_LONGEST_SURPRISE = 0.2  # Seconds for which a sudden acceleration is assumed at most.
_SHORTEST = 1e-6  # Seconds.
_WINDOWS = (3, 4, 5, 6, 8, 10, 12, 16)  # Numbers of measurements since a change.
_LARGEST_SQUARE = 20.0  # Largest squared distance that counts, since one may be of an outlier.
_ALERT = 20.0  # Sum of the last three squared distances; by chance one of 60 is larger.
_COST_OF_CHANGE = 8.0  # Least price of a change of any amount, 3 log(1 + gate²/3).
_EVIDENCE = 16.0  # Least difference of minus twice the logarithms of the likelihoods.


@dataclass(frozen=True, eq=False)
class Replay:
    """Measurements that were applied once more, with other assumptions.

    Attributes:
        seen: The measurements in vectors, shape (k, 13).
        after: Belief after each measurement, and its innovation.
    """

    seen: FloatArray
    after: list[tuple[PoseBelief, Innovation]]

    @property
    def squared(self) -> FloatArray:
        """Returns νᵀ S⁻¹ ν of position and orientation, shape (k, 2)."""
        return np.array([new.squared for _, new in self.after])

    @property
    def last(self) -> Innovation:
        """Returns the innovation of the last measurement."""
        return self.after[-1][1]

    def steps(self) -> FloatArray:
        """Returns the measurements, each with the belief after it, as `PoseTrack.steps`."""
        return np.hstack([self.seen, [pack(belief) for belief, _ in self.after]])


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
    seen, start = track.recent[:, :MEASUREMENT_SIZE], _start_of(track, 2)
    step, assumed = settings.step, (settings.p_OCoM, track.noise_factor)
    if start and is_outlier and track.innovation_squared.max() > MANOEUVRE_GATE**2:
        noise = settings.sudden
        first = noise.acceleration, noise.angular_acceleration
        pair = Replay(seen[-2:], step.replay(start, seen[-2:], first, noise, *assumed))
        before, last = pair.squared.max(axis=1)
        is_short = track.last_seen[0] - start.time <= _LONGEST_SURPRISE
        if is_short and before <= settings.gate_squared and last <= MANOEUVRE_GATE**2:
            return pair
    squared = np.minimum(track.recent[:, MEASUREMENT_SIZE:], _LARGEST_SQUARE)
    squared = squared[::-1].cumsum(axis=0)  # Row k: sum of the newest k + 1.
    best, found = _EVIDENCE, None
    if not squared[2].max() > _ALERT:
        return None
    log_det = np.linalg.slogdet(new.S)[1]
    for count in _WINDOWS:
        start = _start_of(track, count)
        if start is None:
            break
        if squared[count - 1].max() - 2 * count < _EVIDENCE + _COST_OF_CHANGE:
            continue  # Even noise would leave a new motion squares of 2 a measurement.
        dt = track.recent[-count, 0] - start.time
        parts, likelier = [False, False], [True, True]
        while any(likelier) and likelier != parts:  # Only likelier parts change.
            parts = likelier
            first = _sudden(settings, parts, dt)
            replayed = start, seen[-count:], first, settings.noise, *assumed
            squares = step.squares(*replayed)
            # Differences of minus twice the logarithm of the likelihood.
            gains = (squared[count - 1] + count * log_det - squares.sum(axis=(0, 1))).tolist()
            likelier = [mine and gain > _EVIDENCE for mine, gain in zip(parts, gains, strict=True)]
        gain = sum(itertools.compress(gains, likelier))
        if gain > best and squares[:, 0].max() <= FIRST_GATE**2:
            best, found = gain, replayed
    return found and Replay(found[1], step.replay(*found))


def _start_of(track: PoseTrack, count: int) -> PoseBelief | None:
    """Returns the belief before that many newest measurements, or None without a recent one."""
    times = track.recent[-count:, 0]
    before = int(np.searchsorted(track.steps[:, 0], times[0])) - 1
    if before < 0 or (times[1:] <= times[:-1]).any():
        return None
    is_recent = _SHORTEST < times[0] - track.steps[before, 0] <= _LONGEST_SURPRISE
    return unpack_belief(track.steps[before, MEASUREMENT_SIZE:]) if is_recent else None


def _sudden(settings: TrackerSettings, parts: Sequence[bool], dt: float) -> tuple[float, float]:
    """Returns the accelerations with which parts change their velocity by any amount within dt."""
    noise, sudden, rate = settings.noise, settings.sudden, settings.gate * dt**-1.5
    linear = max(sudden.acceleration, rate * noise.position)
    angular = max(sudden.angular_acceleration, rate * noise.orientation)
    return (
        linear if parts[0] else noise.acceleration,
        angular if parts[1] else noise.angular_acceleration,
    )
