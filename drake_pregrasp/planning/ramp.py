"""A smooth change of a number from one value to another."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Ramp:
    """A value over time that starts and ends at rest, by the cubic 3 s² - 2 s³.

    Attributes:
        start: When it starts to change, in seconds.
        duration: How long it changes, in seconds; at least 0.
        first: Its value until then.
        last: Its value after that.
    """

    start: float
    duration: float
    first: float
    last: float

    @staticmethod
    def at_rest(value: float) -> "Ramp":
        """Returns a ramp that stays."""
        return Ramp(0.0, 0.0, value, value)

    def value(self, time: float) -> float:
        """Returns the value at a time."""
        s = self._share(time)
        return self.first + (self.last - self.first) * s * s * (3 - 2 * s)

    def rate(self, time: float) -> float:
        """Returns how fast it changes at a time, per second."""
        s = self._share(time)
        change = 6 * s * (1 - s) * (self.last - self.first)
        return change / self.duration if change else 0.0

    def is_over(self, time: float) -> bool:
        """Returns whether it has come to its end, but for rounding."""
        return time >= self.start + self.duration - 1e-9

    def _share(self, time: float) -> float:
        if time >= self.start + self.duration:
            return 1.0
        return max(0.0, (time - self.start) / self.duration)
