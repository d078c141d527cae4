"""Faults of pose measurements: their settings, their checks, and when they happen."""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from drake_pregrasp.ticks import first_tick


class FaultChannel(IntEnum):
    """What a fault's random numbers are for.

    They start at 1: numpy takes the entropy (seed, tick, 0) for (seed, tick), which is that of the
    measurement noise.
    """

    TAILS = 1
    OUTLIERS = 2
    DROPOUTS = 3
    JITTER = 4
    FREEZING = 5
    SIGN_FLIPS = 6
    NAN = 7


def fault_generator(seed: int, tick: int, channel: FaultChannel) -> np.random.Generator:
    """Returns a generator that starts anew: the same arguments give the same numbers.

    Args:
        seed: At least 0.
        tick: Index of the planning tick, of either sign.
        channel: Different ones have independent numbers.
    """
    return np.random.default_rng((seed, tick % 2**63, int(channel)))


CUT_OFF = 5.0
"""No burst is longer than this many mean lengths; a share of exp(-5) is cut to that."""

MAX_BURST_TICKS = 10_000
"""How many ticks the longest burst may have: at each tick one looks back so far."""

_REMEMBERED = 4 * MAX_BURST_TICKS  # Draws that are kept, enough to look back in both channels.


def in_burst(
    tick: int, *, rate: float, duration: float, period: float, seed: int, channel: FaultChannel
) -> bool:
    """Returns whether a burst covers a tick.

    Bursts start as a Poisson process, sampled at the ticks: at each tick one starts with the
    probability p = 1 - exp(-rate * period). Its length E is exponential, and it covers the ticks
    from its own to less than E later, so one at least, but none after the cut-off. Bursts may
    overlap. This is a queue with infinitely many servers (Takács, "Introduction to the Theory of
    Queues", 1962), in discrete time: its busy share is 1 - Π_a (1 - p P(E > a period)) over the
    ages a = 0, 1, ... of a burst in ticks.

    Being a function of the seed and the tick, it needs no memory, and is as busy at the first tick
    as at any other.

    Args:
        tick: Index of the planning tick.
        rate: Starts per second; 0 for no bursts.
        duration: Mean of the lengths before they are cut off, in seconds, greater than 0.
        period: Seconds between ticks.
        seed: Of the random numbers.
        channel: Of the random numbers.
    """
    if not rate:
        return False
    probability = -math.expm1(-rate * period)
    for age in range(burst_reach(duration, period)):
        start, length = _draws(seed, tick - age, channel)
        if start < probability and age * period < length * duration:
            return True
    return False


def burst_reach(duration: float, period: float) -> int:
    """Returns how many ticks the longest burst covers.

    Args:
        duration: See `in_burst`.
        period: Seconds between ticks.
    """
    return max(1, math.ceil(CUT_OFF * duration / period))


@functools.lru_cache(maxsize=_REMEMBERED)
def _draws(seed: int, tick: int, channel: FaultChannel) -> tuple[float, float]:
    """Returns a number from 0 to 1, and the length in means of a burst that starts there."""
    generator = fault_generator(seed, tick, channel)
    return generator.random(), generator.standard_exponential()


FOREVER = 1e7
"""When faults end by default, in seconds: after any run."""


@dataclass(frozen=True)
class MeasurementFaults:
    """Faults of a pose sensor; by default there are none.

    Attributes:
        noise_factor: By which the noise is larger.
        position_bias: Added to the position, in W, shape (3,), in metres.
        orientation_bias: A rotation vector in W by which the orientation is off, shape (3,), in
            radians.
        degrees_of_freedom: Of Student's t, in place of the normal noise; 0 for normal noise.
        outlier_probability: That a measurement is an outlier.
        outlier_position: How far the position of an outlier is off, in metres.
        outlier_orientation: How far its orientation is off, in radians.
        dropout_rate: How many occlusions start per second, on average.
        dropout_duration: Their mean length, in seconds.
        delay: From taking a measurement to its arrival, in seconds.
        jitter: Largest random addition to the delay, in seconds.
        out_of_order: Whether a measurement that others have overtaken counts when it arrives.
        freeze_rate: How often per second the value freezes, on average.
        freeze_duration: Mean length of that, in seconds.
        sign_flip_probability: That the quaternion of a measurement has the other sign.
        nan_probability: That a measurement is not a number.
        sample_period: Seconds between measurements; 0 for one each tick.
        start: Faults act on what is measured from this time on, in seconds.
        end: Until just before this time, in seconds.
    """

    noise_factor: float = 1.0
    position_bias: Sequence[float] = (0.0, 0.0, 0.0)
    orientation_bias: Sequence[float] = (0.0, 0.0, 0.0)
    degrees_of_freedom: float = 0.0
    outlier_probability: float = 0.0
    outlier_position: float = 0.1
    outlier_orientation: float = 0.5
    dropout_rate: float = 0.0
    dropout_duration: float = 0.5
    delay: float = 0.0
    jitter: float = 0.0
    out_of_order: bool = False
    freeze_rate: float = 0.0
    freeze_duration: float = 0.5
    sign_flip_probability: float = 0.0
    nan_probability: float = 0.0
    sample_period: float = 0.0
    start: float = 0.0
    end: float = FOREVER

    @property
    def need_memory(self) -> bool:
        """Whether what a sensor emits depends on earlier measurements."""
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
                *self.orientation_bias,
                self.degrees_of_freedom,
                self.outlier_probability,
                self.sign_flip_probability,
                self.nan_probability,
            )
        )

    def act_at(self, tick: int, period: float) -> bool:
        """Returns whether they act on what is measured at a tick.

        Args:
            tick: Its index; it is at tick * period.
            period: Seconds between ticks.
        """
        return first_tick(self.start, period) <= tick < first_tick(self.end, period)


