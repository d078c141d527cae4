"""Posture of the palm on a carrier or an arm: above the object, without lag or jitter."""

import numpy as np
import pytest
from driven import Driven
from made_systems import CONTROL_PERIOD as PERIOD
from made_systems import FRAMES, HAND, NQ, RING, bus, make_arm, make_carrier
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialVelocity

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.systems.palm_posture import SMOOTHING

LIMITED = (-0.5, 0.3)
X_GP = RigidTransform(RollPitchYaw(0.0, np.pi / 2, 0.0), [-0.03, 0.0, 0.08])
HOME = np.arange(float(NQ))
LEAD = 0.03
X_WO = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.1, 0.2, 0.3])


def make_posture(make, **arguments):
    posture = Driven(make(**arguments), X_WO_estimated=X_WO)
    place(posture, 0)
    return posture


def carrier(**arguments):
    return make_posture(make_carrier, carrier=HAND.base.joints, **arguments)


def arm(**arguments):
    return make_posture(make_arm, X_GP=X_GP, home=HOME, lead=LEAD, **arguments)


def place(posture, tick, p_WG=(0.0, 0.0, 0.0), yaw=0.0, v=(0.0, 0.0, 0.0), w=0.0):
    """Puts G there at a tick, with goals of tips that are on the ring when they are due."""
    due = RotationMatrix.MakeZRotation(yaw + LEAD * w).matrix()
    goals = bus(0.079 * RING @ due.T + p_WG + LEAD * np.array(v))
    V_WG = SpatialVelocity(w=[0, 0, w], v=v)
    X_WG = RigidTransform(np.array(p_WG))
    posture.at(tick * PERIOD, X_WG=X_WG, V_WG=V_WG, tip_goals=goals)


def palm_goal(posture):
    return posture.eval("goals").Find("palm")


def upright(yaw):
    return RigidTransform(RotationMatrix.MakeZRotation(yaw), X_WO.translation())


@pytest.mark.parametrize(("name", "value"), [("period", 0.0), ("gain", -1.0), ("gain", np.nan)])
def test_a_carrier_needs_a_period_and_a_gain(name, value):
    with pytest.raises(InvalidArgumentError, match=f"{name} must be greater than 0 .*{value}"):
        make_carrier(**{name: value})


@pytest.mark.parametrize("make", [carrier, arm])
@pytest.mark.parametrize(("yaw_range", "middle"), [(LIMITED, -0.1), (FREE_TURN, None)])
def test_the_hand_is_over_the_object_and_turned_as_its_palm_or_in_the_middle(
    make, yaw_range, middle
):
    posture = make(yaw_range=yaw_range)
    rate, ticks = 0.5, 100
    for tick in range(ticks):
        place(posture, tick, yaw=rate * tick * PERIOD, w=rate)
        posture.update()
    turned = posture.context.get_discrete_state(0).value()[-1]
    assert yaw_range == FREE_TURN or turned == pytest.approx(0.3)
    assert posture.eval("X_WU").IsNearlyEqualTo(upright(turned), 1e-9)
    expected = upright(turned if middle is None else middle)
    assert posture.eval("X_WH").IsNearlyEqualTo(expected, 1e-9)


def test_a_carrier_turns_with_the_goals_on_and_on():
    posture = carrier()
    for tick, angle in enumerate(np.arange(0.0, 13.0, 0.3)):
        p_WG = np.array([0.01 * tick, 0.0, 0.1])
        place(posture, tick, p_WG, angle)
        nominal = posture.array("nominal_posture")
        np.testing.assert_allclose(nominal[:4] - [0, 0, 0.155, 0], [*p_WG, angle], atol=1e-12)
        posture.update()


