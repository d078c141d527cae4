import numpy as np
import pytest
from made_systems import PERIOD, make_estimator
from pydrake.math import RigidTransform, RollPitchYaw
from scipy.spatial.transform import Rotation

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp import MeasurementVerdict as Verdict
from drake_pregrasp.config.planner_config import MOST_LATE, EstimatorConfig, filter_noise
from drake_pregrasp.estimation.pose_filter import PoseMeasurement, first_belief, predict, update
from drake_pregrasp.systems.pose_estimator import PoseEstimator

NOISE = filter_noise(EstimatorConfig())
X_0 = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.1, 0.2, 0.3])
X_1 = RigidTransform(RollPitchYaw(0.1, 0.2, 0.31), [0.101, 0.2, 0.3])


def estimator_and_context(X_WO_measured, time=0.0, **arguments):
    estimator = make_estimator(**arguments)
    context = estimator.CreateDefaultContext()
    context.SetTime(time)
    estimator.GetInputPort("X_WO_measured").FixValue(context, X_WO_measured)
    return estimator, context


def tick(estimator, context):
    context.SetDiscreteState(estimator.EvalUniquePeriodicDiscreteUpdate(context))


def pose(estimator, context):
    return estimator.GetOutputPort("X_WO_estimated").Eval(context)


@pytest.mark.parametrize("time", [0.0, -1.0])
def test_before_any_tick_the_first_measurement_is_the_estimate(time):
    estimator, context = estimator_and_context(X_0, time)
    assert pose(estimator, context).IsNearlyEqualTo(X_0, 1e-12)


@pytest.mark.parametrize("p_OCoM", [np.zeros(3), np.array([0.01, -0.02, 0.03])])
def test_ticks_do_what_the_filter_does(p_OCoM):
    estimator, context = estimator_and_context(X_0, p_OCoM=p_OCoM)
    belief = first_belief(PoseMeasurement(0, X_0 @ p_OCoM, X_0.rotation().matrix()), NOISE, p_OCoM)
    tick(estimator, context)
    context.SetTime(PERIOD)
    estimator.GetInputPort("X_WO_measured").FixValue(context, X_1)
    prior = predict(belief, PERIOD, NOISE)
    belief = update(prior, PoseMeasurement(0, X_1 @ p_OCoM, X_1.rotation().matrix()), NOISE, p_OCoM)
    np.testing.assert_allclose(pose(estimator, context) @ p_OCoM, belief.p_WCoM, atol=1e-15)
    V_WO = estimator.GetOutputPort("V_WO_estimated").Eval(context)
    np.testing.assert_allclose(V_WO.rotational(), belief.w_WO, atol=1e-15)
    p_OCoM_W = belief.R_WO @ p_OCoM
    v_WCoM = V_WO.translational() + np.cross(belief.w_WO, p_OCoM_W)
    np.testing.assert_allclose(v_WCoM, belief.v_WCoM, atol=1e-15)
    covariance = estimator.GetOutputPort("p_WO_covariance").Eval(context).reshape(3, 3)
    np.testing.assert_allclose(covariance, belief.P_position[:3, :3], rtol=1e-12)


def rotation(X):
    return Rotation.from_matrix(X.rotation().matrix())


def test_a_measurement_is_used_once():
    estimator, context = estimator_and_context(X_0)
    tick(estimator, context)
    estimator.GetInputPort("X_WO_measured").FixValue(context, X_1)  # The same tick: ignored.
    assert pose(estimator, context).IsNearlyEqualTo(X_0, 1e-12)


def test_between_ticks_the_estimate_moves_on_with_the_estimated_twist():
    estimator, context = estimator_and_context(X_0)
    for k, X in enumerate([X_0, X_1]):
        context.SetTime(k * PERIOD)
        estimator.GetInputPort("X_WO_measured").FixValue(context, X)
        tick(estimator, context)
    at_tick = RigidTransform(pose(estimator, context))
    V_WO = estimator.GetOutputPort("V_WO_estimated").Eval(context)
    context.SetTime(1.5 * PERIOD)
    moved = pose(estimator, context).translation() - at_tick.translation()
    np.testing.assert_allclose(moved, V_WO.translational() * PERIOD / 2, atol=1e-15)


def test_a_context_that_is_set_back_in_time_starts_afresh():
    estimator, context = estimator_and_context(X_0)
    for k in range(200):
        context.SetTime(k * PERIOD)
        tick(estimator, context)
    context.SetTime(0.0)
    estimator.GetInputPort("X_WO_measured").FixValue(context, X_1)
    assert pose(estimator, context).IsNearlyEqualTo(X_1, 1e-12)
    covariance = estimator.GetOutputPort("p_WO_covariance").Eval(context).reshape(3, 3)
    np.testing.assert_allclose(covariance, NOISE.position**2 * np.eye(3), rtol=1e-12)
    tick(estimator, context)
    assert pose(estimator, context).IsNearlyEqualTo(X_1, 1e-12)


def test_lookahead_is_prediction_with_a_grown_covariance():
    (now, context), (ahead, _) = (estimator_and_context(X_0, lookahead=t) for t in (0.0, 0.2))
    later = ahead.CreateDefaultContext()
    ahead.GetInputPort("X_WO_measured").FixValue(later, X_0)
    for system, c in ((now, context), (ahead, later)):
        tick(system, c)
        c.SetTime(PERIOD)
        system.GetInputPort("X_WO_measured").FixValue(c, X_1)
        tick(system, c)
    context.SetTime(PERIOD + 0.2 - 1e-9)
    context_pose = now.GetOutputPort("X_WO_estimated")
    V_WO = now.GetOutputPort("V_WO_estimated")
    context.SetTime(PERIOD)
    expected = context_pose.Eval(context).translation() + 0.2 * V_WO.Eval(context).translational()
    np.testing.assert_allclose(pose(ahead, later).translation(), expected, atol=1e-12)
    grown = ahead.GetOutputPort("p_WO_covariance").Eval(later)
    assert grown[0] > now.GetOutputPort("p_WO_covariance").Eval(context)[0]


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
    arguments = {"period": PERIOD, name: value}
    make = PoseEstimator if name in ("period", "p_OCoM") else make_estimator
    with pytest.raises(InvalidArgumentError, match=name):
        make(**(arguments if make is PoseEstimator else {name: value}))


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
    estimator, context = estimator_and_context(X_0, **arguments)
    tick(estimator, context)
    context.SetTime(PERIOD)
    estimator.GetInputPort("X_WO_measured").FixValue(context, X_1)
    assert estimator.GetOutputPort("measurement_verdict").Eval(context)[0] == Verdict.USED
    assert np.all(np.isfinite(pose(estimator, context).GetAsMatrix34()))
