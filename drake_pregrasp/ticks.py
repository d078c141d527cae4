"""Planning ticks: tick k is at k * period, as near as floats can say it."""

import math

SLACK = 1e-6
"""Share of a period by which rounding may move a tick: k * period must not count as k - 1."""

_NEVER = -(10**18)


def tick_index(time: float, period: float) -> int:
    """Returns the number of the last tick at or before `time`.

    The time -inf, which stands for never, comes before every tick.
    """
    return _NEVER if time == -math.inf else math.floor(time / period + SLACK)


def first_tick(time: float, period: float) -> int:
    """Returns the number of the first tick at or after `time`, which is finite."""
    return math.ceil(time / period - SLACK)


def tick_is_due(time: float, stored_time: float, period: float) -> bool:
    """Returns whether what was stored at `stored_time` belongs to another tick than `time` does.

    That other tick is an earlier one as a rule, and a later one if a Context was set back in time.
    """
    return tick_index(time, period) != tick_index(stored_time, period)
