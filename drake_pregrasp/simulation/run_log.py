"""Logs of a run, and the phases of its ticks.

`log.csv` has one row for each planning tick, `grasp.csv` one for each control tick of a hand.
"""

import contextlib
import itertools
import os
import time
from array import array
from collections import deque
from collections.abc import Callable, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from drake_pregrasp.arrays import SLACK, FloatArray, norms
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.quality.grasp_quality import GraspQuality
from drake_pregrasp.simulation.output import reading_back, writing
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.link_contacts import TOUCHED
from drake_pregrasp.systems.loggers import GraspRecord, TickRecord

_FLUSH_PERIOD = 1.0  # Seconds of data that a killed run can lose.
_LONGEST_ROW = 100_000  # Largest length of a row, in characters.
# Parts of a row of `log.csv`, which `tick_table` takes in this order.
_STEP_FIELDS = attrgetter("time", "p_WC", "contact_status")
_OTHER_FIELDS = attrgetter(
    *("X_WO", "X_WO_estimated", "grasp_quality", "regions.counts"),
    *("contact_causes", "tracking_status", "time_since_measurement"),
)


def number_table(*parts: Any) -> FloatArray:
    """Returns the numbers of rows, shape (rows, columns), given each part of all rows."""
    plain = ([pose_values(X) for X in p] if type(p[0]) is RigidTransform else p for p in parts)
    return np.hstack([np.reshape(part, (len(part), -1)) for part in plain])


class CsvLog:
    """Writes rows to a CSV file during a run, so that an interrupted run keeps them.

    Numbers are written with all digits, so reading them back gives the same floats. The file is
    open inside a `with` block, which raises an `OutputError` if the file cannot be written.

    Args:
        path: File to write; an existing one is replaced.
        columns: Names of the columns.
        table: Function that returns rows, shape (rows, columns), given each part of all rows.

    Attributes:
        columns: Names of the columns.
        num_rows: Number of rows, also of those that are still in memory.
    """

    def __init__(
        self,
        path: Path,
        columns: Sequence[str],
        table: Callable[..., FloatArray] = number_table,
    ) -> None:
        self.columns = list(columns)
        self._table = table
        self.num_rows = 0
        self._flushed = time.monotonic()
        self._path = path
        self._waiting: list[tuple[Any, ...]] = []

    def __enter__(self) -> Self:
        with writing(self._path):
            self._file = self._path.open("w", encoding="utf-8", newline="")
            self._file.write(",".join(self.columns) + "\n")
        return self

    def __exit__(self, *raised: object) -> None:
        try:
            with writing(self._path), self._file:
                self._flush()
        finally:  # A full disk may truncate the last row.
            with contextlib.suppress(OSError), self._path.open("r+b") as file:
                start = max(0, file.seek(0, os.SEEK_END) - _LONGEST_ROW)
                file.seek(start)
                file.truncate(start + file.read().rfind(b"\n") + 1)

    def write(self, *parts: Any) -> None:
        """Adds a row of the numbers in all parts; it may stay in memory for a second.

        Poses are written as their `pose_values`. All rows have parts of the same shapes. Do not
        change a part later: rows are computed when they are written.
        """
        self.num_rows += 1
        self._waiting.append(parts)
        if time.monotonic() - self._flushed > _FLUSH_PERIOD:
            self._flush()

    def _flush(self) -> None:
        rows = self._table(*zip(*self._waiting, strict=True)).tolist() if self._waiting else []
        text = "".join(",".join(map(repr, row)) + "\n" for row in rows)
        self._waiting.clear()  # An interrupt can cost the last rows, but none between others.
        with writing(self._path):
            self._file.write(text)
            self._file.flush()
        self._flushed = time.monotonic()

    def read(self, *names: str) -> list[FloatArray]:
        """Returns columns of the closed file.

        Raises:
            OutputError: If the file cannot be read.
        """
        if self.num_rows == 0:
            return [np.empty(0) for _ in names]
        indices = [self.columns.index(name) for name in names]
        with reading_back(self._path):
            table = np.loadtxt(self._path, delimiter=",", skiprows=1, usecols=indices, ndmin=2)
        return list(table.T)


