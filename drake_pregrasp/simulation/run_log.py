"""The log of a run: one row of `log.csv` a planning tick."""

from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.contact_status import is_active
from drake_pregrasp.planning.grasp_quality import GraspQuality
from drake_pregrasp.simulation.csv_log import CsvLog
from drake_pregrasp.simulation.tick_times import TickTimes
from drake_pregrasp.systems.tick_logger import TickRecord


class RunLog(CsvLog):
    """Writes ticks to `log.csv` as they come; no more than two of them are kept in memory.

    Args:
        path: The file to write; what was there is replaced.
        num_contacts: n.
        static_end: When the static phase ends, in seconds.
        deadline: What a tick may take, in seconds.

    Attributes:
        num_ticks: How many there are.
        last_static: The last tick of the static phase, if there is one.
        last: The last of all, if there is one.
        tick_times: How long they took.

    Raises:
        OutputError: If the file can't be written.
    """

    def __init__(
        self, path: Path, num_contacts: int, *, static_end: float = 0.0, deadline: float = np.inf
    ) -> None:
        super().__init__(path, log_columns(num_contacts))
        self.num_ticks = 0
        self.last_static: TickRecord | None = None
        self.last: TickRecord | None = None
        self.tick_times = TickTimes(deadline)
        self._static_end = static_end

    def append(self, record: TickRecord) -> None:
        """Adds a tick."""
        row = _row(record, self.last or record)
        self.num_ticks += 1
        self.last = record
        if record.time < self._static_end:
            self.last_static = record
        self.tick_times.add(record.wall_seconds)
        self.write(row)


def log_columns(num_contacts: int) -> list[str]:
    """Returns the names of the columns of `log.csv`, in their order."""
    contacts = range(num_contacts)
    return [
        "time",
        *(f"c{i}_{axis}" for i in contacts for axis in "xyz"),
        *(f"c{i}_active" for i in contacts),
        *GraspQuality.names(),
        "displacement",
        "energy",
        *(f"region{i}_size" for i in contacts),
        *pose_columns("wo"),
        "yaw_wo",
        *pose_columns("wo_estimated"),
        "position_error",
        *(f"c{i}_status" for i in contacts),
        *(f"c{i}_cause" for i in contacts),
        "tracking_status",
        "time_since_measurement",
    ]


def pose_columns(frames: str) -> list[str]:
    """Returns the names of the columns that hold a pose, as `wo` for X_WO."""
    return [f"{coordinate}_{frames}" for coordinate in ("x", "y", "z", "qw", "qx", "qy", "qz")]


def _row(record: TickRecord, previous: TickRecord) -> FloatArray:
    active = is_active(record.contact_status)
    dt = record.time - previous.time
    moved = active & is_active(previous.contact_status)
    squares = np.sum((record.p_WC - previous.p_WC)[moved] ** 2, axis=1)
    energy = squares.sum() / (2 * dt**2) if dt > 0 else 0.0
    error = record.X_WO_estimated.translation() - record.X_WO.translation()
    return np.concatenate(
        [
            [record.time],
            record.p_WC.ravel(),
            active,
            record.grasp_quality,
            [np.sqrt(squares).sum(), energy],
            record.regions.sizes(),
            *pose_values(record.X_WO),
            [RollPitchYaw(record.X_WO.rotation()).yaw_angle()],
            *pose_values(record.X_WO_estimated),
            [np.sqrt(error @ error)],
            record.contact_status,
            record.contact_causes,
            [record.tracking_status, record.time_since_measurement],
        ]
    )


def pose_values(X: RigidTransform) -> tuple[FloatArray, FloatArray]:
    """Returns what goes into those columns: position, and quaternion w, x, y, z."""
    return X.translation(), X.rotation().ToQuaternion().wxyz()
