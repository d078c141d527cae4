"""Faults of a simulated pose sensor: wrong, lost, frozen and delayed measurements.

Each fault is a function of the seed and the tick. While faults do not act, a measurement is taken
at each tick, and arrives at once.
"""

from dataclasses import dataclass, replace

import numpy as np

from drake_pregrasp.arrays import FloatArray, first_tick
from drake_pregrasp.estimation.fault_settings import (
    FaultChannel,
    MeasurementFaults,
    burst_end,
    burst_reach,
    fault_generator,
)
from drake_pregrasp.geometry.rotations import rotation_matrix


def faulty_disturbance(
    noise: FloatArray,
    position_scale: float | FloatArray,
    orientation_std: float,
    faults: MeasurementFaults,
    *,
    tick: int,
    period: float,
    seed: int,
) -> tuple[FloatArray, FloatArray]:
    """Returns the offset, shape (3,), and the turn, shape (3, 3), of a measurement with faults.

    The measured pose M of the object O is p_WM = p_WO + offset, R_WM = turn R_WO. With the scaled
    noise n, bias b, drift d, an outlier o, and the same for the orientation without a drift,

        offset = S n + b + d + o,  turn = Exp(o_R) Exp(orientation_std n_R) Exp(b_R).

    An invalid measurement is NaN in all its numbers.

    Args:
        noise: Standard normal numbers, shape (6,), three each for position and orientation.
        position_scale: Scale S of the noise or of Student's t: a standard deviation, or a matrix of
            shape (3, 3), in metres.
        orientation_std: The same for the orientation's rotation vector, in radians.
        faults: Faults that act; `next_memory` applies those that concern time.
        tick: Index of the planning tick.
        period: Seconds between ticks.
        seed: Seed of the random numbers.
    """
    # A generator takes longer to make than the rest.
    chance = faults.nan_probability
    if chance and fault_generator(seed, tick, FaultChannel.NAN).random() < chance:
        return np.full(3, np.nan), np.full((3, 3), np.nan)
    if faults.degrees_of_freedom:
        # A normal vector over the root of a chi-square number by its degrees of freedom is a vector
        # of the multivariate t (Lange, Little & Taylor, "Robust statistical modeling using the t
        # distribution", 1989). Position and orientation have a chi-square number each.
        tails = fault_generator(seed, tick, FaultChannel.TAILS)
        squares = tails.chisquare(faults.degrees_of_freedom, size=2)
        noise = noise / np.repeat(np.sqrt(squares / faults.degrees_of_freedom), 3)
    noise = faults.noise_factor * noise
    offset = np.dot(position_scale, noise[:3]) + np.asarray(faults.position_bias)
    if faults.drift_std:
        offset = offset + faults.drift_std * drift(tick * period / faults.drift_time, seed)
    turn = rotation_matrix(orientation_std * noise[3:])
    turn = turn @ rotation_matrix(np.asarray(faults.orientation_bias, dtype=float))
    chance = faults.outlier_probability
    outliers = fault_generator(seed, tick, FaultChannel.OUTLIERS) if chance else None
    if outliers and outliers.random() < chance:
        offset = offset + faults.outlier_position * _direction(outliers)
        turn = rotation_matrix(faults.outlier_orientation * _direction(outliers)) @ turn
    return offset, turn


_WAVES = 64  # Waves of a drift along each axis.


def drift(time: float, seed: int, sensor: int = 0) -> FloatArray:
    """Returns independent Gauss-Markov processes of unit variance at a time, shape (3,).

    Each is a sum of waves with random phases. As their frequencies have Cauchy's distribution, its
    covariance over a lag s is exp(-|s|) in the mean over seeds, and nothing is remembered from tick
    to tick (Shinozuka & Jan, "Digital simulation of random processes and its applications", 1972).

    Args:
        time: Time in units of the time constant.
        seed: Seed of the random numbers.
        sensor: Index of the sensor, each of which has processes of its own.
    """
    generator = fault_generator(seed, sensor, FaultChannel.DRIFT)
    frequencies = generator.standard_cauchy((3, _WAVES))
    phases = generator.uniform(0, 2 * np.pi, (3, _WAVES))
    return np.asarray(np.sqrt(2 / _WAVES) * np.cos(frequencies * time + phases).sum(axis=1))


def _direction(generator: np.random.Generator) -> FloatArray:
    """Returns a unit vector, shape (3,), uniform on the sphere (Muller, 1959)."""
    vector = generator.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))


def is_taken(tick: int, faults: MeasurementFaults, period: float) -> bool:
    """Returns whether a measurement is taken at a tick.

    Measurement n is due at n * sample_period, and is taken at the first tick from then on.

    Args:
        tick: Index of the tick.
        faults: Faults of the sensor, with the sample period; each tick has a measurement if it
            is 0.
        period: Seconds between ticks.
    """
    if not faults.sample_period or not faults.act_at(tick, period):
        return True
    n = first_tick(tick * period, faults.sample_period)
    return tick in (first_tick(k * faults.sample_period, period) for k in (n - 1, n))


def arrival_tick(tick: int, faults: MeasurementFaults, period: float, seed: int) -> int:
    """Returns the tick at which a measurement arrives: the first one after delay and jitter.

    Args:
        tick: Index of the tick at which the measurement is taken.
        faults: Faults of the sensor, with delay and jitter.
        period: Seconds between ticks.
        seed: Seed of the random numbers.
    """
    if not faults.act_at(tick, period):
        return tick
    share = fault_generator(seed, tick, FaultChannel.JITTER).random()
    return tick + first_tick(faults.delay + share * faults.jitter, period)


