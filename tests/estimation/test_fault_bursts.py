import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_pregrasp.estimation.fault_settings import (
    CUT_OFF,
    FaultChannel,
    burst_reach,
    fault_generator,
    in_burst,
)

PERIOD = 0.05
TICKS = 12_000


def covered(rate, duration, seed=0, channel=FaultChannel.DROPOUTS, ticks=range(TICKS)):
    settings = {"rate": rate, "duration": duration, "period": PERIOD}
    return np.array([in_burst(k, **settings, seed=seed, channel=channel) for k in ticks])


def survival(duration):
    """Returns P(E > a period) for the ages a of a burst."""
    return np.exp(-PERIOD / duration * np.arange(burst_reach(duration, PERIOD)))


def lengths(mask):
    return [len(list(run)) for inside, run in itertools.groupby(mask) if inside]


@pytest.mark.parametrize(
    ("rate", "duration"), [(0.3, 0.2), (1.0, 0.5), (5.0, 0.05), (30.0, 0.01), (5.0, 1e-6)]
)
def test_the_busy_share_is_that_of_the_queue(rate, duration):
    """Counted in blocks of 300 ticks, which are all but independent."""
    busy = 1 - np.prod(1 - -math.expm1(-rate * PERIOD) * survival(duration))
    shares = covered(rate, duration).reshape(-1, 300).mean(axis=1)
    error = np.std(shares) / math.sqrt(len(shares))
    assert abs(np.mean(shares) - busy) < 3.5 * error
    assert error < 0.1 * busy


@pytest.mark.slow
def test_rare_bursts_have_the_stated_mean_length_and_none_is_longer_than_the_cut_off():
    mask = np.concatenate([covered(0.05, 0.3, seed) for seed in range(4)])
    found = lengths(mask)
    assert len(found) == pytest.approx(0.05 * PERIOD * len(mask), rel=0.3)
    assert np.mean(found) == pytest.approx(np.sum(survival(0.3)), rel=0.25)
    assert max(found) <= math.ceil(CUT_OFF * 0.3 / PERIOD) == burst_reach(0.3, PERIOD)


@pytest.mark.slow
def test_bursts_are_as_many_at_the_first_tick_as_later():
    """There is no start-up: occlusions may have begun before the run."""
    first = [covered(1.0, 0.5, seed, ticks=[0])[0] for seed in range(1500)]
    later = np.mean(covered(1.0, 0.5))
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


def test_bursts_are_a_function_of_seed_channel_and_tick_whatever_the_order():
    mask = covered(1.0, 0.3, 5, ticks=range(300))
    np.testing.assert_array_equal(covered(1.0, 0.3, 5, ticks=range(299, -1, -1))[::-1], mask)
    assert np.any(covered(1.0, 0.3, 6, ticks=range(300)) != mask)
    assert not np.any(covered(0.0, 10.0, ticks=range(100)))
    assert np.any(covered(1.0, 0.3, 5, FaultChannel.FREEZING, range(300)) != mask)


def test_channels_share_no_numbers_with_each_other_nor_with_the_noise():
    numbers = [np.random.default_rng((3, 7)).random()]
    numbers += [fault_generator(3, 7, channel).random() for channel in FaultChannel]
    assert len(set(numbers)) == len(FaultChannel) + 1
    assert fault_generator(3, -7, FaultChannel.NAN).random() not in numbers
