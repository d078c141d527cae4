"""Arms, hands and objects in plants of one's own: cases of the table of `plants.table`."""

import pytest
from conftest import lacking_robots, lacking_shadow
from plants.own_plants import (
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
CASES = [  # Each arm, hand, object and base once at least.
    Case("panda", "shadow", "cylinder", "stands"),  # The palm yields, else fingers do not arrive.
    Case("xarm7", "five_finger", "bottle", "moved"),
    Case("ur5", "five_finger", "mug", "moved"),
    Case("carrier", "urdf_gripper", "box", "moved"),
]


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
