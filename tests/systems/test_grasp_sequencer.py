"""The sequencer of a grasp: its frame, its forces, and the holding fingers."""

import numpy as np
import pytest
from driven import Driven
from made_systems import AROUND, CONTROL_PERIOD, NQ, RADIUS, RING, SETTINGS, N, make_sequencer
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity

from drake_pregrasp import BallSolid, BoxSolid
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.hand_description import Fingertip
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.grasping.grasp_state import GiveUp, GraspPhase
from drake_pregrasp.grasping.held_motion import TETHER
from drake_pregrasp.grasping.object_stiffness import holding_gain

MEETING = 1.5  # Time of the meeting, in seconds.
STIFFNESS = 400.0
SLACK = GraspConfig.planned_friction * 9.81 * 0.4 / (5 * STIFFNESS)
AT_TABLE = RigidTransform(RotationMatrix.MakeXRotation(0.3), [0.0, 0.0, 0.05])
ALL = np.ones(N, dtype=bool)


def tips_at(X_WO, gap):
    return (X_WO @ ((0.05 + RADIUS + gap) * RING).T).T.ravel()


def sequencer_over(X_WO, sequencer=None, active=ALL, **inputs):
    around = {
        "close": [0.0],
        "contacts": np.concatenate([0.05 * RING, RING, active], axis=None),
        "X_WO_estimated": X_WO,
        "V_WO_estimated": SpatialVelocity.Zero(),
        "p_WT": tips_at(X_WO, 0.0),
        "f_T_W": np.zeros(3 * N),
        "approach": [MEETING, *np.full(6, np.nan)],
    }
    return Driven(sequencer or make_sequencer(), **around | inputs)


def close_until_touch(hand, X_WO):
    """Closes with fingertips at their standoff, and then on the object."""
    hand.fix(close=[1.0], p_WT=tips_at(X_WO, SETTINGS.standoff))
    hand.advance(MEETING + 0.1)
    while (gap := hand.eval("command").standoffs[0]) > 0:
        hand.fix(p_WT=tips_at(X_WO, gap))
        hand.tick()
    hand.fix(p_WT=tips_at(X_WO, 0.0))


def put_tips(hand, tips):
    """Puts fingertips at places in W, where they press like springs beyond the command."""
    command = hand.eval("command")
    goals = (0.05 + RADIUS + command.standoffs)[:, None] * RING @ command.R_WG.T + command.p_WG
    felt = command.f_T_W - STIFFNESS * (tips - goals)
    hand.fix(p_WT=tips.ravel(), f_T_W=felt.ravel())


def felt_by_first(nhat_W):
    """Forces that the first finger feels when it touches."""
    return np.where(np.arange(N) == 0, -2 * SETTINGS.touch_force, 0.0)[:, None] * nhat_W


def test_fingers_hold_from_closing_until_they_let_go():
    X_WO = RigidTransform([0.0, 0.0, 0.05])
    hand = sequencer_over(X_WO)
    np.testing.assert_array_equal(hand.eval("command").fingers_hold, 0)
    touching = {"f_T_W": felt_by_first(RING).ravel()}
    close_until_touch(hand, X_WO)
    for inputs, seconds, holding in (
        (touching, 0.1, [1] * N),
        ({"close": [0.0]}, CONTROL_PERIOD, [1, 0, 0, 0, 0]),
        ({}, SETTINGS.squeeze_duration, [0] * N),
    ):
        hand.fix(**inputs)
        hand.advance(seconds)
        command = hand.eval("command")
        np.testing.assert_array_equal(command.fingers_hold, holding)
        if any(holding):
            np.testing.assert_array_equal(command.p_WE, command.p_WG)
        else:
            np.testing.assert_array_equal(command.p_WE, X_WO.translation())
    assert hand.array("hold_contacts")[0] == 1


def test_contacts_are_held_for_the_last_part_of_the_approach():
    hand, meeting = sequencer_over(AT_TABLE), SETTINGS.closing_duration + 0.1
    hand.fix(approach=[np.inf, *np.full(6, np.nan)])
    assert hand.array("hold_contacts")[0] == 0
    hand.fix(approach=[meeting, *np.full(6, np.nan)])
    for time, held in ((0.09, 0), (0.11, 1), (meeting - 0.01, 1), (meeting + 0.05, 0)):
        hand.advance(time - hand.context.get_time())
        assert hand.array("hold_contacts")[0] == held


@pytest.mark.parametrize("close", [0.0, 1.0])
def test_contacts_are_held_for_the_last_part_of_the_gate(close):
    hand, closing = sequencer_over(AT_TABLE), SETTINGS.gate_limit - SETTINGS.closing_duration
    hand.fix(close=[close], p_WT=tips_at(AT_TABLE, 0.1), approach=[0.0, *np.full(6, np.nan)])
    for time, held in ((closing - 0.02, 0), (closing + 0.02, close)):
        hand.advance(time - hand.context.get_time())
        assert hand.array("grasp_report")[0] == GraspPhase.TRACK
        assert hand.array("hold_contacts")[0] == held


