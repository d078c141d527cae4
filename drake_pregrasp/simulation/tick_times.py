"""How long ticks take, over runs of any length."""

import numpy as np

_SHORTEST = 1e-6
_STEPS = 100  # To a factor of e: percentiles are good to half a percent.
_DECADES = 9


class TickTimes:
    """A histogram of durations, on a logarithmic scale.

    Args:
        deadline: What a tick may take, in seconds.

    Attributes:
        overruns: How many took longer than that.
    """

    def __init__(self, deadline: float = np.inf) -> None:
        self.overruns = 0
        self._deadline = deadline
        self._counts = np.zeros(int(_STEPS * _DECADES * np.log(10)), dtype=np.int64)

    def add(self, seconds: float) -> None:
        """Counts a tick."""
        self.overruns += seconds > self._deadline
        bin_ = int(_STEPS * np.log(max(seconds, _SHORTEST) / _SHORTEST))
        self._counts[min(bin_, len(self._counts) - 1)] += 1

    def percentile_ms(self, percent: float) -> float | None:
        """Returns a percentile in milliseconds, to half a percent; None if there is no tick."""
        ends = np.cumsum(self._counts)
        if ends[-1] == 0:
            return None
        bin_ = np.searchsorted(ends, percent / 100 * ends[-1])
        return float(1e3 * _SHORTEST * np.exp((bin_ + 0.5) / _STEPS))
