"""Where an arm holds the palm: over the object, without a lag, and calm."""

import numpy as np
import pytest
from driven import Driven
from made_systems import CONTROL_PERIOD as PERIOD
from made_systems import bus, make_arm
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialVelocity

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.systems.palm_posture import SMOOTHING

FRAMES = [f"hand::tip_{i}" for i in range(4)]
AZIMUTHS = np.array([0.4, 0.0, -0.4, np.pi])
RING = 0.065 * np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS), 0 * AZIMUTHS], axis=1)
X_GP = RigidTransform(RollPitchYaw(0.0, np.pi / 2, 0.0), [-0.03, 0.0, 0.08])
HOME = np.arange(23.0)
LEAD = 0.03


def make_posture(**changes):
    arm = make_arm(
        tip_frames=FRAMES,
        palm_frame="hand::palm",
        finger_azimuths=AZIMUTHS,
        X_GP=X_GP,
        home=HOME,
        lead=LEAD,
        **changes,
    )
    return Driven(arm)


def place(posture, p_WG, yaw, v=(0.0, 0.0, 0.0), w=0.0):
    """Puts G there, with goals of tips that are on the ring when they are due."""
    posture.fix(X_WG=RigidTransform(p_WG))
    posture.fix(V_WG=SpatialVelocity(w=[0, 0, w], v=v))
    due = RotationMatrix.MakeZRotation(yaw + LEAD * w).matrix()
    goals = bus(RING @ due.T + p_WG + LEAD * np.array(v), names=FRAMES)
    posture.fix(tip_goals=goals)


def palm_goal(posture):
    return posture.eval("goals").Find("hand::palm")


def test_goals_of_tips_are_passed_on_and_the_posture_is_home():
    posture = make_posture()
    place(posture, np.array([0.1, 0.2, 0.3]), 0.5)
    goals = posture.eval("goals")
    asked = posture.system.GetInputPort("tip_goals").Eval(posture.context)
    for name in FRAMES:
        assert goals.Find(name).IsExactlyEqualTo(asked.Find(name))
    np.testing.assert_array_equal(posture.eval("nominal_posture"), HOME)


def test_a_palm_over_a_steady_motion_is_where_it_belongs_when_the_goals_are_due():
    posture = make_posture()
    v, w = np.array([0.05, 0.0, 0.0]), 0.2618
    for index in range(100):
        time = index * PERIOD
        place(posture, v * time, w * time, v, w)
        due = time + LEAD
        turn = RotationMatrix.MakeZRotation(w * due)
        expected = RigidTransform(turn, v * due) @ X_GP
        assert palm_goal(posture).IsNearlyEqualTo(expected, 1e-9)
        posture.simulator.AdvanceTo(time + PERIOD / 2)  # The tick at that time is over.


def test_a_jump_is_taken_up_without_one():
    posture = make_posture()
    place(posture, np.zeros(3), 0.0)
    posture.simulator.AdvanceTo(0.1)
    jump = np.array([0.01, -0.02, 0.0, 0.1])  # Of the position of G, and of the yaw.
    place(posture, jump[:3], jump[3])
    # Of what is left of the jump, each tick takes up the same share.
    left = jump
    for index in range(5, 60):
        left = left * (1 - PERIOD / SMOOTHING)
        X_WG = palm_goal(posture) @ X_GP.inverse()
        there = np.append(X_WG.translation(), RollPitchYaw(X_WG.rotation()).yaw_angle())
        np.testing.assert_allclose(jump - there, left, atol=1e-12)
        posture.simulator.AdvanceTo((index + 0.5) * PERIOD)  # The tick at that time is over.


@pytest.mark.parametrize("yaw", [-3.0, 0.0, 2.0, 3.1])
def test_it_turns_on_past_half_a_turn(yaw):
    posture = make_posture(yaw=yaw)
    w = 1.0
    for index in range(200):
        place(posture, np.zeros(3), yaw + w * index * PERIOD, w=w)
        posture.simulator.AdvanceTo((index + 0.5) * PERIOD)
    turn = posture.context.get_discrete_state(0).value()[3]
    assert turn == pytest.approx(yaw + w * 200 * PERIOD)


def test_it_stays_in_its_range_and_says_where_the_hand_is():
    low, high = -0.5, 0.3
    posture = make_posture(yaw_range=(low, high))
    X_WO = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.1, 0.2, 0.3])
    posture.fix(X_WO_estimated=X_WO)
    w, ticks = 0.5, 100
    assert w * ticks * PERIOD > high  # The object turns out of the range, and the palm stays in.
    for index in range(ticks):
        place(posture, np.zeros(3), w * index * PERIOD, w=w)
        posture.simulator.AdvanceTo(index * PERIOD)
    R_WG = palm_goal(posture).rotation() @ X_GP.rotation().inverse()
    assert RollPitchYaw(R_WG).yaw_angle() == pytest.approx(high)
    X_WH = posture.eval("X_WH")
    # H is amid the range, wherever the palm is in it.
    middle = RotationMatrix.MakeZRotation((low + high) / 2)
    expected = RigidTransform(middle, X_WO.translation())
    assert X_WH.IsNearlyEqualTo(expected, 1e-12)
    X_WU = posture.eval("X_WU")
    expected = RigidTransform(RotationMatrix.MakeZRotation(0.3), X_WO.translation())
    assert X_WU.IsNearlyEqualTo(expected, 1e-9)


def test_a_period_has_to_be_positive():
    with pytest.raises(InvalidArgumentError, match="period must be greater than 0 s, not 0"):
        make_posture(period=0)