@pytest.mark.parametrize(("left", "opens"), [(10.0, True), (0.2, True), (0.02, False)])
def test_a_finger_waits_beside_an_object_that_comes_to_the_palm(left, opens):
    """A bar leans toward the first finger, which its upper end meets before its middle."""
    R_WO, lean = AT_TABLE.rotation(), RotationMatrix.MakeYRotation(np.arctan2(0.07, 0.2))
    bar = BoxSolid([0, 0, 0], (R_WO.inverse() @ lean).matrix(), [0.02, 0.02, 0.42])
    hand = sequencer_over(AT_TABLE, make_sequencer(object_solid=bar))
    p_WL = AT_TABLE.translation() + np.array([0, 0, left])
    hand.fix(approach=[MEETING, *p_WL, 0, 0, 0])
    gaps = hand.eval("command").standoffs
    assert (gaps[0] > SETTINGS.standoff + 0.005) == opens
    np.testing.assert_array_equal(gaps[1:], SETTINGS.standoff)


@pytest.mark.parametrize(
    ("close", "meeting", "is_late"),
    [(1.0, 0.3, 1), (1.0, 0.8, 0), (1.0, np.inf, 0), (0.0, 0.3, 0)],
)
def test_a_finger_is_late_if_it_cannot_be_there_when_the_hand_closes(close, meeting, is_late):
    hand = sequencer_over(AT_TABLE)
    way = 0.6 + SETTINGS.gate_distance  # It takes more than 2 s, and the hand waits for 1.5 s.
    away = np.zeros((N, 3))
    away[1] = way * AT_TABLE.rotation().matrix() @ RING[1]
    p_WT = tips_at(AT_TABLE, SETTINGS.standoff) + away.ravel()
    hand.fix(close=[close], p_WT=p_WT, approach=[meeting, *np.full(6, np.nan)])
    hand.tick()
    np.testing.assert_array_equal(hand.array("late_fingers"), [0, is_late, 0, 0, 0])
    hand.fix(p_WT=tips_at(AT_TABLE, SETTINGS.standoff))
    hand.advance(0.5)
    np.testing.assert_array_equal(hand.array("late_fingers"), 0)


def test_fingers_that_have_touched_keep_touching_and_all_together_carry_the_weight():
    hand = sequencer_over(AT_TABLE)
    nhat_W = RING @ AT_TABLE.rotation().matrix().T
    close_until_touch(hand, AT_TABLE)
    hand.fix(f_T_W=felt_by_first(nhat_W).ravel())
    hand.advance(0.1)
    forces = hand.eval("command").f_T_W
    np.testing.assert_allclose(forces, felt_by_first(nhat_W) / 2, atol=1e-12)
    hand.fix(f_T_W=(-nhat_W).ravel())
    hand.advance(SETTINGS.squeeze_duration)
    forces = hand.eval("command").f_T_W
    np.testing.assert_allclose(forces.sum(axis=0), 0, atol=0.01)  # The table carries the weight.
    hand.advance(0.2)
    forces = hand.eval("command").f_T_W
    # The largest acceleration of the lift is 6 h/T^2.
    lift = 6 * SETTINGS.lift_height / SETTINGS.lift_duration**2
    np.testing.assert_allclose(forces.sum(axis=0), [0, 0, 0.4 * (9.81 + lift)], atol=0.01)
    assert np.min(-np.sum(forces * nhat_W, axis=1)) >= SETTINGS.least_force - 1e-3


def squeeze_at(X_WO, sequencer=None, active=ALL, **inputs):
    """Returns a hand that has been told to close and feels all fingers, after the squeeze."""
    hand = sequencer_over(X_WO, sequencer, active)
    close_until_touch(hand, X_WO)
    hand.fix(f_T_W=(-RING @ X_WO.rotation().matrix().T).ravel(), **inputs)
    hand.advance(SETTINGS.squeeze_duration + 0.1)
    return hand


def test_forces_are_planned_at_the_measured_fingertips_with_the_normals_there():
    X_WO = RigidTransform([0.0, 0.0, 0.05])
    # Beside the goals on a ball, to either side in turns, so that the hand does not turn.
    aside = AROUND + 0.06 * np.array([1, -1, 1, -1, 0])
    turned = np.stack([np.cos(aside), np.sin(aside), 0 * aside], axis=1)
    p_WT = (X_WO @ ((0.05 + RADIUS) * turned).T).T
    forces = squeeze_at(X_WO, p_WT=p_WT.ravel()).eval("command").f_T_W
    pressing = forces * [1, 1, 0] / np.linalg.norm(forces[:, :2], axis=1, keepdims=True)
    np.testing.assert_allclose(pressing, -turned, atol=1e-3)


