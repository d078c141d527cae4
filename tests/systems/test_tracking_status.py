"""The estimator when measurements fail: what it says, and that it goes on."""

import numpy as np
import pytest
from made_systems import PERIOD, make_estimator
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from scipy.spatial.transform import Rotation

from drake_pregrasp import MeasurementVerdict, TrackingStatus
from drake_pregrasp.arrays import FARTHEST
from drake_pregrasp.estimation.pose_track import tracking_status

COAST, LOST = 0.1, 0.5
NAN = RigidTransform([np.nan, 0, 0])


def X_true(time):
    return RigidTransform(RollPitchYaw(0, 0, 0.2 * time), [0.05 * time, 0, 0.1])


class Tracked:
    """An estimator on its own, with a clock and a hand that feeds it."""

    def __init__(self, **arguments):
        settings = {"coast_after": COAST, "lost_after": LOST} | arguments
        self.estimator = make_estimator(**settings)
        self.context = self.estimator.CreateDefaultContext()

    def set_time(self, time):
        self.context.SetTime(time)

    def tick(self, k, X, stamp=None):
        self.set_time(k * PERIOD)
        self.estimator.GetInputPort("X_WO_measured").FixValue(self.context, X)
        if stamp is not None:
            self.estimator.GetInputPort("measurement_time").FixValue(self.context, [stamp])
        before = self.numbers()
        update = self.estimator.EvalUniquePeriodicDiscreteUpdate(self.context)
        self.context.SetDiscreteState(update)
        np.testing.assert_allclose(self.numbers(), before, atol=1e-15)
        assert np.all(np.isfinite(before))

    def follow(self, ticks, start=0):
        for k in range(start, start + ticks):
            self.tick(k, X_true(k * PERIOD))

    def out(self, port):
        return self.estimator.GetOutputPort(port).Eval(self.context)

    def numbers(self):
        V_WO = self.out("V_WO_estimated")
        return np.concatenate(
            [
                self.out("X_WO_estimated").GetAsMatrix34().ravel(),
                V_WO.rotational(),
                V_WO.translational(),
                self.out("p_WO_covariance"),
                self.out("tracking_status"),
                self.out("time_since_measurement"),
                self.out("measurement_verdict"),
                self.out("innovation_squared"),
            ]
        )

    @property
    def status(self):
        return TrackingStatus(int(self.out("tracking_status")[0]))

    @property
    def verdict(self):
        return MeasurementVerdict(int(self.out("measurement_verdict")[0]))


def test_status_goes_from_tracking_to_coasting_to_lost_and_back():
    tracked = Tracked()
    tracked.follow(20)
    last = 19 * PERIOD
    for k in range(20, 40):
        tracked.tick(k, NAN)
        overdue = k * PERIOD - last - PERIOD
        expected = TrackingStatus.TRACKING
        if overdue > COAST + 1e-6:
            expected = TrackingStatus.COASTING
        if overdue > LOST + 1e-6:
            expected = TrackingStatus.LOST
        assert tracked.status == expected
        assert tracked.out("time_since_measurement")[0] == pytest.approx(k * PERIOD - last)
        assert tracked.verdict == MeasurementVerdict.UNUSABLE
    tracked.follow(1, start=40)
    assert tracked.status == TrackingStatus.TRACKING
    assert tracked.out("time_since_measurement")[0] == 0


def test_coasting_follows_the_twist_and_a_lost_object_stands_still():
    tracked = Tracked()
    tracked.follow(60)
    V_WO = tracked.out("V_WO_estimated")
    w, v = V_WO.rotational().copy(), V_WO.translational().copy()
    start = RigidTransform(tracked.out("X_WO_estimated"))
    for k in range(60, 90):
        tracked.tick(k, NAN)
        # From the moment of the loss on, nothing moves.
        since = min((k - 59) * PERIOD, PERIOD + LOST)
        turn = RotationMatrix(Rotation.from_rotvec(w * since).as_matrix())
        expected = RigidTransform(turn @ start.rotation(), start.translation() + v * since)
        assert tracked.out("X_WO_estimated").IsNearlyEqualTo(expected, 1e-12)
        moving = np.linalg.norm(tracked.out("V_WO_estimated").translational()) > 0
        assert moving == tracked.status.is_followed
    assert tracked.status == TrackingStatus.LOST


def test_ignorance_grows_for_as_long_as_nothing_is_seen():
    tracked = Tracked()
    tracked.follow(20)
    sizes = []
    for k in range(20, 80):
        tracked.tick(k, NAN)
        sizes.append(np.linalg.det(tracked.out("p_WO_covariance").reshape(3, 3)))
    assert np.all(np.diff(sizes) > 0)