POSE_SIZE = 12
"""Numbers of a pose: its rotation matrix and its position side by side, by rows."""


@dataclass(frozen=True, eq=False)
class SensorMemory:
    """State of the sensor after a tick.

    Attributes:
        tick: Index of the tick; -inf before the first.
        occluded_until: First tick after the occlusions so far; -inf if there was none.
        hidden_until: First tick at which an object that was hidden is measured again; -inf if it
            was never hidden.
        frozen_until: First tick after the freezing of values so far; -inf if there was none.
        stamp: Time of the measurement that arrived last, in seconds; -inf if none has.
        pose: Pose of the measurement that arrived last, shape (12,); NaN if there is none.
        is_frozen: Whether a value is repeated.
        frozen: Pose that is repeated, shape (12,); NaN if there is none.
        under_way: Measurements that have not arrived, shape (capacity, 14): time of each, in
            seconds, index of the tick at which it arrives, and pose; infinite where there is none.
    """

    tick: float
    occluded_until: float
    hidden_until: float
    frozen_until: float
    stamp: float
    pose: FloatArray
    is_frozen: bool
    frozen: FloatArray
    under_way: FloatArray

    @staticmethod
    def empty(faults: MeasurementFaults, period: float) -> "SensorMemory":
        """Returns the state before the first tick.

        Args:
            faults: Faults of the sensor; delay and jitter bound the number of measurements under
                way.
            period: Seconds between ticks.
        """
        capacity = first_tick(faults.delay + faults.jitter, period)
        no_pose = np.full(POSE_SIZE, np.nan)
        under_way = np.full((capacity, 2 + POSE_SIZE), np.inf)
        never = -np.inf
        return SensorMemory(never, never, never, never, never, no_pose, False, no_pose, under_way)


def next_memory(
    memory: SensorMemory,
    pose: FloatArray,
    *,
    time: float,
    tick: int,
    faults: MeasurementFaults,
    period: float,
    seed: int,
    hidden: int = 0,
) -> SensorMemory:
    """Returns the state of the sensor after a tick.

    1. A measurement is taken at this tick, or not.
    2. While the value is frozen, it is that of the burst's first measurement, with a new time.
    3. While the object is occluded or hidden, the measurement is lost.
    4. The measurement arrives at the first tick after delay and jitter. If several arrive at one
       tick, the one that was taken last counts. An out-of-sequence measurement, which arrives after
       a later one, counts only if `out_of_order`.

    If the memory is of this tick or a later one, the sensor starts anew. Nothing is measured at
    ticks that were skipped, and no value stays frozen over them.

    Args:
        memory: State after the tick before.
        pose: Measured pose at this tick, shape (12,).
        time: Time of the tick, in seconds.
        tick: Index of the tick.
        faults: Faults of the sensor.
        period: Seconds between ticks.
        seed: Seed of the random numbers.
        hidden: Number of ticks, from this one on, at which the object is not measured because
            something hides it now.
    """
    if memory.tick >= tick:
        memory = SensorMemory.empty(faults, period)
    memory = _with_bursts(memory, tick, faults, period, seed)
    if hidden:
        memory = replace(memory, hidden_until=max(memory.hidden_until, tick + hidden))
    taken, acts = is_taken(tick, faults, period), faults.act_at(tick, period)
    frozen = memory.frozen if memory.is_frozen and memory.tick == tick - 1 else None
    if not (acts and tick < memory.frozen_until):
        frozen = None
    elif frozen is None and taken:
        frozen = pose
    sent = memory.under_way
    is_lost = (acts and tick < memory.occluded_until) or tick < memory.hidden_until
    if taken and not is_lost:
        arrival = arrival_tick(tick, faults, period, seed)
        sent = np.vstack([sent, np.r_[time, arrival, pose if frozen is None else frozen]])
    has_arrived = sent[:, 1] <= tick
    arrived = sent[has_arrived]
    if len(arrived):
        last = arrived[np.argmax(arrived[:, 0])]
        if faults.out_of_order or last[0] > memory.stamp:
            memory = replace(memory, stamp=float(last[0]), pose=last[2:])
    waiting = sent[~has_arrived & np.isfinite(sent[:, 1])]
    under_way = np.full_like(memory.under_way, np.inf)
    under_way[: len(waiting)] = waiting
    return replace(
        memory,
        tick=float(tick),
        is_frozen=frozen is not None,
        frozen=np.full(POSE_SIZE, np.nan) if frozen is None else frozen,
        under_way=under_way,
    )


def _with_bursts(
    memory: SensorMemory, tick: int, faults: MeasurementFaults, period: float, seed: int
) -> SensorMemory:
    """Returns the state with the ends of bursts up to a tick; arguments as in `next_memory`."""

    def end(known: float, rate: float, duration: float, channel: FaultChannel) -> float:
        # After skipped ticks, and before the first one, bursts may have begun that still last.
        before = 0 if memory.tick == tick - 1 else burst_reach(duration, period) - 1
        ticks = range(tick - before, tick + 1)
        new = burst_end(
            ticks, rate=rate, duration=duration, period=period, seed=seed, channel=channel
        )
        return max(known, new)

    dropout, freezing = FaultChannel.DROPOUTS, FaultChannel.FREEZING
    return replace(
        memory,
        occluded_until=end(
            memory.occluded_until, faults.dropout_rate, faults.dropout_duration, dropout
        ),
        frozen_until=end(memory.frozen_until, faults.freeze_rate, faults.freeze_duration, freezing),
    )
