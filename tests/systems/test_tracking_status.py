"""The estimator without valid measurements: its status and its predictions."""

import numpy as np
import pytest
from driven import Driven
from made_systems import PERIOD, make_estimator
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from scipy.spatial.transform import Rotation

from drake_pregrasp import MeasurementVerdict as Verdict
from drake_pregrasp import TrackingStatus
from drake_pregrasp.arrays import FARTHEST

COAST, LOST = 0.1, 0.5
NAN = RigidTransform([np.nan, 0, 0])


def X_true(time):
    return RigidTransform(RollPitchYaw(0, 0, 0.2 * time), [0.05 * time, 0, 0.1])


class Tracked(Driven):
    """An estimator of an object that moves steadily, tick by tick."""

    def __init__(self, followed=0, **settings):
        super().__init__(make_estimator(**({"coast_after": COAST, "lost_after": LOST} | settings)))
        self.follow(followed)

    def see(self, k, X, stamp=None):
        stamps = {} if stamp is None else {"measurement_time": [stamp]}
        self.at(k * PERIOD, X_WO_measured=X, **stamps)
        before = self.numbers()
        self.update()
        np.testing.assert_allclose(self.numbers(), before, atol=1e-15)
        assert np.all(np.isfinite(before))

    def follow(self, ticks, start=0):
        for k in range(start, start + ticks):
            self.see(k, X_true(k * PERIOD))

    def is_at(self, X, tolerance):
        return self.eval("X_WO_estimated").IsNearlyEqualTo(X, tolerance)

    @property
    def covariance(self):
        return self.array("p_WO_covariance").reshape(3, 3)

    @property
    def age(self):
        return self.eval("time_since_measurement")[0]

    @property
    def status(self):
        return TrackingStatus(int(self.eval("tracking_status")[0]))

    @property
    def verdict(self):
        return Verdict(int(self.eval("measurement_verdict")[0]))


def test_status_goes_from_tracking_to_coasting_to_lost_and_back():
    tracked = Tracked(followed=20)
    last = 19 * PERIOD
    for k in range(20, 40):
        tracked.see(k, NAN)
        overdue = k * PERIOD - last - PERIOD
        expected = TrackingStatus.TRACKING
        if overdue > COAST + 1e-6:
            expected = TrackingStatus.COASTING
        if overdue > LOST + 1e-6:
            expected = TrackingStatus.LOST
        assert tracked.status == expected
        assert tracked.age == pytest.approx(k * PERIOD - last)
        assert tracked.verdict == Verdict.UNUSABLE
    tracked.follow(1, start=40)
    assert (tracked.status, tracked.age) == (TrackingStatus.TRACKING, 0)


def test_coasting_follows_the_twist_and_a_lost_object_stands_still_of_less_known_place():
    tracked = Tracked(followed=60)
    V_WO = tracked.eval("V_WO_estimated")
    w, v = V_WO.rotational().copy(), V_WO.translational().copy()
    start = RigidTransform(tracked.eval("X_WO_estimated"))
    sizes = []
    for k in range(60, 90):
        tracked.see(k, NAN)
        # From the moment of the loss on, nothing moves.
        since = min((k - 59) * PERIOD, PERIOD + LOST)
        turn = RotationMatrix(Rotation.from_rotvec(w * since).as_matrix())
        expected = RigidTransform(turn @ start.rotation(), start.translation() + v * since)
        assert tracked.is_at(expected, 1e-12)
        moving = np.linalg.norm(tracked.eval("V_WO_estimated").translational()) > 0
        assert moving == tracked.status.is_followed
        sizes.append(np.linalg.det(tracked.covariance))
    assert tracked.status == TrackingStatus.LOST
    assert np.all(np.diff(sizes) > 0)


@pytest.mark.parametrize("lost_after", [LOST, 1e6])
def test_however_late_it_is_outputs_are_finite_and_ignorance_does_not_shrink(lost_after):
    tracked = Tracked(followed=20, lost_after=lost_after)
    tracked.see(20, NAN)
    sizes = []
    for time in np.logspace(0.1, 300 if lost_after == LOST else 5, 60):
        tracked.at(time)
        assert np.all(np.isfinite(tracked.numbers()))
        sizes.append(np.trace(tracked.covariance))
    assert np.all(np.diff(sizes) >= 0)
    expected = TrackingStatus.LOST if lost_after == LOST else TrackingStatus.COASTING
    assert tracked.status == expected


def test_before_any_measurement_it_waits_and_is_finite():
    tracked = Tracked()
    for k in range(5):
        tracked.see(k, NAN)
        assert tracked.status == TrackingStatus.WAITING
        np.testing.assert_array_equal(tracked.covariance, np.eye(3))  # In m²; see the docs.
        assert tracked.age == pytest.approx(k * PERIOD)
    assert tracked.eval("X_WO_estimated").IsExactlyIdentity()
    tracked.follow(1, start=5)
    assert tracked.verdict == Verdict.STARTED
    assert tracked.is_at(X_true(5 * PERIOD), 1e-12)


def test_delayed_measurements_are_for_their_own_time():
    delayed, unaware = Tracked(), Tracked()
    for k in range(60):
        stamp = (k - 2) * PERIOD
        delayed.see(k, X_true(stamp), stamp if k >= 2 else -np.inf)
        unaware.see(k, X_true(stamp))
    now = X_true(59 * PERIOD)
    assert delayed.is_at(now, 2e-4)
    assert delayed.age == pytest.approx(2 * PERIOD)
    assert delayed.status == TrackingStatus.TRACKING
    lag = unaware.eval("X_WO_estimated").translation() - now.translation()
    assert np.linalg.norm(lag) > 4e-3


def test_a_time_that_was_there_before_is_nothing_new():
    tracked = Tracked()
    tracked.see(0, X_true(0), 0.0)
    tracked.see(1, X_true(3.0), 0.0)
    assert tracked.verdict == Verdict.NOTHING_NEW
    assert tracked.is_at(X_true(0), 1e-12)


@pytest.mark.parametrize("X", [NAN, RigidTransform([0, 2 * FARTHEST, 0])])
def test_an_invalid_pose_is_refused_at_the_first_and_at_later_ticks(X):
    tracked = Tracked()
    tracked.see(0, X)
    assert tracked.status == TrackingStatus.WAITING
    tracked.follow(10, start=1)
    tracked.see(11, X)
    assert tracked.verdict == Verdict.UNUSABLE
    assert tracked.is_at(X_true(11 * PERIOD), 1e-3)


@pytest.mark.parametrize(("gate", "verdict"), [(0.0, Verdict.USED), (7.0, Verdict.OUTLIER)])
def test_without_a_gate_all_is_taken(gate, verdict):
    tracked = Tracked(followed=5, gate=gate)
    tracked.see(5, RigidTransform([1000.0, 0, 0]))
    assert tracked.verdict == verdict


@pytest.mark.parametrize("late", [1, 3])
@pytest.mark.parametrize(("more", "verdict"), [(0, Verdict.USED_LATE), (1, Verdict.TOO_LATE)])
def test_late_measurements_are_used_up_to_the_set_number(late, more, verdict):
    tracked = Tracked(late_measurements=late)
    for k in range(10):
        tracked.see(k, X_true(k * PERIOD), k * PERIOD)
    stamp = (9 - late - more + 0.5) * PERIOD
    tracked.see(10, X_true(stamp), stamp)
    assert tracked.verdict == verdict
