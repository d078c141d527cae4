"""Velocity profiles: velocities over time, and their integrals."""

from collections.abc import Sequence

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError


class VelocityProfile:
    """Velocities that are linear between the rows of a table, and constant after the last row.

    Args:
        rows: Rows of a time in seconds and k velocities, with times that increase from 0. One row
            is a constant velocity.

    Raises:
        InvalidArgumentError: If the times do not increase from 0, or rows differ in length.
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
        """Number k of velocities."""
        return int(self._velocities.shape[1])

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Returns positions and velocities at a time of 0 s or more, shapes (k,).

        Positions are the exact integral of the velocities from 0: over a linear piece, the time
        times the mean of the velocities at its ends.
        """
        row = int(self._times.searchsorted(time, side="right")) - 1
        since = time - self._times[row]
        velocities: FloatArray = self._velocities[row] + since * self._accelerations[row]
        return self._positions[row] + since * (self._velocities[row] + velocities) / 2, velocities
