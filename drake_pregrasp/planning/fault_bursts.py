"""Faults that come in bursts, such as occlusions."""

import functools
import math

from drake_pregrasp.planning.fault_draws import FaultChannel, fault_generator

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
