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

    Attributes:
        times: Time of each row, shape (m,), in seconds.
        coefficients: Positions after each row as polynomials of the time s since then,
            p + v s + a s²/2: p, v and a/2 of each, shape (m, k, 3).

    Raises:
        InvalidArgumentError: If the times do not increase from 0, or rows differ in length.
    """

    def __init__(self, rows: Sequence[Sequence[float]]) -> None:
        if not rows or len({len(row) for row in rows}) != 1 or len(rows[0]) < 2:
            raise InvalidArgumentError(
                f"a profile needs rows of one length, a time and velocities, not {rows}"
            )
        table = np.array(rows, dtype=float)
        times, velocities = table[:, 0], table[:, 1:]
        steps = np.diff(times)[:, None]
        if times[0] != 0 or not np.all(steps > 0):
            raise InvalidArgumentError(
                f"a profile's times must increase from 0, not be {times.tolist()}"
            )
        self.times, self.coefficients = times, np.zeros((*velocities.shape, 3))
        areas = steps * (velocities[:-1] + velocities[1:]) / 2
        self.coefficients[1:, :, 0] = np.cumsum(areas, axis=0)
        self.coefficients[:, :, 1] = velocities
        self.coefficients[:-1, :, 2] = np.diff(velocities, axis=0) / steps / 2

    @property
    def size(self) -> int:
        """Number k of velocities."""
        return int(self.coefficients.shape[1])

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Returns positions and velocities at a time of 0 s or more, shapes (k,).

        Positions are the exact integral of the velocities from 0.
        """
        row = int(self.times.searchsorted(time, side="right")) - 1
        since, (p, v, half_a) = time - self.times[row], self.coefficients[row].T
        return p + since * (v + since * half_a), v + 2 * since * half_a
