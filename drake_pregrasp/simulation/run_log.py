"""The log of a run: one row of `log.csv` a planning tick."""

import time
from pathlib import Path
from types import TracebackType

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.contact_status import is_active
from drake_pregrasp.planning.grasp_quality import GraspQuality
from drake_pregrasp.simulation.output import reading_back, writing
from drake_pregrasp.simulation.tick_times import TickTimes
from drake_pregrasp.systems.tick_logger import TickRecord

_FLUSH_PERIOD = 1.0  # Seconds that an interrupted run may lose.


class RunLog:
    """Writes ticks to `log.csv` as they come, so that an interrupted run keeps what it has.

    Numbers are written with all their digits: reading them gives the same floats. However long the
    run is, no more than two ticks are kept in memory.

    Args:
        path: The file to write; what was there is replaced.
        num_contacts: n.
        static_end: When the static phase ends, in seconds.

    Attributes:
        columns: Names of the columns.
        num_ticks: How many there are.
        last_static: The last tick of the static phase, if there is one.
        last: The last of all, if there is one.
        tick_times: How long they took.

    Raises:
        OutputError: If the file can't be written.
    """

    def __init__(self, path: Path, num_contacts: int, *, static_end: float = 0.0) -> None:
        self.columns = log_columns(num_contacts)
        self.num_ticks = 0
        self.last_static: TickRecord | None = None
        self.last: TickRecord | None = None
        self.tick_times = TickTimes()
        self._flushed = time.monotonic()
        self._path = path
        self._static_end = static_end
        with writing(path):
            self._file = path.open("w", encoding="utf-8", newline="\n")
            self._file.write(",".join(self.columns) + "\n")

    def __enter__(self) -> "RunLog":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def append(self, record: TickRecord) -> None:
        """Adds a tick."""
        row = _row(record, self.last or record)
        self.num_ticks += 1
        self.last = record
        if record.time < self._static_end:
            self.last_static = record
        self.tick_times.add(record.wall_seconds)
        now = time.monotonic()
        with writing(self._path):
            self._file.write(",".join(map(repr, row.tolist())) + "\n")
            if now - self._flushed > _FLUSH_PERIOD:
                self._file.flush()
                self._flushed = now

    def read(self, *names: str) -> list[FloatArray]:
        """Reads columns over the ticks back from the file, once it is closed.

        Raises:
            OutputError: If the file can't be read.
        """
        if self.num_ticks == 0:
            return [np.empty(0) for _ in names]
        indices = [self.columns.index(name) for name in names]
        with reading_back(self._path):
            table = np.loadtxt(self._path, delimiter=",", skiprows=1, usecols=indices, ndmin=2)
        return list(table.T)


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
        *_pose_columns("wo"),
        "yaw_wo",
        *_pose_columns("wo_estimated"),
        "position_error",
        *(f"c{i}_status" for i in contacts),
        *(f"c{i}_cause" for i in contacts),
    ]


def _pose_columns(frames: str) -> list[str]:
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
            *_pose_values(record.X_WO),
            [RollPitchYaw(record.X_WO.rotation()).yaw_angle()],
            *_pose_values(record.X_WO_estimated),
            [np.sqrt(error @ error)],
            record.contact_status,
            record.contact_causes,
        ]
    )


def _pose_values(X: RigidTransform) -> tuple[FloatArray, FloatArray]:
    return X.translation(), X.rotation().ToQuaternion().wxyz()
