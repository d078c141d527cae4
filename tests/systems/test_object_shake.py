"""The force that shakes a held object, and what it does to an object in a plant."""

import numpy as np
import pytest
from driven import Driven
from five_finger_hand import HAND

from drake_pregrasp import Box, Conveyor, HandStation
from drake_pregrasp.config.object_config import Toss
from drake_pregrasp.grasping.grasp_state import GraspPhase
from drake_pregrasp.grasping.held_criterion import HOLD_DURATION, SHAKE, SHAKE_END, SHAKE_PERIOD
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.object_shake import ObjectShake

MASS, SINCE = 0.4, 7.3
HOME = HAND.home(np.array([0.0, 0.0, 0.4]), 0.0)
HELD = [GraspPhase.HOLD, SINCE, 0.0, 0.0]


def station(motion):
    plant = Scenario().plant_config
    plant.time_step = 0.005
    cube = Box(size=[0.1] * 3, mass=MASS)
    return HandStation(cube, motion, plant, HAND, friction=0.7, initial=HOME)


@pytest.fixture(scope="module")
def body():
    return station(Conveyor()).plant.GetBodyByName("object")


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1, -1])
def test_it_pushes_with_half_the_weight_at_the_centre_of_mass(body, axis, sign):
    driven = Driven(ObjectShake(body), grasp_report=HELD)
    driven.at(SINCE + HOLD_DURATION + SHAKE_PERIOD * (axis + 0.5 - sign * 0.25))
    (force,) = driven.eval("spatial_forces")
    expected = sign * SHAKE * 9.81 * MASS * np.eye(3)[axis]
    np.testing.assert_allclose(force.F_Bq_W.translational(), expected, atol=2e-3)
    np.testing.assert_array_equal(force.F_Bq_W.rotational(), 0)
    np.testing.assert_array_equal(force.p_BoBq_B, body.default_com())
    assert force.body_index == body.index()


def test_it_does_nothing_before_and_after_nor_to_an_object_that_is_not_held(body):
    driven, middle = Driven(ObjectShake(body)), SINCE + HOLD_DURATION + 0.1
    driven.at(middle)
    assert driven.eval("spatial_forces") == []
    driven.at(middle, grasp_report=[GraspPhase.BACK_OFF, *HELD[1:]])
    assert driven.eval("spatial_forces") == []
    driven.fix(grasp_report=HELD)
    assert len(driven.eval("spatial_forces")) == 1
    for time in (0.0, SINCE + HOLD_DURATION - 0.01, SINCE + SHAKE_END + 0.01):
        driven.at(time)
        assert driven.eval("spatial_forces") == []


def test_the_force_adds_to_those_that_launch_an_object():
    """In flight, a quarter of the shake along z lifts the object by a known distance."""
    seconds, rate = SHAKE_PERIOD / 4, 2 * np.pi / SHAKE_PERIOD
    rises = []
    for report in (
        {},
        {"grasp_report": [GraspPhase.HOLD, -HOLD_DURATION - 2 * SHAKE_PERIOD, 0, 0]},
    ):
        made = station(Toss(position=[1.0, 0.0, 1.0], velocity=[0.0, 0.0, 2.0]))
        driven = Driven(made, desired_state=np.append(HOME, np.zeros_like(HOME)), **report)
        driven.advance(seconds)
        rises.append(driven.eval("X_WO").translation()[2] - 1.0)
    assert rises[0] == pytest.approx(2.0 * seconds - 9.81 / 2 * seconds**2, abs=1e-3)
    lifted = SHAKE * 9.81 * (seconds / rate - np.sin(rate * seconds) / rate**2)
    assert rises[1] - rises[0] == pytest.approx(lifted, rel=0.05)
