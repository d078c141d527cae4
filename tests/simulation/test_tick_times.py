"""Durations of ticks as a histogram."""

import numpy as np
import pytest

from drake_pregrasp.simulation.run_log import TickTimes


@pytest.mark.parametrize("percent", [1, 50, 99])
def test_percentiles_are_good_to_half_a_percent(percent):
    seconds = np.random.default_rng(0).lognormal(np.log(1e-3), 1, 3001)
    times = TickTimes()
    for value in seconds:
        times.add(value)
    expected = 1e3 * np.percentile(seconds, percent)
    assert times.percentile_ms(percent) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(("seconds", "ms"), [(0.0, 1e-3), (1e-3, 1.0), (1e9, 1e6)])
def test_any_duration_counts(seconds, ms):
    times = TickTimes()
    times.add(seconds)
    assert times.percentile_ms(50) == pytest.approx(ms, rel=0.01)


def test_without_ticks_there_is_no_percentile():
    assert TickTimes().percentile_ms(50) is None


def test_ticks_beyond_the_deadline_are_counted():
    times, endless = TickTimes(deadline=1e-3), TickTimes()
    for seconds in (1e-4, 1e-3, 1.1e-3, 2.0):
        times.add(seconds)
        endless.add(seconds)
    assert (times.overruns, endless.overruns) == (2, 0)
