from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.arrays import FARTHEST, pack, unpack
from drake_pregrasp.estimation.pose_filter import (
    NO_MEASUREMENT,
    PoseFilterNoise,
    PoseMeasurement,
    first_belief,
    predict,
    update,
)
from drake_pregrasp.estimation.pose_track import (
    MeasurementVerdict,
    PoseTrack,
)
from drake_pregrasp.estimation.pose_tracker import OLDEST, TrackerSettings, update_track

NOISE = PoseFilterNoise(
    position=5e-4,
    orientation=3.5e-3,
    acceleration=1e-2,
    angular_acceleration=5e-2,
    initial_velocity=0.1,
    initial_angular_velocity=0.5,
)
SETTINGS = TrackerSettings(NOISE)
DT = 0.05
V, W = np.array([0.02, -0.01, 0.005]), np.array([0.1, 0.05, -0.2])


def truth(time):
    return V * time, Rotation.from_rotvec(W * time)


def measured(time, rng, noise=1.0, at=None):
    p, R = truth(time)
    p = p + noise * rng.normal(scale=NOISE.position, size=3)
    R = Rotation.from_rotvec(noise * rng.normal(scale=NOISE.orientation, size=3)) * R
    return PoseMeasurement(time if at is None else at, p, R.as_matrix())


def follow(measurements, settings=SETTINGS, memory=20):
    """Takes (now, measurement) pairs and returns the track and the verdicts."""
    track, verdicts = PoseTrack.empty(memory), []
    for now, measurement in measurements:
        track = update_track(track, measurement, now, settings)
        verdicts.append(track.verdict)
    return track, verdicts


def in_time(count, rng, start=0):
    return [(k * DT, measured(k * DT, rng)) for k in range(start, start + count)]


def error(track, now):
    belief = predict(track.newest, now - track.newest.time, NOISE)
    return np.linalg.norm(belief.p_WCoM - truth(now)[0])


def test_good_measurements_in_time_are_what_the_filter_gets():
    stream = in_time(30, np.random.default_rng(0))
    track, verdicts = follow(stream)
    belief = first_belief(stream[0][1], NOISE)
    for time, z in stream[1:]:
        belief = update(predict(belief, time - belief.time, NOISE), z, NOISE)
    np.testing.assert_array_equal(pack(track.newest), pack(belief))
    assert verdicts == [MeasurementVerdict.STARTED] + [MeasurementVerdict.USED] * 29


@given(st.permutations(range(8)))
def test_measurements_in_any_order_give_the_same_belief(order):
    rng = np.random.default_rng(1)
    head, tail = in_time(20, rng), in_time(8, rng, start=20)
    now = 28 * DT
    in_order, _ = follow(head + [(now, z) for _, z in tail])
    shuffled, verdicts = follow(head + [(now, tail[k][1]) for k in order])
    np.testing.assert_allclose(pack(shuffled.newest), pack(in_order.newest), rtol=1e-9, atol=1e-12)
    newest = np.maximum.accumulate(order)
    late = [
        MeasurementVerdict.USED_LATE if k < m else MeasurementVerdict.USED
        for k, m in zip(order, newest, strict=True)
    ]
    assert verdicts[20:] == late


def test_a_late_measurement_is_worth_as_much_as_one_in_time():
    rng = np.random.default_rng(2)
    stream = in_time(40, rng)
    delayed, _ = follow([(now + 0.15, z) for now, z in stream])
    prompt, _ = follow(stream)
    np.testing.assert_array_equal(pack(delayed.newest), pack(prompt.newest))


def test_what_is_older_than_the_memory_is_refused_and_said_so():
    rng = np.random.default_rng(3)
    old = measured(0.5 * DT, rng)
    for memory, verdict in ((30, MeasurementVerdict.USED_LATE), (5, MeasurementVerdict.TOO_LATE)):
        track, _ = follow(in_time(20, rng), memory=memory)
        later = update_track(track, old, 20 * DT, SETTINGS)
        assert later.verdict == verdict
        assert np.array_equal(later.steps, track.steps) == verdict.is_refusal


def test_how_far_an_outlier_was_off_is_said_of_late_ones_too():
    rng = np.random.default_rng(3)
    track, _ = follow(in_time(20, rng))
    far = measured(0.5 * DT, rng)
    far = replace(far, p_WCoM=far.p_WCoM + 1.0)
    after = update_track(track, far, 20 * DT, SETTINGS)
    assert after.verdict == MeasurementVerdict.OUTLIER
    np.testing.assert_array_equal(after.steps, track.steps)
    assert after.innovation_squared[0] > SETTINGS.gate**2 > after.innovation_squared[1]


