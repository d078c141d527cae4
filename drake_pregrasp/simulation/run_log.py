"""The logs of a run: one row of `log.csv` a planning tick, one of `grasp.csv` a control tick."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Self

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.quality.grasp_quality import GraspQuality
from drake_pregrasp.simulation.output import reading_back, writing
from drake_pregrasp.systems.loggers import GraspRecord, TickRecord

_FLUSH_PERIOD = 1.0  # Seconds that an interrupted run may lose.


class CsvLog:
    """Writes rows as they come, so that an interrupted run keeps what it has.

    Numbers are written with all their digits: reading them gives the same floats.

    Args:
        path: The file to write; what was there is replaced.
        columns: Names of the columns.

    Attributes:
        columns: The names.
        num_rows: How many there are.

    Raises:
        OutputError: If the file can't be written.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        self.columns = list(columns)
        self.num_rows = 0
        self._flushed = time.monotonic()
        self._path = path
        with writing(path):
            self._file = path.open("w", encoding="utf-8", newline="\n")
            self._file.write(",".join(self.columns) + "\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self._file.close()

    def write(self, row: FloatArray) -> None:
        """Adds a row."""
        self.num_rows += 1
        now = time.monotonic()
        with writing(self._path):
            self._file.write(",".join(map(repr, row.tolist())) + "\n")
            if now - self._flushed > _FLUSH_PERIOD:
                self._file.flush()
                self._flushed = now

    def read(self, *names: str) -> list[FloatArray]:
        """Reads columns back from the file, once it is closed.

        Raises:
            OutputError: If the file can't be read.
        """
        if self.num_rows == 0:
            return [np.empty(0) for _ in names]
        indices = [self.columns.index(name) for name in names]
        with reading_back(self._path):
            table = np.loadtxt(self._path, delimiter=",", skiprows=1, usecols=indices, ndmin=2)
        return list(table.T)


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


class GraspLog(CsvLog):
    """Writes what a hand does to `grasp.csv`.

    Args:
        path: The file to write; what was there is replaced.
        num_fingers: n.

    Raises:
        OutputError: If the file can't be written.
    """

    def __init__(self, path: Path, num_fingers: int) -> None:
        super().__init__(path, grasp_columns(num_fingers))
        self._num_fingers = num_fingers

    def append(self, record: GraspRecord) -> None:
        """Adds a tick."""
        self.write(
            np.concatenate(
                [
                    [record.time],
                    record.report,
                    record.p_WT.ravel(),
                    record.p_GT.ravel(),
                    record.f_T_W.ravel(),
                    *pose_values(record.X_WG),
                    *pose_values(record.X_WO),
                    *pose_values(record.X_WD),
                ]
            )
        )

    def read_points(self, kind: str) -> FloatArray:
        """Reads the tips' `tip` in W, `goal` in G or `force` in W back, shape (ticks, n, 3)."""
        names = _point_columns(kind, self._num_fingers)
        return np.stack(self.read(*names), axis=-1).reshape(-1, self._num_fingers, 3)

    def read_pose(self, frames: str) -> FloatArray:
        """Reads poses back, as `wo`, shape (ticks, 7)."""
        return np.stack(self.read(*pose_columns(frames)), axis=-1)


def grasp_columns(num_fingers: int) -> list[str]:
    """Returns the names of the columns of `grasp.csv`, in their order."""
    return [
        "time",
        "phase",
        "phase_since",
        "gave_up",
        "gave_up_detail",
        *_point_columns("tip", num_fingers),
        *_point_columns("goal", num_fingers),
        *_point_columns("force", num_fingers),
        *pose_columns("wg"),
        *pose_columns("wo"),
        *pose_columns("wd"),
    ]


def _point_columns(kind: str, num_fingers: int) -> list[str]:
    return [f"{kind}{i}_{axis}" for i in range(num_fingers) for axis in "xyz"]
