import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest, kstest, norm, t

from drake_pregrasp import MeasurementFaults
from drake_pregrasp.estimation.measurement_faults import drift, faulty_disturbance
from drake_pregrasp.geometry.rotations import rotation_vector

TICKS = 2000
T = 0.05
STD = (0.01, 0.02)
NORMAL = np.random.default_rng(1).standard_normal((TICKS, 6))
SILENT = np.zeros((TICKS, 6))
SURE = 1e-4  # Of a test that a right model fails: seeds are fixed, so it never does later on.


def disturbances(faults, noise=NORMAL, std=STD):
    """Returns offsets and rotation vectors, shapes (k, 3)."""
    found = [
        faulty_disturbance(n, *std, faults, tick=k, period=T, seed=0) for k, n in enumerate(noise)
    ]
    return np.array([p for p, _ in found]), np.array([rotation_vector(turn) for _, turn in found])


@pytest.mark.parametrize(
    ("faults", "factor"), [({}, 1), ({"noise_factor": 3.0}, 3), ({"degrees_of_freedom": 1e6}, 1)]
)
def test_without_other_faults_it_is_the_noise_times_its_factor(faults, factor):
    offsets, vectors = disturbances(MeasurementFaults(**faults), NORMAL[:200])
    rtol = 0.01 if "degrees_of_freedom" in faults else 1e-9
    np.testing.assert_allclose(offsets, factor * STD[0] * NORMAL[:200, :3], rtol=rtol)
    np.testing.assert_allclose(vectors, factor * STD[1] * NORMAL[:200, 3:], rtol=rtol, atol=1e-14)


def test_a_bias_is_there_in_w_whatever_the_noise():
    bias, turn = np.array([0.1, -0.2, 0.3]), np.array([0.4, 0.0, -0.5])
    faults = MeasurementFaults(position_bias=bias, orientation_bias=turn)
    for noise in (SILENT[:1], NORMAL[:20]):
        offsets, vectors = disturbances(faults, noise)
        white, angles = disturbances(MeasurementFaults(), noise)
        np.testing.assert_allclose(offsets, white + bias, atol=1e-15)
        expected = Rotation.from_rotvec(angles) * Rotation.from_rotvec(turn)
        np.testing.assert_allclose(vectors, expected.as_rotvec(), atol=1e-12)


@pytest.mark.parametrize("degrees_of_freedom", [1.0, 2.5, 8.0])
def test_heavy_tails_are_students(degrees_of_freedom):
    """Each number by itself, at the scale that is stated."""
    faults = MeasurementFaults(degrees_of_freedom=degrees_of_freedom)
    # So little noise of the orientation that no rotation vector is beyond half a turn.
    offsets, vectors = disturbances(faults, std=(0.01, 1e-9))
    for numbers, scale in ((offsets, 0.01), (vectors, 1e-9)):
        for column in numbers.T / scale:
            assert kstest(column, t(degrees_of_freedom).cdf).pvalue > SURE
            assert kstest(column, norm.cdf).pvalue < SURE or degrees_of_freedom > 3


def test_heavy_tails_prefer_no_direction_and_come_one_by_one():
    faults = MeasurementFaults(degrees_of_freedom=1.5)
    offsets, vectors = disturbances(faults, std=(0.01, 1e-9))
    directions = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
    np.testing.assert_allclose(directions.T @ directions / TICKS, np.eye(3) / 3, atol=0.04)
    p, R, n = (np.log(np.linalg.norm(x, axis=1)) for x in (offsets, vectors, NORMAL[:, :3]))
    assert abs(np.corrcoef(p - n, R)[0, 1]) < 0.1


def test_outliers_are_as_many_and_as_far_as_stated_in_any_direction():
    faults = MeasurementFaults(
        outlier_probability=0.3, outlier_position=0.25, outlier_orientation=0.5
    )
    offsets, vectors = disturbances(faults, SILENT)
    out = np.linalg.norm(offsets, axis=1) > 0
    np.testing.assert_array_equal(np.linalg.norm(vectors, axis=1) > 0, out)
    assert binomtest(int(np.sum(out)), TICKS, 0.3).pvalue > SURE
    for numbers, size in ((offsets[out], 0.25), (vectors[out], 0.5)):
        np.testing.assert_allclose(np.linalg.norm(numbers, axis=1), size, rtol=1e-9)
        for column in numbers.T / size:  # Archimedes: on a sphere each coordinate is uniform.
            assert kstest(column, "uniform", args=(-1, 2)).pvalue > SURE
        # On the sphere x⁴ + y⁴ + z⁴ is 3/5 on average: no corner of a cube is preferred.
        quartic = np.sum((numbers / size) ** 4, axis=1)
        assert np.mean(quartic) == pytest.approx(0.6, abs=4 * np.std(quartic) / len(quartic) ** 0.5)
    assert abs(np.mean(np.sum(offsets[out] * vectors[out], axis=1)) / 0.125) < 0.1


def test_more_outliers_are_the_same_ones_and_others():
    few, many = (
        disturbances(MeasurementFaults(outlier_probability=p), SILENT[:300])[0] for p in (0.1, 0.4)
    )
    out = np.any(few != 0, axis=1)
    assert 0 < np.sum(out) < np.sum(np.any(many != 0, axis=1))
    np.testing.assert_array_equal(many[out], few[out])


def test_nan_measurements_are_nan_throughout_and_have_the_set_probability():
    found = [
        faulty_disturbance(
            n, *STD, MeasurementFaults(nan_probability=0.2), tick=k, period=T, seed=0
        )
        for k, n in enumerate(NORMAL)
    ]
    bad = np.array([np.append(offset, turn) for offset, turn in found])
    np.testing.assert_array_equal(np.any(np.isnan(bad), axis=1), np.all(np.isnan(bad), axis=1))
    assert binomtest(int(np.sum(np.isnan(bad[:, 0]))), TICKS, 0.2).pvalue > SURE


@pytest.mark.slow
@pytest.mark.parametrize("lag", [0.0, 0.5, 2.0])
def test_a_drift_is_gauss_markov(lag):
    """Over seeds, its numbers are nearly normal with the covariance exp(-lag); axes differ."""
    count = 4000
    first = np.array([drift(7.3, seed) for seed in range(count)])
    later = np.array([drift(7.3 + lag, seed) for seed in range(count)])
    np.testing.assert_allclose(first.T @ later / count, np.exp(-lag) * np.eye(3), atol=0.06)
    assert all(kstest(axis, norm.cdf).pvalue > SURE for axis in first.T)


def test_a_drift_adds_to_the_position_and_keeps_its_pace():
    faults = MeasurementFaults(drift_std=0.02, drift_time=4.0)
    offsets, vectors = disturbances(faults, SILENT)
    expected = [0.02 * drift(k * T / 4.0, 0) for k in range(TICKS)]
    np.testing.assert_allclose(offsets, expected, atol=1e-15)
    assert not vectors.any()
