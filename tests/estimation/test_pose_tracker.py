"""Verdicts of the tracker: measurements that are used, rejected, or restart the track."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import slow
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp import MeasurementVerdict as Verdict
from drake_pregrasp.arrays import FARTHEST, pack
from drake_pregrasp.config.planner_config import EstimatorConfig, tracker_settings
from drake_pregrasp.estimation.pose_belief import NO_MEASUREMENT, PoseMeasurement, first_belief
from drake_pregrasp.estimation.pose_filter import filter_step, merged, predict
from drake_pregrasp.estimation.pose_track import CONFIRMATIONS, PoseTrack, TrackingStatus
from drake_pregrasp.estimation.pose_tracker import OLDEST, update_track
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.geometry.rotations import MOST_EQUIVALENT, rotation_group

SETTINGS = replace(tracker_settings(EstimatorConfig()), step=default_kernels().filter_step)
NOISE = SETTINGS.noise
MODELS = len(NOISE.densities)
DT = 0.05
V, W = np.array([0.02, -0.01, 0.005]), np.array([0.1, 0.05, -0.2])


def measured(time, rng, noise=1.0, at=None):
    p = V * time + noise * rng.normal(scale=NOISE.position, size=3)
    R = Rotation.from_rotvec(noise * rng.normal(scale=NOISE.orientation, size=3))
    R_WO = (R * Rotation.from_rotvec(W * time)).as_matrix()
    return PoseMeasurement(time if at is None else at, p, R_WO)


def tracks(stream, settings=SETTINGS, memory=20, track=None):
    """Yields the track after each pair of a time and the measurement that arrives then."""
    track = track or PoseTrack.empty(memory, len(settings.noise.densities))
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
    return [(now, replace(z, p_WO=z.p_WO + d)) for (now, z), d in zip(stream, offsets, strict=True)]


def verdict(track, measurement, now, settings=SETTINGS):
    return update_track(track, measurement, now, settings).verdict


def status(track, now):
    return track.status(now, DT, coast_after=0.1, lost_after=1.0)


def error(track, now):
    belief = predict(merged(track.newest), now - track.newest.time, NOISE.liveliest)
    return np.linalg.norm(belief.p_WCoM[0] - V * now)


def test_with_one_model_the_newest_belief_is_that_of_the_plain_filter():
    single = replace(SETTINGS, noise=replace(NOISE, manoeuvre_rate=0.0))
    stream = in_time(30, np.random.default_rng(0))
    track, verdicts = follow(stream, single)
    belief = first_belief(stream[0][1], single.noise)
    for _, z in stream[1:]:
        belief = filter_step(belief, z, single.noise)[1].belief
    assert len(belief.weights) == 1
    np.testing.assert_allclose(pack(track.newest), pack(belief), rtol=1e-9, atol=1e-12)
    assert verdicts == [Verdict.STARTED] + [Verdict.USED] * 29


@pytest.mark.slow
@given(st.permutations(range(8)), st.sampled_from([0, 20]))
def test_measurements_in_any_order_give_the_same_belief(order, before):
    """Also if the first one of all arrives late."""
    rng = np.random.default_rng(1)
    head, tail = in_time(before, rng), in_time(8, rng, start=before)
    now = (before + 8) * DT + 0.15  # No measurement is worth less for being late.
    in_order, _ = follow(head + [(now, z) for _, z in tail])
    shuffled, verdicts = follow(head + [(now, tail[k][1]) for k in order])
    np.testing.assert_allclose(pack(shuffled.newest), pack(in_order.newest), rtol=1e-6, atol=1e-10)
    newest = np.maximum.accumulate(order)
    expected = [
        Verdict.USED_LATE if k < m else Verdict.USED for k, m in zip(order, newest, strict=True)
    ]
    assert verdicts[max(before, 1) :] == expected[before == 0 :]
    assert status(shuffled, now - 0.15) == TrackingStatus.TRACKING


def test_a_late_measurement_that_is_too_far_is_refused():
    rng, track = tracked(3, 20)
    late = measured(0.5 * DT, rng)
    after = update_track(track, replace(late, p_WO=late.p_WO + 1.0), 20 * DT, SETTINGS)
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
        {"p_WO": np.array([2 * FARTHEST, 0, 0])},
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
    for track in (PoseTrack.empty(5, MODELS), follow(in_time(10, rng))[0]):
        after = update_track(track, bad, 10 * DT, SETTINGS)
        assert after.verdict == Verdict.UNUSABLE
        np.testing.assert_array_equal(after.steps, track.steps)


@pytest.mark.parametrize("seed", range(3))
def test_single_outliers_of_position_or_orientation_leave_the_belief_alone(seed):
    """While the newest measurement is an outlier, the object is not tracked."""
    rng = np.random.default_rng(seed)
    stream = in_time(60, rng)
    wrong = (20, 30, 31, 45)
    for k in wrong:
        now, z = stream[k]
        if k % 2:
            z = replace(z, p_WO=z.p_WO + rng.normal(scale=0.1, size=3) + 0.3)
        else:
            z = replace(z, R_WO=Rotation.from_rotvec([0.5, 0, 0]).as_matrix() @ z.R_WO)
        stream[k] = now, z
    found = list(tracks(stream))
    assert tuple(k for k, track in enumerate(found) if track.verdict >= Verdict.UNUSABLE) == wrong
    for k, track in enumerate(found):
        is_tracked = k > CONFIRMATIONS and k not in wrong
        assert (status(track, k * DT) == TrackingStatus.TRACKING) == is_tracked
        assert k < 10 or error(track, k * DT) < 4 * NOISE.position
    naive, _ = follow(stream[:46], replace(SETTINGS, gate=0))
    assert error(naive, 45 * DT) > 4 * NOISE.position


def test_a_jump_is_followed_after_three_measurements_and_confirmed_by_a_fourth():
    rng = np.random.default_rng(6)
    away = np.array([0.3, 0.2, 0.0])
    found = list(tracks(in_time(30, rng) + shifted(in_time(20, rng, start=30), away)))
    verdicts = [track.verdict for track in found[30:33]]
    assert verdicts == [Verdict.OUTLIER, Verdict.OUTLIER, Verdict.REACQUIRED]
    statuses = [status(track, k * DT) for k, track in enumerate(found)][29:35]
    tracking, coasting = TrackingStatus.TRACKING, TrackingStatus.COASTING
    assert statuses == [tracking, coasting, coasting, coasting, tracking, tracking]
    assert error(found[-1], 49 * DT) == pytest.approx(np.linalg.norm(away), abs=1e-3)


def test_outliers_that_disagree_are_no_jump_and_the_object_is_lost_in_time():
    rng = np.random.default_rng(7)
    wild = shifted(in_time(45, rng, start=30), lambda: rng.uniform(-5, 5, 3))
    before, _ = follow(in_time(30, rng))
    for track, (now, _) in zip(tracks(wild, track=before), wild, strict=True):
        overdue = now - 29 * DT - DT
        expected = TrackingStatus.COASTING if overdue < 1 + 1e-6 else TrackingStatus.LOST
        assert status(track, now) == expected


@pytest.mark.parametrize("same_place", [True, False])
def test_outliers_with_good_measurements_between_never_refute_the_belief(same_place):
    rng = np.random.default_rng(16)
    stream = in_time(70, rng)
    away = np.full(3, 0.5) if same_place else lambda: rng.uniform(1, 5, 3)
    stream[31::2] = shifted(stream[31::2], away)
    track, verdicts = follow(stream)
    assert set(verdicts[31::2]) == {Verdict.OUTLIER}
    assert set(verdicts[30::2]) == {Verdict.USED}
    assert error(track, 69 * DT) < 4 * NOISE.position


@pytest.mark.parametrize("distance", [0.005, 0.02, 0.04])
def test_the_measurement_after_a_small_outlier_tells_it_from_a_manoeuvre(distance):
    rng, before = tracked(21, 60)
    stream, away = in_time(2, rng, start=60), distance * np.eye(3)[1]
    found = list(tracks(shifted(stream[:1], away) + stream[1:], track=before))
    assert [track.verdict for track in found] == [Verdict.OUTLIER, Verdict.USED]
    assert error(found[-1], 61 * DT) < 4 * NOISE.position
    turned = shifted(stream[:1], away) + shifted(stream[1:], 2.5 * away)
    found = list(tracks(turned, track=before))
    assert [track.verdict for track in found] == [Verdict.OUTLIER, Verdict.USED]
    assert (found[-1].steps[-3:, 0] == DT * np.array([59, 60, 61])).all()
    off = merged(found[-1].newest).p_WCoM[0] - V * 61 * DT - 2.5 * away
    assert np.linalg.norm(off) < 5 * NOISE.position
    statuses = [status(track, (60 + k) * DT) for k, track in enumerate(found)]
    assert statuses == [TrackingStatus.COASTING, TrackingStatus.TRACKING]


def test_an_outlier_that_a_silence_explains_is_not_believed_at_once():
    """After a silence, only a measurement where a quiet object would be confirms the prediction."""
    rng, track = tracked(14, 60)
    time = 59 * DT + 0.4
    late = measured(time, rng)
    assert status(update_track(track, late, time, SETTINGS), time) == TrackingStatus.TRACKING
    after = update_track(track, replace(late, p_WO=late.p_WO + 0.05), time, SETTINGS)
    assert (after.verdict, status(after, time)) == (Verdict.OUTLIER, TrackingStatus.COASTING)
    for now in time + DT * np.arange(1, 5):
        after = update_track(after, measured(now, rng), now, SETTINGS)
    assert status(after, now) == TrackingStatus.TRACKING


@pytest.mark.parametrize("silence", [3.0, 40.0, 90.0, 110.0, 0.9 * OLDEST])
def test_after_a_silence_the_object_is_lost_until_measurements_confirm_where_it_is(silence):
    rng, track = tracked(17, 60)
    begin = 59 * DT + silence
    away = Rotation.from_rotvec([0.0, 2.0, 0.0]).as_matrix()
    for k in range(4):
        now, z = begin + k * DT, measured(k * DT, rng)
        z = replace(z, time=now, p_WO=z.p_WO + 0.5, R_WO=away @ z.R_WO)
        track = update_track(track, z, now, SETTINGS)
        assert np.all(np.linalg.eigvalsh(merged(track.newest).P[0]) > 0)
        assert k == 2 or status(track, now) == (
            TrackingStatus.TRACKING if k == 3 else TrackingStatus.LOST
        )


def test_a_kicked_object_is_found_with_its_new_velocity():
    rng = np.random.default_rng(19)
    kick = np.array([5.0, 0, 0])
    kicked = [
        (now, replace(z, p_WO=z.p_WO + kick * (now - 59 * DT)))
        for now, z in in_time(8, rng, start=60)
    ]
    track, verdicts = follow(in_time(60, rng) + kicked)
    assert Verdict.REACQUIRED in verdicts[60:65]
    np.testing.assert_allclose(merged(track.newest).V_WCoM[0, 3:], V + kick, atol=2e-2)


def test_a_frozen_value_is_refused_but_only_of_a_noisy_sensor_and_a_moving_object():
    rng = np.random.default_rng(9)
    stream = in_time(40, rng)
    track, _ = follow(stream)
    frozen = replace(stream[-1][1], time=40 * DT)
    assert verdict(track, frozen, 40 * DT) == Verdict.REPEATED
    # A pose from a simulator, without noise, may well stop where it is, or swing and stop.
    exact = [measured(min(k, 40) * DT, rng, noise=0, at=k * DT) for k in range(60)]
    swings = [0.03 * np.sin(2 * min(k * DT, 5.0)) * np.eye(3)[0] for k in range(200)]
    for poses in (exact, [PoseMeasurement(k * DT, p, np.eye(3)) for k, p in enumerate(swings)]):
        track, verdicts = follow([(z.time, z) for z in poses])
        assert Verdict.REPEATED not in verdicts
        assert np.linalg.norm(merged(track.newest).p_WCoM[0] - poses[-1].p_WO) < 1e-3
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
    assert np.all((means > 2.5) & (means < 3.1))


@pytest.mark.parametrize("factor", [1.0, slow(1.6), 4.0])
def test_a_sensor_noisier_than_assumed_is_believed_less(factor):
    rng, track = tracked(12, 40)
    stream = in_time(120, rng, start=40, noise=factor)
    found = list(tracks(stream, track=track))
    errors = [error(after, now) for after, (now, _) in zip(found, stream, strict=True)]
    assert Verdict.REACQUIRED not in [after.verdict for after in found]
    assert max(errors[40:]) < 5 * factor * NOISE.position


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.3, 1.0, 3.0])
@pytest.mark.parametrize("order", ["in time", "uneven", "out of sequence"])
def test_the_noise_is_estimated_while_the_object_accelerates(noise, order):
    """Also with outliers, and with a factor of 1 unless the noise is clearly larger."""
    rng = np.random.default_rng(18)
    ratios, late = [], order == "out of sequence"
    track = PoseTrack.empty(20, MODELS)
    for k in range(300):
        tick = k ^ 1 if late else k
        time = DT * (tick + 0.4 * (order == "uneven") * (k % 3))
        z = measured(time, rng, noise)
        p_WO = z.p_WO + 5 * time**2 * np.eye(3)[0] + 0.5 * (k % 20 == 19)
        track = update_track(track, replace(z, p_WO=p_WO), time + late * DT, SETTINGS)
        ratios.append(track.noise.ratios)
    assert np.all(np.median(ratios[50:], axis=0) < 1.4 * noise**2 + 1e-6)
    assert np.all(np.median(ratios[50:], axis=0) > 0.7 * noise**2 - 1e-6)
    assert np.all((np.array(track.noise.factors) == 1) == (noise < 2))


HALF_TURN = np.array([[0.0, 0.0, np.pi]])


def test_equivalent_poses_of_a_symmetric_object_are_the_same_measurement():
    rng = np.random.default_rng(22)
    stream = in_time(60, rng)
    about_z = Rotation.from_rotvec(HALF_TURN[0]).as_matrix()
    flipped = [
        (now, replace(z, R_WO=z.R_WO @ about_z) if k and rng.random() < 0.5 else z)
        for k, (now, z) in enumerate(stream)
    ]
    symmetric = replace(SETTINGS, symmetry=rotation_group(HALF_TURN))
    expected, verdicts = follow(stream)
    assert Verdict.OUTLIER not in verdicts
    found, _ = follow(flipped, symmetric)
    np.testing.assert_allclose(pack(found.newest), pack(expected.newest), rtol=1e-7, atol=1e-9)
    assert Verdict.OUTLIER in follow(flipped)[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("thetas", "count"),
    [
        ([], 1),
        (HALF_TURN, 2),
        ([[0, 0, np.pi], [np.pi, 0, 0]], 4),
        ([[0, 0, np.pi / 2], [np.pi / 2, 0, 0]], 24),
        ([[0, 0, np.radians(3)]], 120),
    ],
)
def test_symmetries_are_closed_under_composition(thetas, count):
    group = rotation_group(np.reshape(thetas, (-1, 3)))
    assert len(group) == count
    products = np.einsum("aij,bjk->abik", group, group).reshape(-1, 9)
    distances = np.abs(products[:, None] - group.reshape(-1, 9)).max(axis=2).min(axis=1)
    assert distances.max() < 1e-9


def test_a_symmetry_that_never_closes_is_refused():
    with pytest.raises(InvalidArgumentError, match=f"symmetry: .* {MOST_EQUIVALENT} equivalent"):
        tracker_settings(EstimatorConfig(symmetry=[[0, 0, 1.0]]))
