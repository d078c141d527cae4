import numpy as np
import pytest
from sampled_motion import measured, normalized_squares, sampled_motion
from scipy.spatial.transform import Rotation

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.estimation.pose_belief import PoseFilterNoise
from drake_pregrasp.estimation.pose_smoother import filter_poses, smooth

NOISE = PoseFilterNoise(
    position=1e-3,
    orientation=5e-3,
    acceleration=0.2,
    angular_acceleration=1.0,
    initial_velocity=0.5,
    initial_angular_velocity=1.0,
    gravity=9.81,
)
DT = 0.02


def recording(seed, steps=40):
    """Returns the times, the true motion, and the measured positions and filtered beliefs."""
    rng = np.random.default_rng(seed)
    truth = sampled_motion(rng, NOISE, DT, steps)
    p, R = measured(rng, truth[0], truth[2], NOISE)
    times = DT * np.arange(steps)
    return times, truth, p, filter_poses(times, p, R.as_matrix(), NOISE)


def test_smoothed_positions_are_those_of_least_squares():
    """All states at once, from all measurements and all steps, weighted by their covariances."""
    times, _, p, beliefs = recording(2, steps=6)
    smoothed, k = smooth(beliefs, NOISE), len(times)
    Q = NOISE.acceleration**2 * np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]])
    W = np.linalg.inv(np.linalg.cholesky(Q))
    F = np.array([[1, DT], [0, 1]])
    for axis in range(3):
        fall = -NOISE.gravity * (axis == 2) * np.array([DT**2 / 2, DT])
        rows, values = [np.eye(2 * k)[1] / NOISE.initial_velocity], [0.0]
        for step in range(k):
            rows.append(np.eye(2 * k)[2 * step] / NOISE.position)
            values.append(p[step, axis] / NOISE.position)
            if step + 1 < k:
                block = np.zeros((2, 2 * k))
                block[:, 2 * step : 2 * step + 4] = np.hstack([-F, np.eye(2)])
                rows += list(W @ block)
                values += list(W @ fall)
        A = np.array(rows)
        x = np.linalg.lstsq(A, np.array(values), rcond=None)[0].reshape(k, 2)
        covariance = np.linalg.inv(A.T @ A)
        for step, belief in enumerate(smoothed):
            assert belief.p_WCoM[0, axis] == pytest.approx(x[step, 0], abs=1e-9)
            assert belief.V_WCoM[0, 3 + axis] == pytest.approx(x[step, 1], abs=1e-7)
            block = covariance[2 * step : 2 * step + 2, 2 * step : 2 * step + 2]
            P = belief.P[0][np.ix_([axis + 3, axis + 9], [axis + 3, axis + 9])]
            np.testing.assert_allclose(P, block, rtol=1e-6, atol=1e-12)


def test_past_poses_come_closer_to_the_truth_by_what_the_covariance_says():
    gains, squares = [], []
    for seed in range(12):
        times, (p, v, R, w), _, beliefs = recording(seed)
        smoothed = smooth(beliefs, NOISE)
        assert smoothed[-1] is beliefs[-1]
        assert [belief.time for belief in smoothed] == times.tolist()
        for k in range(5, len(times) - 5):
            before, after = beliefs[k], smoothed[k]
            squares.append(normalized_squares(after, p[k], v[k], R[k], w[k]))
            errors = [np.linalg.norm(p[k] - b.p_WCoM[0]) for b in (before, after)]
            R_WO = Rotation.from_matrix([before.R_WO[0], after.R_WO[0]])
            gains.append([errors, (R[k].inv() * R_WO).magnitude()])
    before, after = np.sqrt(np.mean(np.square(gains), axis=0)).T
    assert np.all(after < 0.8 * before)
    np.testing.assert_allclose(np.mean(squares, axis=0), 6, atol=0.8)


def test_beliefs_out_of_order_are_refused_and_few_are_fine():
    *_, beliefs = recording(3, steps=3)
    with pytest.raises(InvalidArgumentError, match="in the order of time"):
        smooth(beliefs[::-1], NOISE)
    assert smooth([], NOISE) == []
    assert smooth(beliefs[:1], NOISE) == beliefs[:1]