def test_a_measurement_counts_once():
    rng = np.random.default_rng(4)
    track, _ = follow(in_time(10, rng))
    again = update_track(track, measured(9 * DT, rng), 10 * DT, SETTINGS)
    assert again.verdict == MeasurementVerdict.NOTHING_NEW
    np.testing.assert_array_equal(again.steps, track.steps)
    assert update_track(track, NO_MEASUREMENT, 1.0, SETTINGS).verdict == again.verdict


@pytest.mark.parametrize(
    "change",
    [
        {"p_WCoM": np.array([np.nan, 0, 0])},
        {"p_WCoM": np.array([np.inf, 0, 0])},
        {"p_WCoM": np.array([2 * FARTHEST, 0, 0])},
        {"R_WO": np.full((3, 3), np.nan)},
        {"R_WO": 1.1 * np.eye(3)},
        {"R_WO": -np.eye(3)},
        {"time": np.nan},
        {"time": np.inf},
        {"time": 99.0},
        {"time": -1e300},
    ],
)
def test_what_is_no_pose_changes_nothing(change):
    rng = np.random.default_rng(5)
    track, _ = follow(in_time(10, rng))
    bad = replace(measured(10 * DT, rng), **change)
    after = update_track(track, bad, 10 * DT, SETTINGS)
    assert after.verdict == MeasurementVerdict.UNUSABLE
    np.testing.assert_array_equal(after.steps, track.steps)
    nothing = update_track(PoseTrack.empty(5), bad, 10 * DT, SETTINGS)
    assert nothing.newest.time == -np.inf


@pytest.mark.parametrize("seed", range(5))
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
    refused = [k for k, verdict in enumerate(verdicts) if verdict.is_refusal]
    assert refused == [20, 30, 31, 45]
    assert error(track, 59 * DT) < 4 * NOISE.position
    naive, _ = follow(stream[:46], replace(SETTINGS, gate=0))
    assert error(naive, 45 * DT) > 4 * NOISE.position


def test_a_jump_is_followed_after_as_many_measurements_as_are_asked_for():
    rng = np.random.default_rng(6)
    away = np.array([0.3, 0.2, 0.0])
    for count in (1, 3, 6):
        stream = in_time(30, rng) + [
            (now, replace(z, p_WCoM=z.p_WCoM + away)) for now, z in in_time(20, rng, start=30)
        ]
        track, verdicts = follow(stream, replace(SETTINGS, reacquire_after=count))
        assert verdicts.index(MeasurementVerdict.REACQUIRED) == 30 + count - 1
        assert all(v == MeasurementVerdict.OUTLIER for v in verdicts[30 : 30 + count - 1])
        assert error(track, 49 * DT) == pytest.approx(np.linalg.norm(away), abs=1e-3)


def test_outliers_that_disagree_are_no_jump():
    rng = np.random.default_rng(7)
    wild = [
        (now, replace(z, p_WCoM=rng.uniform(-5, 5, 3))) for now, z in in_time(15, rng, start=30)
    ]
    wild = wild[:14]
    track, verdicts = follow(in_time(30, rng) + wild)
    assert set(verdicts[30:]) == {MeasurementVerdict.OUTLIER}
    assert error(track, 44 * DT) < 10e-3


def test_where_nothing_but_outliers_comes_the_belief_is_given_up():
    rng = np.random.default_rng(7)
    wild = [
        (now, replace(z, p_WCoM=rng.uniform(-5, 5, 3))) for now, z in in_time(15, rng, start=30)
    ]
    track, verdicts = follow(in_time(30, rng) + wild)
    assert verdicts[-2:] == [MeasurementVerdict.OUTLIER, MeasurementVerdict.STARTED]
    np.testing.assert_array_equal(track.newest.p_WCoM, wild[-1][1].p_WCoM)


def test_after_it_was_given_up_as_many_outliers_are_borne_again():
    rng = np.random.default_rng(7)
    wild = [
        (now, replace(z, p_WCoM=rng.uniform(-5, 5, 3))) for now, z in in_time(45, rng, start=30)
    ]
    _, verdicts = follow(in_time(30, rng) + wild)
    assert verdicts[30:] == 3 * ([MeasurementVerdict.OUTLIER] * 14 + [MeasurementVerdict.STARTED])


