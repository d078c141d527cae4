"""When a planning tick is due."""

import math


def tick_index(time: float, period: float) -> int:
    """Returns the number of the last tick at or before `time`; tick k is at k * period.

    The slack of a millionth of a period keeps the tick at k * period from counting as k - 1 when
    the product is rounded. Time -inf, before the first tick, has index -1.
    """
    return -1 if time == -math.inf else math.floor(time / period + 1e-6)
