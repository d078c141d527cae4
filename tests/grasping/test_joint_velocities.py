"""Laws of the velocities of joints when nothing keeps all limits."""

import numpy as np
import pytest

from drake_pregrasp.grasping.clearances import RETREAT, Clearances
from drake_pregrasp.grasping.grasp_state import NOT_BLOCKED
from drake_pregrasp.grasping.joint_velocities import JointLimits, next_velocities

FREE, BRAKE = np.full(2, 10.0), 0.1
LIMITS = JointLimits(-FREE, FREE, FREE, np.full(2, BRAKE))


def velocities(v_last, goal, least):
    """Of two joints with goals of their own, and something before the first one."""
    clear = Clearances(np.array([[1.0, 0.0]]), np.array([least]), np.array([3]))
    each, still = np.eye(2), np.zeros(2)
    return next_velocities(still, np.array(v_last), each, np.array(goal), still, LIMITS, clear)


def test_joints_follow_their_goals_where_there_is_room():
    v, blocked = velocities([0.2, 0.0], [0.25, 0.05], -1.0)
    np.testing.assert_allclose(v, [0.25, 0.05], atol=1e-6)
    assert blocked == NOT_BLOCKED


@pytest.mark.parametrize("goal", [-0.5, 0.5])
def test_joints_stop_if_no_velocities_keep_clear(goal):
    v, blocked = velocities([-0.3, 0.2], [goal, 0.5], RETREAT - 0.2)
    np.testing.assert_allclose(v, [-0.2, 0.1])
    assert blocked == 3


@pytest.mark.parametrize(("goal", "expected"), [(1.0, [0.4, 0.3]), (-1.0, [0.2, 0.1])])
def test_joints_do_not_stop_before_what_comes_fast_if_their_goals_lead_away(goal, expected):
    v, blocked = velocities([0.3, 0.2], [goal, 0.5], 1.5)
    np.testing.assert_allclose(v, expected, atol=1e-6)
    assert blocked == 3
