"""The hand's systems, each by itself: what they measure, carry, and command."""

import numpy as np
import pytest
from driven import Driven
from made_systems import (
    AROUND,
    CONTROL_PERIOD,
    HAND,
    RADIUS,
    SETTINGS,
    bus,
    make_carrier,
    make_reference,
    make_sequencer,
    make_shaper,
    points_of,
)
from made_systems import RING as UNIT_RING
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from drake_pregrasp import BallSolid, HalfSpace, InvalidArgumentError, Obstacles
from drake_pregrasp.contacts.assignment import FREE_TURN, palm_turn, wrapped
from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.systems.fingertip_sensor import FingertipSensor, HandKinematics
from drake_pregrasp.systems.joint_reference import LARGEST_RATE

Q = HAND.home(np.array([0.1, -0.05, 0.05]), 0.4) + 0.05 * np.sin(np.arange(19))
PERIOD = CONTROL_PERIOD
STILL = SpatialVelocity.Zero()
RING = 0.079 * UNIT_RING


def jacobians(q):
    plant = HAND.kinematics.plant
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    return HAND.kinematics.tip_jacobians(context)


def test_a_sensor_feels_what_fingers_press_with():
    f_T_W = np.random.default_rng(1).normal(size=(5, 3))
    torques = np.einsum("nij,ni->j", jacobians(Q), f_T_W)
    sensor = Driven(FingertipSensor(HAND.kinematics))
    sensor.fix(hand_state=np.concatenate([Q, 0 * Q]), net_actuation=torques)
    np.testing.assert_allclose(sensor.array("f_T_W").reshape(5, 3), f_T_W, atol=1e-6)
    np.testing.assert_allclose(sensor.array("p_WT").reshape(5, 3), HAND.tips_at(Q), atol=1e-12)


def test_a_reference_moves_steadily_between_ticks():
    v = np.linspace(-0.2, 0.2, 19)
    reference = Driven(make_reference(Q), commanded_velocity=v)
    reference.advance(PERIOD / 2)  # The first tick is over.
    for time in (0.03, 0.04, 0.047, 0.06):
        reference.advance(time - reference.context.get_time())
        q = reference.array("position")
        np.testing.assert_allclose(q, Q + v * time, atol=1e-12)
        desired = reference.array("desired_state")
        np.testing.assert_allclose(desired, np.concatenate([q, v]), atol=1e-12)


def test_a_reference_stays_within_limits_and_rates():
    reference = Driven(make_reference(Q), commanded_velocity=100.0 * np.eye(19)[5])
    reference.tick()
    assert reference.array("desired_state")[19 + 5] == LARGEST_RATE
    reference.advance(1.0)
    assert reference.array("position")[5] == HAND.kinematics.upper[5]
    assert reference.array("desired_state")[19 + 5] == 0


def test_a_reference_presses_by_its_stiffness():
    f_T_W = np.random.default_rng(2).normal(size=(5, 3))
    reference = Driven(make_reference(Q), f_T_W=f_T_W.ravel())
    torques = HAND.kinematics.stiffness * (reference.array("desired_state")[:19] - Q)
    np.testing.assert_allclose(torques, np.einsum("nij,ni->j", jacobians(Q), f_T_W), atol=1e-9)


LIMITED = (-0.5, 0.3)


def posture_over(p_WG=(0.0, 0.0, 0.0), V_WG=STILL, **changes):
    """A carrier's posture over a point, with goals on the ring."""
    system = make_carrier(carrier=HAND.base.joints, **changes)
    X_WG = RigidTransform(np.array(p_WG))
    return Driven(system, X_WG=X_WG, V_WG=V_WG, tip_goals=bus(RING + p_WG))


def turned(angle):
    return RING @ RotationMatrix.MakeZRotation(angle).matrix().T


def test_a_palm_turns_with_the_goals_on_and_on():
    posture = posture_over()
    for index, angle in enumerate(np.arange(0.0, 13.0, 0.3)):
        p_WG = np.array([0.01 * index, 0.0, 0.1])
        posture.fix(X_WG=RigidTransform(p_WG), tip_goals=bus(turned(angle) + p_WG))
        posture.simulator.AdvanceTo(index * PERIOD + 1e-3)
        nominal = posture.array("nominal_posture")
        assert nominal[3] == pytest.approx(angle)
        np.testing.assert_allclose(nominal[:3] - [0, 0, 0.155], p_WG, atol=1e-12)


