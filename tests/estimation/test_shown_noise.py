"""What a sensor's innovations tell of its noise."""

import numpy as np
import pytest

from drake_pregrasp.estimation.pose_filter import Innovation
from drake_pregrasp.estimation.pose_tracker import noisiness_after

ROOTS = np.array([np.diag([1e-3, 2e-3, 3e-3]), [[1e-2, 0, 0], [5e-3, 8e-3, 0], [0, 0, 1e-2]]])
S = ROOTS @ ROOTS.transpose(0, 2, 1)


def mean_noisiness(share, count=3000):
    """Mean over a sensor whose innovations have that share of the standard deviation expected."""
    rng = np.random.default_rng(0)
    zero = np.zeros((2, 3, 3))
    last, noisiness, shown = np.zeros((2, 3)), min(1.0, share**2), []
    for normal in rng.normal(size=(count, 2, 3, 1)):
        nu = share * (ROOTS @ normal)[:, :, 0]
        noisiness = noisiness_after(noisiness, Innovation(nu, zero, zero, S), last)
        last = nu
        shown.append(noisiness)
    return np.mean(shown)


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_a_sensor_quieter_than_assumed_shows_its_share_of_the_variance(share):
    assert mean_noisiness(share) == pytest.approx(share**2, rel=0.1)


def test_noisiness_grows_with_the_noise_up_to_one():
    shown = [mean_noisiness(share, 500) for share in (0.0, 0.2, 0.5, 1.0, 2.0, 10.0)]
    assert shown[0] == 0
    assert np.all(np.diff(shown) > 0)
    assert 0.6 < shown[3] < 0.95 < shown[-1] <= 1


def test_innovations_that_are_alike_are_no_noise():
    nu, zero = np.full((2, 3), 0.05), np.zeros((2, 3, 3))
    noisiness = 1.0
    for _ in range(200):
        noisiness = noisiness_after(noisiness, Innovation(nu, zero, zero, S), nu)
    assert noisiness < 1e-3
