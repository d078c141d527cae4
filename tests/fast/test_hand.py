"""The compiled functions of a hand agree with their references in numpy."""

from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drake_pregrasp import BallSolid, BoxSolid, HalfSpace
from drake_pregrasp.fast import numba_is_installed
from drake_pregrasp.geometry.solids import PlacedSolid
from drake_pregrasp.grasping.clearances import Clearances, Links, NearPairs, clearances
from drake_pregrasp.grasping.fingertip_paths import Pace, TipRoom, straight_step
from drake_pregrasp.grasping.forward_kinematics import HandPose
from drake_pregrasp.grasping.grasp_state import BASE, NOT_BLOCKED
from drake_pregrasp.grasping.hand_goals import HandGoals, PalmAxis, goal_velocities, hand_goals
from drake_pregrasp.grasping.joint_velocities import JointLimits, next_velocities

if not numba_is_installed():
    pytest.skip("needs the extra fast", allow_module_level=True)
from drake_pregrasp.fast.hand import compiled_clearances, compiled_next_velocities
from drake_pregrasp.fast.tip_steps import (
    compiled_goal_velocities,
    compiled_hand_goals,
    compiled_straight_step,
)

N, M, NQ = 3, 8, 11  # Fingers, links, joints.


def random_pairs(rng, k):
    normals = rng.normal(size=(k, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # Other fingers, the object, or the rest.
    link, other = rng.integers(0, M, k), rng.choice([0, 1, M, M, M, M + 1], k)
    return NearPairs(link, other, rng.uniform(-0.01, 0.025, k), rng.normal(size=(k, 3)), normals)


@pytest.mark.parametrize("seed", range(40))
def test_clearances_are_those_of_the_reference(seed):
    rng = np.random.default_rng(seed)
    finger, is_tip = rng.integers(BASE, N, M), rng.random(M) < 0.4
    moves = np.vstack([rng.random((M, NQ)) < 0.5, np.zeros((2, NQ))]).astype(float)
    is_tip &= finger != BASE
    links = Links(finger, is_tip, (rng.random(M) < 0.7) & (finger != BASE), moves)
    others = rng.normal(size=(6, NQ)), rng.normal(size=6), rng.random(N) < 0.5 * (seed % 3), 15.0
    near = random_pairs(rng, 1 + seed % 14)
    expected = clearances(links, near, *others)
    for name, found in compiled_clearances(links, near, *others)._asdict().items():
        np.testing.assert_allclose(found, getattr(expected, name), atol=1e-12, err_msg=name)


@pytest.mark.parametrize("seed", range(40))
def test_velocities_are_those_of_the_reference(seed):
    """With loose limits, or with some that stop the joints, and with a degenerate Jacobian."""
    rng = np.random.default_rng(seed)
    J, V = rng.normal(size=(6, NQ)), rng.normal(size=6)
    if seed % 4 == 3:
        J[1] = J[0]
    room = (10.0, 0.5, 0.02)[seed % 3]
    limits = JointLimits(np.full(NQ, -room), np.full(NQ, room), np.full(NQ, 5.0), np.full(NQ, room))
    clear = Clearances(rng.normal(size=(3, NQ)), rng.normal(-room, 0.1, size=3), np.arange(3))
    q, v_last = rng.uniform(-room, room, (2, NQ))
    arguments = q, v_last, J, V, rng.normal(size=NQ), limits, clear
    (expected, blocked), (found, also) = (
        function(*arguments) for function in (next_velocities, compiled_next_velocities)
    )
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert also == blocked
    assert seed % 12 or blocked == NOT_BLOCKED


def test_straight_steps_are_those_of_the_reference():
    """Over a box or beside it, to goals near and far; sometimes with a number that is unknown."""
    rng, can_move = np.random.default_rng(1), []
    box, ball = (
        BoxSolid(np.zeros(3), np.eye(3), np.array([0.1, 0.08, 0.1])),
        BallSolid(np.ones(3), 1),
    )
    table = HalfSpace(np.array([0.0, 0, -0.05]), np.array([0.0, 0, 1]))
    placed, *around = (PlacedSolid(solid.rounded_box()) for solid in (box, table, ball))
    clearances = tuple((solid, np.full(N, 0.01)) for solid in around)
    pace = Pace(0.3, 2.5, 0.01)
    for case in range(300):
        intrusions = np.where(rng.random(N) < 0.3, np.inf, 0.002)
        room = TipRoom(placed, np.full(N, 0.02), clearances, np.full((N, N), 0.01), intrusions)
        p = rng.uniform([-0.1, -0.1, -0.03], [0.1, 0.1, 0.12], (N, 3))
        p[:, 2] += 0.1 * (case % 3 > 0)
        goal = p + rng.normal(size=(N, 3)) * (0.0, 0.003, 0.03)[case % 3]
        v = 0.05 * rng.normal(size=(N, 3))
        if case % 10 == 9:
            (p, v, goal)[case % 3][1, 2] = np.nan
        expected, found = (
            step(p, v, goal, pace, room) for step in (straight_step, compiled_straight_step)
        )
        assert (expected is None) == (found is None)
        can_move.append(found is not None)
        if found is not None:
            np.testing.assert_allclose(found, expected, atol=1e-14)
    assert 50 < sum(can_move) < 250


@pytest.mark.parametrize("seed", range(20))
def test_goals_in_the_world_are_those_of_the_reference(seed):
    rng = np.random.default_rng(seed)
    axis = PalmAxis(
        R_AL=Rotation.random(random_state=seed).as_matrix(),
        p_AL=rng.normal(size=3),
        p_OCoM=rng.normal(size=3),
        finger_azimuths=rng.uniform(-np.pi, np.pi, N),
        yaw_range=(-0.3, 0.4) if seed % 2 else (-np.inf, np.inf),
        yaw_slack=0.5 * (seed % 3),
    )
    command = SimpleNamespace(
        R_WG=Rotation.random(random_state=seed + 20).as_matrix(),
        p_WG=rng.normal(size=3),
        V_WG=rng.normal(size=(2, 3)),
    )
    arguments = axis, command, *rng.normal(size=(2, N, 3)), 10 * rng.normal(), 0.03
    expected, found = asdict(hand_goals(*arguments)), asdict(compiled_hand_goals(*arguments))
    assert expected.pop("active") is found.pop("active") is None  # The shaper sets it.
    for name, value in expected.items():
        np.testing.assert_allclose(found[name], value, atol=1e-13, err_msg=name)


@pytest.mark.parametrize("speed", [0.01, 1.0])
def test_velocities_toward_goals_are_those_of_the_reference(speed):
    rng, pace = np.random.default_rng(2), Pace(speed, 5.0, 0.01)
    for _ in range(40):
        p, v, p_WT = 0.01 * rng.normal(size=(3, N, 3))
        pose = HandPose(np.empty(0), np.empty(0), p_WT, rng.normal(size=(N, 3, NQ)))
        arguments = (
            HandGoals(p, v, np.zeros(3), np.zeros(3), 0.0, 0.0),
            pose,
            0.02 * rng.normal(size=NQ),
            0.01 * rng.normal(size=(N, 3)),
            pace,
        )
        found = compiled_goal_velocities(*arguments)
        np.testing.assert_allclose(found, goal_velocities(*arguments), atol=1e-13)
