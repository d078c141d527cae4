import dataclasses

import numpy as np
import pytest
from driven import Driven
from pydrake.math import RigidTransform, RollPitchYaw

from drake_pregrasp import BlendConfig, ContactStatus, PlannerConfig, PregraspPlanner
from drake_pregrasp.contacts.strategies import STRATEGIES

CONFIG = PlannerConfig(static_duration=0.0)
X_0 = RigidTransform(RollPitchYaw(0, 0, 0.2), [0.1, 0.2, 0.05])
X_1 = RigidTransform(RollPitchYaw(0, 0, 0.25), [0.11, 0.2, 0.05])


def driven_planner(surface, p_OC, config=CONFIG):
    return Driven(PregraspPlanner(config, surface, p_OC), X_WO_measured=X_0)


def ticks(planner, poses):
    """Yields the goals of each tick, before the update."""
    for k, X_WO in enumerate(poses):
        planner.at(k * CONFIG.period, X_WO_measured=X_WO)
        yield planner.array("p_WC")
        planner.update()


def goals_in_estimate(planner):
    p_WC = planner.array("p_WC").reshape(-1, 3)
    return (planner.eval("X_WO_estimated").inverse() @ p_WC.T).T


def test_a_measurement_shapes_the_goals_of_its_own_tick_and_they_ride_on_the_object(surface, p_OC):
    planner = driven_planner(surface, p_OC)
    *_, before_update = ticks(planner, [X_0, X_1])
    p_WC = planner.array("p_WC")
    np.testing.assert_allclose(p_WC, before_update, atol=1e-15)
    estimate = planner.eval("X_WO_estimated")
    # The first two measurements fix position and velocity, so the second one is nearly adopted.
    np.testing.assert_allclose(estimate.translation(), X_1.translation(), atol=1e-4)
    p_OC_now = goals_in_estimate(planner)
    np.testing.assert_allclose(p_OC_now, surface.project(p_OC_now)[0], atol=1e-12)
    assert 0.005 < np.mean(p_WC.reshape(-1, 3)[:, 0] - 0.1) < 0.03
    planner.at(1.5 * CONFIG.period)  # Between two ticks.
    np.testing.assert_allclose(goals_in_estimate(planner), p_OC_now, atol=1e-12)
    assert np.max(np.abs(planner.array("p_WC") - p_WC)) > 1e-3


def test_goals_settle_on_the_object(surface, p_OC):
    planner = driven_planner(surface, p_OC)
    *_, previous, now = ticks(planner, [X_0] * 60)
    np.testing.assert_allclose(now, previous, atol=1e-12)
    assert np.all(planner.eval("contact_status") == ContactStatus.ACTIVE)


@pytest.mark.parametrize("strategy", ["position", "vew"])
def test_the_planner_moves_with_the_world(surface, p_OC, strategy):
    """Under a rigid motion of the world, goals and targets move along."""
    X_VW = RigidTransform(RollPitchYaw(0.3, -1.0, 2.0), [3.0, -2.0, 1.0])
    config = PlannerConfig(static_duration=0.0, strategy=strategy)
    goals, tips = [], []
    for X in (RigidTransform(), X_VW):
        planner = driven_planner(surface, p_OC, config)
        *_, p_WC = ticks(planner, [X @ X_0, X @ X_1])
        p = p_WC.reshape(-1, 3)
        goals.append((X.inverse() @ p.T).T)
        target = planner.eval("fingertip_targets").Find("fingertip_2")
        tips.append((X.inverse() @ target).GetAsMatrix34())
    # Candidates at a tie between regions may change sides, by rounding.
    np.testing.assert_allclose(goals[1], goals[0], atol=2e-3)
    np.testing.assert_allclose(tips[1], tips[0], atol=2e-3)


def test_a_lost_finger_reaches_the_planner_through_its_port(surface, p_OC):
    planner = driven_planner(surface, p_OC)
    planner.fix(contact_weights=np.zeros(5))
    for _ in ticks(planner, [X_0, X_0]):
        planner.fix(contact_weights=[0, -np.inf, 0, 0, 0])
    assert list(planner.eval("contact_status")) == [1, ContactStatus.LOST, 1, 1, 1]


@pytest.mark.parametrize("period", [0.05, 0.01, 1 / 64])
def test_the_period_sets_the_planning_rate(surface, p_OC, period):
    planner = PregraspPlanner(PlannerConfig(period=period), surface, p_OC)
    attribute = planner.GetUniquePeriodicDiscreteUpdateAttribute()
    assert attribute.period_sec() == period
    assert attribute.offset_sec() == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        {"friction": 0.2},
        {"power": 3.0},
        {"in_turns": True},
        {"stretch": False},
        {"best_point": True},
        {"strategy": "blend", "blend": BlendConfig(vew=1.0)},
        {"strategy": "blend", "blend": BlendConfig(margin=1.0, position=0.5)},
    ],
)
def test_every_setting_of_the_weights_reaches_the_goals(surface, p_OC, change):
    config = PlannerConfig(static_duration=0.0, strategy="margin")
    before, after = (
        goals_in_estimate(driven_planner(surface, p_OC, each))
        for each in (config, dataclasses.replace(config, **change))
    )
    assert np.max(np.abs(after - before)) > 1e-4


def test_a_blend_has_a_weight_for_each_strategy():
    assert tuple(field.name for field in dataclasses.fields(BlendConfig)) == STRATEGIES
