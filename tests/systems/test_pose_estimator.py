"""The estimator with measurements: it agrees with the filter at each time."""

import numpy as np
import pytest
from driven import Driven
from made_systems import PERIOD, make_estimator
from pydrake.math import RigidTransform, RollPitchYaw

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp import MeasurementVerdict as Verdict
from drake_pregrasp.config.planner_config import MOST_LATE, EstimatorConfig, filter_noise
from drake_pregrasp.estimation.pose_filter import PoseMeasurement, first_belief, predict, update

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
    first, second = (PoseMeasurement(0, X @ p_OCoM, X.rotation().matrix()) for X in (X_0, X_1))
    prior = predict(first_belief(first, NOISE, p_OCoM), PERIOD, NOISE)
    belief = update(prior, second, NOISE, p_OCoM)
    estimator = seen_twice(p_OCoM=p_OCoM)
    np.testing.assert_allclose(pose(estimator) @ p_OCoM, belief.p_WCoM, atol=1e-15)
    V_WO = estimator.eval("V_WO_estimated")
    np.testing.assert_allclose(V_WO.rotational(), belief.w_WO, atol=1e-15)
    v_WCoM = V_WO.translational() + np.cross(belief.w_WO, belief.R_WO @ p_OCoM)
    np.testing.assert_allclose(v_WCoM, belief.v_WCoM, atol=1e-15)
    covariance = estimator.array("p_WO_covariance").reshape(3, 3)
    np.testing.assert_allclose(covariance, belief.P_position[:3, :3], rtol=1e-12)


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
    "reacquire_after": NO_COUNTS,
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
        {"reacquire_after": 1000},
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
    estimator = first_seen(sudden_acceleration=0.001)
    refused, errors, rng = 0, [], np.random.default_rng(3)
    for tick in range(60):
        time = PERIOD * tick
        rising = max(0.0, time - 1.5)
        up = np.array([0, 0, min(rising, 0.5)])  # Accelerates at 1 m/s^2 for 0.5 s.
        p_WO = X_0.translation() + up * (rising - up[2] / 2)
        seen = RigidTransform(X_0.rotation(), p_WO + rng.normal(scale=NOISE.position, size=3))
        held = np.array([1.0, 0, 0, 0, *up]) if is_told else np.zeros(7)
        estimator.at(time, X_WO_measured=seen, V_WO_held=held)
        refused += Verdict(int(estimator.array("measurement_verdict")[0])).is_refusal
        errors.append(np.linalg.norm(pose(estimator).translation() - p_WO))
        estimator.update()
    assert (refused == 0) == is_told
    assert (max(errors) < 2e-3) == is_told
