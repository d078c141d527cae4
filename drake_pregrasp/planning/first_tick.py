"""The tick that comes with a time, or next after it."""

import math

_ROUNDING = 1e-6  # Share of a period: a time that rounding moved by so little is still the tick's.


def first_tick(time: float, period: float) -> int:
    """Returns the index of the first tick at or after a time; tick k is at k * period.

    Args:
        time: In seconds, finite.
        period: Seconds between ticks.
    """
    return math.ceil(time / period - _ROUNDING)
