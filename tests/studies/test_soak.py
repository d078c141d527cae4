import numpy as np
import pytest

from drake_pregrasp.studies.bench.soak import drift, soak


def test_hours_are_means_over_all_their_ticks():
    seen = []
    hours = soak(3, seconds=5.0, on_hour=lambda index, hour: seen.append((index, hour)))
    assert seen == list(enumerate(hours))
    assert [hour.ticks for hour in hours] == [100, 100, 100]
    static, later, last = hours
    assert static.q_gii < later.q_gii
    assert later.q_gii == pytest.approx(last.q_gii, rel=1e-3)
    assert 0 < last.position_error < 2e-3
    assert last.active == 1
    assert last.resident > 0


def test_drift_is_the_slope_of_all_hours_but_the_first():
    slope, error = drift([100.0, 1.0, 3.0, 5.0, 7.0])
    assert slope == pytest.approx(2)
    assert error == pytest.approx(0, abs=1e-12)
    noisy = 2.0 * np.arange(200) + np.random.default_rng(0).normal(size=200)
    slope, error = drift(noisy.tolist())
    assert abs(slope - 2) < 4 * error
    assert error < 0.01
