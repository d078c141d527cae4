"""Changes over time: smooth ramps, and velocities with the positions they lead to."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError


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


class VelocityProfile:
    """Velocities that are linear between the rows of a table, and stay as they are after the last.

    Args:
        rows: Each a time in seconds and the k velocities then; times increase from 0. One row makes
            a constant velocity.

    Raises:
        InvalidArgumentError: If the times are otherwise, or rows differ in length.
    """

    def __init__(self, rows: Sequence[Sequence[float]]) -> None:
        if not rows or len({len(row) for row in rows}) != 1 or len(rows[0]) < 2:
            raise InvalidArgumentError(
                f"a profile needs rows of one length, a time and velocities, not {rows}"
            )
        table = np.array(rows, dtype=float)
        self._times, self._velocities = table[:, 0], table[:, 1:]
        steps = np.diff(self._times)
        if self._times[0] != 0 or not np.all(steps > 0):
            raise InvalidArgumentError(
                f"a profile's times must increase from 0, not be {self._times.tolist()}"
            )
        areas = steps[:, None] * (self._velocities[:-1] + self._velocities[1:]) / 2
        self._accelerations = np.zeros(self._velocities.shape)
        self._accelerations[:-1] = np.diff(self._velocities, axis=0) / steps[:, None]
        self._positions = np.vstack([np.zeros(self.size), np.cumsum(areas, axis=0)])

    @property
    def size(self) -> int:
        """The number k of velocities."""
        return int(self._velocities.shape[1])

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Returns positions and velocities at a time from 0 on, shapes (k,).

        Positions start at 0 and are the exact integral: over a linear piece, the time times the
        mean of the velocities at its ends.
        """
        row = int(self._times.searchsorted(time, side="right")) - 1
        since = time - self._times[row]
        velocities: FloatArray = self._velocities[row] + since * self._accelerations[row]
        positions: FloatArray = (
            self._positions[row] + since * (self._velocities[row] + velocities) / 2
        )
        return positions, velocities
