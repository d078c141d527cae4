"""Recorded poses of the object over time, and the reader of their files."""

import csv
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO, TextIOWrapper
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.resources import read_bounded

COLUMNS = ("time", "x", "y", "z", "qw", "qx", "qy", "qz")
"""Columns of a pose stream's CSV file: time in seconds, position in metres, unit quaternion."""

MAX_ROWS = 200_000
"""Largest number of rows of a file: half an hour at 100 Hz."""

MAX_BYTES = 100_000_000
"""Largest size of a file, in bytes: 500 for each row."""

MAX_LINE = 10_000
"""Largest number of characters of a line."""

MAX_DISTANCE = 100.0
"""Largest coordinate of a position, in metres: larger ones are probably in millimetres."""

MAX_TIME = 1e10
"""Largest time of a pose, in seconds: larger ones are probably in nanoseconds."""

CLOCK = 1e6
"""Time in seconds, 12 days, beyond which times are those of a clock, not of a run."""

QUATERNION_TOLERANCE = 0.01
"""Largest deviation of a quaternion's length from 1, so that a few digits are enough."""

_SHOWN = 40  # Characters of a cell in a message.
# Not `1_0` or digits of other scripts, which `float` reads too.
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
_POSITION, _QUATERNION = slice(1, 4), slice(4, 8)


@dataclass(frozen=True, eq=False)
class RecordedPoses:
    """Poses of the object O in the world W.

    Attributes:
        times: Times of the poses, increasing, shape (k,), in seconds.
        p_WO: Positions, shape (k, 3), in metres.
        R_WO: Orientations, k of them.
    """

    times: FloatArray
    p_WO: FloatArray
    R_WO: Rotation

    @staticmethod
    def from_rows(rows: Sequence[Sequence[float]]) -> "RecordedPoses":
        """Returns the poses of checked rows (`check_pose`), at least one."""
        table = np.array(rows)
        quaternions = np.roll(table[:, _QUATERNION], -1, axis=1)
        return RecordedPoses(table[:, 0], table[:, _POSITION], Rotation.from_quat(quaternions))

    def check_moves_within(self, duration: float) -> None:
        """Checks that the object does not stand still all through a run.

        Args:
            duration: Duration of the run, in seconds.

        Raises:
            InvalidArgumentError: If there are several poses, and all are before the run, or so long
                after it that they have the times of another clock.
        """
        first, last = self.times[[0, -1]].tolist()
        if first < last and (first > max(duration, CLOCK) or last <= 0):
            raise InvalidArgumentError(
                f"has poses from {first:.10g} s to {last:.10g} s, and the run is from 0 s to"
                f" {duration:g} s; times count from the start of the run"
            )

    def at(self, time: float) -> tuple[FloatArray, Rotation]:
        """Returns position and orientation at a time, in seconds.

        Positions are interpolated linearly, orientations along the shortest turn (Shoemake's slerp,
        1985). Before the first pose and after the last one the object stands still.
        """
        last = len(self.times) - 1
        row = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, last))
        if row == last or time <= self.times[0]:
            return self.p_WO[row], self.R_WO[row]
        ends = self.times[row : row + 2]
        share = (time - ends[0]) / (ends[1] - ends[0])
        p_WO: FloatArray = (1 - share) * self.p_WO[row] + share * self.p_WO[row + 1]
        return p_WO, Slerp(ends, self.R_WO[row : row + 2])(time)


def read_recorded_poses(path: Path) -> RecordedPoses:
    """Reads a CSV file with the columns `COLUMNS`, in any order; others are ignored.

    Args:
        path: Path of the file.

    Raises:
        InvalidArgumentError: If the file is invalid; the message names file, row, column and value.
            Row 1 is the header.
    """
    data = read_bounded(path, MAX_BYTES)
    try:
        rows = list(_rows(data))
    except (csv.Error, UnicodeDecodeError) as error:
        raise InvalidArgumentError(f"{path}: cannot be read: {error}") from error
    except InvalidArgumentError as error:
        raise InvalidArgumentError(f"{path}: {error}") from error
    if not rows:
        raise InvalidArgumentError(f"{path}: has no poses; at least one row must follow the header")
    return RecordedPoses.from_rows(rows)


def _lines(data: bytes) -> Iterator[str]:
    file = TextIOWrapper(BytesIO(data), encoding="utf-8-sig", newline="")
    for number, line in enumerate(iter(lambda: file.readline(MAX_LINE + 1), ""), start=1):
        if len(line) > MAX_LINE:
            raise InvalidArgumentError(f"row {number}: has more than {MAX_LINE} characters")
        yield line


def _rows(data: bytes) -> Iterator[list[float]]:
    """Yields the values of each row, in the order of `COLUMNS`; errors name row and column."""
    reader = csv.reader(_lines(data))
    header = [name.strip() for name in next(reader, [])]
    for name in COLUMNS:
        if name not in header:
            raise InvalidArgumentError(
                f"row 1: lacks the column {name}; the header must be {','.join(COLUMNS)}"
            )
        if header.count(name) > 1:
            raise InvalidArgumentError(f"row 1: has the column {name} more than once")
    places = [header.index(name) for name in COLUMNS]
    previous = -math.inf
    for number, cells in enumerate(reader, start=2):
        if number > MAX_ROWS + 1:
            raise InvalidArgumentError(
                f"has more than {MAX_ROWS} rows of poses; take fewer, or cut it up"
            )
        if not cells:
            continue
        row = f"row {number}"
        if len(cells) != len(header):
            raise InvalidArgumentError(
                f"{row}: has {len(cells)} cells; the header has {len(header)}"
            )
        values = [
            _number(f"{row}, column {name}", cells[place])
            for name, place in zip(COLUMNS, places, strict=True)
        ]
        check_pose(row, values, previous)
        previous = values[0]
        yield values


def _number(place: str, cell: str) -> float:
    value = float(cell) if _NUMBER.fullmatch(cell.strip()) else math.nan
    if not math.isfinite(value):
        raise InvalidArgumentError(f"{place}: {cell.strip()[:_SHOWN]!r} must be a finite number")
    return value


def check_pose(row: str, values: Sequence[float], previous: float) -> None:
    """Raises an error unless a row is a pose.

    Args:
        row: Name of the row, for the message.
        values: Finite values of `COLUMNS`.
        previous: Time of the row before, in seconds.

    Raises:
        InvalidArgumentError: If the time does not increase or is too far from 0, the position is
            too far away, or the quaternion has not length 1.
    """
    if not values[0] > previous:
        raise InvalidArgumentError(
            f"{row}, column time: {values[0]:g} must be more than {previous:g} before it"
        )
    if abs(values[0]) > MAX_TIME:
        raise InvalidArgumentError(
            f"{row}, column time: {values[0]:g} s is more than {MAX_TIME:g} s from 0; times must be"
            " in seconds, are these nanoseconds?"
        )
    for column, value in zip(COLUMNS[_POSITION], values[_POSITION], strict=True):
        if abs(value) > MAX_DISTANCE:
            raise InvalidArgumentError(
                f"{row}, column {column}: {value:g} m is more than {MAX_DISTANCE:g} m away;"
                " positions must be in metres, are these millimetres?"
            )
    length = math.hypot(*values[_QUATERNION])
    if abs(length - 1) > QUATERNION_TOLERANCE:
        raise InvalidArgumentError(
            f"{row}, columns qw to qz: a quaternion of length {length:.4g} must have length 1"
            f" within {QUATERNION_TOLERANCE}"
        )
