"""Commanded positions and rates, from velocities over time."""

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_pregrasp.errors import InvalidArgumentError


class ObjectMotion(LeafSystem):
    """Commands the joints that move the object: those of a conveyor and turntable, or a pusher's.

    .. pydrake_system::

        name: ObjectMotion
        output_ports:
        - desired_state

    Port `desired_state` emits a vector of 2 k: the k positions, then their k rates. Rates are
    interpolated linearly between the rows of the profile, and hold after the last. Positions are
    their exact integrals from time 0: over a linear piece, the time times the mean of its ends.

    Args:
        profile: Rows of a time in seconds and the k rates then, in m/s and rad/s; times increase
            from 0. One row makes a constant velocity.

    Raises:
        InvalidArgumentError: If the times are otherwise, or rows differ in length.
    """

    def __init__(self, profile: Sequence[Sequence[float]]) -> None:
        super().__init__()
        if not profile or len({len(row) for row in profile}) != 1 or len(profile[0]) < 2:
            raise InvalidArgumentError(
                f"a profile needs rows of one length, a time and velocities, not {profile}"
            )
        rows = np.array(profile, dtype=float)
        self._times, self._rates = rows[:, 0], rows[:, 1:]
        steps = np.diff(self._times)
        if self._times[0] != 0 or not np.all(steps > 0):
            raise InvalidArgumentError(
                f"a profile's times must increase from 0, not be {self._times.tolist()}"
            )
        areas = steps[:, None] * (self._rates[:-1] + self._rates[1:]) / 2
        self._positions = np.vstack([np.zeros(self._rates.shape[1]), np.cumsum(areas, axis=0)])
        self.DeclareVectorOutputPort(
            "desired_state",
            2 * self._rates.shape[1],
            self._calc_desired_state,
            {self.time_ticket()},
        )

    def _calc_desired_state(self, context: Context, output: BasicVector) -> None:
        time = context.get_time()
        row = int(np.searchsorted(self._times, time, side="right")) - 1
        rates = np.array([np.interp(time, self._times, column) for column in self._rates.T])
        mean = (self._rates[row] + rates) / 2
        positions = self._positions[row] + (time - self._times[row]) * mean
        output.SetFromVector(np.concatenate([positions, rates]))
