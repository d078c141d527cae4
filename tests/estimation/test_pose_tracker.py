"""Verdicts of the tracker: measurements that are used, rejected, or restart the track."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import slow
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drake_pregrasp import MeasurementVerdict as Verdict
from drake_pregrasp.arrays import FARTHEST, pack
from drake_pregrasp.config.planner_config import EstimatorConfig, tracker_settings
from drake_pregrasp.estimation.manoeuvres import find_manoeuvre
from drake_pregrasp.estimation.pose_filter import (
    NO_MEASUREMENT,
    Innovation,
    PoseMeasurement,
    first_belief,
    predict,
    update,
)
from drake_pregrasp.estimation.pose_track import MEASUREMENT_SIZE, FilterStep, PoseTrack
from drake_pregrasp.estimation.pose_tracker import OLDEST, update_track
from drake_pregrasp.fast import default_kernels

SETTINGS = tracker_settings(EstimatorConfig(acceleration=1e-2, angular_acceleration=5e-2))
NOISE = SETTINGS.noise
DT = 0.05
V, W = np.array([0.02, -0.01, 0.005]), np.array([0.1, 0.05, -0.2])


def measured(time, rng, noise=1.0, at=None):
    p = V * time + noise * rng.normal(scale=NOISE.position, size=3)
    R = Rotation.from_rotvec(noise * rng.normal(scale=NOISE.orientation, size=3))
    R_WO = (R * Rotation.from_rotvec(W * time)).as_matrix()
    return PoseMeasurement(time if at is None else at, p, R_WO)


def tracks(stream, settings=SETTINGS, memory=20, track=None):
    """Yields the track after each pair of a time and the measurement that arrives then."""
    track = track or PoseTrack.empty(memory)
    for now, measurement in stream:
        yield (track := update_track(track, measurement, now, settings))


def follow(stream, settings=SETTINGS, memory=20, track=None):
    """Returns the last track and the verdicts of all."""
    found = list(tracks(stream, settings, memory, track))
    return found[-1], [track.verdict for track in found]


def in_time(count, rng, start=0, noise=1.0):
    return [(k * DT, measured(k * DT, rng, noise)) for k in range(start, start + count)]


def tracked(seed, count):
    """Returns a generator and the track of an object that it has followed for some measurements."""
    rng = np.random.default_rng(seed)
    return rng, follow(in_time(count, rng))[0]


def shifted(stream, offset):
    """Returns a stream with an offset of the positions, or one drawn for each."""
    offsets = [offset() if callable(offset) else offset for _ in stream]
    return [
        (now, replace(z, p_WCoM=z.p_WCoM + d)) for (now, z), d in zip(stream, offsets, strict=True)
    ]


def verdict(track, measurement, now, settings=SETTINGS):
    return update_track(track, measurement, now, settings).verdict


def error(track, now):
    belief = predict(track.newest, now - track.newest.time, NOISE)
    return np.linalg.norm(belief.p_WCoM - V * now)


def test_good_measurements_in_time_are_what_the_filter_gets():
    stream = in_time(30, np.random.default_rng(0))
    track, verdicts = follow(stream)
    belief = first_belief(stream[0][1], NOISE)
    for time, z in stream[1:]:
        belief = update(predict(belief, time - belief.time, NOISE), z, NOISE)
    np.testing.assert_array_equal(pack(track.newest), pack(belief))
    assert verdicts == [Verdict.STARTED] + [Verdict.USED] * 29


@pytest.mark.slow
@given(st.permutations(range(8)))
def test_measurements_in_any_order_give_the_same_belief(order):
    rng = np.random.default_rng(1)
    head, tail = in_time(20, rng), in_time(8, rng, start=20)
    now = 28 * DT + 0.15  # No measurement is worth less for being late.
    in_order, _ = follow(head + [(now, z) for _, z in tail])
    shuffled, verdicts = follow(head + [(now, tail[k][1]) for k in order])
    np.testing.assert_allclose(pack(shuffled.newest), pack(in_order.newest), rtol=1e-9, atol=1e-12)
    newest = np.maximum.accumulate(order)
    assert verdicts[20:] == [
        Verdict.USED_LATE if k < m else Verdict.USED for k, m in zip(order, newest, strict=True)
    ]


def test_a_late_measurement_that_is_too_far_is_refused():
    rng, track = tracked(3, 20)
    late = measured(0.5 * DT, rng)
    after = update_track(track, replace(late, p_WCoM=late.p_WCoM + 1.0), 20 * DT, SETTINGS)
    assert after.verdict == Verdict.OUTLIER
    np.testing.assert_array_equal(after.steps, track.steps)
    assert after.innovation_squared[0] > SETTINGS.gate**2 > after.innovation_squared[1]


def test_a_measurement_counts_once():
    rng, track = tracked(4, 10)
    for nothing_new in (measured(9 * DT, rng), measured(5 * DT, rng), NO_MEASUREMENT):
        again = update_track(track, nothing_new, 10 * DT, SETTINGS)
        assert again.verdict == Verdict.NOTHING_NEW
        np.testing.assert_array_equal(again.steps, track.steps)


@pytest.mark.parametrize(
    "change",
    [
        {"p_WCoM": np.array([2 * FARTHEST, 0, 0])},
        {"R_WO": -np.eye(3)},
        {"time": np.nan},
        {"time": np.inf},
        {"time": 99.0},
        {"time": -1e300},
    ],
)
def test_an_invalid_pose_changes_nothing(change):
    rng = np.random.default_rng(5)
    bad = replace(measured(10 * DT, rng), **change)
    for track in (PoseTrack.empty(5), follow(in_time(10, rng))[0]):
        after = update_track(track, bad, 10 * DT, SETTINGS)
        assert after.verdict == Verdict.UNUSABLE
        np.testing.assert_array_equal(after.steps, track.steps)


@pytest.mark.parametrize("seed", range(3))
def test_single_outliers_of_position_or_orientation_leave_the_belief_alone(seed):
    rng = np.random.default_rng(seed)
    stream = in_time(60, rng)
    for k in (20, 30, 31, 45):
        now, z = stream[k]
        if k % 2:
            z = replace(z, p_WCoM=z.p_WCoM + rng.normal(scale=0.1, size=3) + 0.02)
        else:
            z = replace(z, R_WO=Rotation.from_rotvec([0.5, 0, 0]).as_matrix() @ z.R_WO)
        stream[k] = now, z
    track, verdicts = follow(stream)
    assert [k for k, found in enumerate(verdicts) if found >= Verdict.UNUSABLE] == [20, 30, 31, 45]
    assert error(track, 59 * DT) < 4 * NOISE.position
    naive, _ = follow(stream[:46], replace(SETTINGS, gate=0))
    assert error(naive, 45 * DT) > 4 * NOISE.position


@pytest.mark.parametrize("count", [1, 3, 6])
def test_a_jump_is_followed_after_as_many_measurements_as_are_asked_for(count):
    rng = np.random.default_rng(6)
    away = np.array([0.3, 0.2, 0.0])
    stream = in_time(30, rng) + shifted(in_time(20, rng, start=30), away)
    track, verdicts = follow(stream, replace(SETTINGS, reacquire_after=count))
    assert verdicts[30 : 30 + count] == [Verdict.OUTLIER] * (count - 1) + [Verdict.REACQUIRED]
    assert error(track, 49 * DT) == pytest.approx(np.linalg.norm(away), abs=1e-3)
    assert track.is_locked


def test_outliers_that_disagree_are_no_jump_until_nothing_else_is_left():
    rng = np.random.default_rng(7)
    wild = shifted(in_time(45, rng, start=30), lambda: rng.uniform(-5, 5, 3))
    before, _ = follow(in_time(30, rng))
    track, _ = follow(wild[:14], track=before)
    assert error(track, 44 * DT) < 10e-3
    track, verdicts = follow(wild, track=before)
    assert verdicts == 3 * ([Verdict.OUTLIER] * 14 + [Verdict.STARTED])
    np.testing.assert_array_equal(track.newest.p_WCoM, wild[-1][1].p_WCoM)
    assert not track.is_locked


@pytest.mark.parametrize("same_place", [True, False])
def test_outliers_with_good_measurements_between_never_refute_the_belief(same_place):
    rng = np.random.default_rng(16)
    stream = in_time(70, rng)
    away = np.full(3, 0.5) if same_place else lambda: rng.uniform(1, 5, 3)
    stream[31::2] = shifted(stream[31::2], away)
    track, verdicts = follow(stream)
    assert set(verdicts[31::2]) == {Verdict.OUTLIER}
    assert set(verdicts[30::2]) == {Verdict.USED}
    assert track.is_locked
    assert error(track, 69 * DT) < 4 * NOISE.position


def test_a_belief_that_knows_the_orientation_no_more_starts_anew_and_no_other_one():
    rng, track = tracked(17, 60)
    known, unknown = set(), set()
    for silence in np.linspace(1.0, 40.0, 40):
        time = 59 * DT + silence
        P = predict(track.newest, silence, NOISE).P_orientation
        std = np.sqrt(np.max(P.diagonal()[:3]))
        found = verdict(track, measured(time, rng), time)
        if std < 0.3:
            known.add(found)
        elif np.pi / 2 < std < 4 * np.pi:  # A quarter turn and more: it may face any way.
            unknown.add(found)
    assert known == {Verdict.USED}
    assert unknown == {Verdict.STARTED}
    for silence in (0.9 * OLDEST, 10 * OLDEST, 1e300):
        assert verdict(track, measured(0.0, rng, at=silence), silence) == Verdict.STARTED


def test_after_a_jump_velocities_are_those_from_before():
    changes = []
    for seed in range(8):
        rng, before = tracked(seed, 60)
        track, verdicts = follow(shifted(in_time(3, rng, start=60), 0.3), track=before)
        assert verdicts[-1] == Verdict.REACQUIRED
        changes.append(track.newest.v_WCoM - before.newest.v_WCoM)
    # Three places alone tell a velocity to sqrt(2) standard deviations over the time between them.
    assert np.std(changes) < 0.7 * NOISE.position / (np.sqrt(2) * DT)


def test_a_kicked_object_is_found_with_its_new_velocity_by_default():
    rng = np.random.default_rng(19)
    kick = np.array([0.9, 0, 0])
    kicked = [
        (now, replace(z, p_WCoM=z.p_WCoM + kick * (now - 59 * DT)))
        for now, z in in_time(8, rng, start=60)
    ]
    track, verdicts = follow(in_time(60, rng) + kicked)
    assert Verdict.REACQUIRED in verdicts[60:65]
    np.testing.assert_allclose(track.newest.v_WCoM, V + kick, atol=2e-2)


def test_an_outlier_after_a_long_silence_is_not_believed():
    rng, track = tracked(14, 60)
    late = measured(59 * DT + 2.0, rng)
    wrong = replace(late, p_WCoM=late.p_WCoM + 0.5)
    assert verdict(track, wrong, late.time) == Verdict.OUTLIER
    assert verdict(track, late, late.time) == Verdict.USED


def test_a_frozen_value_is_refused_but_only_of_a_noisy_sensor_and_a_moving_object():
    rng = np.random.default_rng(9)
    stream = in_time(40, rng)
    track, _ = follow(stream)
    frozen = replace(stream[-1][1], time=40 * DT)
    assert verdict(track, frozen, 40 * DT) == Verdict.REPEATED
    trusting = replace(SETTINGS, refuse_repeats=False)
    assert verdict(track, frozen, 40 * DT, trusting) == Verdict.USED
    # A pose from a simulator, without noise, may well stop where it is, or swing and stop.
    exact = [measured(min(k, 40) * DT, rng, noise=0, at=k * DT) for k in range(60)]
    swings = [0.03 * np.sin(2 * min(k * DT, 5.0)) * np.eye(3)[0] for k in range(200)]
    for poses in (exact, [PoseMeasurement(k * DT, p, np.eye(3)) for k, p in enumerate(swings)]):
        track, verdicts = follow([(z.time, z) for z in poses])
        assert Verdict.REPEATED not in verdicts
        assert np.linalg.norm(track.newest.p_WCoM - poses[-1].p_WCoM) < 1e-3
    # And a coarse sensor may see an object at rest in the same place again.
    still = [PoseMeasurement(k * DT, rng.normal(scale=5e-4, size=3), np.eye(3)) for k in range(40)]
    track, _ = follow([(z.time, z) for z in still])
    assert verdict(track, replace(still[-1], time=40 * DT), 40 * DT) == Verdict.USED


@pytest.mark.slow
def test_the_innovation_is_chi_square_distributed():
    stream = in_time(4000, np.random.default_rng(10))
    squares = [track.innovation_squared for track in tracks(stream, memory=3)]
    # The truth has no acceleration, so that the filter expects a little more than there is.
    means = np.mean(squares[100:], axis=0)
    assert np.all((means > 2) & (means < 3))


@pytest.mark.parametrize("factor", [1.0, slow(1.6), 4.0])
def test_a_sensor_noisier_than_assumed_is_believed_less(factor):
    rng, track = tracked(12, 40)
    stream = in_time(120, rng, start=40, noise=factor)
    found = list(tracks(stream, track=track))
    errors = [error(after, now) for after, (now, _) in zip(found, stream, strict=True)]
    assert (found[-1].noise_factor > 1) == (factor > 1)
    # The excess is a running mean, so no single innovation changes it by much.
    assert np.max(np.abs(np.diff([after.excess for after in found]))) < 0.5
    assert Verdict.REACQUIRED not in [after.verdict for after in found]
    assert max(errors[40:]) < 2 * factor * NOISE.position


def test_a_noisy_sensor_is_believed_less_when_it_is_late_too():
    """Of two measurements, the second one comes first."""
    stream = in_time(400, np.random.default_rng(15), noise=3.0)
    pairs = zip(stream[::2], stream[1::2], strict=True)
    stream = [(now, z) for (_, first), (now, second) in pairs for z in (second, first)]
    squares = []
    for belief in (track.newest for track in tracks(stream)):
        e = V * belief.time - belief.p_WCoM
        squares.append(e @ np.linalg.solve(belief.P_position[:3, :3], e))
    assert np.mean(squares[100:]) < 6  # 3 are expected; a noise estimate that lags costs some.


@pytest.mark.parametrize(("noise", "low", "high"), [(0.0, 0, 1e-6), (0.3, 0.02, 0.2), (1, 0.5, 1)])
def test_the_noise_level_is_the_share_of_the_expected_noise(noise, low, high):
    track, _ = follow(in_time(300, np.random.default_rng(18), noise=noise))
    assert low <= track.noise_level <= high


DEFAULTS = tracker_settings(EstimatorConfig())
DEFAULTS = replace(DEFAULTS, step=default_kernels().filter_step())
X = np.array([1.0, 0.0, 0.0])


def worst_error(stream, truth, settings=DEFAULTS):
    found = list(tracks(stream, settings))
    errors = [after.newest.p_WCoM - true for after, true in zip(found, truth, strict=True)]
    return np.max(np.linalg.norm(errors[50:], axis=1))


def test_a_sudden_acceleration_is_followed_within_two_measurements():
    for seed, start in enumerate(np.linspace(3.0, 3.05, 10)):
        stream = in_time(100, np.random.default_rng(seed))
        accelerating = np.clip([now - start for now, _ in stream], 0.0, 0.2)
        since = np.maximum(0.0, [now - start for now, _ in stream])
        ways = (1.5 * accelerating * (since - accelerating / 2))[:, None] * X  # At 1.5 m/s^2.
        truth = [V * now + way for (now, _), way in zip(stream, ways, strict=True)]
        fast = [
            (now, replace(z, p_WCoM=z.p_WCoM + way))
            for (now, z), way in zip(stream, ways, strict=True)
        ]
        # It is away by 17 mm at the third measurement.
        assert worst_error(fast, truth) < 0.01


@pytest.mark.parametrize("away", [0.008, 0.03])
def test_a_single_outlier_is_no_sudden_acceleration(away):
    stream = in_time(60, np.random.default_rng(21))
    track, _ = follow(stream[:58], DEFAULTS)
    for now, z in stream[58:]:  # The second one is away the other way.
        z = replace(z, p_WCoM=z.p_WCoM + away * X)
        track, away = update_track(track, z, now, DEFAULTS), -away
        assert track.verdict == Verdict.OUTLIER


@pytest.mark.slow
def test_heavy_tails_are_no_sudden_accelerations():
    worst = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        stream = in_time(180, rng)
        for k in range(60, 180):  # Student's t of two degrees of freedom.
            now, z = stream[k]
            off = rng.normal(scale=NOISE.position, size=3) / np.sqrt(rng.chisquare(2) / 2)
            stream[k] = now, replace(z, p_WCoM=V * now + off)
        worst.append(worst_error(stream, [V * now for now, _ in stream]))
    assert np.median(worst) < 2e-3


@pytest.mark.parametrize(("left", "is_found"), [(1.0, True), (5.0, False)])
def test_a_part_changes_its_motion_only_by_evidence_of_its_own(left, is_found):
    _, track = tracked(0, 30)
    track.recent[-3:, MEASUREMENT_SIZE:] = 10.0  # With 5 left, each part has 15 of the 16 it needs.
    new = Innovation(*5 * [np.array([np.eye(3)] * 2)], squared=np.full(2, left))
    step = type("Step", (FilterStep,), {"__call__": lambda self, belief, *_: (belief, new, belief)})
    settings = replace(SETTINGS, step=step())
    assert (find_manoeuvre(track, new, False, settings) is not None) == is_found
