"""The estimator with measurements and without: estimates, status and predictions."""

import numpy as np
import pytest
from driven import Driven
from made_systems import PERIOD, make_estimator
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from scipy.spatial.transform import Rotation

from drake_pregrasp import InvalidArgumentError, TrackingStatus
from drake_pregrasp import MeasurementVerdict as Verdict
from drake_pregrasp.arrays import FARTHEST
from drake_pregrasp.config.planner_config import MOST_LATE, EstimatorConfig, filter_noise
from drake_pregrasp.estimation.pose_belief import PoseMeasurement, first_belief
from drake_pregrasp.estimation.pose_filter import filter_step, merged
from drake_pregrasp.estimation.pose_track import FOLLOWED
from drake_pregrasp.systems.pose_estimator import PoseEstimator

NOISE = filter_noise(EstimatorConfig())
X_0 = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.1, 0.2, 0.3])
X_1 = RigidTransform(RollPitchYaw(0.1, 0.2, 0.31), [0.101, 0.2, 0.3])


def first_seen(**arguments):
    """An estimator before its first tick, at which the object is at X_0."""
    return Driven(make_estimator(**arguments), X_WO_measured=X_0)


def seen_twice(**arguments):
    """An estimator before its second tick, at which the object is at X_1."""
    estimator = first_seen(**arguments)
    estimator.update()
    estimator.at(PERIOD, X_WO_measured=X_1)
    return estimator


def pose(estimator):
    return RigidTransform(estimator.eval("X_WO_estimated"))


@pytest.mark.parametrize("time", [0.0, -1.0])
def test_before_any_tick_the_first_measurement_is_the_estimate(time):
    estimator = first_seen()
    estimator.at(time)
    assert pose(estimator).IsNearlyEqualTo(X_0, 1e-12)


@pytest.mark.parametrize("p_OCoM", [np.zeros(3), np.array([0.01, -0.02, 0.03])])
def test_ticks_do_what_the_filter_does(p_OCoM):
    first, second = (
        PoseMeasurement(time, X.translation(), X.rotation().matrix())
        for time, X in ((0.0, X_0), (PERIOD, X_1))
    )
    posterior = filter_step(first_belief(first, NOISE, p_OCoM), second, NOISE, p_OCoM)[1].belief
    belief = merged(posterior)
    estimator = seen_twice(p_OCoM=p_OCoM)
    np.testing.assert_allclose(pose(estimator) @ p_OCoM, belief.p_WCoM[0], atol=1e-14)
    V_WO, (w_WO, v_WCoM) = estimator.eval("V_WO_estimated"), belief.V_WCoM[0].reshape(2, 3)
    np.testing.assert_allclose(V_WO.rotational(), w_WO, atol=1e-12)
    v_WO = v_WCoM - np.cross(w_WO, belief.R_WO[0] @ p_OCoM)
    np.testing.assert_allclose(V_WO.translational(), v_WO, atol=1e-12)
    # With a = R_WO p_OCoM an error theta of the orientation moves the origin of O by a x theta.
    H = np.hstack([np.cross(np.eye(3), belief.R_WO[0] @ p_OCoM), np.eye(3)])
    covariance = estimator.array("p_WO_covariance").reshape(3, 3)
    np.testing.assert_allclose(covariance, H @ belief.P[0, :6, :6] @ H.T, atol=1e-15)


def test_a_measurement_is_used_once():
    estimator = first_seen()
    estimator.update()
    estimator.fix(X_WO_measured=X_1)  # The same tick: ignored.
    assert pose(estimator).IsNearlyEqualTo(X_0, 1e-12)


def test_between_ticks_the_estimate_moves_on_with_the_estimated_twist():
    estimator = seen_twice()
    estimator.update()
    p_WO, V_WO = pose(estimator).translation(), estimator.eval("V_WO_estimated")
    expected = p_WO + V_WO.translational() * PERIOD / 2
    estimator.at(1.5 * PERIOD)
    np.testing.assert_allclose(pose(estimator).translation(), expected, atol=1e-15)


def test_a_context_that_is_set_back_in_time_starts_afresh():
    estimator = first_seen()
    estimator.tick(200)
    estimator.at(0.0, X_WO_measured=X_1)
    for _ in range(2):
        assert pose(estimator).IsNearlyEqualTo(X_1, 1e-12)
        covariance = estimator.array("p_WO_covariance").reshape(3, 3)
        np.testing.assert_allclose(covariance, NOISE.position**2 * np.eye(3), rtol=1e-12)
        estimator.update()


def test_lookahead_is_prediction_with_a_grown_covariance():
    now, ahead = seen_twice(), seen_twice(lookahead=0.2)
    shift = 0.2 * now.eval("V_WO_estimated").translational()
    expected = pose(now).translation() + shift
    np.testing.assert_allclose(pose(ahead).translation(), expected, atol=1e-12)
    assert ahead.eval("p_WO_covariance")[0] > now.eval("p_WO_covariance")[0]


