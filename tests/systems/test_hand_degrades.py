"""Whatever comes to the hand's systems, what they command is finite and within their limits."""

import numpy as np
import pytest
from made_systems import (
    CONTROL_PERIOD,
    FRAMES,
    HAND,
    NQ,
    RADIUS,
    RING,
    SETTINGS,
    Driven,
    N,
    bus,
    make_arm,
    make_carrier,
    make_reference,
    make_sequencer,
    make_shaper,
    points_of,
)
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.framework import BusValue

from drake_pregrasp import (
    FingertipSensor,
    GraspConfig,
    GraspQualityMonitor,
    HalfSpace,
    InvalidArgumentError,
    Obstacles,
    TrackingStatus,
)
from drake_pregrasp.config.planner_config import MeasuresConfig
from drake_pregrasp.grasping.grasp_state import GiveUp, GraspPhase

BAD_NUMBERS = [np.nan, np.inf, -np.inf, 1e300]
NO_POSE = RigidTransform(RotationMatrix.MakeUnchecked(np.full((3, 3), np.nan)), np.zeros(3))
FAR = RigidTransform([1e300, 0.0, np.nan])
SKEW = RigidTransform(RotationMatrix.MakeUnchecked(np.ones((3, 3))), np.zeros(3))


def velocity(number):
    return SpatialVelocity(w=[0.0, number, 0.0], v=[number, 0.0, 0.0])


def mutated(spoil):
    obstacles = Obstacles((HalfSpace(np.array([0.0, 0, -9]), np.array([0.0, 0, 1])),))
    spoil(obstacles.solids[0])
    return AbstractValue.Make(obstacles)


ON_SURFACE = 0.05 * RING
X_G = RigidTransform([0.3, -0.2, 0.1])
INPUTS = {
    "shaper": {
        "fingertip_targets": bus((X_G @ ON_SURFACE.T).T, RING),
        "contact_status": np.ones(N),
        "X_WO_estimated": X_G,
        "X_WG": X_G,
        "V_WG": velocity(0.01),
        "standoffs": np.full(N, 0.02),
        "hold_contacts": [0.0],
        "X_WU": X_G,
        "fingers_hold": np.zeros(N),
        "tracking_status": [1.0],
    },
    "sequencer": {
        "close": [0.0],
        "contact_status": np.ones(N),
        "contact_frames": np.concatenate([ON_SURFACE, RING]).ravel(),
        "X_WO_estimated": X_G,
        "V_WO_estimated": velocity(0.01),
        "p_WT": (X_G @ ((0.05 + RADIUS + 0.02) * RING).T).T.ravel(),
        "f_T_W": np.zeros(3 * N),
        "tracking_status": [1.0],
    },
    "carrier": {
        "tip_goals": bus((X_G @ (0.08 * RING).T).T, RING),
        "X_WG": X_G,
        "V_WG": velocity(0.01),
        "X_WO_estimated": X_G,
    },
    "reference": {"commanded_velocity": np.full(NQ, 0.1), "f_T_W": np.ones(3 * N)},
    "monitor": {"p_WC": (X_G @ ON_SURFACE.T).T.ravel(), "X_WO": X_G, "contact_status": np.ones(N)},
}
INPUTS["arm"] = INPUTS["carrier"]


MAKERS = {
    "shaper": lambda s: make_shaper(lead=0.03, target_period=CONTROL_PERIOD),
    "sequencer": lambda s: make_sequencer(),
    "carrier": lambda s: make_carrier(np.zeros(NQ)),
    "reference": lambda s: make_reference(),
    "monitor": lambda s: GraspQualityMonitor(
        MeasuresConfig(contact_model="hard_finger"), surface=s, num_contacts=N
    ),
    "arm": lambda s: make_arm(p_WG=X_G.translation()),
}


def make(name, surface):
    return Driven(MAKERS[name](surface), **INPUTS[name])


def spoiled(value, number):
    """Yields what a port may get instead of a sound value."""
    if isinstance(value, RigidTransform):
        yield from (NO_POSE, FAR, SKEW)
    elif isinstance(value, SpatialVelocity):
        yield velocity(number)
    elif isinstance(value, BusValue):
        points = points_of(value)
        points[2, 1] = number
        yield bus(points, RING)
        yield BusValue()
    else:
        for index in {0, len(value) - 1}:
            one = np.array(value, dtype=float)
            one[index] = number
            yield one
        yield np.full(len(value), number)


