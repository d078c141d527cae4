"""Velocities of fingertips that follow their goals."""

import numpy as np
import pytest

from drake_pregrasp.fast.kernels import REFERENCE
from drake_pregrasp.grasping.fingertip_paths import Pace
from drake_pregrasp.grasping.forward_kinematics import HandPose
from drake_pregrasp.grasping.hand_goals import HandGoals

PACE = Pace(speed=0.4, acceleration=5.0, period=0.01)
EAST = np.array([1.0, 0.0, 0.0])


def follow(away, v, acceleration, ticks):
    """Returns ways from a fingertip to its goal, which starts with v and accelerates, each tick."""
    p, goal, v_last, ways = np.zeros(3), away * EAST, v * EAST, []
    velocity = v_last
    for _ in range(ticks):
        v_goal = v_last + PACE.period * acceleration * EAST
        goals = HandGoals(
            (goal + PACE.period * v_goal)[None], v_goal[None], *np.zeros((2, 3)), 0, 0
        )
        pose = HandPose(np.empty(0), np.empty(0), p[None], np.eye(3)[None])
        velocity = REFERENCE.hand().goal_velocities(goals, pose, velocity, v_last[None], PACE)
        p, goal, v_last = p + PACE.period * velocity, goal + PACE.period * v_goal, v_goal
        ways.append(float((goal - p) @ EAST))
    return np.array(ways)


@pytest.mark.parametrize("acceleration", [0.0, 4.0, 20.0])
def test_a_fingertip_stays_at_a_goal_that_accelerates(acceleration):
    np.testing.assert_allclose(follow(0.0, 0.3, acceleration, 30), 0.0, atol=1e-12)


def test_the_way_to_a_goal_takes_as_long_when_the_goal_accelerates():
    still, moving = follow(0.03, 0.0, 0.0, 40), follow(0.03, 0.3, 20.0, 40)
    np.testing.assert_allclose(moving, still, atol=1e-12)
    assert still[8] > 1e-3 > still[-1]
