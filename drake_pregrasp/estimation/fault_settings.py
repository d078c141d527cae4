"""Settings of a pose sensor's faults, and the random times at which they act."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import IntEnum, unique

import numpy as np

from drake_pregrasp.arrays import first_tick


@unique
class FaultChannel(IntEnum):
    """Use of a stream of random numbers.

    Values start at 1: numpy takes the entropy (seed, tick, 0) for (seed, tick), which is that of
    the measurement noise.
    """

    TAILS = 1
    OUTLIERS = 2
    DROPOUTS = 3
    JITTER = 4
    FREEZING = 5
    NAN = 6
    DEPTH = 7
    DRIFT = 8


def fault_generator(seed: int, tick: int, channel: FaultChannel) -> np.random.Generator:
    """Returns a generator that starts anew: the same arguments give the same numbers.

    Args:
        seed: Seed of the random numbers, at least 0.
        tick: Index of the planning tick, of either sign.
        channel: Use of the numbers; channels are independent of each other.
    """
    return np.random.default_rng((seed, tick % 2**63, int(channel)))


CUT_OFF = 5.0
"""Largest length of a burst, in mean lengths; a share of exp(-5) of the bursts is cut to it."""

MAX_BURST_TICKS = 10_000
"""Largest length of a burst, in ticks, and so of the look-back at each tick."""


def burst_end(
    ticks: Iterable[int],
    *,
    rate: float,
    duration: float,
    period: float,
    seed: int,
    channel: FaultChannel,
) -> float:
    """Returns the first tick after all bursts that start at some ticks; -inf if none does.

    Bursts start as a Poisson process, sampled at the ticks: at each tick one starts with the
    probability p = 1 - exp(-rate * period). Its length E is exponential, and it covers the ticks
    from its own to less than E later, so one at least, but none after the cut-off. Bursts may
    overlap. This is a queue with infinitely many servers (Takács, "Introduction to the Theory of
    Queues", 1962), in discrete time: its busy share is 1 - Π_a (1 - p P(E > a period)) over the
    ages a = 0, 1, ... of a burst in ticks.

    A burst is a function of the seed and its first tick. So bursts are as frequent at the first
    tick of a run as at any other, if those are looked for that started `burst_reach` ticks before.

    Args:
        ticks: Indices of planning ticks.
        rate: Starts per second; 0 for no bursts.
        duration: Mean of the lengths before they are cut off, in seconds, greater than 0.
        period: Seconds between ticks.
        seed: Seed of the random numbers.
        channel: Use of the random numbers.
    """
    end = -math.inf
    if not rate:
        return end
    probability, reach = -math.expm1(-rate * period), burst_reach(duration, period)
    for tick in ticks:
        generator = fault_generator(seed, tick, channel)
        if generator.random() < probability:
            ages = generator.standard_exponential() * duration / period
            end = max(end, tick + min(reach, max(1, math.ceil(ages))))
    return end


def burst_reach(duration: float, period: float) -> int:
    """Returns the number of ticks that the longest burst covers.

    Args:
        duration: Mean length of a burst before the cut-off, in seconds.
        period: Seconds between ticks.
    """
    return max(1, math.ceil(CUT_OFF * duration / period))


FOREVER = 1e7
"""Default end of faults, in seconds: after any run."""


_VECTOR = {"length": 3, "at_least": -10, "at_most": 10}
_ANGLES = {"length": 3, "at_least": -math.pi, "at_most": math.pi}
_PROBABILITY = {"at_least": 0, "at_most": 1}
_RATE = {"at_least": 0, "at_most": 1000}
_DURATION = {"above": 0, "at_most": 100}
_LAG = {"at_least": 0, "at_most": 100}


def _zeros() -> list[float]:
    return [0.0, 0.0, 0.0]


@dataclass
class MeasurementFaults:
    """Faults of a pose sensor; by default it has no faults."""

    # Factor on the standard deviations of the noise.
    noise_factor: float = field(default=1.0, metadata={"at_least": 0, "at_most": 1000})

    # Constant error of the position, along the axes of W, in metres.
    position_bias: list[float] = field(default_factory=_zeros, metadata=_VECTOR)

    # Standard deviation of an error of the position that drifts, along each axis of W, in metres.
    drift_std: float = field(default=0.0, metadata={"at_least": 0, "at_most": 10})

    # Time constant of the drift, a Gauss-Markov process, in seconds.
    drift_time: float = field(default=5.0, metadata={"at_least": 0.01, "at_most": 1e6})

    # Constant error of the orientation: a rotation vector in W, of at most half a turn, in radians.
    orientation_bias: list[float] = field(default_factory=_zeros, metadata=_ANGLES)

    # Degrees of freedom of Student's t, at least 1, for noise with heavy tails; the sensor's
    # standard deviations are then its scale. 0: the noise is normal.
    degrees_of_freedom: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1e6})

    # Probability that a measurement is an outlier.
    outlier_probability: float = field(default=0.0, metadata=_PROBABILITY)

    # Distance by which the position of an outlier is off, in a random direction, in metres.
    outlier_position: float = field(default=0.1, metadata={"at_least": 0, "at_most": 10})

    # Angle by which the orientation of an outlier is off, about a random axis, in radians.
    outlier_orientation: float = field(default=0.5, metadata={"at_least": 0, "at_most": math.pi})

    # Mean number of occlusions per second, during which nothing is measured.
    dropout_rate: float = field(default=0.0, metadata=_RATE)

    # Mean length of an occlusion, in seconds. Lengths are exponential, up to five times the mean.
    dropout_duration: float = field(default=0.5, metadata=_DURATION)

    # Seconds from a measurement to its arrival; together with `jitter`, at most 1000 planning
    # periods.
    delay: float = field(default=0.0, metadata=_LAG)

    # Largest addition to the delay, in seconds; additions are uniform from 0 on.
    jitter: float = field(default=0.0, metadata=_LAG)

    # Whether out-of-sequence measurements count when they arrive; otherwise they are dropped. This
    # needs a jitter longer than the time between measurements.
    out_of_order: bool = False

    # Mean number of times per second that the measured value freezes: it repeats, with new times.
    freeze_rate: float = field(default=0.0, metadata=_RATE)

    # Mean length of a freeze, in seconds; lengths are distributed as those of occlusions.
    freeze_duration: float = field(default=0.5, metadata=_DURATION)

    # Probability that a measurement is not a number.
    nan_probability: float = field(default=0.0, metadata=_PROBABILITY)

    # Seconds between measurements, at least planner.period; 0 for one each planning tick.
    sample_period: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1000})

    # Faults act on what is measured from this time on, in seconds.
    start: float = field(default=0.0, metadata={"at_least": 0, "at_most": FOREVER})

    # Faults act until just before this time, in seconds.
    end: float = field(default=FOREVER, metadata={"above": 0, "at_most": FOREVER})

    @property
    def need_memory(self) -> bool:
        """Whether the sensor's output depends on earlier measurements."""
        return any(
            (self.dropout_rate, self.delay, self.jitter, self.freeze_rate, self.sample_period)
        )

    @property
    def are_any(self) -> bool:
        """Whether there is any fault at all."""
        return self.need_memory or any(
            (
                self.noise_factor != 1,
                *self.position_bias,
                self.drift_std,
                *self.orientation_bias,
                self.degrees_of_freedom,
                self.outlier_probability,
                self.nan_probability,
            )
        )

    def act_at(self, tick: int, period: float) -> bool:
        """Returns whether faults act on the measurement of a tick.

        Args:
            tick: Index of the tick, which is at tick * period.
            period: Seconds between ticks.
        """
        return first_tick(self.start, period) <= tick < first_tick(self.end, period)


MAX_DELAY_TICKS = 1000
"""Largest delay of a measurement, jitter included, in ticks, and so of the sensor's memory."""
