"""Study of the pose estimate on random motions: its errors, and whether its status holds.

The tracker runs without a diagram, with default settings: what `PoseEstimator` does at each tick.
"""

import argparse
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.object_config import GRAVITY
from drake_pregrasp.config.planner_config import EstimatorConfig, tracker_settings
from drake_pregrasp.config.sensor_config import SensorConfig
from drake_pregrasp.estimation.fault_settings import MeasurementFaults
from drake_pregrasp.estimation.measurement_faults import (
    SensorMemory,
    faulty_disturbance,
    next_memory,
)
from drake_pregrasp.estimation.pose_belief import PoseMeasurement
from drake_pregrasp.estimation.pose_filter import predict
from drake_pregrasp.estimation.pose_track import FOLLOWED, PoseTrack, TrackingStatus
from drake_pregrasp.estimation.pose_tracker import update_track
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.geometry.rotations import rotation_vector
from drake_pregrasp.studies import command_options
from drake_pregrasp.studies.report_page import Part, Table, write_report
from drake_pregrasp.studies.runner import OnProgress, StudyRows, run_jobs

RATES = (20, 50, 100)
"""Rates of the measurements, in Hz."""

DURATION = 3.0
"""Length of a motion, in seconds."""

SETTLED = 20
"""Number of measurements after which the error counts as settled."""

ALLOWANCE = 0.01
"""Error beyond 3 standard deviations that contradicts the status `TRACKING`, in metres."""

_FINE = 1000  # Steps per second in which random velocities are integrated.
_HALF_TURN = [0.0, 0.0, math.pi]

Poses = tuple[FloatArray, Rotation]
"""Positions, shape (k, 3), in metres, and orientations, k of them."""


def _direction(rng: np.random.Generator) -> FloatArray:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def _moved(t: FloatArray, p: FloatArray, turns: FloatArray, rng: np.random.Generator) -> Poses:
    """Returns the poses in a random frame, with a random first orientation."""
    frame = Rotation.random(rng=rng)
    return frame.apply(p), frame * Rotation.from_rotvec(turns) * Rotation.random(rng=rng)


def _constant(t: FloatArray, rng: np.random.Generator) -> Poses:
    v, w = rng.uniform(0, 5) * _direction(rng), rng.uniform(0, 30) * _direction(rng)
    return _moved(t, t[:, None] * v, t[:, None] * w, rng)


def _circle(radius: float, speed: float) -> Callable[[FloatArray, np.random.Generator], Poses]:
    def circle(t: FloatArray, rng: np.random.Generator) -> Poses:
        angle = speed / radius * t + rng.uniform(0, 2 * math.pi)
        p = radius * np.stack([np.cos(angle), np.sin(angle), 0 * t], axis=1)
        return _moved(t, p, angle[:, None] * [0, 0, 1], rng)

    return circle


def _figure_of_eight(t: FloatArray, rng: np.random.Generator) -> Poses:
    angle = rng.uniform(2, 4) * t + rng.uniform(0, 2 * math.pi)
    p = 0.3 * np.stack([np.sin(angle), np.sin(2 * angle) / 2, 0 * t], axis=1)
    return _moved(t, p, 0.5 * np.sin(angle)[:, None] * [0, 0, 1], rng)


def _straight(t: FloatArray, rng: np.random.Generator) -> Poses:
    start, end = np.cumsum(rng.uniform([0.6, 0.3], [1.2, 0.7]))
    accelerated, after = np.clip(t, start, end) - start, np.maximum(t - end, 0)
    way = 10 * (accelerated**2 / 2 + (end - start) * after)
    return _moved(t, way[:, None] * _direction(rng), np.zeros((len(t), 3)), rng)


def _flight(t: FloatArray, rng: np.random.Generator) -> Poses:
    v, w = rng.uniform(1, 4) * _direction(rng), rng.uniform(0, 10) * _direction(rng)
    p = t[:, None] * v - GRAVITY / 2 * t[:, None] ** 2 * [0, 0, 1]
    return _moved(t, p, t[:, None] * w, rng)