def test_the_hand_closes_by_its_contacts_whatever_is_nearest_to_the_standoffs():
    X_WO = RigidTransform([0.0, 0.0, 0.05])
    hand = sequencer_over(
        X_WO, make_sequencer(object_solid=BallSolid(np.array([0.0, 0.0, -0.5]), 0.4))
    )
    hand.fix(close=[1.0], p_WT=tips_at(X_WO, SETTINGS.standoff))
    hand.advance(MEETING + 0.1)
    assert hand.array("grasp_report")[0] == GraspPhase.CLOSE


@pytest.mark.parametrize(("lever", "reason"), [(0.1, GiveUp.NONE), (100.0, GiveUp.NEEDS_TORQUE)])
def test_the_torques_of_the_joints_limit_the_squeeze(lever, reason):
    J = np.zeros((N, 3, NQ))
    J[:, 0, :N] = lever * np.eye(N)  # Each finger has a joint against forces along x.
    hand = squeeze_at(AT_TABLE, J_WT=J.ravel())
    hand.advance(SETTINGS.closing_duration + SETTINGS.correction_limit)
    assert hand.array("grasp_report")[2] == reason


def test_the_frame_moves_with_the_palm_until_they_meet_and_then_with_the_object():
    X_WO = RigidTransform(RotationMatrix.MakeZRotation(0.3), [0.1, 0.0, 0.05])
    hand = sequencer_over(X_WO)
    place, velocity = [0.2, -0.1, 0.3], [0.4, 0.5, -0.6]
    hand.fix(approach=[MEETING, *place, *velocity])
    np.testing.assert_allclose(hand.eval("X_WG").translation(), place)
    np.testing.assert_array_equal(hand.eval("X_WG").rotation().matrix(), X_WO.rotation().matrix())
    np.testing.assert_allclose(hand.eval("command").V_WG, [np.zeros(3), velocity])
    hand.advance(MEETING + 0.1)
    assert hand.array("grasp_report")[0] == GraspPhase.TRACK
    np.testing.assert_allclose(hand.eval("X_WG").translation(), X_WO.translation())


def test_it_comes_along_the_axis_of_the_palm_and_lifts_along_a_direction_of_its_own():
    X_WO, palm, lift = RigidTransform([0.0, 0.0, 0.05]), np.array([1.0, 0.0, 0.0]), [0.6, 0.0, 0.8]
    config = GraspConfig(lift_direction=[3.0, 0.0, 4.0])

    def raised(hand):
        return hand.eval("X_WG").translation() - X_WO.translation()

    hand = sequencer_over(X_WO, make_sequencer(config, palm_axis=palm))
    np.testing.assert_allclose(raised(hand), SETTINGS.approach_height * palm)
    hand = squeeze_at(X_WO, make_sequencer(config, palm_axis=palm))
    hand.advance(0.15)
    acceleration = 6 * SETTINGS.lift_height / SETTINGS.lift_duration**2
    load = 0.4 * (acceleration * np.array(lift) + np.array([0.0, 0.0, 9.81]))
    forces = hand.eval("command").f_T_W
    np.testing.assert_allclose(forces.sum(axis=0), load, atol=0.01)
    hand.advance(SETTINGS.lift_duration)
    np.testing.assert_allclose(raised(hand), SETTINGS.lift_height * np.array(lift), atol=1e-6)
    # It sets the object down where it was, and backs off as it came.
    hand.fix(close=[0.0])
    hand.advance(SETTINGS.lift_duration + 0.1)
    np.testing.assert_allclose(raised(hand), 0, atol=1e-6)
    hand.advance(SETTINGS.squeeze_duration + SETTINGS.rise_duration + 1.0)
    np.testing.assert_allclose(raised(hand), SETTINGS.approach_height * palm, atol=1e-6)


@pytest.mark.parametrize("direction", [[0.0, 0.0, 0.0], [1.0, 0.0, -0.1]])
def test_no_lift_pushes_into_the_table(direction):
    with pytest.raises(InvalidArgumentError, match="lift_direction must not be zero, nor"):
        make_sequencer(GraspConfig(lift_direction=direction))


