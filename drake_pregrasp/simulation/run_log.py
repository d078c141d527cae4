"""The log of a run: one row a planning tick, in memory and in `log.csv`."""

from dataclasses import replace
from pathlib import Path
from types import TracebackType

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.contact_status import is_active
from drake_pregrasp.planning.grasp_quality import GraspQuality
from drake_pregrasp.simulation.output import writing
from drake_pregrasp.systems.tick_logger import TickRecord


class RunLog:
    """Writes each tick to `log.csv` as it comes, so that an interrupted run keeps what it has.

    Numbers are written with all their digits: reading them gives the same floats.

    Args:
        path: The file to write; what was there is replaced.
        num_contacts: n.
        static_end: When the static phase ends, in seconds. Regions, which are large, are kept of
            the last tick before it and of the last of all.

    Raises:
        OutputError: If the file can't be written.
    """

    def __init__(self, path: Path, num_contacts: int, *, static_end: float = 0.0) -> None:
        self.columns = log_columns(num_contacts)
        self.records: list[TickRecord] = []
        self.rows: list[list[float]] = []
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
        previous = self.records[-1] if self.records else record
        if self.records and not previous.time < self._static_end <= record.time:
            self.records[-1] = replace(previous, regions=None)
        row = _row(record, previous)
        self.records.append(record)
        self.rows.append(row)
        with writing(self._path):
            self._file.write(",".join(_text(value) for value in row) + "\n")
            self._file.flush()

    def column(self, name: str) -> FloatArray:
        """Returns a column's values over the ticks."""
        index = self.columns.index(name)
        return np.array([row[index] for row in self.rows])


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


def _row(record: TickRecord, previous: TickRecord) -> list[float]:
    active = is_active(record.contact_status)
    dt = record.time - previous.time
    moved = active & is_active(previous.contact_status)
    steps = np.linalg.norm((record.p_WC - previous.p_WC)[moved], axis=1)
    error = record.X_WO_estimated.translation() - record.X_WO.translation()
    return [
        record.time,
        *record.p_WC.ravel(),
        *active.astype(float),
        *record.grasp_quality,
        float(np.sum(steps)),
        float(np.sum(steps**2) / (2 * dt**2)) if dt > 0 else 0.0,
        *_region_sizes(record),
        *_pose_values(record.X_WO),
        float(RollPitchYaw(record.X_WO.rotation()).yaw_angle()),
        *_pose_values(record.X_WO_estimated),
        float(np.linalg.norm(error)),
        *record.contact_status,
        *record.contact_causes,
    ]


def _region_sizes(record: TickRecord) -> list[float]:
    assert record.regions is not None  # They are dropped only after this.
    return list(record.regions.sizes().astype(float))


def _pose_values(X: RigidTransform) -> list[float]:
    return [*X.translation(), *X.rotation().ToQuaternion().wxyz()]


def _text(value: float) -> str:
    return repr(float(value))