def test_a_palm_that_lags_by_its_gain_is_asked_to_be_ahead():
    posture = posture_over(V_WG=SpatialVelocity(w=[0, 0, 0.2], v=[0.04, 0.02, 0.0]), gain=4.0)
    nominal = posture.array("nominal_posture")
    np.testing.assert_allclose(nominal[:4], [0.01, 0.005, 0.155, 0.05], atol=1e-12)


def test_a_palm_of_limited_range_stays_in_it_and_comes_back_the_other_way_round():
    posture = posture_over(yaw_range=LIMITED)
    yaws = []
    for index, angle in enumerate(np.arange(0.0, 2 * np.pi, 0.2)):
        posture.fix(tip_goals=bus(turned(angle)))
        posture.simulator.AdvanceTo(index * PERIOD + 1e-3)
        yaws.append(posture.array("nominal_posture")[3])
    assert (min(yaws), max(yaws)) == LIMITED
    assert yaws[-1] == pytest.approx(6.2 - 2 * np.pi)


@pytest.mark.parametrize(("yaw_range", "expected"), [(LIMITED, -0.1), (FREE_TURN, 0.4)])
def test_the_hand_is_over_the_object_and_turned_as_its_palm_or_in_the_middle(yaw_range, expected):
    p_WG = np.array([0.3, 0.2, 0.5])
    posture = posture_over(p_WG, yaw_range=yaw_range)
    posture.fix(tip_goals=bus(turned(0.4) + p_WG))
    X_WO = RigidTransform(RotationMatrix.MakeXRotation(0.2), [0.3, 0.2, 0.1])
    posture.fix(X_WO_estimated=X_WO)
    posture.advance(PERIOD + 1e-3)
    for port, turn in (("X_WH", expected), ("X_WU", np.clip(0.4, *yaw_range))):
        expected_pose = RigidTransform(RotationMatrix.MakeZRotation(turn), [0.3, 0.2, 0.1])
        assert posture.eval(port).IsNearlyEqualTo(expected_pose, 1e-9)


@pytest.mark.parametrize(("name", "value"), [("period", 0.0), ("gain", -1.0), ("gain", np.nan)])
def test_a_posture_needs_a_period_and_a_gain(name, value):
    with pytest.raises(InvalidArgumentError, match=f"{name} must be greater than 0 .*{value}"):
        make_carrier(**{name: value})


class Shaper(Driven):
    """A shaper around a cube with goals on a ring, at which inputs can be changed."""

    def __init__(self, contacts, **more):
        table = HalfSpace(np.array([0, 0, -0.05]), np.array([0, 0, 1.0]))
        super().__init__(make_shaper(fixed=[table], **more))
        self.fix(contact_status=np.full(5, float(ContactStatus.ACTIVE)))
        self.fix(X_WO_estimated=RigidTransform(), X_WG=RigidTransform())
        self.fix(V_WG=SpatialVelocity.Zero())
        self.contacts(contacts)

    def contacts(self, contacts):
        points, normals = zip(*contacts, strict=True)
        self.fix(fingertip_targets=bus(points, normals))

    def goals(self, seconds):
        self.advance(seconds)
        return points_of(self.eval("tip_goals"))


X, Y = [1, 0, 0], [0, 1, 0]
CONTACTS = [
    ([0.05, -0.01, 0.0], X),
    ([0.02, 0.05, 0.0], Y),
    ([-0.03, 0.05, 0.02], Y),
    ([-0.05, -0.02, 0.0], [-1, 0, 0]),
    ([0.0, -0.05, 0.01], [0, -1, 0]),
]
POINTS, NORMALS = (np.array(column, dtype=float) for column in zip(*CONTACTS, strict=True))


def test_goals_come_to_stand_off_their_contacts():
    goals = Shaper(CONTACTS, standoff=0.02).goals(1.0)
    np.testing.assert_allclose(goals, POINTS + 0.029 * NORMALS, atol=1e-9)