class TickRows:
    """Parts of the rows of `log.csv`, from each tick and those before it.

    Args:
        lookahead: Prediction horizon of the logged estimates, in seconds.
    """

    def __init__(self, lookahead: float) -> None:
        self._lookahead = lookahead
        self._last: TickRecord | None = None
        self._predictions: deque[tuple[float, FloatArray]] = deque()

    def parts(self, record: TickRecord) -> tuple[Any, ...]:
        """Returns the parts of the next tick's row, from which `tick_table` computes the row."""
        now, before = _STEP_FIELDS(record), _STEP_FIELDS(self._last or record)
        self._last = record
        return (*now, *before, *_OTHER_FIELDS(record), self._estimate_for(record))

    def _estimate_for(self, record: TickRecord) -> FloatArray:
        """Returns the position of O in W that was estimated for the time of a tick.

        With look-ahead, it is interpolated between earlier predictions, or NaN if there are none.
        """
        p_WO: FloatArray = record.X_WO_estimated.translation()
        if not self._lookahead:
            return p_WO
        now = record.time + SLACK * self._lookahead
        self._predictions.append((record.time + self._lookahead, p_WO))
        while len(self._predictions) > 1 and self._predictions[1][0] <= now:
            self._predictions.popleft()
        if self._predictions[0][0] > now:
            return np.full(3, np.nan)
        (t0, p0), (t1, p1) = self._predictions[0], self._predictions[1]
        share = (record.time - t0) / (t1 - t0)
        return p0 + share * (p1 - p0)


def tick_table(*parts: Any) -> FloatArray:
    """Returns rows of `log.csv`, shape (rows, columns), given each of the `TickRows.parts`.

    Many rows at once take much less time than one by one.
    """
    times, p_WC, status, earlier, p_WC_before, status_before = map(np.array, parts[:6])
    X_WO, X_WO_estimated, quality, sizes, *others, p_WO = parts[6:]
    active, dt = is_active(status), times - earlier
    squares = np.sum((p_WC - p_WC_before) ** 2, axis=2)
    squares[~(active & is_active(status_before))] = 0.0
    energy = squares.sum(axis=1) / np.where(dt > 0, 2 * dt**2, np.inf)
    displacement = np.sqrt(squares).sum(axis=1)
    yaw = [RollPitchYaw(X.rotation()).yaw_angle() for X in X_WO]
    error = norms(np.subtract(p_WO, [X.translation() for X in X_WO]))
    contacts = times, p_WC, active, quality, displacement, energy, sizes
    return number_table(*contacts, X_WO, yaw, X_WO_estimated, error, status, *others)


class RunLog(CsvLog):
    """Writes planning ticks to `log.csv`; only the durations of all ticks stay in memory.

    Args:
        path: File to write; an existing one is replaced.
        num_contacts: Number of contacts n.
        static_end: End of the static phase, in seconds.
        lookahead: Prediction horizon of the logged estimates, in seconds.

    Attributes:
        last_static: Record of the last tick in the static phase, or None.
        last: Record of the last tick, or None.
        tick_seconds: Computing time of each tick, in seconds.
    """

    def __init__(
        self, path: Path, num_contacts: int, *, static_end: float = 0.0, lookahead: float = 0.0
    ) -> None:
        super().__init__(path, log_columns(num_contacts), tick_table)
        self.last_static: TickRecord | None = None
        self.last: TickRecord | None = None
        self.tick_seconds = array("d")
        self._static_end = static_end
        self._rows = TickRows(lookahead)

    def append(self, record: TickRecord) -> tuple[Any, ...]:
        """Writes a tick, and returns its `TickRows.parts`."""
        self.last = record
        if record.time < self._static_end:
            self.last_static = record
        self.tick_seconds.append(record.wall_seconds)
        parts = self._rows.parts(record)
        self.write(*parts)
        return parts