MAX_DELAY_TICKS = 1000
"""Largest delay of a measurement, jitter included, in ticks: so many are remembered at most."""

_PROBABILITIES = ("outlier_probability", "sign_flip_probability", "nan_probability")
_NOT_NEGATIVE = (
    "noise_factor",
    "degrees_of_freedom",
    "outlier_position",
    "outlier_orientation",
    "dropout_rate",
    "delay",
    "jitter",
    "freeze_rate",
    "sample_period",
    "start",
)
_POSITIVE = ("dropout_duration", "freeze_duration", "end")
_VECTORS = ("position_bias", "orientation_bias")


class FaultFlaw(NamedTuple):
    """What is wrong with a setting.

    Attributes:
        name: Of the attribute of `MeasurementFaults`.
        problem: What is there and what would be right, in one line.
    """

    name: str
    problem: str


def find_flaw(faults: MeasurementFaults, period: float) -> FaultFlaw | None:
    """Returns the first setting that is unusable, or None.

    Args:
        faults: To be checked.
        period: Seconds between ticks, greater than 0.
    """
    return _out_of_range(faults) or _flaw_in_size(faults) or _flaw_in_time(faults, period)


def _out_of_range(faults: MeasurementFaults) -> FaultFlaw | None:
    for name in _VECTORS:
        vector = np.asarray(getattr(faults, name), dtype=float)
        if vector.shape != (3,) or not np.all(np.isfinite(vector)):
            return FaultFlaw(name, f"{vector.tolist()} must be three finite numbers")
    smallest = math.ulp(0.0)
    for names, low, high, meant in (
        (_PROBABILITIES, 0.0, 1.0, "a probability, from 0 to 1"),
        (_NOT_NEGATIVE, 0.0, math.inf, "at least 0, and finite"),
        (_POSITIVE, smallest, math.inf, "above 0, and finite"),
    ):
        for name in names:
            value = getattr(faults, name)
            if not (low <= value <= high and math.isfinite(value)):
                return FaultFlaw(name, f"{value} must be {meant}")
    return None


def _flaw_in_size(faults: MeasurementFaults) -> FaultFlaw | None:
    angle = math.hypot(*faults.orientation_bias)
    if angle > math.pi:
        problem = f"{list(faults.orientation_bias)} turns by {angle:.4g} rad; at most pi"
        return FaultFlaw("orientation_bias", problem)
    if faults.outlier_orientation > math.pi:
        return FaultFlaw("outlier_orientation", f"{faults.outlier_orientation} must be at most pi")
    if 0 < faults.degrees_of_freedom < 1:
        problem = f"{faults.degrees_of_freedom} must be 0, for normal noise, or at least 1"
        return FaultFlaw("degrees_of_freedom", problem)
    if faults.outlier_probability and not (faults.outlier_position or faults.outlier_orientation):
        problem = "outlier_position and outlier_orientation are both 0; one must be above"
        return FaultFlaw("outlier_probability", problem)
    return None


def _flaw_in_time(faults: MeasurementFaults, period: float) -> FaultFlaw | None:
    if not faults.start < faults.end:
        return FaultFlaw("start", f"{faults.start} must be less than end, which is {faults.end}")
    if not first_tick(faults.start, period) < first_tick(faults.end, period):
        problem = (
            f"{faults.start} must be a tick before end, {faults.end}: nothing is measured between"
        )
        return FaultFlaw("start", problem)
    if 0 < faults.sample_period < period:
        problem = f"{faults.sample_period} must be 0 or at least the planning period, {period}"
        return FaultFlaw("sample_period", problem)
    latest, limit = faults.delay + faults.jitter, MAX_DELAY_TICKS * period
    if latest > limit:
        problem = f"it is {latest:g} s with jitter; at most {MAX_DELAY_TICKS} ticks, {limit:g} s"
        return FaultFlaw("delay", problem)
    between = max(period, faults.sample_period)
    if faults.out_of_order and not faults.jitter > between:
        problem = f"with a jitter of {faults.jitter} s none overtakes; more than {between} s does"
        return FaultFlaw("out_of_order", problem)
    for kind in ("dropout", "freeze"):
        duration = getattr(faults, f"{kind}_duration")
        reach = burst_reach(duration, period)
        if getattr(faults, f"{kind}_rate") and reach > MAX_BURST_TICKS:
            longest = duration * MAX_BURST_TICKS / reach
            problem = f"{duration} must be at most {longest:g} with a period of {period} s"
            return FaultFlaw(f"{kind}_duration", problem)
    return None