NO_NUMBERS = (np.nan, -np.inf, -1.0, "abc", None, [1.0, 2.0], 1j)
NO_COUNTS = (*NO_NUMBERS, np.inf, 0, 2.5, 3.0)
REFUSED = {
    "period": (*NO_NUMBERS, np.inf, 0.0, 10**400),
    "lookahead": (*NO_NUMBERS, np.inf, 1e200, 10**400),
    "gate": NO_NUMBERS,
    "late_measurements": (*NO_COUNTS, MOST_LATE + 1, 10**400),
    "coast_after": (*NO_NUMBERS, 2.0),
    "lost_after": (*NO_NUMBERS, 0.05),
    "p_OCoM": ("abc", 0.1, np.zeros(2), [np.nan, 0, 0], [0, np.inf, 0], [[1], [2, 3]], [1j, 0, 0]),
}


@pytest.mark.parametrize(
    ("name", "value"), [(name, value) for name, values in REFUSED.items() for value in values]
)
def test_bad_arguments_are_refused_by_name(name, value):
    with pytest.raises(InvalidArgumentError, match=name):
        make_estimator(**{name: value})


@pytest.mark.parametrize(
    "arguments",
    [
        {"gate": 1e6},
        {"late_measurements": np.int64(1)},
        {"coast_after": 0, "lost_after": 0},
        {"coast_after": 1e6, "lost_after": 1e6},
        {"lookahead": np.float32(0.5), "p_OCoM": (1, 2, 3)},
    ],
)
def test_the_ends_of_ranges_are_taken_and_estimates_follow(arguments):
    estimator = seen_twice(**arguments)
    assert estimator.eval("measurement_verdict")[0] == Verdict.USED
    assert np.all(np.isfinite(estimator.numbers()))


@pytest.mark.parametrize("is_told", [True, False])
def test_a_lift_that_the_estimator_is_told_of_is_no_surprise(is_told):
    estimator = first_seen(manoeuvre_rate=0.0)
    refused, errors, rng = 0, [], np.random.default_rng(3)
    for tick in range(60):
        time = PERIOD * tick
        rising = max(0.0, time - 1.5)
        up = np.array([0, 0, min(rising, 0.5)])  # Accelerates at 1 m/s^2 for 0.5 s.
        p_WO = X_0.translation() + up * (rising - up[2] / 2)
        seen = RigidTransform(X_0.rotation(), p_WO + rng.normal(scale=NOISE.position, size=3))
        held = SpatialVelocity(np.append(np.zeros(3), up) if is_told else np.full(6, np.nan))
        estimator.at(time, X_WO_measured=seen, V_WO_held=held)
        refused += estimator.array("measurement_verdict")[0] >= Verdict.UNUSABLE
        errors.append(np.linalg.norm(pose(estimator).translation() - p_WO))
        estimator.update()
    assert (refused == 0) == is_told
    assert (max(errors) < 2e-3) == is_told


@pytest.mark.parametrize(("speed", "counts"), [(99.0, True), (101.0, False), (1e6, False)])
def test_no_hand_moves_an_object_that_fast(speed, counts):
    """Such twists, from a control loop that is unstable, are no change; the object stays held."""
    outputs = []
    for v in (speed, 0.0):
        estimator = Driven(PoseEstimator(EstimatorConfig(gravity=9.81), period=PERIOD))
        for tick in range(30):
            held = SpatialVelocity(np.zeros(3), [v if tick == 20 else 0.0, 0, 0])
            estimator.at(PERIOD * tick, X_WO_measured=RigidTransform(), V_WO_held=held)
            estimator.update()
        found = (estimator.array(port) for port in ("X_WO_estimated", "p_WO_covariance"))
        outputs.append(np.concatenate([values.ravel() for values in found]))
    assert np.array_equal(*outputs) != counts


@pytest.mark.parametrize("is_told", [True, False])
def test_an_object_that_a_hand_holds_does_not_fall(is_told):
    estimator = first_seen(manoeuvre_rate=0.0, gravity=9.81)
    held = SpatialVelocity.Zero() if is_told else SpatialVelocity(np.full(6, np.nan))
    speeds = []
    for tick in range(60):
        estimator.at(PERIOD * tick, X_WO_measured=X_0, V_WO_held=held)
        speeds.append(np.linalg.norm(estimator.eval("V_WO_estimated").translational()))
        estimator.update()
    assert (max(speeds[20:]) < 1e-3) == is_told


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
        assert moving == (tracked.status in FOLLOWED)
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


@pytest.mark.parametrize("p_OCoM", [np.zeros(3), np.array([0.01, -0.02, 0.03])])
def test_before_any_measurement_it_waits_and_is_finite(p_OCoM):
    tracked = Tracked(p_OCoM=p_OCoM)
    for k in range(5):
        tracked.see(k, NAN)
        assert tracked.status == TrackingStatus.WAITING
        np.testing.assert_array_equal(tracked.covariance, np.eye(3))  # In m²; see the docs.
        assert tracked.age == pytest.approx(k * PERIOD)
    assert tracked.eval("X_WO_estimated").IsExactlyIdentity()
    assert not tracked.eval("V_WO_estimated").get_coeffs().any()
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