@pytest.mark.parametrize("jump", [0.001, 0.004])
def test_a_frame_on_which_fingers_close_follows_the_estimate_without_its_jumps(jump):
    p_OCoM = np.array([0.01, 0.02, 0.0])
    X_WO = RigidTransform([0.0, 0.0, 0.05])
    w, v = np.array([0.0, 0.0, 0.1]), np.array([0.03, -0.02, 0.0])

    def pose(time, jump=0.0):
        R_WO = RotationMatrix.MakeZRotation(0.1 * time + 10 * jump)
        p_WCoM = X_WO @ p_OCoM + v * time + [jump, 0.0, jump]
        return RigidTransform(R_WO, p_WCoM - R_WO @ p_OCoM)

    def fix(time, jump):
        X = pose(time, jump)
        V_WO = SpatialVelocity(w=w, v=v - np.cross(w, X.rotation() @ p_OCoM))
        hand.fix(X_WO_estimated=X, V_WO_estimated=V_WO)

    hand = sequencer_over(X_WO, make_sequencer(p_OCoM=p_OCoM))
    hand.fix(close=[1.0], p_WT=tips_at(X_WO, SETTINGS.standoff))
    hand.advance(MEETING + 0.1)
    assert hand.array("grasp_report")[0] == GraspPhase.CLOSE
    fix(0.0, 0.0)
    start, errors = hand.context.get_time(), []
    for _ in range(15):
        hand.fix(p_WT=tips_at(hand.eval("X_WG"), SETTINGS.standoff))
        hand.tick()
        time = hand.context.get_time() - start
        fix(time, jump)
        off = pose(time, jump).inverse() @ hand.eval("X_WG")
        away, angle = np.linalg.norm(off @ p_OCoM - p_OCoM), off.rotation().ToAngleAxis().angle()
        errors.append([away, angle] / np.exp(-time / 0.3))
    # It moves with the velocity, and an error of at most 2 mm decays with a time constant of 0.3 s.
    error = 2**0.5 * jump
    left = min(1.0, 0.002 / error / np.exp(-CONTROL_PERIOD / 0.3))
    np.testing.assert_allclose(errors, left * np.array([[error, 10 * jump]] * 15), rtol=3e-3)


def test_fingers_that_squeeze_carry_the_frame_and_no_estimate_does():
    X_WO = RigidTransform([0.0, 0.0, 0.05])
    hand = sequencer_over(X_WO)
    close_until_touch(hand, X_WO)
    tips = hand.inputs["p_WT"].reshape(N, 3)
    jumped = RigidTransform([0.002, 0.0, 0.05])
    assert np.isnan(hand.array("V_WO_held")).all()
    hand.fix(X_WO_estimated=X_WO, f_T_W=-3 * SETTINGS.touch_force * RING.ravel())
    hand.advance(0.1)
    v = np.array([0.05, -0.02, 0.0])
    for step in range(1, 16):
        moved = v * CONTROL_PERIOD * step
        hand.fix(X_WO_estimated=RigidTransform(jumped.translation() + moved))
        hand.tick()
        put_tips(hand, tips + moved)
    behind = hand.eval("X_WG").translation() - [0, 0, 0.05] - 0.3 * v
    assert np.linalg.norm(behind) < SLACK + 5e-4
    np.testing.assert_allclose(hand.array("V_WO_held"), [0, 0, 0, *v], atol=1e-2)
    # An estimate that is farther away than the tether pulls the frame.
    far = RigidTransform([0.05, 0.0, 0.05])
    hand.fix(X_WO_estimated=far)
    away = hand.eval("X_WG").translation() - far.translation()
    assert np.linalg.norm(away) == pytest.approx(TETHER)
    # Fingers stay behind it. What the tether leaves of their push does not make it ever faster.
    speeds = []
    for _ in range(50):
        hand.tick()
        speeds.append(np.linalg.norm(hand.array("V_WO_held")[3:]))
    assert max(speeds) < 3 * np.linalg.norm(v)


def test_what_fingers_do_to_the_object_as_they_touch_is_not_taken_for_the_belt():
    X_WO, touch = RigidTransform([0.0, 0.0, 0.05]), SETTINGS.touch_force
    hand = sequencer_over(X_WO)
    hand.fix(V_WO_estimated=SpatialVelocity([0.3, 0.0, 0.1], [0.02, 0.0, 0.3]))
    close_until_touch(hand, X_WO)
    hand.fix(f_T_W=felt_by_first(RING).ravel())
    hand.tick()
    hand.tick()
    assert hand.array("grasp_report")[0] == GraspPhase.CLOSE
    hand.fix(V_WO_estimated=SpatialVelocity([0.0, 0.0, -0.4], [-0.03, 0.05, 0.0]))
    hand.fix(f_T_W=-3 * touch * RING.ravel())
    hand.advance(0.1)
    assert hand.array("grasp_report")[0] == GraspPhase.SQUEEZE
    # Of the belt's twist, the table leaves the yaw rate and the horizontal velocity.
    w_WG, v_WG = hand.eval("command").V_WG
    np.testing.assert_allclose(w_WG, [0.0, 0.0, 0.1], atol=1e-12)
    np.testing.assert_allclose(v_WG, [0.02, 0.0, 0.0], atol=5e-3)


