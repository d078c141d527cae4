"""Which settings of faults are unusable."""

import math
from typing import NamedTuple

import numpy as np

from drake_pregrasp.planning.fault_bursts import MAX_BURST_TICKS, burst_reach
from drake_pregrasp.planning.fault_settings import MeasurementFaults
from drake_pregrasp.planning.ticks import first_tick

MAX_DELAY_TICKS = 1000
"""Largest delay of a measurement, jitter included, in ticks: so many are remembered at most."""

_PROBABILITIES = ("outlier_probability", "sign_flip_probability", "nan_probability")
_NOT_NEGATIVE = (
    "noise_factor",
    "degrees_of_freedom",
    "outlier_position",
    "outlier_orientation",
    "dropout_rate",
    "delay",
    "jitter",
    "freeze_rate",
    "sample_period",
    "start",
)
_POSITIVE = ("dropout_duration", "freeze_duration", "end")
_VECTORS = ("position_bias", "orientation_bias")


class FaultFlaw(NamedTuple):
    """What is wrong with a setting.

    Attributes:
        name: Of the attribute of `MeasurementFaults`.
        problem: What is there and what would be right, in one line.
    """

    name: str
    problem: str


def find_flaw(faults: MeasurementFaults, period: float) -> FaultFlaw | None:
    """Returns the first setting that is unusable, or None.

    Args:
        faults: To be checked.
        period: Seconds between ticks, greater than 0.
    """
    return _out_of_range(faults) or _flaw_in_size(faults) or _flaw_in_time(faults, period)


def _out_of_range(faults: MeasurementFaults) -> FaultFlaw | None:
    for name in _VECTORS:
        vector = np.asarray(getattr(faults, name), dtype=float)
        if vector.shape != (3,) or not np.all(np.isfinite(vector)):
            return FaultFlaw(name, f"{vector.tolist()} must be three finite numbers")
    smallest = math.ulp(0.0)
    for names, low, high, meant in (
        (_PROBABILITIES, 0.0, 1.0, "a probability, from 0 to 1"),
        (_NOT_NEGATIVE, 0.0, math.inf, "at least 0, and finite"),
        (_POSITIVE, smallest, math.inf, "above 0, and finite"),
    ):
        for name in names:
            value = getattr(faults, name)
            if not (low <= value <= high and math.isfinite(value)):
                return FaultFlaw(name, f"{value} must be {meant}")
    return None


def _flaw_in_size(faults: MeasurementFaults) -> FaultFlaw | None:
    angle = math.hypot(*faults.orientation_bias)
    if angle > math.pi:
        problem = f"{list(faults.orientation_bias)} turns by {angle:.4g} rad; at most pi"
        return FaultFlaw("orientation_bias", problem)
    if faults.outlier_orientation > math.pi:
        return FaultFlaw("outlier_orientation", f"{faults.outlier_orientation} must be at most pi")
    if 0 < faults.degrees_of_freedom < 1:
        problem = f"{faults.degrees_of_freedom} must be 0, for normal noise, or at least 1"
        return FaultFlaw("degrees_of_freedom", problem)
    if faults.outlier_probability and not (faults.outlier_position or faults.outlier_orientation):
        problem = "outlier_position and outlier_orientation are both 0; one must be above"
        return FaultFlaw("outlier_probability", problem)
    return None


def _flaw_in_time(faults: MeasurementFaults, period: float) -> FaultFlaw | None:
    if not faults.start < faults.end:
        return FaultFlaw("start", f"{faults.start} must be less than end, which is {faults.end}")
    if not first_tick(faults.start, period) < first_tick(faults.end, period):
        problem = (
            f"{faults.start} must be a tick before end, {faults.end}: nothing is measured between"
        )
        return FaultFlaw("start", problem)
    if 0 < faults.sample_period < period:
        problem = f"{faults.sample_period} must be 0 or at least the planning period, {period}"
        return FaultFlaw("sample_period", problem)
    latest, limit = faults.delay + faults.jitter, MAX_DELAY_TICKS * period
    if latest > limit:
        problem = f"it is {latest:g} s with jitter; at most {MAX_DELAY_TICKS} ticks, {limit:g} s"
        return FaultFlaw("delay", problem)
    between = max(period, faults.sample_period)
    if faults.out_of_order and not faults.jitter > between:
        problem = f"with a jitter of {faults.jitter} s none overtakes; more than {between} s does"
        return FaultFlaw("out_of_order", problem)
    for kind in ("dropout", "freeze"):
        duration = getattr(faults, f"{kind}_duration")
        reach = burst_reach(duration, period)
        if getattr(faults, f"{kind}_rate") and reach > MAX_BURST_TICKS:
            longest = duration * MAX_BURST_TICKS / reach
            problem = f"{duration} must be at most {longest:g} with a period of {period} s"
            return FaultFlaw(f"{kind}_duration", problem)
    return None
