import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_pregrasp import InvalidArgumentError, MeasurementFaults
from drake_pregrasp.arrays import pack, unpacker
from drake_pregrasp.config.sensor_config import check_faults
from drake_pregrasp.estimation.measurement_faults import (
    POSE_SIZE,
    SensorMemory,
    arrival_tick,
    is_frozen,
    is_occluded,
    is_taken,
    next_memory,
)

T = 0.05
TICKS = 120


def value(tick):
    """Returns the pose that is measured at a tick: numbers that tell which it is."""
    return np.arange(POSE_SIZE) + 100.0 * tick


def played(faults, seed=0, ticks=range(TICKS)):
    """Returns the memories after the ticks, each by way of the vector that is stored."""
    memory = SensorMemory.empty(faults, T)
    found, unpack = [], unpacker(memory)
    for tick in ticks:
        now = {"time": tick * T, "tick": tick, "faults": faults, "period": T, "seed": seed}
        memory = unpack(pack(next_memory(memory, value(tick), **now)))
        found.append(memory)
    return found


def transcribed(faults, seed):
    """Returns stamps and first numbers of poses, straight from all that was ever measured."""
    sent, held = [], None
    for tick in range(TICKS):
        taken, frozen = is_taken(tick, faults, T), is_frozen(tick, faults, T, seed)
        held = (held if held is not None else tick if taken else None) if frozen else None
        if taken and not is_occluded(tick, faults, T, seed):
            shown = tick if held is None else held
            sent.append((arrival_tick(tick, faults, T, seed), tick, shown))
    for now in range(TICKS):
        arrived = [entry for entry in sent if entry[0] <= now]
        key = (lambda e: e[:2]) if faults.out_of_order else (lambda e: e[1])
        _, tick, shown = max(arrived, key=key, default=(0, None, None))
        yield (-math.inf, math.nan) if tick is None else (tick * T, 100.0 * shown)


@settings(max_examples=40)
@given(
    faults=st.builds(
        MeasurementFaults,
        dropout_rate=st.sampled_from([0.0, 1.0]),
        dropout_duration=st.floats(0.05, 0.5),
        delay=st.sampled_from([0.0, 0.05, 0.13, 3 * 0.1]),
        jitter=st.sampled_from([0.0, 0.03, 0.4]),
        out_of_order=st.booleans(),
        freeze_rate=st.sampled_from([0.0, 1.0]),
        freeze_duration=st.floats(0.05, 0.5),
        sample_period=st.sampled_from([0.0, 0.07, 0.2]),
        start=st.sampled_from([0.0, 1.0]),
        end=st.sampled_from([4.0, 1e6]),
    ),
    seed=st.integers(0, 1000),
)
def test_memory_of_a_few_knows_what_memory_of_all_does(faults, seed):
    found = played(faults, seed)
    expected = list(transcribed(faults, seed))
    np.testing.assert_array_equal([(m.stamp, m.pose[0]) for m in found], expected)


def test_each_measurement_arrives_not_before_its_delay_nor_after_the_jitter():
    faults = MeasurementFaults(delay=0.12, jitter=0.3)
    lags = np.array([arrival_tick(k, faults, T, 1) - k for k in range(3000)]) * T
    assert lags.min() >= faults.delay
    assert lags.max() < faults.delay + faults.jitter + T
    # On average a lag is up to the next tick, half a period.
    assert np.mean(lags) == pytest.approx(0.12 + 0.15 + T / 2, abs=0.01)


def test_a_frozen_value_is_not_kept_over_skipped_ticks():
    always = MeasurementFaults(freeze_rate=1000.0)
    for skipped_to, shown in ((1, 0), (2, 2)):
        *_, last = played(always, ticks=[0, skipped_to])
        np.testing.assert_array_equal(last.pose, value(shown))


@pytest.mark.parametrize("sample_period", [0.05, 0.1, 0.12, 0.3, 1.0])
@pytest.mark.parametrize("period", [0.05, 0.03, 0.1 / 3])
def test_a_low_rate_takes_the_first_tick_of_each_turn(sample_period, period):
    faults = MeasurementFaults(sample_period=sample_period)
    taken = [k * period for k in range(1200) if is_taken(k, faults, period)]
    turns = np.arange(len(taken)) * sample_period
    assert np.all(taken - turns > -1e-6)
    assert np.all(taken - turns < period)
    assert abs(1200 * period - len(taken) * sample_period) <= max(sample_period, period) + 1e-6


USABLE = {"outlier_probability": 0.1, "dropout_rate": 1.0, "freeze_rate": 1.0}
PLANNING = 0.04  # Seconds between ticks.


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("orientation_bias", {"orientation_bias": (0.0, 3.0, 1.0)}),
        ("noise_factor", {"noise_factor": -1.0}),
        ("degrees_of_freedom", {"degrees_of_freedom": 0.5}),
        ("outlier_probability", {"outlier_position": 0.0, "outlier_orientation": 0.0}),
        ("dropout_duration", {"dropout_duration": 81.0}),
        ("freeze_duration", {"freeze_duration": 81.0}),
        ("delay", {"delay": 30.0, "jitter": 11.0}),
        ("out_of_order", {"jitter": 0.04, "out_of_order": True}),
        ("out_of_order", {"jitter": 0.2, "sample_period": 0.2, "out_of_order": True}),
        ("sample_period", {"sample_period": 0.03}),
        ("start", {"start": 2.0, "end": 2.0}),
        ("start", {"start": 2.01, "end": 2.03}),
    ],
)
def test_invalid_settings_are_named(name, changed):
    check_faults(MeasurementFaults(**USABLE), PLANNING)
    with pytest.raises(InvalidArgumentError) as caught:
        check_faults(MeasurementFaults(**USABLE | changed), PLANNING)
    assert str(caught.value).startswith(f"faults.{name}")
    assert "\n" not in str(caught.value)


def test_the_longest_delay_and_burst_that_are_allowed_can_be_used():
    faults = MeasurementFaults(delay=30.0, jitter=20.0, dropout_rate=1.0, dropout_duration=100.0)
    check_faults(faults, T)
    assert len(SensorMemory.empty(faults, T).under_way) == 1000
    assert len(played(faults, ticks=range(3))) == 3
