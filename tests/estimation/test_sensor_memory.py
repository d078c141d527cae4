"""Memory and bursts of the faults of the simulated sensor."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_pregrasp import InvalidArgumentError, MeasurementFaults
from drake_pregrasp.arrays import pack, unpacker
from drake_pregrasp.config.sensor_config import check_faults
from drake_pregrasp.estimation import measurement_faults
from drake_pregrasp.estimation.fault_settings import (
    CUT_OFF,
    FaultChannel,
    burst_end,
    burst_reach,
    fault_generator,
)

T = 0.05
TICKS = 120


def value(tick):
    """Returns the pose that is measured at a tick: numbers that tell which it is."""
    return np.arange(measurement_faults.POSE_SIZE) + 100.0 * tick


def played(faults, seed=0, ticks=range(TICKS)):
    """Returns the memories after the ticks, each by way of the vector that is stored."""
    memory = measurement_faults.SensorMemory.empty(faults, T)
    found, unpack = [], unpacker(memory)
    for tick in ticks:
        now = {"time": tick * T, "tick": tick, "faults": faults, "period": T, "seed": seed}
        memory = unpack(pack(measurement_faults.next_memory(memory, value(tick), **now)))
        found.append(memory)
    return found


def transcribed(faults, seed):
    """Returns stamps and first numbers of poses, straight from all that was ever measured."""
    sent, held = [], None
    bursts = [
        covered(faults.freeze_rate, faults.freeze_duration, seed, FaultChannel.FREEZING),
        covered(faults.dropout_rate, faults.dropout_duration, seed, FaultChannel.DROPOUTS),
    ]
    for tick in range(TICKS):
        taken, acts = measurement_faults.is_taken(tick, faults, T), faults.act_at(tick, T)
        frozen, occluded = (acts and mask[tick] for mask in bursts)
        held = (held if held is not None else tick if taken else None) if frozen else None
        if taken and not occluded:
            shown = tick if held is None else held
            sent.append((measurement_faults.arrival_tick(tick, faults, T, seed), tick, shown))
    for now in range(TICKS):
        arrived = [entry for entry in sent if entry[0] <= now]
        key = (lambda e: e[:2]) if faults.out_of_order else (lambda e: e[1])
        _, tick, shown = max(arrived, key=key, default=(0, None, None))
        yield (-math.inf, math.nan) if tick is None else (tick * T, 100.0 * shown)


@pytest.mark.slow
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
    lags = np.array([measurement_faults.arrival_tick(k, faults, T, 1) - k for k in range(3000)]) * T
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
    taken = [k * period for k in range(1200) if measurement_faults.is_taken(k, faults, period)]
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
    assert len(measurement_faults.SensorMemory.empty(faults, T).under_way) == 1000
    assert len(played(faults, ticks=range(3))) == 3


PERIOD = 0.05
MANY = range(12_000)


def covered(rate, duration, seed=0, channel=FaultChannel.DROPOUTS, ticks=range(TICKS)):
    burst = {"rate": rate, "duration": duration, "period": PERIOD, "seed": seed, "channel": channel}
    before = range(ticks[0] - burst_reach(duration, PERIOD) + 1, ticks[0])
    ends = [burst_end(before, **burst), *(burst_end([k], **burst) for k in ticks)]
    return np.maximum.accumulate(ends)[1:] > np.array(ticks)


def survival(duration):
    """Returns P(E > a period) for the ages a of a burst."""
    return np.exp(-PERIOD / duration * np.arange(burst_reach(duration, PERIOD)))


def lengths(mask):
    return [len(list(run)) for inside, run in itertools.groupby(mask) if inside]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "duration"), [(0.3, 0.2), (1.0, 0.5), (5.0, 0.05), (30.0, 0.01), (5.0, 1e-6)]
)
def test_the_busy_share_is_that_of_the_queue(rate, duration):
    """Counted in blocks of 300 ticks, which are all but independent."""
    busy = 1 - np.prod(1 - -math.expm1(-rate * PERIOD) * survival(duration))
    shares = covered(rate, duration, ticks=MANY).reshape(-1, 300).mean(axis=1)
    error = np.std(shares) / math.sqrt(len(shares))
    assert abs(np.mean(shares) - busy) < 3.5 * error
    assert error < 0.1 * busy


@pytest.mark.slow
def test_rare_bursts_have_the_stated_mean_length_and_none_is_longer_than_the_cut_off():
    mask = np.concatenate([covered(0.05, 0.3, seed, ticks=MANY) for seed in range(4)])
    found = lengths(mask)
    assert len(found) == pytest.approx(0.05 * PERIOD * len(mask), rel=0.3)
    assert np.mean(found) == pytest.approx(np.sum(survival(0.3)), rel=0.25)
    assert max(found) <= math.ceil(CUT_OFF * 0.3 / PERIOD) == burst_reach(0.3, PERIOD)


@pytest.mark.slow
def test_bursts_are_as_many_at_the_first_tick_as_later():
    """There is no start-up: occlusions may have begun before the run."""
    first = [covered(1.0, 0.5, seed, ticks=[0])[0] for seed in range(1500)]
    later = np.mean(covered(1.0, 0.5, ticks=MANY))
    assert np.mean(first) == pytest.approx(later, abs=4 * math.sqrt(later * (1 - later) / 1500))


@pytest.mark.slow
@settings(max_examples=25)
@given(
    rate=st.floats(0.1, 5.0),
    duration=st.floats(0.02, 0.5),
    more=st.floats(1.0, 3.0),
    seed=st.integers(0, 2**53),
)
def test_more_frequent_or_longer_bursts_cover_what_others_did(rate, duration, more, seed):
    ticks = range(40)
    mask = covered(rate, duration, seed, ticks=ticks)
    assert np.all(covered(more * rate, duration, seed, ticks=ticks) >= mask)
    assert np.all(covered(rate, more * duration, seed, ticks=ticks) >= mask)


def test_bursts_are_a_function_of_seed_channel_and_tick_wherever_one_begins():
    mask = covered(1.0, 0.3, 5, ticks=range(300))
    alone = [covered(1.0, 0.3, 5, ticks=[tick])[0] for tick in range(0, 300, 7)]
    np.testing.assert_array_equal(alone, mask[::7])
    assert np.any(covered(1.0, 0.3, 6, ticks=range(300)) != mask)
    assert not np.any(covered(0.0, 10.0, ticks=range(100)))
    assert np.any(covered(1.0, 0.3, 5, FaultChannel.FREEZING, range(300)) != mask)


def test_channels_share_no_numbers_with_each_other_nor_with_the_noise():
    numbers = [np.random.default_rng((3, 7)).random()]
    numbers += [fault_generator(3, 7, channel).random() for channel in FaultChannel]
    assert len(set(numbers)) == len(FaultChannel) + 1
    assert fault_generator(3, -7, FaultChannel.NAN).random() not in numbers