def log_columns(num_contacts: int) -> list[str]:
    """Returns the names of the columns of `log.csv`, in their order.

    - `time`: time of the tick.
    - `c{i}_x`, `c{i}_y`, `c{i}_z`: contact goal p_WC in W.
    - `c{i}_active`: 1 if the contact takes part in the grasp, else 0.
    - `q_msv`, `q_gii`, `q_vew`: measures of the active contacts, about the true centre of mass.
    - `graspable`, `indeterminate`: conditions of the paper's Eqs. 9 and 8: 1 if they hold, else 0.
    - `displacement`: distance that the goals have moved in W since the last tick, summed over
      contacts that are active at both ticks.
    - `energy`: sum of v²/2 of the same contacts, in joules per kilogram.
    - `region{i}_size`: number of candidates in the safe region.
    - `x_wo`, `y_wo`, `z_wo`, `qw_wo`, `qx_wo`, `qy_wo`, `qz_wo`, `yaw_wo`: true pose X_WO:
      position, quaternion, and yaw in radians.
    - `x_wo_estimated`, `y_wo_estimated`, `z_wo_estimated`, `qw_wo_estimated`, `qx_wo_estimated`,
      `qy_wo_estimated`, `qz_wo_estimated`: estimated pose.
    - `position_error`: distance between the true position of O and the one that was estimated for
      this time. With look-ahead, that is an earlier prediction, and NaN until there is one.
    - `c{i}_status`, `c{i}_cause`: `ContactStatus`, and the index of the contact or obstacle that
      causes it, or -1.
    - `tracking_status`: `TrackingStatus`.
    - `time_since_measurement`: age of the newest measurement in the estimate.
    """
    contacts = range(num_contacts)
    points = [f"c{i}_{axis}" for i in contacts for axis in "xyz"]
    active = [f"c{i}_active" for i in contacts]
    sizes = [f"region{i}_size" for i in contacts]
    states = [f"c{i}_{state}" for state in ("status", "cause") for i in contacts]
    poses = [*pose_columns("wo"), "yaw_wo", *pose_columns("wo_estimated"), "position_error"]
    contact_columns = [*points, *active, *GraspQuality.names(), "displacement", "energy", *sizes]
    tracking = ["tracking_status", "time_since_measurement"]
    return ["time", *contact_columns, *poses, *states, *tracking]


def pose_columns(frames: str) -> list[str]:
    """Returns the names of the columns of a pose; `frames` is `wo` for X_WO."""
    return [f"{coordinate}_{frames}" for coordinate in ("x", "y", "z", "qw", "qx", "qy", "qz")]


def pose_values(X: RigidTransform) -> FloatArray:
    """Returns the values of `pose_columns`: position in metres, and quaternion w, x, y, z."""
    return np.concatenate([X.translation(), X.rotation().ToQuaternion().wxyz()])


class GraspLog(CsvLog):
    """Writes control ticks of a hand to `grasp.csv`.

    Args:
        path: File to write; an existing one is replaced.
        num_fingers: Number of fingers n.
    """

    def __init__(self, path: Path, num_fingers: int) -> None:
        super().__init__(path, grasp_columns(num_fingers))
        self._num_fingers = num_fingers

    def append(self, record: GraspRecord) -> None:
        """Adds a tick."""
        points = (record.p_WT, record.p_GT, record.f_T_W)
        poses = (record.X_WG, record.X_WO, record.X_WD)
        last = record.link_forces, record.catch_certificate
        self.write(record.time, record.report, *points, *poses, *last)

    def read_points(self, kind: str) -> FloatArray:
        """Returns vectors of a kind, `tip` in W, `goal` in G or `force` in W, as (ticks, n, 3)."""
        names = _point_columns(kind, self._num_fingers)
        return np.stack(self.read(*names), axis=-1).reshape(-1, self._num_fingers, 3)

    def read_pose(self, frames: str) -> FloatArray:
        """Returns the poses of a pair of frames such as `wo`, shape (ticks, 7)."""
        return np.stack(self.read(*pose_columns(frames)), axis=-1)