def _stop_and_go(t: FloatArray, rng: np.random.Generator) -> Poses:
    steps = 1 + round(_FINE * t[-1])
    wanted, start, goes = np.zeros(steps), round(_FINE * rng.uniform(0.5, 0.8)), True
    while start < steps:
        end = start + round(_FINE * rng.uniform(0.3, 0.8))
        wanted[start:end] = goes * rng.choice([-1, 1]) * rng.uniform(0.2, 1)
        start, goes = end, not goes
    most, speeds = rng.uniform(3, 10) / _FINE, [0.0]
    for speed in wanted[1:]:
        speeds.append(speeds[-1] + np.clip(speed - speeds[-1], -most, most))
    way = np.interp(t, np.arange(steps) / _FINE, np.cumsum(speeds) / _FINE)
    return _moved(t, way[:, None] * _direction(rng), np.zeros((len(t), 3)), rng)


def _turns(t: FloatArray, rng: np.random.Generator) -> Poses:
    steps = 1 + round(_FINE * t[-1])
    acceleration, start = np.zeros(steps), round(_FINE * rng.uniform(0.5, 0.8))
    while start < steps:
        half, pause = np.round(_FINE * rng.uniform(0.1, [0.4, 0.3])).astype(int)
        side = rng.choice([-30, 30])
        acceleration[start : start + half] = side
        acceleration[start + half : start + 2 * half] = -side
        start += 2 * half + pause
    angle = np.cumsum(np.cumsum(acceleration)) / _FINE**2
    turned = np.interp(t, np.arange(steps) / _FINE, angle)[:, None] * _direction(rng)
    return _moved(t, t[:, None] * rng.uniform(0, 0.5) * _direction(rng), turned, rng)


MOTIONS: Mapping[str, Callable[[FloatArray, np.random.Generator], Poses]] = {
    "constant velocity, up to 5 m/s and 30 rad/s": _constant,
    "circle of 0.3 m at 1 m/s": _circle(0.3, 1.0),
    "circle of 0.5 m at 2 m/s": _circle(0.5, 2.0),
    "figure of eight, up to 1.7 m/s": _figure_of_eight,
    "at rest, then 10 m/s² for 0.3 to 0.7 s": _straight,
    "free flight, gravity not modelled": _flight,
    "stop and go, up to 1 m/s and 10 m/s²": _stop_and_go,
    "turns with 30 rad/s²": _turns,
}
"""Kinds of random motions: functions of the times, in seconds, and a generator."""

NO_FAULT = "none"
"""Name of the measurements without faults."""

FAULTS: Mapping[str, MeasurementFaults] = {
    NO_FAULT: MeasurementFaults(),
    "delay of 50 ms": MeasurementFaults(delay=0.05),
    "delay of 100 ms": MeasurementFaults(delay=0.1),
    "delay of 0 to 100 ms, out of sequence": MeasurementFaults(jitter=0.1, out_of_order=True),
    "noise three times as large as assumed": MeasurementFaults(noise_factor=3),
    "30 % outliers": MeasurementFaults(outlier_probability=0.3),
    "dropouts of 0.2 s, once a second": MeasurementFaults(dropout_rate=1, dropout_duration=0.2),
    "half of the measurements turned by 180°": MeasurementFaults(),
}
"""Faults of the measurements. In the last one the object has this symmetry."""

_FLIPPED = list(FAULTS)[-1]