def test_the_estimator_is_told_a_push_when_the_frame_has_yielded_to_it():
    X_WO = RigidTransform([0.0, 0.0, 0.05])
    hand = sequencer_over(X_WO)
    close_until_touch(hand, X_WO)
    hand.fix(f_T_W=-3 * SETTINGS.touch_force * RING.ravel())
    hand.advance(0.1)
    before, tips = hand.array("V_WO_held"), hand.inputs["p_WT"].reshape(N, 3)
    assert np.isfinite(before).all()
    put_tips(hand, np.add(tips, [0.003, 0.0, 0.0]))
    np.testing.assert_array_equal(hand.array("V_WO_held"), before)
    hand.tick()
    assert np.linalg.norm(hand.array("V_WO_held") - before) > 1e-3


def test_an_offset_of_the_camera_that_a_touch_reveals_does_not_move_the_frame_at_once():
    """The estimate and the offset change by opposite amounts, as the filter does by a touch."""
    X_WO, jump = RigidTransform([0.0, 0.0, 0.05]), np.array([0.006, -0.004, 0.003])
    jumped = RigidTransform(X_WO.translation() + jump)
    hand = sequencer_over(X_WO)
    hand.fix(camera_offset=np.zeros(12), close=[1.0], p_WT=tips_at(X_WO, SETTINGS.standoff))
    hand.advance(MEETING)
    revealed = {"camera_offset": np.append(-jump, np.zeros(9)), "X_WO_estimated": jumped}
    early = sequencer_over(X_WO)
    early.fix(**revealed)
    np.testing.assert_allclose(early.eval("X_WG").translation()[:2], jump[:2])
    hand.advance(0.1)
    assert hand.array("grasp_report")[0] == GraspPhase.CLOSE
    hand.fix(**revealed)
    for _ in range(3):
        X_WG = hand.eval("X_WG")
        away = X_WG.translation() - X_WO.translation()
        np.testing.assert_allclose(away, [0.0, 0.0, jump[2]], atol=1e-9)
        assert X_WG.rotation().IsNearlyIdentity(1e-9)
        hand.tick()
    hand.fix(camera_offset=np.full(12, np.nan))  # The last one counts.
    np.testing.assert_allclose(hand.eval("X_WG").translation()[:2], 0.0, atol=1e-9)


@pytest.mark.parametrize("azimuth", [0.0, 2.0])
def test_a_touch_moves_the_frame_and_the_other_fingers_to_the_object(azimuth):
    """The true object is 5 mm off; each finger stops at its surface, and feels it there."""
    X_WO, off = (
        RigidTransform([0.0, 0.0, 0.05]),
        5e-3 * np.array([np.cos(azimuth), np.sin(azimuth)]),
    )
    hand = sequencer_over(X_WO)
    hand.fix(close=[1.0], p_WT=tips_at(X_WO, SETTINGS.standoff))
    hand.advance(MEETING + 0.1)
    center = np.append(off, 0.05)
    while hand.array("grasp_report")[0] == GraspPhase.CLOSE:
        command = hand.eval("command")
        goals = (0.05 + RADIUS + command.standoffs)[:, None] * RING + command.p_WG
        away = goals - center
        distance = np.linalg.norm(away, axis=1, keepdims=True)
        touches = distance < 0.05 + RADIUS
        tips = np.where(touches, center + (0.05 + RADIUS) * away / distance, goals)
        felt = np.where(touches, -2 * SETTINGS.touch_force * away / distance, 0.0)
        hand.fix(p_WT=tips.ravel(), f_T_W=felt.ravel())
        hand.tick()
    assert hand.array("grasp_report")[0] == GraspPhase.SQUEEZE
    np.testing.assert_allclose(hand.eval("X_WG").translation(), center, atol=2e-3)