@pytest.mark.parametrize("same_place", [True, False])
def test_outliers_with_good_measurements_between_never_refute_the_belief(same_place):
    rng = np.random.default_rng(16)
    stream = in_time(110, rng)
    for k in range(31, 110, 2):
        now, z = stream[k]
        away = np.full(3, 0.5) if same_place else rng.uniform(1, 5, 3)
        stream[k] = now, replace(z, p_WCoM=z.p_WCoM + away)
    track, verdicts = follow(stream)
    assert set(verdicts[31::2]) == {MeasurementVerdict.OUTLIER}
    assert set(verdicts[30::2]) == {MeasurementVerdict.USED}
    assert error(track, 109 * DT) < 4 * NOISE.position
    assert track.refused == track.support == 1
    after = update_track(track, measured(110 * DT, rng), 110 * DT, SETTINGS)
    assert after.refused == after.support == 0
    assert after.alternative[0] == -np.inf


def test_a_belief_that_knows_the_orientation_no_more_starts_anew_and_no_other_one():
    rng = np.random.default_rng(17)
    track, _ = follow(in_time(60, rng))
    known, unknown = [], []
    for silence in np.linspace(1.0, 40.0, 40):
        time = 59 * DT + silence
        P = predict(track.newest, silence, NOISE).P_orientation
        std = np.sqrt(np.max(P.diagonal()[:3]))
        verdict = update_track(track, measured(time, rng), time, SETTINGS).verdict
        if std < 0.3:
            known.append(verdict)
        elif np.pi / 2 < std < 4 * np.pi:  # A quarter turn and more: it may face any way.
            unknown.append(verdict)
    assert set(known) == {MeasurementVerdict.USED}
    assert set(unknown) == {MeasurementVerdict.STARTED}


def test_after_a_jump_velocities_are_those_from_before():
    changes = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        stream = in_time(60, rng)
        moved = [(now, replace(z, p_WCoM=z.p_WCoM + 0.3)) for now, z in in_time(3, rng, start=60)]
        before, _ = follow(stream)
        track, verdicts = follow(stream + moved)
        assert verdicts[-1] == MeasurementVerdict.REACQUIRED
        changes.append(track.newest.v_WCoM - before.newest.v_WCoM)
    # Three places alone tell a velocity to sqrt(2) standard deviations over the time between them.
    assert np.std(changes) < 0.7 * NOISE.position / (np.sqrt(2) * DT)
    # But an object that is kicked has others, and these are found, too.
    kick = np.array([0.5, 0, 0])
    kicked = [
        (now, replace(z, p_WCoM=z.p_WCoM + kick * (now - 59 * DT)))
        for now, z in in_time(8, rng, start=60)
    ]
    wide = replace(SETTINGS, noise=replace(NOISE, initial_velocity=1.0))
    track, verdicts = follow(stream + kicked, wide)
    assert MeasurementVerdict.REACQUIRED in verdicts[60:65]
    np.testing.assert_allclose(track.newest.v_WCoM, V + kick, atol=2e-2)


def test_an_outlier_after_a_long_silence_is_not_believed():
    rng = np.random.default_rng(14)
    track, _ = follow(in_time(60, rng))
    late = measured(59 * DT + 2.0, rng)
    wrong = replace(late, p_WCoM=late.p_WCoM + 0.5)
    assert update_track(track, wrong, late.time, SETTINGS).verdict == MeasurementVerdict.OUTLIER
    assert update_track(track, late, late.time, SETTINGS).verdict == MeasurementVerdict.USED


def test_after_a_long_silence_the_next_measurement_is_believed():
    rng = np.random.default_rng(8)
    track, _ = follow(in_time(30, rng))
    late = measured(100.0, rng)
    late = replace(late, p_WCoM=late.p_WCoM + 5.0)
    assert update_track(track, late, 100.0, SETTINGS).verdict == MeasurementVerdict.STARTED
    for silence in (0.9 * OLDEST, 10 * OLDEST, 1e300):
        later = update_track(track, replace(late, time=silence), silence, SETTINGS)
        assert later.verdict == MeasurementVerdict.STARTED