class TrackingJob(NamedTuple):
    """A random motion.

    Attributes:
        motion: Name of the kind of motion, one of `MOTIONS`.
        fault: Name of the fault, one of `FAULTS`.
        rate: Rate of the measurements, in Hz.
        seed: Seed of motion, noise and faults.
    """

    motion: str
    fault: str
    rate: int
    seed: int


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `drake-pregrasp tracking`."""
    parser.set_defaults(command=_command)
    command_options.add_out_option(parser, "tracking")
    for name, default, what in (
        ("--count", 2000, "number of random motions"),
        ("--first_seed", 0, "seed of the first motion; the others follow"),
    ):
        text, kind = f"{what}; %(default)s if not set", command_options.whole_number(default > 0)
        parser.add_argument(name, type=kind, default=default, metavar="N", help=text)
    command_options.add_processes_option(parser)


def _command(options: argparse.Namespace) -> int:
    return command_options.make_rows_and_report(
        lambda on_progress: study_tracking(
            options.out,
            count=options.count,
            first_seed=options.first_seed,
            processes=options.processes,
            on_progress=on_progress,
        ),
        folder=Path(options.out),
    )


def study_tracking(
    out: str | Path,
    *,
    count: int,
    first_seed: int,
    processes: int | None = None,
    on_progress: OnProgress = lambda done, total: None,
) -> tuple[StudyRows, Path]:
    """Tracks random motions, half of them without faults.

    Args:
        out: Folder of the rows and the report.
        count: Number of motions.
        first_seed: Seed of the first motion; the others follow.
        processes: Number of motions at a time.
        on_progress: Called with the number of finished motions and the number of motions to do.

    Returns:
        The rows of the motions, and the path of `tracking.md`.

    Raises:
        OutputError: If the folder cannot be used.
    """
    jobs, faults = [], [name for fault in list(FAULTS)[1:] for name in (NO_FAULT, fault)]
    for k in range(count):  # The next motion each time, and with each round the next fault.
        group, motion = divmod(k, len(MOTIONS))
        rate = RATES[(k + group // len(faults)) % len(RATES)]
        fault = faults[group % len(faults)]
        jobs.append(TrackingJob(list(MOTIONS)[motion], fault, rate, first_seed + k))
    found = run_jobs(
        track_motion, jobs, folder=Path(out), processes=processes, on_progress=on_progress
    )
    return found, write_report(Path(out), "", report(found.rows), name="tracking", formats=("md",))


def track_motion(job: TrackingJob) -> dict[str, float]:
    """Tracks one motion.

    Returns:
        `locked`: Number of the measurement at whose tick the status is first `TRACKING`, counted
            from the first tick; inf if it never is.
        `worst`, `settled`, `error_99`: Largest error of the position while `TRACKING`, the same
            after `SETTLED` measurements, and the 99th percentile after them, in metres.
        `nees_position`, `nees_orientation`: Mean of eᵀ P⁻¹ e while `TRACKING`; 3 is expected.
        `beyond`: Share of coordinates of the position that err by more than 3 standard deviations,
            while `TRACKING`.
        `violations`: Number of ticks while `TRACKING` at which the position errs by more than 3
            standard deviations and `ALLOWANCE`.
        `tracking`, `lost`: Shares of all ticks with that status.
    """
    rng = np.random.default_rng(job.seed)
    period = 1 / job.rate
    times = np.arange(round(DURATION * job.rate)) * np.float64(period)
    p_WO, rotations = MOTIONS[job.motion](times, rng)
    R_WO = rotations.as_matrix()
    is_symmetric = job.fault == _FLIPPED
    config = EstimatorConfig(symmetry=[_HALF_TURN] if is_symmetric else [])
    kernels = default_kernels()
    settings = replace(tracker_settings(config), step=kernels.filter_step)
    track = PoseTrack.empty(config.late_measurements + 1, len(settings.noise.densities))
    rows = []
    for tick, measurement in enumerate(_measurements(job, times, p_WO, R_WO, rng)):
        now = float(times[tick])
        track = update_track(track, measurement, now, settings)
        status = track.status(now, period, config.coast_after, config.lost_after)
        errors = [math.nan] * 5
        if status in FOLLOWED:
            newest = kernels.merged(track.newest)
            belief = predict(newest, max(0.0, now - newest.time), settings.noise.liveliest)
            offset = p_WO[tick] - belief.p_WCoM[0]
            turns = (R_WO[tick] @ S @ belief.R_WO[0].T for S in settings.symmetry)
            theta = min(map(rotation_vector, turns), key=np.linalg.norm)
            errors = _errors(offset, theta, belief.P[0])
        rows.append([status, *errors])
    return _summary(np.array(rows))


def _measurements(
    job: TrackingJob,
    times: FloatArray,
    p_WO: FloatArray,
    R_WO: FloatArray,
    rng: np.random.Generator,
) -> "list[PoseMeasurement]":
    """Returns the output of the simulated sensor at each tick."""
    faults, sensor, period = FAULTS[job.fault], SensorConfig(), 1 / job.rate
    flips = rng.random(len(times)) < 0.5 * (job.fault == _FLIPPED)
    noise, half_turn = rng.normal(size=(len(times), 6)), np.diag([-1.0, -1.0, 1.0])
    memory, outputs = SensorMemory.empty(faults, period), []
    for tick, time in enumerate(times.tolist()):
        at = {"tick": tick, "seed": job.seed}
        stds = sensor.position_std, sensor.orientation_std
        offset, turn = faulty_disturbance(noise[tick], *stds, faults, period=period, **at)
        R = turn @ R_WO[tick] @ (half_turn if flips[tick] else np.eye(3))
        pose = np.append(R.ravel(), p_WO[tick] + offset)
        memory = next_memory(memory, pose, time=time, faults=faults, period=period, **at)
        R_M, p_M = memory.pose[:9].reshape(3, 3), memory.pose[9:]
        outputs.append(PoseMeasurement(memory.stamp, p_M, R_M))
    return outputs


def _errors(offset: FloatArray, theta: FloatArray, P: FloatArray) -> list[float]:
    """Returns the error, its excess over 3 standard deviations, the share beyond, and the NEES."""
    P_R, P_p = P[:3, :3], P[3:6, 3:6]
    error = float(np.linalg.norm(offset))
    std = math.sqrt(offset @ P_p @ offset) / error  # Along the error.
    beyond = np.mean(np.abs(offset) > 3 * np.sqrt(P_p.diagonal()))
    nees = offset @ np.linalg.solve(P_p, offset), theta @ np.linalg.solve(P_R, theta)
    return [error, error - 3 * std, float(beyond), *map(float, nees)]


def _summary(rows: FloatArray) -> dict[str, float]:
    is_tracking = rows[:, 0] == TrackingStatus.TRACKING
    tracked, settled = rows[is_tracking], rows[SETTLED:][is_tracking[SETTLED:]]
    locked = float(np.argmax(is_tracking) + 1) if len(tracked) else math.inf
    beyond, nees_position, nees_orientation = np.append(tracked, [[0] * 6], axis=0)[:, 3:].T
    share = len(tracked) or 1
    return {
        "locked": locked,
        "worst": float(tracked[:, 1].max(initial=0)),
        "settled": float(settled[:, 1].max(initial=0)),
        "error_99": float(np.percentile(settled[:, 1], 99)) if len(settled) else 0.0,
        "nees_position": float(nees_position.sum() / share),
        "nees_orientation": float(nees_orientation.sum() / share),
        "beyond": float(beyond.sum() / share),
        "violations": float(np.sum(tracked[:, 2] > ALLOWANCE)),
        "tracking": float(np.mean(is_tracking)),
        "lost": float(np.mean(rows[:, 0] == TrackingStatus.LOST)),
    }


def report(rows: pd.DataFrame) -> list[Part]:
    """Returns the parts of the report.

    Args:
        rows: Rows of `track_motion`, with the columns of their jobs.
    """
    parts: list[Part] = [
        f"{len(rows)} random motions of {DURATION:g} s at {', '.join(map(str, RATES))} Hz, seeds"
        f" {rows.seed.min()} to {rows.seed.max()}. Medians over motions, and the largest value in"
        " brackets; NEES and shares are means. Errors and NEES are those of ticks with the status"
        " `TRACKING`."
    ]
    for by, group in (("motion", rows[rows.fault == NO_FAULT]), ("fault", rows)):
        if by == "fault":
            parts.append("All kinds of motion, by fault:")
        parts.append(Table(_table(group, by)))
    return parts


def _table(rows: pd.DataFrame, by: str) -> pd.DataFrame:
    names = list(MOTIONS if by == "motion" else FAULTS)
    groups = rows.groupby(pd.Categorical(rows[by], names), observed=True)
    median, most, mean = (getattr(groups, n)(numeric_only=True) for n in ("median", "max", "mean"))
    table = pd.DataFrame({by: mean.index.astype(str)}, index=mean.index)
    table["motions"] = groups.size()
    columns = (
        ("locked", "locked at measurement", 1, 0),
        ("settled", f"worst error [mm], from measurement {SETTLED + 1} on", 1e3, 1),
        ("error_99", "99 % error [mm]", 1e3, 1),
    )
    for column, label, scale, digits in columns:
        middle, worst = (
            (scale * part[column]).map(f"{{:.{digits}f}}".format) for part in (median, most)
        )
        table[label] = middle + " (" + worst + ")"
    nees = [mean[f"nees_{part}"].map("{:.1f}".format) for part in ("position", "orientation")]
    table["NEES of position, orientation (3)"] = nees[0] + ", " + nees[1]
    table["coordinates beyond 3 sigma"] = (100 * mean["beyond"]).map("{:.2f} %".format)
    table["ticks beyond 10 mm + 3 sigma"] = groups["violations"].sum().map("{:.0f}".format)
    table["TRACKING"] = (100 * mean["tracking"]).map("{:.1f} %".format)
    return table