def test_goals_are_carried_ahead_with_the_frame():
    shaper = Shaper(CONTACTS, lead=0.03)
    still = shaper.goals(1.0)
    R = RotationMatrix.MakeZRotation(0.3).matrix()
    shaper.fix(X_WG=RigidTransform(RotationMatrix(R), [0.1, 0.2, 0.3]))
    shaper.fix(V_WG=SpatialVelocity(w=[0, 0, 0.5], v=[0.05, 0, 0]))
    ahead = RotationMatrix.MakeZRotation(0.3 + 0.015).matrix()
    expected = still @ ahead.T + [0.1 + 0.0015, 0.2, 0.3]
    np.testing.assert_allclose(shaper.goals(0.0), expected, atol=1e-12)


def test_held_contacts_stay_when_goals_move_on():
    shaper = Shaper(CONTACTS)
    before = shaper.goals(1.0)
    shaper.fix(hold_contacts=[1.0])
    shaper.contacts([([0.05, 0.04, 0.03], X), *CONTACTS[1:]])
    shaper.fix(contact_status=np.array([1.0, 1, 1, 1, ContactStatus.OBSTRUCTED]))
    np.testing.assert_allclose(shaper.goals(0.5), before, atol=1e-9)
    shaper.fix(standoffs=np.array([-0.001, 0.02, 0.02, 0.02, 0.02]))
    pressed = shaper.goals(0.5)
    np.testing.assert_allclose(pressed[0] - before[0], [-0.021, 0, 0], atol=1e-9)


def test_fingers_without_a_contact_wait_above():
    shaper = Shaper(CONTACTS[:4])
    shaper.fix(contact_status=np.array([1.0, 1, 1, 1, ContactStatus.LOST]))
    goals = shaper.goals(2.0)
    assert goals[4, 2] >= 0.05 + RADIUS + 0.02 - 1e-9
    np.testing.assert_allclose(goals[:4], (POINTS + 0.029 * NORMALS)[:4], atol=1e-9)


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
def test_fingers_without_a_contact_wait_at_their_own_azimuths_in_the_hand(yaw):
    shaper = Shaper(CONTACTS)
    shaper.fix(contact_status=np.full(5, float(ContactStatus.OUT_OF_REACH)))
    X_WG = RigidTransform(RotationMatrix.MakeZRotation(1.1), [0.2, 0.1, 0.3])
    shaper.fix(X_WG=X_WG)
    shaper.fix(X_WU=RigidTransform(RotationMatrix.MakeZRotation(yaw), [0.2, 0.1, 0.05]))
    goals = shaper.goals(3.0)
    away = goals - X_WG.translation()
    azimuths = np.arctan2(away[:, 1], away[:, 0])
    np.testing.assert_allclose(wrapped(azimuths - AROUND - yaw), 0, atol=1e-6)
    np.testing.assert_allclose(away[:, 2], 0.05 + RADIUS + 0.02, atol=1e-9)


def test_a_tip_on_the_axis_has_a_way_out():
    p_GT = 1.2 * RING
    p_GT[2] = [0.0, 0.0, 0.2]
    system = make_shaper(p_GT=p_GT)
    frames = system.GetOutputPort("contact_frames").Eval(system.CreateDefaultContext())
    np.testing.assert_allclose(frames.reshape(2, 5, 3)[1, 2], RING[2] / 0.079, atol=1e-12)


def test_a_contact_without_room_is_shifted_along_the_surface_only():
    normal = np.array([0.8, 0.0, -0.6])
    point = np.array([0.05, -0.01, -0.04])
    shaper = Shaper([(point, normal), *CONTACTS[1:]])
    shaper.advance(1.0)
    contacts, normals = shaper.array("contact_frames").reshape(2, 5, 3)
    shift = contacts[0] - point
    assert np.linalg.norm(shift) > 1e-3
    assert shift @ normal == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(normals[0], normal, atol=1e-9)


def test_a_contact_too_low_for_a_tip_is_shifted_up():
    low = [([0.05, -0.01, -0.049], X), *CONTACTS[1:]]
    shaper = Shaper(low)
    goals = shaper.goals(1.0)
    assert goals[0, 2] == pytest.approx(-0.05 + RADIUS + 0.004)
    frames = shaper.array("contact_frames").reshape(2, 5, 3)
    np.testing.assert_allclose(frames[0, 0], [0.05, -0.01, goals[0, 2]], atol=1e-9)
    shaper.fix(hold_contacts=[1.0])
    np.testing.assert_allclose(shaper.goals(0.5), goals, atol=1e-9)