def grasp_columns(num_fingers: int) -> list[str]:
    """Returns the names of the columns of `grasp.csv`, in their order.

    - `time`: time of the tick.
    - `phase`, `phase_since`: `GraspPhase`, and the time at which it began.
    - `gave_up`, `gave_up_detail`: `GiveUp`: why the hand opened last, waits or stands still; and
      the finger, number or force that it is about.
    - `tip{i}_x`, `tip{i}_y`, `tip{i}_z`: centre of the fingertip in W.
    - `goal{i}_x`, `goal{i}_y`, `goal{i}_z`: its goal, in the frame G.
    - `force{i}_x`, `force{i}_y`, `force{i}_z`: force with which the fingertip presses, in W.
    - `x_wg`, `y_wg`, `z_wg`, `qw_wg`, `qx_wg`, `qy_wg`, `qz_wg`: pose X_WG of the frame in which
      goals are planned.
    - `x_wo`, `y_wo`, `z_wo`, `qw_wo`, `qx_wo`, `qy_wo`, `qz_wo`: true pose of the object.
    - `x_wd`, `y_wd`, `z_wd`, `qw_wd`, `qx_wd`, `qy_wd`, `qz_wd`: pose of the turntable D; that of
      the world if there is none.
    - `link_force_object`, `link_force_surroundings`, `link_force_hand`: largest force since the
      last tick between a link that is no fingertip and the object; the table or an obstacle with a
      body; another finger.
    - `catch_limit`, `meeting_time`, `meeting_x`, `meeting_y`, `meeting_z`: `CatchLimit`: what
      prevents a meeting; and its time and place, as planned last.
    """
    report = ["time", "phase", "phase_since", "gave_up", "gave_up_detail"]
    points = (_point_columns(kind, num_fingers) for kind in ("tip", "goal", "force"))
    poses = (pose_columns(frames) for frames in ("wg", "wo", "wd"))
    links = [f"link_force_{touched}" for touched in TOUCHED]
    meeting = ["catch_limit", "meeting_time", *(f"meeting_{axis}" for axis in "xyz")]
    return [*report, *itertools.chain(*points, *poses), *links, *meeting]


def _point_columns(kind: str, num_fingers: int) -> list[str]:
    return [f"{kind}{i}_{axis}" for i in range(num_fingers) for axis in "xyz"]


def ticks_from(scenario: Scenario, times: FloatArray, start: float) -> int:
    """Returns the index of the first tick at or after the time `start`."""
    return int(np.searchsorted(times, start - SLACK * scenario.planner.period))


def static_end(scenario: Scenario) -> float:
    """Returns the time in seconds at which the static phase ends.

    Initial contacts are then released, or the first contact is lost. The time is reduced by a small
    slack, so that rounding puts no tick at the same time before it.
    """
    end = min(scenario.planner.static_duration, _first_loss(scenario))
    return float(end - SLACK * scenario.planner.period)


def _first_loss(scenario: Scenario) -> float:
    return min((event.at for event in scenario.damage), default=np.inf)


def static_phase(scenario: Scenario, times: FloatArray) -> slice:
    """Returns the ticks at which all initial contacts are held."""
    return slice(0, ticks_from(scenario, times, static_end(scenario)))


def adapting_phase(scenario: Scenario, times: FloatArray) -> slice:
    """Returns the ticks at which all initial contacts adapt."""
    start = ticks_from(scenario, times, scenario.planner.static_duration)
    return slice(start, max(start, ticks_from(scenario, times, _first_loss(scenario))))


def last_phase(scenario: Scenario, times: FloatArray) -> slice:
    """Returns the ticks at which contacts adapt after the last loss or return of a finger.

    With losses only, these are the ticks of the paper's tables.
    """
    last_change = max((max(event.at, event.until) for event in scenario.damage), default=0.0)
    start = max(scenario.planner.static_duration, last_change)
    return slice(ticks_from(scenario, times, start), None)