@pytest.mark.parametrize("number", BAD_NUMBERS)
@pytest.mark.parametrize("name", INPUTS)
def test_outputs_are_finite_whatever_comes(surface, name, number):
    player = make(name, surface)
    player.tick(2)
    for port, sound in INPUTS[name].items():
        for value in spoiled(sound, number):
            player.fix(**{port: value})
            assert np.all(np.isfinite(player.numbers())), port
            player.tick(2)
            assert np.all(np.isfinite(player.numbers())), port
        player.fix(**{port: sound})
        player.tick()
        assert np.all(np.isfinite(player.numbers())), port


def test_tips_never_outrun_their_speed_and_come_back(surface):
    player = make("shaper", surface)
    player.tick(40)
    settled = np.array(player.eval("p_GT"))
    rng = np.random.default_rng(4)
    before = settled
    for _ in range(60):
        port = rng.choice([p for p in INPUTS["shaper"] if p != "standoffs"])
        choices = [*spoiled(INPUTS["shaper"][port], rng.choice(BAD_NUMBERS))]
        player.fix(**{port: choices[rng.integers(len(choices))]})
        player.tick()
        player.fix(**{port: INPUTS["shaper"][port]})
        p_GT = np.array(player.eval("p_GT"))
        steps = np.linalg.norm((p_GT - before).reshape(-1, 3), axis=1)
        assert np.max(steps) <= GraspConfig().goal_speed * CONTROL_PERIOD + 1e-12
        before = p_GT
    player.tick(60)
    np.testing.assert_allclose(player.eval("p_GT"), settled, atol=1e-9)


@pytest.mark.parametrize("status", [TrackingStatus.LOST, TrackingStatus.WAITING, np.nan])
def test_a_lost_object_gets_no_new_contacts(surface, status):
    player = make("shaper", surface)
    player.tick(40)
    contacts = np.array(player.eval("contact_frames"))
    off = bus((X_G @ (0.07 * RING).T).T, RING)
    player.fix(tracking_status=[float(status)])
    player.fix(fingertip_targets=off)
    player.tick(20)
    np.testing.assert_array_equal(player.eval("contact_frames"), contacts)
    player.fix(tracking_status=[float(TrackingStatus.COASTING)])
    player.tick(2)
    assert not np.allclose(player.eval("contact_frames"), contacts, atol=1e-3)


def test_tips_stay_where_an_obstacle_may_be_anywhere(surface):
    player = make("shaper", surface)
    player.tick(2)
    before = np.array(player.eval("p_GT"))
    player.fix(contact_status=np.zeros(N))
    lost = mutated(lambda solid: solid.point.__setitem__(2, np.nan))
    player.fix(obstacles=lost)
    player.tick(5)
    np.testing.assert_array_equal(player.eval("p_GT"), before)
    player.fix(obstacles=mutated(lambda solid: None))
    player.tick(5)
    assert not np.allclose(player.eval("p_GT"), before)


@pytest.mark.parametrize(
    ("name", "port"),
    [("shaper", "fingertip_targets"), ("carrier", "tip_goals"), ("arm", "tip_goals")],
)
def test_an_entry_of_another_type_is_refused_by_the_ports_name(surface, name, port):
    wrong = BusValue()
    wrong.Set(FRAMES[0], AbstractValue.Make(3.0))
    player = make(name, surface)
    player.fix(**{port: wrong})
    with pytest.raises(InvalidArgumentError, match=f"port {port}"):
        player.tick()


def test_obstacles_of_another_type_are_refused_by_the_ports_name(surface):
    player = make("shaper", surface)
    player.fix(obstacles=AbstractValue.Make(object()))
    with pytest.raises(InvalidArgumentError, match="port obstacles"):
        player.tick()


def phase(player):
    return GraspPhase(int(player.eval("grasp_report")[0]))


def tracking_hand(surface):
    player = make("sequencer", surface)
    player.tick(int(SETTINGS.approach_duration / CONTROL_PERIOD) + 2)
    assert phase(player) == GraspPhase.TRACK
    player.fix(close=[1.0])
    return player