def test_obstacles_push_goals_away_but_not_what_is_held():
    shaper = Shaper(CONTACTS)
    before = shaper.goals(1.0)
    ball = BallSolid(before[0] + [0.0, 0.03, 0.0], 0.02)
    shaper.fix(obstacles=AbstractValue.Make(Obstacles((ball,))))
    pushed = shaper.goals(0.5)
    assert ball.distance(pushed)[0] >= RADIUS + 0.004 - 1e-6
    frames = shaper.array("contact_frames")
    shaper.fix(hold_contacts=[1.0])
    nearer = BallSolid(before[0] + [0.0, 0.01, 0.0], 0.02)
    shaper.fix(obstacles=AbstractValue.Make(Obstacles((nearer,))))
    held_goals = shaper.goals(0.5)
    contacts, normals = frames.reshape(2, 5, 3)
    np.testing.assert_allclose(held_goals, contacts + 0.029 * normals, atol=1e-9)
    held = shaper.array("contact_frames")
    np.testing.assert_array_equal(held, frames)


@pytest.mark.parametrize("let_go", [0, 3])
def test_fingers_that_have_let_go_heed_obstacles_again(let_go):
    shaper = Shaper(CONTACTS)
    before = shaper.goals(1.0)
    shaper.fix(hold_contacts=[1.0])
    holds = np.ones(5)
    holds[let_go] = 0
    shaper.fix(fingers_hold=holds)
    walls = tuple(BallSolid(p + np.array([0.0, 0.0, 0.02]), 0.015) for p in before)
    shaper.fix(obstacles=AbstractValue.Make(Obstacles(walls)))
    goals = shaper.goals(0.5)
    gaps = np.array([wall.distance(goals[i : i + 1])[0] for i, wall in enumerate(walls)])
    assert gaps[let_go] >= RADIUS + 0.004 - 1e-6
    np.testing.assert_allclose(np.delete(goals, let_go, 0), np.delete(before, let_go, 0))


def test_a_palm_of_limited_range_goes_to_its_goals_whoever_is_withdrawn():
    shaper, posture = Shaper(CONTACTS), posture_over(yaw_range=LIMITED)
    turn = RotationMatrix.MakeZRotation(0.25).matrix()
    shaper.contacts([(0.6 * p @ turn.T, turn @ p / 0.079) for p in RING])
    shaper.fix(contact_status=np.array([1.0, 1, 1, ContactStatus.LOST, ContactStatus.LOST]))
    posture.fix(X_WO_estimated=RigidTransform())
    for _ in range(200):
        shaper.fix(X_WU=posture.eval("X_WU"))
        goals = shaper.goals(PERIOD)
        posture.fix(tip_goals=bus(goals))
        yaw = posture.array("nominal_posture")[3]
        posture.context.SetDiscreteState(0, [yaw])
    assert yaw == pytest.approx(palm_turn(goals[:3], AROUND[:3], 0.0), abs=1e-3)
    aside = np.arctan2(goals[3:, 1], goals[3:, 0]) - AROUND[3:] - yaw
    np.testing.assert_allclose(wrapped(aside), 0, atol=1e-3)


def sequencer_over(X_WO):
    return Driven(
        make_sequencer(),
        close=[0.0],
        contact_status=np.ones(5),
        contact_frames=np.concatenate([POINTS, NORMALS]).ravel(),
        X_WO_estimated=X_WO,
        V_WO_estimated=SpatialVelocity(w=[0, 0, 0.1], v=[0.05, 0, 0]),
        p_WT=(X_WO @ (POINTS + RADIUS * NORMALS).T).T.ravel(),
        f_T_W=np.zeros(15),
    )


def test_fingers_hold_from_closing_until_they_let_go():
    hand = sequencer_over(X_WO=RigidTransform([0.0, 0.0, 0.05]))
    felt = np.zeros((5, 3))
    felt[0] = -2 * SETTINGS.touch_force * NORMALS[0]
    for inputs, seconds, holding in (
        ({}, SETTINGS.approach_duration + 0.1, [0] * 5),
        ({"f_T_W": felt.ravel(), "close": [1.0]}, SETTINGS.gate_limit + 0.1, [1] * 5),
        ({"close": [0.0]}, PERIOD, [1, 0, 0, 0, 0]),
        ({}, SETTINGS.squeeze_duration, [0] * 5),
    ):
        hand.fix(**inputs)
        hand.advance(seconds)
        np.testing.assert_array_equal(hand.array("fingers_hold"), holding)
    assert hand.array("hold_contacts")[0] == 1