@pytest.mark.parametrize("way", [[np.nan] * 6, [0.1, 0.02, 0.2, 0.0, 0.0, -0.1]])
@pytest.mark.parametrize("direction", [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
def test_a_touch_before_the_hand_closes_moves_the_frame_and_where_the_object_is_expected(
    way, direction
):
    """The first finger meets an object that is not where it is estimated."""
    X_WO, first = RigidTransform([0.1, 0.0, 0.05]), np.arange(N)[:, None] == 0
    hand = sequencer_over(X_WO, make_sequencer(object_solid=BallSolid([0, 0, 0], 0.05)))
    hand.fix(approach=[MEETING, *way])
    before = hand.eval("X_WG").translation().copy()
    tips = hand.eval("command").p_WG + (0.05 + RADIUS + SETTINGS.standoff) * RING
    felt = np.where(first, -2 * SETTINGS.touch_force * np.array(direction), 0.0)
    hand.fix(p_WT=tips.ravel(), f_T_W=felt.ravel())
    for _ in range(3):
        hand.tick()
    moved = hand.eval("X_WG").translation() - before
    assert 0.8 * 0.1 * 2 * CONTROL_PERIOD < moved @ RING[0] < 0.1 * 4 * CONTROL_PERIOD
    hand.fix(f_T_W=np.zeros(3 * N))
    for seconds, phase in ((0.0, GraspPhase.APPROACH), (MEETING + 0.1, GraspPhase.TRACK)):
        hand.advance(seconds)
        command = hand.eval("command")
        assert hand.array("grasp_report")[0] == phase
        np.testing.assert_allclose(command.p_WE - X_WO.translation(), moved, atol=1e-9)
        np.testing.assert_array_equal(command.V_WE, 0.0)
        np.testing.assert_array_equal(command.p_WO, X_WO.translation())
    np.testing.assert_array_equal(command.p_WG, command.p_WE)


def test_pads_that_touch_beside_their_middles_do_not_move_the_frame_across_their_way():
    """Normals at their middles lean to one side, and both pads touch before these do."""
    ways, X_WO = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]), RigidTransform([0.0, 0.0, 0.05])
    pads, beside = [Fingertip(radius=RADIUS, patch_radius=0.02)] * 2, np.array([0.0, 0.012, 0.0])
    hand = sequencer_over(
        X_WO,
        make_sequencer(fingertips=pads),
        contacts=np.concatenate([0.05 * ways + beside, ways, [1.0, 1.0]], axis=None),
        p_WT=np.zeros(6),
        f_T_W=np.zeros(6),
    )

    def tips(gap):
        return (X_WO @ ((0.05 + RADIUS + gap) * ways + beside).T).T.ravel()

    hand.fix(close=[1.0], p_WT=tips(SETTINGS.standoff))
    hand.advance(MEETING + 0.1)
    for _ in range(100):
        if (gap := hand.eval("command").standoffs[0]) <= 0.002:
            break
        hand.fix(p_WT=tips(gap))
        hand.tick()
    assert hand.array("grasp_report")[0] == GraspPhase.CLOSE
    hand.fix(p_WT=tips(0.001), f_T_W=(-1.2 * SETTINGS.touch_force * ways).ravel())
    for _ in range(100):
        hand.tick()
        np.testing.assert_allclose(hand.eval("X_WG").translation()[:2], 0.0, atol=1e-4)


@pytest.mark.parametrize("strain", [0.5, 4.0])
def test_the_touch_leaves_no_strain_that_could_slide_the_object(strain):
    """Fingertips rest beside and below their goals: G gives way to all but a share of friction."""
    X_WO = RigidTransform([0.0, 0.0, 0.05])
    strained = strain * SLACK
    strain = RigidTransform([strained, 0.0, -4e-4])
    hand = sequencer_over(X_WO)
    close_until_touch(hand, X_WO)
    met = tips_at(strain @ X_WO, 0.0)
    hand.fix(p_WT=met, f_T_W=-3 * SETTINGS.touch_force * RING.ravel())
    hand.advance(0.1)
    for _ in range(round((SETTINGS.squeeze_duration - 0.1) / CONTROL_PERIOD)):
        put_tips(hand, met.reshape(N, 3))
        hand.tick()
    assert hand.array("grasp_report")[0] == GraspPhase.SQUEEZE
    X_WG, standoffs = hand.eval("X_WG"), hand.eval("command").standoffs
    goals = (X_WG @ ((0.05 + RADIUS + standoffs)[:, None] * RING).T).T
    left = np.mean(met.reshape(-1, 3) - goals, axis=0)
    np.testing.assert_allclose(left[1:], 0, atol=5e-5)
    assert abs(left[0]) <= min(strained, SLACK) + 1e-12
    np.testing.assert_allclose(X_WG.rotation().matrix(), np.eye(3), atol=1e-3)
    np.testing.assert_allclose(hand.eval("command").V_WG, 0, atol=5e-3)


def test_fingers_that_only_yield_do_not_move_the_frame():
    """Their forces are in balance, so that they are beside their goals without a push."""
    X_WO, aside = RigidTransform([0.0, 0.0, 0.05]), np.array([0.01, 0.0, 0.0])
    hand = sequencer_over(X_WO)
    close_until_touch(hand, X_WO)
    hand.fix(f_T_W=-3 * SETTINGS.touch_force * RING.ravel())
    hand.advance(0.1)
    assert hand.array("grasp_report")[0] == GraspPhase.SQUEEZE
    place = hand.eval("X_WG").translation().copy()
    for _ in range(10):
        tips = hand.inputs["p_WT"].reshape(N, 3) + aside / 10
        hand.fix(p_WT=tips.ravel(), f_T_W=hand.eval("command").f_T_W.ravel())
        hand.tick()
    np.testing.assert_allclose(hand.eval("X_WG").translation(), place, atol=1e-9)


