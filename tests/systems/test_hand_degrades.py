"""For any inputs, the commands of the hand's systems are finite and within limits."""

import made_systems
import numpy as np
import pytest
from broken_values import NO_POSES, broken_values, spoiled_wall

from drake_pregrasp import GraspConfig, Obstacles, TrackingStatus
from drake_pregrasp.grasping.grasp_state import GiveUp, GraspPhase


def test_tips_never_outrun_their_speed_and_come_back():
    player = made_systems.driven("shaper")
    player.tick(40)
    settled = before = player.array("p_GT")
    rng = np.random.default_rng(4)
    for _ in range(60):
        port = rng.choice([p for p in player.inputs if p != "command"])
        choices = [*broken_values(player.inputs[port])]
        player.fix(**{port: choices[rng.integers(len(choices))]})
        player.tick()
        player.fix(**{port: player.inputs[port]})
        p_GT = player.array("p_GT")
        steps = np.linalg.norm((p_GT - before).reshape(-1, 3), axis=1)
        assert np.max(steps) <= GraspConfig().goal_speed * made_systems.CONTROL_PERIOD + 1e-12
        before = p_GT
    player.tick(60)
    np.testing.assert_allclose(player.array("p_GT"), settled, atol=1e-5)


@pytest.mark.parametrize("status", [TrackingStatus.LOST, TrackingStatus.WAITING, np.nan])
def test_a_lost_object_gets_no_new_contacts(status):
    sequencer = made_systems.driven("sequencer")
    for now, is_tracked in ((status, False), (TrackingStatus.COASTING, True)):
        sequencer.fix(tracking_status=[float(now)])
        assert sequencer.eval("command").is_tracked == is_tracked
    player = made_systems.driven("shaper")
    player.tick(40)
    contacts = player.array("contacts")
    player.fix(
        command=made_systems.grasp_command(made_systems.X_G, is_tracked=False),
        fingertip_targets=made_systems.bus(made_systems.ring(0.07), made_systems.RING),
    )
    player.tick(20)
    np.testing.assert_array_equal(player.array("contacts"), contacts)
    player.fix(command=made_systems.grasp_command(made_systems.X_G))
    player.tick(2)
    assert not np.allclose(player.array("contacts"), contacts, atol=1e-3)


def test_tips_stay_where_an_obstacle_may_be_anywhere():
    player = made_systems.driven("shaper")
    player.tick(2)
    before = player.array("p_GT")
    player.fix(contact_status=np.zeros(made_systems.N), obstacles=spoiled_wall(np.nan))
    player.tick(5)
    np.testing.assert_array_equal(player.array("p_GT"), before)
    player.fix(obstacles=Obstacles())
    player.tick(5)
    assert not np.allclose(player.array("p_GT"), before)


def phase(player):
    return GraspPhase(int(player.eval("grasp_report")[0]))


@pytest.fixture
def tracking_hand():
    player = made_systems.driven("sequencer")
    player.fix(f_T_W=np.zeros(3 * made_systems.N))  # Not at the object, fingertips feel nothing.
    player.tick(int(made_systems.VALUES["approach"][0][0] / made_systems.CONTROL_PERIOD) + 2)
    assert phase(player) == GraspPhase.TRACK
    player.fix(close=[1.0])
    return player


@pytest.mark.parametrize(
    ("port", "value"),
    [
        ("tracking_status", [float(TrackingStatus.LOST)]),
        ("tracking_status", [float(TrackingStatus.WAITING)]),
        ("X_WO_estimated", NO_POSES[0]),
    ],
)
def test_a_hand_closes_on_nothing_that_it_does_not_see(tracking_hand, port, value):
    tracking_hand.fix(**{port: value})
    tracking_hand.tick(int(3 * made_systems.SETTINGS.gate_limit / made_systems.CONTROL_PERIOD))
    assert phase(tracking_hand) == GraspPhase.TRACK
    assert tracking_hand.eval("grasp_report")[2] == GiveUp.OBJECT_UNSEEN
    tracking_hand.fix(**{port: tracking_hand.inputs[port]})
    tracking_hand.tick(2)
    assert phase(tracking_hand) == GraspPhase.CLOSE
    tracking_hand.fix(**{port: value})
    tracking_hand.tick(2)
    assert phase(tracking_hand) == GraspPhase.BACK_OFF
    tracking_hand.tick(int(1.0 / made_systems.CONTROL_PERIOD))
    standoffs = tracking_hand.eval("command").standoffs
    np.testing.assert_allclose(standoffs, made_systems.SETTINGS.standoff)


def test_a_hand_does_not_close_with_fingers_that_are_nowhere(tracking_hand):
    p_WT = tracking_hand.inputs["p_WT"].copy()
    p_WT[:9] = np.nan
    tracking_hand.fix(p_WT=p_WT)
    tracking_hand.tick(int(1.2 * made_systems.SETTINGS.gate_limit / made_systems.CONTROL_PERIOD))
    assert phase(tracking_hand) == GraspPhase.BACK_OFF
    assert tracking_hand.eval("grasp_report")[2] == GiveUp.TOO_FEW_FINGERS


@pytest.mark.parametrize("asked", [False, True])
def test_an_unknown_command_changes_nothing(tracking_hand, asked):
    if asked:
        tracking_hand.tick(2)
    tracking_hand.fix(close=[np.nan])
    tracking_hand.tick(2)
    assert phase(tracking_hand) == (GraspPhase.CLOSE if asked else GraspPhase.TRACK)


def test_an_unknown_pose_is_the_last_one():
    player = made_systems.driven("sequencer")
    player.tick(100)
    last = player.array("X_WG")
    player.fix(X_WO_estimated=NO_POSES[0])
    player.tick(2)
    np.testing.assert_allclose(player.array("X_WG"), last, atol=1e-12)
    np.testing.assert_allclose(player.eval("command").R_WO, last[:, :3], atol=1e-12)


def test_what_fingers_feel_is_unknown_where_their_joints_are():
    sensor = made_systems.driven("fingertip sensor")
    sensor.fix(hand_state=np.full(2 * made_systems.NQ, np.nan))
    assert np.all(np.isnan(sensor.numbers()))
    sensor.tick(2)
    assert np.all(np.isnan(sensor.numbers()))
    sensor.fix(hand_state=np.zeros(2 * made_systems.NQ))
    sensor.tick(4)
    assert np.all(np.isfinite(sensor.numbers()))


def test_contacts_without_a_place_do_not_count():
    monitor = made_systems.driven("monitor")
    monitor.fix(contact_status=[1.0, 1, 1, 1, 0])
    four = monitor.numbers()
    monitor.fix(
        contact_status=np.ones(made_systems.N), p_WC=np.append(monitor.inputs["p_WC"][:-1], np.nan)
    )
    np.testing.assert_allclose(monitor.numbers(), four, atol=1e-12)