def test_who_has_touched_keeps_touching_and_all_together_carry_the_weight():
    R_WO = RotationMatrix.MakeXRotation(0.3)
    hand = sequencer_over(RigidTransform(R_WO, [0.0, 0.0, 0.05]))
    normals_W = NORMALS @ R_WO.matrix().T
    hand.fix(close=[1.0])
    hand.fix(V_WO_estimated=SpatialVelocity.Zero())
    felt = np.zeros((5, 3))
    felt[0] = -2 * SETTINGS.touch_force * normals_W[0]
    hand.fix(f_T_W=felt.ravel())
    hand.simulator.AdvanceTo(SETTINGS.approach_duration + SETTINGS.gate_limit + 0.1)
    forces = hand.array("squeeze_forces").reshape(5, 3)
    np.testing.assert_allclose(forces[0], -SETTINGS.touch_force * normals_W[0], atol=1e-12)
    np.testing.assert_array_equal(forces[1:], 0)
    hand.fix(f_T_W=(-normals_W).ravel())
    hand.advance(SETTINGS.squeeze_duration + 0.1)
    forces = hand.array("squeeze_forces").reshape(5, 3)
    np.testing.assert_allclose(forces.sum(axis=0), [0, 0, 0.4 * 9.81], atol=0.01)
    assert np.min(-np.sum(forces * normals_W, axis=1)) >= SETTINGS.least_force - 1e-3


def test_the_carried_frame_comes_down_to_the_object():
    X_WO = RigidTransform(RotationMatrix.MakeZRotation(0.3), [0.1, 0.0, 0.05])
    hand = sequencer_over(X_WO)
    heights, speeds = [], []
    for time in np.arange(0.0, 2.0, 0.1):
        hand.simulator.AdvanceTo(time)
        X_WG = hand.eval("X_WG")
        np.testing.assert_array_equal(X_WG.rotation().matrix(), X_WO.rotation().matrix())
        heights.append(X_WG.translation()[2] - 0.05)
        speeds.append(hand.eval("V_WG").translational()[2])
    assert heights[0] == pytest.approx(SETTINGS.approach_height)
    assert heights[-1] == pytest.approx(0)
    assert np.all(np.diff(heights) <= 1e-12)
    np.testing.assert_allclose(speeds[1:-1], np.gradient(heights, 0.1)[1:-1], atol=0.01)


HAND_OF_TWO = """
<robot name="hand">
  <link name="palm"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0"
    izz="1"/></inertial></link>
  <link name="a"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0"
    izz="1"/></inertial></link>
  <link name="b"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0"
    izz="1"/></inertial></link>
  <joint name="j1" type="revolute"><parent link="palm"/><child link="a"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="j2" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  %s
</robot>
"""


def drive(joint, gains):
    gains = '<drake:controller_gains p="1" d="1"/>' if gains else ""
    return (
        "<transmission><type>transmission_interface/SimpleTransmission</type>"
        f'<joint name="{joint}"/><actuator name="{joint}_drive">{gains}</actuator></transmission>'
    )


@pytest.mark.parametrize(
    ("drives", "message"),
    [
        ([("j1", True), ("j2", False)], "joint j2 isn't driven"),
        ([("j2", True), ("j1", True)], "j1_drive must come in the order of the joints"),
    ],
)
def test_joints_must_be_driven_in_their_order(drives, message):
    plant = MultibodyPlant(0.01)
    text = HAND_OF_TWO % "".join(drive(*one) for one in drives)
    text = text.replace('<robot name="hand">', '<robot name="hand" xmlns:drake="drake.mit.edu">')
    Parser(plant).AddModelsFromString(text, "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("palm"))
    plant.Finalize()
    with pytest.raises(InvalidArgumentError, match=message):
        HandKinematics(plant, ["hand::b"])


def test_a_model_instance_that_is_not_there_is_named():
    plant = HAND.kinematics.plant
    with pytest.raises(InvalidArgumentError, match="no model instance 'foot'"):
        HandKinematics(plant, ["foot::tip"])
