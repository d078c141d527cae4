"""Arms, hands and objects in plants of one's own: cases of the table of `plants.table`."""

import numpy as np
import pytest
from conftest import lacking_robots, lacking_shadow
from plants.own_plants import (
    ALL,
    BASES,
    CARRIER,
    OBJECTS,
    Base,
    Case,
    grasp,
    own_robot,
    pose,
)
from pydrake.math import RigidTransform

import drake_pregrasp as dp
from drake_pregrasp.errors import Lack

HANGS = Base(pose([0.0, 0.0, 0.85], [180.0, 0.0, 0.0]), 0.0)
DRAWN = np.random.default_rng(0).choice(len(ALL), 4, replace=False)
# In the first case fingers reach their goals only because the palm of the arm yields.
CASES = [Case("panda", "shadow", "cylinder", "stands"), *(ALL[index] for index in sorted(DRAWN))]


def robot_of(arm, hand, folder):
    needs_robots = arm != CARRIER or hand == "allegro"
    lack = (needs_robots and lacking_robots()) or (hand == "shadow" and lacking_shadow())
    if lack:
        pytest.skip(lack)
    return own_robot(arm, hand, folder)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=str)
def test_arms_and_hands_hold_objects_wherever_they_stand(case, tmp_path):
    robot = robot_of(case.arm, case.hand, tmp_path)
    assert grasp(robot, OBJECTS[case.thing], BASES[case.base]).is_held


@pytest.mark.slow
def test_an_arm_holds_an_object_upside_down(tmp_path):
    assert grasp(robot_of("panda", "allegro", tmp_path), OBJECTS["box"], HANGS).is_held


@pytest.mark.slow
def test_reasons_of_refusals_are_true(tmp_path):
    """Without what is said to be missing, the grasp is not refused for it."""
    hand = robot_of("panda", "allegro", tmp_path).description
    shape = OBJECTS["box"].make_shape()
    surface = dp.mesh_surface(shape, spacing=0.006)
    place = {"mass": 0.25, "X_WO": RigidTransform([0.35, 0.0, 0.0325])}

    def start(**changes):
        return dp.choose_approach(hand, surface, dp.PlannerConfig(), **(place | changes)).start

    with pytest.raises(dp.NoGraspError, match=r"of arm reach: .* it stays \d+\.?\d* mm") as error:
        start()
    assert error.value.lack is Lack.ARM
    assert start(X_WB=RigidTransform([0.35, 0.0, 0.0])).margin > 0