def test_in_the_air_the_frame_falls_on_from_closing_to_the_lift_and_then_stops():
    start, v, fall = np.array([0.0, 0.0, 3.0]), np.array([1.5, 0.2, 1.0]), np.array([0, 0, -9.81])
    X_WO = RigidTransform(start)
    config = GraspConfig(period=0.004, stop_duration=0.5, squeeze_duration=0.1)
    hand = sequencer_over(X_WO, make_sequencer(config, gravity=9.81))
    hand.fix(close=[1.0], V_WO_estimated=SpatialVelocity(np.zeros(3), v))
    closing, speeds = None, []
    while (phase := hand.array("grasp_report")[0]) < GraspPhase.LIFT:
        command, X_WG = hand.eval("command"), hand.eval("X_WG")
        if phase >= GraspPhase.CLOSE:
            closing = hand.context.get_time() if closing is None else closing
            t = hand.context.get_time() - closing
            expected = start + t * v + t * t / 2 * fall
            np.testing.assert_allclose(X_WG.translation(), expected, atol=1e-9)
        speeds.append(command.V_WG[1])
        gap = max(0.0, float(command.standoffs[0]))
        presses = 3.0 * (gap == 0 or phase == GraspPhase.SQUEEZE)
        hand.fix(p_WT=tips_at(X_WG, gap), f_T_W=-presses * RING.ravel())
        hand.tick()
        assert hand.context.get_time() < 5.0
    first, since = hand.eval("X_WG").translation().copy(), hand.context.get_time()
    lift = 6 * config.lift_height / config.lift_duration**2 * np.array([0.0, 0.0, 1.0])
    for after, stops in ((0.3, True), (0.7, False)):
        hand.advance(after - (hand.context.get_time() - since))
        load = 0.4 * (-fall + lift - stops * speeds[-1] / config.stop_duration)
        np.testing.assert_allclose(hand.eval("command").f_T_W.sum(axis=0), load, atol=0.1)
    # From the speed v it stops within v²/2a, along v.
    hand.advance(config.lift_duration)
    stopped = hand.eval("X_WG").translation() - [0.0, 0.0, config.lift_height]
    np.testing.assert_allclose(stopped - first, speeds[-1] * config.stop_duration / 2, atol=0.07)


def test_in_the_air_a_frame_that_spins_falls_with_its_centre_of_mass():
    p_OCoM, fall = np.array([0.0, 0.0, 0.04]), np.array([0.0, 0.0, -9.81])
    V_WO = SpatialVelocity([6.0, 0.0, 0.0], [1.0, 0.0, 2.0])
    v_CoM = V_WO.translational() + np.cross(V_WO.rotational(), p_OCoM)
    X_WO = RigidTransform([0.0, 0.0, 3.0])
    sequencer = make_sequencer(GraspConfig(period=0.004), p_OCoM=p_OCoM, gravity=9.81)
    hand = sequencer_over(X_WO, sequencer)
    hand.fix(close=[1.0], V_WO_estimated=V_WO)
    closing, t = None, 0.0
    while t < 0.2:
        X_WG, now = hand.eval("X_WG"), hand.context.get_time()
        if hand.array("grasp_report")[0] >= GraspPhase.CLOSE:
            closing = now if closing is None else closing
            t = now - closing
            CoM = X_WO @ p_OCoM + t * v_CoM + t * t / 2 * fall
            np.testing.assert_allclose(X_WG @ p_OCoM, CoM, atol=1e-9)
        gap = max(0.005, float(hand.eval("command").standoffs[0]))
        hand.fix(p_WT=tips_at(X_WG, gap))
        hand.tick()
    assert hand.array("grasp_report")[0] == GraspPhase.CLOSE


def test_the_frame_does_not_jump_to_the_estimate_as_the_squeeze_begins():
    X_WO, way = RigidTransform([0.0, 0.0, 0.05]), np.array([0.0, 0.0, 0.0015])
    hand = sequencer_over(X_WO)
    close_until_touch(hand, X_WO)
    hand.fix(X_WO_estimated=RigidTransform(way) @ X_WO, f_T_W=-RING.ravel())
    places, phases = [hand.eval("X_WG").translation().copy()], set()
    for _ in range(6):
        hand.tick()
        phases.add(hand.array("grasp_report")[0])
        places.append(hand.eval("X_WG").translation().copy())
    assert phases == {GraspPhase.CLOSE, GraspPhase.SQUEEZE}
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert np.max(steps) < 0.1 * np.linalg.norm(way)