@pytest.mark.parametrize("make", [carrier, arm])
def test_the_palm_stays_over_a_centre_of_mass_beside_the_origin(make):
    p_OCoM, rate, v = np.array([0.05, -0.02, 0.01]), 0.4, np.array([0.02, 0.0, 0.0])
    posture = make(p_OCoM=p_OCoM)
    for tick in range(300):
        time = tick * PERIOD
        R_WG = RotationMatrix.MakeZRotation(rate * time)
        place(posture, tick, v * time, rate * time, v, rate)
        due = RotationMatrix.MakeZRotation(rate * (time + LEAD)).matrix()
        p_WT = (0.079 * RING + p_OCoM) @ due.T + (time + LEAD) * v
        X_WG = RigidTransform(R_WG, v * time)
        posture.fix(X_WG=X_WG, X_WO_estimated=X_WG, tip_goals=bus(p_WT))
        posture.update()
    p_WCoM, p_WH = X_WG @ p_OCoM, posture.eval("X_WH").translation()
    np.testing.assert_allclose(p_WH, p_WCoM, atol=1e-9)
    lead = 0.2 if make is carrier else LEAD
    ahead = lead * (v + np.cross([0, 0, rate], R_WG @ p_OCoM))
    palm = posture.array("nominal_posture")[:3] - [0.0, 0.0, 0.155]
    if make is arm:
        X_GP_W = RotationMatrix.MakeZRotation(rate * (time + LEAD)) @ X_GP.translation()
        palm = palm_goal(posture).translation() - X_GP_W
    np.testing.assert_allclose(palm, p_WCoM + ahead, atol=5e-4)


def test_a_carrier_that_lags_by_its_gain_is_asked_to_be_ahead():
    posture = carrier(gain=4.0)
    posture.fix(V_WG=SpatialVelocity(w=[0, 0, 0.2], v=[0.04, 0.02, 0.0]))
    nominal = posture.array("nominal_posture")
    np.testing.assert_allclose(nominal[:4], [0.01, 0.005, 0.155, 0.05], atol=1e-12)


def test_a_carrier_of_limited_range_stays_in_it_and_comes_back_the_other_way_round():
    posture = carrier(yaw_range=LIMITED)
    yaws = []
    for tick, angle in enumerate(np.arange(0.0, 2 * np.pi, 0.2)):
        place(posture, tick, yaw=angle)
        yaws.append(posture.array("nominal_posture")[3])
        posture.update()
    assert (min(yaws), max(yaws)) == LIMITED
    assert yaws[-1] == pytest.approx(6.2 - 2 * np.pi)


def test_an_arm_passes_on_goals_of_tips_and_its_posture_is_home():
    posture = arm()
    place(posture, 0, np.array([0.1, 0.2, 0.3]), 0.5)
    goals = posture.eval("goals")
    asked = posture.system.GetInputPort("tip_goals").Eval(posture.context)
    for name in FRAMES:
        assert goals.Find(name).IsExactlyEqualTo(asked.Find(name))
    np.testing.assert_array_equal(posture.eval("nominal_posture"), HOME)


@pytest.mark.parametrize("yaw", [-3.0, 0.0, 2.0, 3.1])
def test_a_palm_over_a_steady_motion_is_where_it_belongs_when_the_goals_are_due(yaw):
    posture = arm(yaw=yaw)
    v, w = np.array([0.05, 0.0, 0.0]), 1.0
    for tick in range(200):
        time = tick * PERIOD
        place(posture, tick, v * time, yaw + w * time, v, w)
        due = time + LEAD
        expected = RigidTransform(RotationMatrix.MakeZRotation(yaw + w * due), v * due) @ X_GP
        assert palm_goal(posture).IsNearlyEqualTo(expected, 1e-9)
        posture.update()
    turn = posture.context.get_discrete_state(0).value()[3]  # On past half a turn.
    assert turn == pytest.approx(yaw + w * 200 * PERIOD)


def test_an_arm_takes_up_a_jump_without_one():
    posture = arm()
    jump = left = np.array([0.01, -0.02, 0.0, 0.1])  # Of the position of G, and of the yaw.
    # Of what is left of the jump, each tick takes up the same share.
    for tick in range(60):
        place(posture, tick, jump[:3], jump[3])
        left = left * (1 - PERIOD / SMOOTHING)
        X_WG = palm_goal(posture) @ X_GP.inverse()
        there = np.append(X_WG.translation(), RollPitchYaw(X_WG.rotation()).yaw_angle())
        np.testing.assert_allclose(jump - there, left, atol=1e-12)
        posture.update()


def test_a_palm_on_an_arm_stays_in_its_range():
    posture = arm(yaw_range=LIMITED)
    for tick in range(60):
        place(posture, tick, yaw=1.0, w=1.0)
        posture.update()
    R_WG = palm_goal(posture).rotation() @ X_GP.rotation().inverse()
    assert RollPitchYaw(R_WG).yaw_angle() == pytest.approx(LIMITED[1])
