import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.estimation.pose_filter import PoseFilterNoise
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
    """Returns times, true positions and orientations, and measured ones, of a model's motion."""
    rng = np.random.default_rng(seed)
    p, v = np.zeros(3), rng.normal(scale=NOISE.initial_velocity, size=3)
    R, w = Rotation.identity(), rng.normal(scale=NOISE.initial_angular_velocity, size=3)
    L = np.linalg.cholesky(np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]]))
    truth, measured = [], []
    for _ in range(steps):
        z_R = Rotation.from_rotvec(rng.normal(scale=NOISE.orientation, size=3)) * R
        truth.append((p, R))
        measured.append((p + rng.normal(scale=NOISE.position, size=3), z_R))
        dp, dv = NOISE.acceleration * L @ rng.normal(size=(2, 3))
        fall = np.array([0, 0, -NOISE.gravity])
        p, v = p + v * DT + fall * DT**2 / 2 + dp, v + fall * DT + dv
        turn, dw = NOISE.angular_acceleration * L @ rng.normal(size=(2, 3))
        R, w = Rotation.from_rotvec(w * DT + turn) * R, w + dw
    return DT * np.arange(steps), truth, measured


def filtered(times, measured):
    p, R = np.array([p for p, _ in measured]), [R.as_matrix() for _, R in measured]
    return filter_poses(times, p, np.array(R), NOISE)


def test_the_newest_belief_stays_and_no_covariance_grows():
    times, _, measured = recording(1)
    beliefs = filtered(times, measured)
    smoothed = smooth(beliefs, NOISE)
    assert smoothed[-1] is beliefs[-1]
    for before, after in zip(beliefs[:-1], smoothed[:-1], strict=True):
        assert after.time == before.time
        for name in ("P_position", "P_orientation"):
            P, P_s = getattr(before, name), getattr(after, name)
            scale = np.sqrt(np.diag(P))
            gain = np.linalg.eigvalsh((P - P_s) / np.outer(scale, scale))
            assert gain.min() > -1e-9
            assert gain.max() > 0.1
            assert np.linalg.eigvalsh(P_s).min() > 0


def test_smoothed_positions_are_those_of_least_squares():
    """All states at once, from all measurements and all steps, weighted by their covariances."""
    times, _, measured = recording(2, steps=6)
    smoothed = smooth(filtered(times, measured), NOISE)
    k = len(times)
    Q = NOISE.acceleration**2 * np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]])
    W = np.linalg.inv(np.linalg.cholesky(Q))
    F = np.array([[1, DT], [0, 1]])
    for axis in range(3):
        fall = -NOISE.gravity * (axis == 2) * np.array([DT**2 / 2, DT])
        rows, values = [np.eye(2 * k)[1] / NOISE.initial_velocity], [0.0]
        for step in range(k):
            rows.append(np.eye(2 * k)[2 * step] / NOISE.position)
            values.append(measured[step][0][axis] / NOISE.position)
            if step + 1 < k:
                block = np.zeros((2, 2 * k))
                block[:, 2 * step : 2 * step + 4] = np.hstack([-F, np.eye(2)])
                rows += list(W @ block)
                values += list(W @ fall)
        A = np.array(rows)
        x = np.linalg.lstsq(A, np.array(values), rcond=None)[0].reshape(k, 2)
        covariance = np.linalg.inv(A.T @ A)
        for step, belief in enumerate(smoothed):
            assert belief.p_WCoM[axis] == pytest.approx(x[step, 0], abs=1e-9)
            assert belief.v_WCoM[axis] == pytest.approx(x[step, 1], abs=1e-7)
            block = covariance[2 * step : 2 * step + 2, 2 * step : 2 * step + 2]
            P = belief.P_position[np.ix_([axis, axis + 3], [axis, axis + 3])]
            np.testing.assert_allclose(P, block, rtol=1e-6, atol=1e-12)


def test_past_poses_come_closer_to_the_truth_by_what_the_covariance_says():
    ratios, normalised = [], []
    for seed in range(12):
        times, truth, measured = recording(seed)
        beliefs = filtered(times, measured)
        smoothed = smooth(beliefs, NOISE)
        inner = range(5, len(times) - 5)
        errors = np.array([[s[j].p_WCoM - truth[j][0] for j in inner] for s in (beliefs, smoothed)])
        ratios.append(np.linalg.norm(errors[1]) / np.linalg.norm(errors[0]))
        turns = np.array(
            [
                [(truth[j][1] * Rotation.from_matrix(s[j].R_WO).inv()).as_rotvec() for j in inner]
                for s in (beliefs, smoothed)
            ]
        )
        ratios.append(np.linalg.norm(turns[1]) / np.linalg.norm(turns[0]))
        for error, turn, j in zip(errors[1], turns[1], inner, strict=True):
            normalised.append(error @ np.linalg.solve(smoothed[j].P_position[:3, :3], error))
            normalised.append(turn @ np.linalg.solve(smoothed[j].P_orientation[:3, :3], turn))
    assert np.mean(ratios) < 0.8
    assert np.mean(normalised) == pytest.approx(3, abs=0.4)


def test_an_exact_recording_stays_as_it_is():
    times = DT * np.arange(30)
    fall = np.array([0, 0, -NOISE.gravity / 2])
    p = times[:, None] * [1.0, 2, 3] + times[:, None] ** 2 * fall
    R = Rotation.from_rotvec(times[:, None] * [2.0, -3, 1]).as_matrix()
    exact = dataclasses.replace(
        NOISE, position=1e-7, orientation=1e-7, initial_velocity=10, initial_angular_velocity=100
    )
    smoothed = smooth(filter_poses(times, p, R, exact), exact)
    for belief, p_WO, R_WO in zip(smoothed, p, R, strict=True):
        np.testing.assert_allclose(belief.p_WCoM, p_WO, atol=1e-7)
        assert Rotation.from_matrix(belief.R_WO.T @ R_WO).magnitude() < 1e-6
        np.testing.assert_allclose(belief.w_WO, [2, -3, 1], atol=1e-3)


def test_beliefs_out_of_order_are_refused_and_few_are_fine():
    times, _, measured = recording(3, steps=3)
    beliefs = filtered(times, measured)
    with pytest.raises(InvalidArgumentError, match="in the order of time"):
        smooth(beliefs[::-1], NOISE)
    assert smooth([], NOISE) == []
    assert smooth(beliefs[:1], NOISE) == beliefs[:1]