def test_a_frozen_value_is_refused_but_only_of_a_noisy_sensor_and_a_moving_object():
    rng = np.random.default_rng(9)
    track, _ = follow(in_time(40, rng))
    frozen = replace(measured(39 * DT, rng), p_WCoM=track.last_seen[1:4], time=40 * DT)
    frozen = replace(frozen, R_WO=track.last_seen[4:].reshape(3, 3))
    assert update_track(track, frozen, 40 * DT, SETTINGS).verdict == MeasurementVerdict.REPEATED
    trusting = replace(SETTINGS, refuse_repeats=False)
    assert update_track(track, frozen, 40 * DT, trusting).verdict == MeasurementVerdict.USED
    # A pose from a simulator, without noise, may well stop where it is.
    exact = [(k * DT, measured(min(k, 40) * DT, rng, noise=0, at=k * DT)) for k in range(60)]
    track, verdicts = follow(exact)
    assert MeasurementVerdict.REPEATED not in verdicts
    assert np.linalg.norm(track.newest.p_WCoM - truth(40 * DT)[0]) < 1e-3
    # And a coarse sensor may see an object at rest in the same place again.
    still = [
        (k * DT, PoseMeasurement(k * DT, rng.normal(scale=5e-4, size=3), np.eye(3)))
        for k in range(40)
    ]
    track, _ = follow(still)
    again = replace(still[-1][1], time=40 * DT)
    assert update_track(track, again, 40 * DT, SETTINGS).verdict == MeasurementVerdict.USED


def test_the_innovation_is_chi_square_distributed():
    rng = np.random.default_rng(10)
    squares = []
    track = PoseTrack.empty(3)
    for now, z in in_time(4000, rng):
        track = update_track(track, z, now, SETTINGS)
        squares.append(track.innovation_squared)
    # The truth has no acceleration, so that the filter expects a little more than there is.
    assert np.all(np.mean(squares[100:], axis=0) < 3)
    assert np.all(np.mean(squares[100:], axis=0) > 2)


def test_vector_form_loses_nothing():
    rng = np.random.default_rng(11)
    track, _ = follow(
        [*in_time(7, rng), (7 * DT, replace(measured(7 * DT, rng), p_WCoM=np.ones(3)))]
    )
    again = unpack(PoseTrack.empty(20), pack(track))
    np.testing.assert_array_equal(pack(again), pack(track))
    assert again.verdict is track.verdict


@pytest.mark.parametrize("change", [{"gate": -1.0}, {"reacquire_after": 0}])
def test_bad_settings_are_refused(change):
    with pytest.raises(InvalidArgumentError, match=next(iter(change))):
        TrackerSettings(NOISE, **change)


@pytest.mark.parametrize("factor", [1.0, 4.0])
def test_a_sensor_noisier_than_assumed_is_believed_less(factor):
    rng = np.random.default_rng(12)
    stream = in_time(40, rng) + [
        (k * DT, measured(k * DT, rng, noise=factor)) for k in range(40, 160)
    ]
    track, verdicts = follow(stream)
    assert (track.excess > 2) == (factor > 2)
    assert MeasurementVerdict.REACQUIRED not in verdicts
    errors = []
    for count in range(80, 160):
        now, _ = stream[count - 1]
        errors.append(error(follow(stream[:count])[0], now) if count % 10 == 0 else 0.0)
    assert max(errors) < 2 * factor * NOISE.position


def test_a_manoeuvre_is_no_noise():
    """An exact sensor on an object that swings and stops is believed when it repeats itself."""
    stream = []
    for k in range(200):
        time = min(k * DT, 5.0)
        p = np.array([0.03 * np.sin(2 * time), 0, 0])
        stream.append((k * DT, PoseMeasurement(k * DT, p, np.eye(3))))
    track, verdicts = follow(stream)
    assert MeasurementVerdict.REPEATED not in verdicts
    assert np.linalg.norm(track.newest.p_WCoM - stream[-1][1].p_WCoM) < 1e-3


def test_a_noisy_sensor_is_believed_less_when_it_is_late_too():
    rng = np.random.default_rng(15)
    in_order = [(k * DT, measured(k * DT, rng, noise=3.0)) for k in range(400)]
    swapped = []
    for first, second in zip(in_order[::2], in_order[1::2], strict=True):
        swapped += [(second[0], second[1]), (second[0], first[1])]
    errors = []
    for stream in (in_order, swapped):
        track, squares = PoseTrack.empty(20), []
        for now, z in stream:
            track = update_track(track, z, now, SETTINGS)
            e = truth(track.newest.time)[0] - track.newest.p_WCoM
            squares.append(e @ np.linalg.solve(track.newest.P_position[:3, :3], e))
        errors.append(np.mean(squares[100:]))
    assert max(errors) < 6  # 3 are expected, and what one noise is told as another costs some.