def test_from_the_lift_on_fingers_press_against_turns_of_the_object():
    X_WO, angle = RigidTransform([0.0, 0.0, 0.05]), 1e-3
    active, k = np.arange(N) < N - 1, 200.0 + 100.0 * np.arange(N)
    hand = squeeze_at(X_WO, make_sequencer(least_stiffness=k), active)
    turn = RigidTransform(RotationMatrix.MakeXRotation(angle), np.zeros(3))
    way = np.cross([angle, 0.0, 0.0], (0.05 + RADIUS) * RING)
    mean = k[active] @ way[active] / np.sum(k[active])
    phases, forces = set(), {}
    while hand.context.get_time() < 8:
        X_WG, command = hand.eval("X_WG"), hand.eval("command")
        np.testing.assert_array_equal(command.p_WE, command.p_WG)
        for name, X in (("straight", X_WG), ("turned", X_WG @ turn)):
            hand.fix(p_WT=tips_at(X, 0.0))
            forces[name] = hand.eval("command").f_T_W
        phases.add(phase := hand.array("grasp_report")[0])
        moved = way if phase == GraspPhase.HOLD else way - mean
        springs = -holding_gain(CONTROL_PERIOD) * (active * k)[:, None] * moved
        np.testing.assert_allclose(forces["turned"] - forces["straight"], springs, atol=1e-4)
        hand.fix(p_WT=tips_at(X_WG, 0.0))
        hand.tick()
    assert phases == {GraspPhase.LIFT, GraspPhase.HOLD}


@pytest.mark.parametrize(
    ("feels", "gap", "reason"),
    [
        (1.0, 0.0, GiveUp.NONE),
        (0.0, 0.0, GiveUp.LOST_TOUCH),
        (1.0, 0.02, GiveUp.LOST_TOUCH),  # What it feels is something else.
    ],
)
def test_a_finger_that_feels_the_object_beside_its_tip_has_not_lost_touch(feels, gap, reason):
    X_WO = RigidTransform([0.0, 0.0, 0.05])
    hand = squeeze_at(X_WO)
    while hand.array("grasp_report")[0] < GraspPhase.HOLD:
        hand.fix(p_WT=tips_at(hand.eval("X_WG"), 0.0))
        hand.tick()
    X_WG, along = hand.eval("X_WG"), feels * np.cross(RING[0], [0.0, 0.0, 1.0])
    first = (np.arange(N) == 0)[:, None]
    f_GT = np.where(first, along, -RING)
    gaps = np.where(first, gap, 0.0)
    p_GT = (0.05 + RADIUS + gaps) * RING
    hand.fix(p_WT=(X_WG @ p_GT.T).T.ravel(), f_T_W=(f_GT @ X_WG.rotation().matrix().T).ravel())
    hand.advance(0.2)
    assert hand.array("grasp_report")[2] == reason


def test_a_finger_that_was_not_measured_as_the_lift_ended_leaves_the_forces_finite():
    X_WO = RigidTransform([0.0, 0.0, 0.05])
    hand = squeeze_at(X_WO)
    while hand.array("grasp_report")[0] == GraspPhase.LIFT:
        p_WT = tips_at(hand.eval("X_WG"), 0.0)
        hand.fix(p_WT=np.where(np.arange(3 * N) < 3, np.nan, p_WT))
        hand.tick()
    assert hand.array("grasp_report")[0] == GraspPhase.HOLD
    hand.fix(p_WT=tips_at(hand.eval("X_WG"), 0.0))
    assert np.isfinite(hand.eval("command").f_T_W).all()


def test_in_the_hold_fingers_keep_the_object_where_it_was_lifted_to():
    """Four fingers hold it. In the lift, it sags by 1 mm."""
    X_WO, way = RigidTransform([0.0, 0.0, 0.05]), np.array([0.001, -0.002, 0.0005])
    active = np.arange(N) < N - 1
    hand, moved = squeeze_at(X_WO, active=active), RigidTransform(way)
    forces = {}
    while hand.context.get_time() < 8:
        phase = hand.array("grasp_report")[0]
        sag = RigidTransform([0.0, 0.0, -0.001 * (phase >= GraspPhase.LIFT)])
        X_WG = sag @ hand.eval("X_WG")
        for name, X in (("resting", X_WG), ("moved", moved @ X_WG)):
            hand.fix(p_WT=tips_at(X, 0.0))
            forces[name] = hand.eval("command").f_T_W
        pushes = forces["moved"] - forces["resting"]
        holds = phase == GraspPhase.HOLD
        springs = np.outer(active, -holding_gain(CONTROL_PERIOD) * STIFFNESS * way)
        np.testing.assert_allclose(pushes, holds * springs, atol=1e-6)
        hand.fix(p_WT=tips_at(X_WG, 0.0))
        hand.tick()
    assert phase == GraspPhase.HOLD
    load = [0.0, 0.0, 0.4 * (9.81 + SETTINGS.lift_acceleration)]  # Nothing against the sag.
    np.testing.assert_allclose(np.sum(forces["resting"], axis=0), load, atol=0.01)
    p_WT = tips_at(moved @ X_WG, 0.0)
    p_WT[:3] = np.nan  # What is not measured exerts nothing, and the others hold.
    hand.fix(p_WT=p_WT)
    pushes = hand.eval("command").f_T_W - forces["resting"]
    np.testing.assert_allclose(pushes[0], 0, atol=1e-6)
    np.testing.assert_allclose(pushes[1:], springs[1:], atol=1e-6)