@pytest.mark.parametrize(
    ("port", "value"),
    [
        ("tracking_status", [float(TrackingStatus.LOST)]),
        ("tracking_status", [float(TrackingStatus.WAITING)]),
        ("X_WO_estimated", NO_POSE),
    ],
)
def test_a_hand_closes_on_nothing_that_it_does_not_see(surface, port, value):
    player = tracking_hand(surface)
    player.fix(**{port: value})
    player.tick(int(3 * SETTINGS.gate_limit / CONTROL_PERIOD))
    assert phase(player) == GraspPhase.TRACK
    assert player.eval("grasp_report")[2] == GiveUp.OBJECT_UNSEEN
    player.fix(**{port: INPUTS["sequencer"][port]})
    player.tick(2)
    assert phase(player) == GraspPhase.CLOSE
    player.fix(**{port: value})
    player.tick(2)
    assert phase(player) == GraspPhase.BACK_OFF
    player.tick(int(1.0 / CONTROL_PERIOD))
    np.testing.assert_allclose(player.eval("standoffs"), SETTINGS.standoff)


def test_a_hand_does_not_close_with_fingers_that_are_nowhere(surface):
    player = tracking_hand(surface)
    p_WT = INPUTS["sequencer"]["p_WT"].copy()
    p_WT[:9] = np.nan
    player.fix(p_WT=p_WT)
    player.tick(int(1.2 * SETTINGS.gate_limit / CONTROL_PERIOD))
    assert phase(player) == GraspPhase.BACK_OFF
    assert player.eval("grasp_report")[2] == GiveUp.TOO_FEW_FINGERS


@pytest.mark.parametrize("asked", [False, True])
def test_an_unknown_command_changes_nothing(surface, asked):
    player = tracking_hand(surface)
    if asked:
        player.tick(2)
    player.fix(close=[np.nan])
    player.tick(2)
    assert phase(player) == (GraspPhase.CLOSE if asked else GraspPhase.TRACK)


def test_an_unknown_pose_is_the_last_one(surface):
    for name, port, output in (
        ("sequencer", "X_WO_estimated", "X_WG"),
        ("carrier", "X_WO_estimated", "X_WH"),
        ("arm", "X_WO_estimated", "X_WU"),
    ):
        player = make(name, surface)
        player.tick(100)
        last = player.eval(output).GetAsMatrix34()
        player.fix(**{port: NO_POSE})
        player.tick(2)
        np.testing.assert_allclose(player.eval(output).GetAsMatrix34(), last, atol=1e-12)


@pytest.mark.parametrize("number", BAD_NUMBERS)
def test_a_reference_stays_where_velocities_are_not_known(surface, number):
    player = make("reference", surface)
    player.tick(5)
    player.fix(commanded_velocity=np.append(np.full(NQ - 1, 0.1), number))
    player.tick()
    q = np.array(player.eval("position"))
    player.tick(5)
    np.testing.assert_allclose(player.eval("position"), q, atol=1e-12)
    np.testing.assert_array_equal(player.eval("desired_state")[NQ:], 0)


def test_what_fingers_feel_is_unknown_where_their_joints_are():
    sensor = FingertipSensor(HAND.kinematics)
    context = sensor.CreateDefaultContext()
    sensor.GetInputPort("hand_state").FixValue(context, np.full(2 * NQ, np.nan))
    sensor.GetInputPort("net_actuation").FixValue(context, np.ones(NQ))
    assert np.all(np.isnan(sensor.GetOutputPort("p_WT").Eval(context)))
    assert np.all(np.isnan(sensor.GetOutputPort("f_T_W").Eval(context)))


def test_contacts_without_a_place_do_not_count(surface):
    player = make("monitor", surface)
    player.fix(contact_status=[1.0, 1, 1, 1, 0])
    four = np.array(player.eval("grasp_quality"))
    player.fix(contact_status=np.ones(N))
    p_WC = INPUTS["monitor"]["p_WC"].copy()
    p_WC[-1] = np.nan
    player.fix(p_WC=p_WC)
    np.testing.assert_allclose(player.eval("grasp_quality"), four, atol=1e-12)