@pytest.mark.parametrize("lost_after", [LOST, 1e6])
def test_however_late_it_is_outputs_are_finite_and_ignorance_does_not_shrink(lost_after):
    tracked = Tracked(lost_after=lost_after)
    tracked.follow(20)
    tracked.tick(20, NAN)
    sizes = []
    for time in np.logspace(0.1, 300 if lost_after == LOST else 5, 60):
        tracked.set_time(time)
        assert np.all(np.isfinite(tracked.numbers()))
        sizes.append(np.trace(tracked.out("p_WO_covariance").reshape(3, 3)))
    assert np.all(np.diff(sizes) >= 0)
    expected = TrackingStatus.LOST if lost_after == LOST else TrackingStatus.COASTING
    assert tracked.status == expected


def test_before_any_measurement_it_waits_and_is_finite():
    tracked = Tracked()
    for k in range(5):
        tracked.tick(k, NAN)
        assert tracked.status == TrackingStatus.WAITING
        assert tracked.out("time_since_measurement")[0] == pytest.approx(k * PERIOD)
    assert tracked.out("X_WO_estimated").IsExactlyIdentity()
    tracked.follow(1, start=5)
    assert tracked.verdict == MeasurementVerdict.STARTED
    assert tracked.out("X_WO_estimated").IsNearlyEqualTo(X_true(5 * PERIOD), 1e-12)


def test_delayed_measurements_are_for_their_own_time():
    delayed, prompt = Tracked(), Tracked()
    for k in range(60):
        stamp = (k - 2) * PERIOD
        delayed.tick(k, X_true(stamp), stamp if k >= 2 else -np.inf)
        prompt.tick(k, X_true(k * PERIOD))
    now = X_true(59 * PERIOD)
    assert delayed.out("X_WO_estimated").IsNearlyEqualTo(now, 2e-4)
    # That is the prediction from what a prompt sensor had made known two ticks earlier.
    assert delayed.out("time_since_measurement")[0] == pytest.approx(2 * PERIOD)
    assert delayed.status == TrackingStatus.TRACKING
    unaware = Tracked()
    for k in range(60):
        unaware.tick(k, X_true((k - 2) * PERIOD))
    lag = unaware.out("X_WO_estimated").translation() - now.translation()
    assert np.linalg.norm(lag) > 4e-3


def test_a_time_that_was_there_before_is_nothing_new():
    tracked = Tracked()
    tracked.tick(0, X_true(0), 0.0)
    tracked.tick(1, X_true(3.0), 0.0)
    assert tracked.verdict == MeasurementVerdict.NOTHING_NEW
    assert tracked.out("X_WO_estimated").IsNearlyEqualTo(X_true(0), 1e-12)


@pytest.mark.parametrize(
    "X",
    [
        NAN,
        RigidTransform([np.inf, 0, 0]),
        RigidTransform([0, 1e300, 0]),
        RigidTransform([0, 2 * FARTHEST, 0]),
    ],
)
def test_what_is_no_pose_is_refused_at_first_and_later(X):
    tracked = Tracked()
    tracked.tick(0, X)
    assert tracked.status == TrackingStatus.WAITING
    tracked.follow(10, start=1)
    tracked.tick(11, X)
    assert tracked.verdict == MeasurementVerdict.UNUSABLE
    assert tracked.out("X_WO_estimated").IsNearlyEqualTo(X_true(11 * PERIOD), 1e-3)


def test_settings_reach_the_tracker():
    estimator = make_estimator(
        gate=0.0, reacquire_after=7, late_measurements=2, coast_after=0.0, lost_after=0.2
    )
    context = estimator.CreateDefaultContext()
    port = estimator.GetInputPort("X_WO_measured")
    port.FixValue(context, X_true(0))
    context.SetDiscreteState(estimator.EvalUniquePeriodicDiscreteUpdate(context))
    context.SetTime(PERIOD)
    port.FixValue(context, RigidTransform([1000.0, 0, 0]))
    verdict = estimator.GetOutputPort("measurement_verdict")
    assert verdict.Eval(context)[0] == MeasurementVerdict.USED  # Without a gate all is taken.


def test_status_is_a_matter_of_how_long_a_measurement_is_overdue():
    args = (0.1, 0.2, 1.0)  # Period, coast_after, lost_after.
    assert tracking_status(np.inf, *args) == TrackingStatus.WAITING
    statuses = [tracking_status(since, *args) for since in np.linspace(0, 2, 201)]
    assert statuses == sorted(statuses)
    assert tracking_status(0.1 + 0.2, *args) == TrackingStatus.TRACKING
    assert tracking_status(0.31, *args) == TrackingStatus.COASTING
    assert tracking_status(1.11, *args) == TrackingStatus.LOST


@pytest.mark.parametrize("late", [1, 3])
def test_a_measurement_may_be_as_many_late_as_is_said(late):
    for behind, verdict in (
        (late, MeasurementVerdict.USED_LATE),
        (late + 1, MeasurementVerdict.TOO_LATE),
    ):
        tracked = Tracked(late_measurements=late)
        for k in range(10):
            tracked.tick(k, X_true(k * PERIOD), k * PERIOD)
        stamp = (9 - behind + 0.5) * PERIOD
        tracked.tick(10, X_true(stamp), stamp)
        assert tracked.verdict == verdict
