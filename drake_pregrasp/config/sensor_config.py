"""Configuration of the simulated pose sensor."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

from drake_pregrasp.arrays import first_tick
from drake_pregrasp.config.object_config import POINT
from drake_pregrasp.config.validation import check_fields
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.fault_settings import (
    MAX_BURST_TICKS,
    MAX_DELAY_TICKS,
    MeasurementFaults,
    burst_reach,
)

POSITION_NOISE = {"typical": (0.0, 0.01), "unit": "mm"}
"""Usual standard deviations of a measured position."""

ORIENTATION_NOISE = {"typical": (0.0, math.radians(5)), "unit": "deg"}
"""Usual standard deviations of a measured orientation."""

_STD = {"at_least": 0, "at_most": 10}


@dataclass
class PoseErrors:
    """Errors of measured poses."""

    # Standard deviation of the white noise of the position, per axis, in metres.
    position_std: float = field(default=0.0005, metadata=_STD | POSITION_NOISE)

    # Standard deviation of the white noise of the orientation, as a rotation vector, per axis, in
    # radians.
    orientation_std: float = field(default=0.0035, metadata=_STD | ORIENTATION_NOISE)

    # Faults of the measurements, besides the white noise.
    faults: MeasurementFaults = field(default_factory=MeasurementFaults)


@dataclass
class SensorConfig(PoseErrors):
    """White noise and faults of measured poses."""


@dataclass
class Camera(PoseErrors):
    """Errors of poses that a depth camera measures; the defaults are those of `see_and_grasp`."""

    # Standard deviation of the white noise of the position across the ray, per axis, in metres.
    position_std: float = field(default=0.0001, metadata=_STD | POSITION_NOISE)

    # Standard deviation of the white noise of the orientation, as a rotation vector, per axis, in
    # radians.
    orientation_std: float = field(default=0.0017, metadata=_STD | ORIENTATION_NOISE)

    # Rate (`sample_period`), latency (`delay`) and lasting errors (`position_bias`, `drift_std`) of
    # the camera, and its faults.
    faults: MeasurementFaults = field(
        default_factory=lambda: MeasurementFaults(sample_period=0.05, delay=0.03)
    )

    # Position of the camera in W, in metres.
    position: list[float] = field(default_factory=lambda: [0.45, -0.45, 0.45], metadata=POINT)

    # Standard deviation of the white noise along the ray from the camera to the object, in metres.
    ray_std: float = field(default=0.0001, metadata=_STD | POSITION_NOISE)

    # Smallest visible share of the surface facing the camera at which the object is still measured.
    # The hand and other bodies hide the rest.
    least_visible: float = field(default=0.05, metadata={"at_least": 0, "at_most": 1})

    # Seconds for which the object is still not measured once it is visible again.
    registration_gap: float = field(default=0.0, metadata={"at_least": 0, "at_most": 100})


AnySensorConfig = SensorConfig | Camera
"""Configuration of a sensor of poses; without a tag it is the first one."""


def check_faults(faults: MeasurementFaults, period: float) -> None:
    """Raises an error unless faults are in range and consistent with each other.

    Args:
        faults: Faults of the sensor.
        period: Seconds between planning ticks, greater than 0.

    Raises:
        InvalidArgumentError: If a fault is out of range, or contradicts another one.
    """
    check_fields(faults, "faults")
    for name, problem in fault_problems(faults, period):
        raise InvalidArgumentError(f"faults.{name}: {problem}")


def fault_problems(faults: MeasurementFaults, period: float) -> Iterator[tuple[str, str]]:
    """Yields the name and the problem, in one line, of each field that contradicts another one.

    Args:
        faults: Faults with each field in its range.
        period: Seconds between planning ticks.
    """
    f = faults
    angle = math.hypot(*f.orientation_bias)
    if angle > math.pi:
        yield "orientation_bias", f"{[*f.orientation_bias]} turns by {angle:.4g} rad; at most pi"
    if 0 < (freedom := f.degrees_of_freedom) < 1:
        yield "degrees_of_freedom", f"{freedom} must be 0, for normal noise, or at least 1"
    if f.outlier_probability and not (f.outlier_position or f.outlier_orientation):
        problem = "outlier_position and outlier_orientation are both 0; one must be above"
        yield "outlier_probability", problem
    if not f.start < f.end:
        yield "start", f"{f.start} must be less than end, which is {f.end}"
    if not first_tick(f.start, period) < first_tick(f.end, period):
        yield "start", f"{f.start} must be a tick before end, {f.end}: nothing is measured between"
    if 0 < f.sample_period < period:
        problem = f"{f.sample_period} must be 0 or at least the planning period, {period}"
        yield "sample_period", problem
    latest, limit = f.delay + f.jitter, MAX_DELAY_TICKS * period
    if latest > limit:
        most = f"{MAX_DELAY_TICKS} ticks, {limit:g} s"
        yield "delay", f"it is {latest:g} s with jitter; at most {most}"
    between = max(period, f.sample_period)
    if f.out_of_order and not f.jitter > between:
        problem = f"it needs a jitter of more than {between} s, not {f.jitter} s"
        yield "out_of_order", problem
    for name, rate, duration in (
        ("dropout_duration", f.dropout_rate, f.dropout_duration),
        ("freeze_duration", f.freeze_rate, f.freeze_duration),
    ):
        reach = burst_reach(duration, period)
        if rate and reach > MAX_BURST_TICKS:
            longest = duration * MAX_BURST_TICKS / reach
            yield name, f"{duration} must be at most {longest:g} with a period of {period} s"
