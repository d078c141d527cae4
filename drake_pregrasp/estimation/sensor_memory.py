"""What a sensor remembers, and what of it has arrived."""

from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.estimation.fault_settings import MeasurementFaults
from drake_pregrasp.estimation.measurement_faults import (
    arrival_tick,
    is_frozen,
    is_occluded,
    is_taken,
)
from drake_pregrasp.ticks import first_tick

POSE_SIZE = 12
"""Numbers of a pose: its rotation matrix and its position side by side, by rows."""

_ROW = 2 + POSE_SIZE  # Of one that is under way: when it was taken, when it arrives, the pose.
_NO_POSE = np.full(POSE_SIZE, np.nan)


@dataclass(frozen=True, eq=False)
class SensorMemory:
    """A sensor's memory after a tick.

    Attributes:
        tick: Index of that tick; -inf before the first.
        stamp: When the measurement that arrived last was taken, in seconds; -inf if none has.
        pose: That measurement, shape (12,); NaN if there is none.
        frozen: The value that is repeated, shape (12,), or None while none is.
        under_way: Measurements that haven't arrived, shape (m, 14): when each was taken, in
            seconds, the index of the tick at which it arrives, and the pose.
    """

    tick: float
    stamp: float
    pose: FloatArray
    frozen: FloatArray | None
    under_way: FloatArray

    @staticmethod
    def empty() -> "SensorMemory":
        """Returns the memory before the first tick."""
        return SensorMemory(-np.inf, -np.inf, _NO_POSE, None, np.empty((0, _ROW)))

    def to_vector(self, capacity: int) -> FloatArray:
        """Returns the memory as one vector, for a discrete state.

        Args:
            capacity: For how many measurements under way there is room, from `memory_capacity`.
        """
        return np.concatenate(
            [
                [self.tick, self.stamp],
                self.pose,
                [self.frozen is not None],
                _NO_POSE if self.frozen is None else self.frozen,
                self.under_way.ravel(),
                np.full((capacity - len(self.under_way)) * _ROW, np.inf),
            ]
        )

    @staticmethod
    def from_vector(vector: FloatArray) -> "SensorMemory":
        """Inverse of `to_vector`."""
        tick, stamp = vector[:2].tolist()
        pose, is_frozen, frozen, rows = np.split(vector[2:], np.cumsum([POSE_SIZE, 1, POSE_SIZE]))
        under_way = rows.reshape(-1, _ROW)
        under_way = under_way[np.isfinite(under_way[:, 1])]
        return SensorMemory(tick, stamp, pose, frozen if is_frozen[0] else None, under_way)


def memory_capacity(faults: MeasurementFaults, period: float) -> int:
    """Returns how many measurements can be under way at once.

    Args:
        faults: Of which delay and jitter count.
        period: Seconds between ticks.
    """
    return first_tick(faults.delay + faults.jitter, period)


def next_memory(
    memory: SensorMemory,
    pose: FloatArray,
    *,
    time: float,
    tick: int,
    faults: MeasurementFaults,
    period: float,
    seed: int,
) -> SensorMemory:
    """Returns the memory after a tick.

    In this order: the tick is one at which a measurement is taken, or not; if the value is frozen,
    it is that of the burst's first measurement, with a stamp of its own; if the object is occluded,
    the measurement is lost; else it arrives after delay and jitter, at the first tick that is not
    earlier. Of several that arrive at one tick the one that was taken last counts. One that was
    overtaken, as one taken later has arrived at an earlier tick, counts only if `out_of_order`.

    A memory of the same tick, or of a later one, is of no use, and the sensor starts anew. Nothing
    is measured at ticks that were skipped, and no value is kept frozen over them. While
    faults don't act a measurement is taken at each tick, and arrives at once.

    Args:
        memory: After the tick before.
        pose: What is measured at this tick, shape (12,).
        time: Of the tick, in seconds.
        tick: Its index.
        faults: What goes wrong.
        period: Seconds between ticks.
        seed: Of the random numbers.
    """
    if memory.tick >= tick:
        memory = SensorMemory.empty()
    now = tick, faults, period
    frozen = memory.frozen if memory.tick == tick - 1 else None
    if not is_frozen(*now, seed):
        frozen = None
    elif frozen is None and is_taken(*now):
        frozen = pose
    under_way = memory.under_way
    if is_taken(*now) and not is_occluded(*now, seed):
        value = pose if frozen is None else frozen
        row = np.concatenate([[time, arrival_tick(*now, seed)], value])
        under_way = np.vstack([under_way, row])
    has_arrived = under_way[:, 1] <= tick
    stamp, arrived_pose = memory.stamp, memory.pose
    if np.any(has_arrived):
        last = max(under_way[has_arrived], key=lambda row: row[0])
        if faults.out_of_order or last[0] > stamp:
            stamp, arrived_pose = float(last[0]), last[2:]
    return SensorMemory(tick, stamp, arrived_pose, frozen, under_way[~has_arrived])
