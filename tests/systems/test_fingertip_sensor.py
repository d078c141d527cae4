"""Kinematics of a hand, and the forces and positions that its fingertips measure."""

import itertools

import numpy as np
import pytest
from driven import Driven
from made_systems import FORCES, HAND, NQ, TIME_STEP, N, Q, joint_torques
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces
from pydrake.systems.analysis import Simulator

from drake_pregrasp import HandModel, InvalidArgumentError, load_hand, load_scenario, make_diagram
from drake_pregrasp.systems.fingertip_sensor import FingertipSensor
from drake_pregrasp.systems.hand_kinematics import HandKinematics

LONG = 0.3  # Seconds after which forces are no longer smoothed.


def resting_sensor(q, torques, hand=HAND.kinematics):
    """A sensor of a hand that has rested for long."""
    inputs = {"hand_state": np.append(q, 0 * q), "net_actuation": torques}
    sensor = Driven(FingertipSensor(hand, TIME_STEP), **inputs)
    sensor.advance(LONG)
    return sensor


def felt(sensor):
    return sensor.array("f_T_W").reshape(-1, 3)


def test_a_sensor_feels_what_fingers_press_with():
    sensor = resting_sensor(Q, joint_torques(FORCES))
    np.testing.assert_allclose(felt(sensor), FORCES, atol=1e-6)
    np.testing.assert_allclose(sensor.array("p_WT").reshape(N, 3), HAND.tips_at(Q), atol=1e-12)


@pytest.mark.parametrize("curl", [0.0, 1e-5, 1e-3, 0.03])
def test_a_stretched_finger_shows_no_force_that_its_torques_hide(curl):
    fingers = np.tile([0.0, 0.3, curl], N)
    q = np.append(np.zeros(4), fingers)  # The carrier comes first.
    torque = 0.02  # Of noise, in N m; a finger is 0.2 m long.
    sensor = resting_sensor(q, np.full(NQ, torque))
    assert np.max(np.linalg.norm(felt(sensor), axis=1)) < 3.0
    across = np.tile([0.0, 0.0, 0.0], (N, 1))
    across[0] = [0.0, 1.0, 0.0]  # The first finger hangs in the plane x-z.
    J = sensor.array("J_WT").reshape(N, 3, NQ)
    sensor = resting_sensor(q, np.einsum("nij,ni->j", J, across))
    np.testing.assert_allclose(felt(sensor), across, atol=1e-6)


def test_a_finger_of_one_joint_feels_the_force_along_its_motion_alone():
    gripper = HandModel(load_hand("package://drake_pregrasp/gripper.yaml"))
    q = gripper.home(np.array([0.1, -0.05, 0.05]), 0.4)
    pressed = FORCES[:2]
    J = gripper.kinematics.pose(q).J_WT
    torques = np.einsum("nij,ni->j", J, pressed)
    forces = felt(resting_sensor(q, torques, gripper.kinematics))
    line = np.array([np.cos(0.4), np.sin(0.4), 0.0])
    np.testing.assert_allclose(forces, np.outer(pressed @ line, line), atol=1e-6)


@pytest.mark.parametrize("limit", [HAND.kinematics.lower, HAND.kinematics.upper])
@pytest.mark.parametrize("torque", [-0.1, 0.1])
def test_a_joint_at_its_stop_shows_no_force(limit, torque):
    joint, others = HAND.kinematics.own_joints(2)[1], np.arange(N) != 2
    for share, shows in ((1.0, False), (0.9, True)):
        q = Q.copy()
        q[joint] += share * (limit[joint] - q[joint])
        sensor = resting_sensor(q, torque * (np.arange(NQ) == joint))
        assert np.any(felt(sensor)) == shows
        J = sensor.array("J_WT").reshape(N, 3, NQ)
        sensor.fix(net_actuation=np.einsum("nij,ni->j", J, FORCES))
        sensor.advance(LONG)
        np.testing.assert_allclose(felt(sensor)[others], FORCES[others], atol=1e-6)


def test_a_finger_at_a_stop_feels_the_least_force_that_its_other_joints_show():
    joint, q = HAND.kinematics.own_joints(2)[1], Q.copy()
    q[joint] = HAND.kinematics.upper[joint]
    free = np.setdiff1d(HAND.kinematics.own_joints(2), joint)
    J = HAND.kinematics.pose(q).J_WT[2]
    sensor = resting_sensor(q, J.T @ FORCES[2])
    expected = np.linalg.pinv(J[:, free].T) @ J[:, free].T @ FORCES[2]
    np.testing.assert_allclose(felt(sensor)[2], expected, atol=1e-6)


def test_what_a_stop_bore_is_not_felt_as_the_joint_leaves_it():
    joint, q = HAND.kinematics.own_joints(2)[1], Q.copy()
    q[joint] = HAND.kinematics.upper[joint]
    sensor = resting_sensor(q, 0.5 * (np.arange(NQ) == joint))
    sensor.fix(net_actuation=np.zeros(NQ))
    sensor.advance(TIME_STEP)
    sensor.fix(hand_state=np.append(Q, 0 * Q))
    sensor.advance(TIME_STEP)
    assert np.max(np.abs(felt(sensor))) < 1e-6


def test_a_finger_whose_joints_are_all_at_their_stops_feels_nothing():
    q = HAND.kinematics.upper.copy()
    q[:4] = 0.0  # The carrier.
    np.testing.assert_array_equal(felt(resting_sensor(q, np.full(NQ, 0.1))), 0.0)


def test_the_stiffness_of_a_finger_is_the_inverse_of_its_compliance():
    hand = HAND.kinematics
    least = hand.least_stiffness(Q)
    for finger, stiffness in enumerate(hand.level_stiffness(Q)):
        own = hand.own_joints(finger)
        J = hand.pose(Q).J_WT[finger][:, own]
        compliance = J @ np.diag(1 / hand.stiffness[own]) @ J.T
        assert 1 / stiffness == pytest.approx(np.mean(np.linalg.eigvalsh(compliance[:2, :2])))
        assert 1 / least[finger] == pytest.approx(np.max(np.linalg.eigvalsh(compliance)))


def test_the_stiffness_of_a_finger_that_moves_up_and_down_only_is_finite(monkeypatch):
    pose = HAND.kinematics.pose(Q)
    upright = pose._replace(J_WT=pose.J_WT * [[0.0], [0.0], [1.0]])
    monkeypatch.setattr(HAND.kinematics, "pose", lambda q: upright)
    assert np.isfinite(HAND.kinematics.level_stiffness(Q)).all()


LINK = """<link name="{}"><inertial><mass value="1"/>
  <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>"""
JOINT = """<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/>
  <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="{}" velocity="1"/></joint>"""
DRIVE = """<transmission><type>transmission_interface/SimpleTransmission</type>
  <joint name="{0}"/><actuator name="{0}_drive">{1}</actuator></transmission>"""
GAINS = '<drake:controller_gains p="{}" d="1"/>'
NAMES = ["palm", "a", "b", "c"]
JOINTS = [JOINT.format(b, a, b, i) for i, (a, b) in enumerate(itertools.pairwise(NAMES), 1)]


def kinematics_of(drives):
    plant = MultibodyPlant(0.01)
    parts = "".join(
        [*map(LINK.format, NAMES), *JOINTS, *(DRIVE.format(*drive) for drive in drives)]
    )
    text = f'<robot name="hand" xmlns:drake="drake.mit.edu">{parts}</robot>'
    Parser(plant).AddModelsFromString(text, "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("palm"))
    plant.Finalize()
    return HandKinematics(plant, ["hand::c"])


def test_drives_may_come_in_any_order():
    hand = kinematics_of([(name, GAINS.format(ord(name))) for name in "cab"])
    np.testing.assert_array_equal(hand.stiffness, [ord(name) for name in "abc"])
    np.testing.assert_array_equal(hand.efforts, [1, 2, 3])


def test_a_joint_without_a_drive_is_named():
    with pytest.raises(InvalidArgumentError, match="joint b is not driven"):
        kinematics_of([("a", GAINS.format(1)), ("b", ""), ("c", GAINS.format(1))])


def test_a_model_instance_that_is_not_there_is_named():
    with pytest.raises(InvalidArgumentError, match="no model instance 'foot'"):
        HandKinematics(HAND.kinematics.plant, ["foot::tip"])


def moving_hand(forces, seconds):
    """A sensor of a hand that swings, whose fingertips press with constant forces."""
    hand, rng = HAND.kinematics, np.random.default_rng(2)
    sensor = Driven(
        FingertipSensor(hand, TIME_STEP), hand_state=np.zeros(2 * NQ), net_actuation=np.zeros(NQ)
    )
    plant, none = hand.plant, MultibodyForces(hand.plant)
    context = plant.CreateDefaultContext()
    q, v, phases = Q.copy(), np.zeros(NQ), rng.uniform(0, 2 * np.pi, NQ)
    for step in range(round(seconds / TIME_STEP)):
        change = 10.0 * TIME_STEP * np.cos(20.0 * step * TIME_STEP + phases)
        v = v + change
        q = q + TIME_STEP * v
        plant.SetPositionsAndVelocities(context, np.append(q, v))
        torques = plant.CalcInverseDynamics(context, change / TIME_STEP, none)
        torques += np.einsum("nij,ni->j", hand.pose(q).J_WT, forces)
        sensor.fix(net_actuation=torques)  # From the last measurement to this one.
        sensor.update()
        sensor.at(sensor.context.get_time() + TIME_STEP, hand_state=np.append(q, v))
    sensor.update()
    return sensor, torques


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_torques_that_accelerate_the_hand_are_no_forces_of_the_fingertips(share):
    sensor, torques = moving_hand(share * FORCES, 0.2)
    inertial = HAND.kinematics.tip_forces(sensor.array("J_WT").reshape(N, 3, NQ), torques)
    assert np.max(np.abs(inertial - share * FORCES)) > 0.2
    np.testing.assert_allclose(felt(sensor), share * FORCES, atol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("engine", "most"), [("drake", 0.01), ("mujoco", 0.1)])
def test_a_hand_that_follows_an_object_feels_nothing_before_it_touches(engine, most):
    if engine == "mujoco":
        pytest.importorskip("mujoco")
    scenario = load_scenario("grasp_five_finger", text=f"engine: {engine}")
    diagram = make_diagram(scenario)
    simulator = Simulator(diagram)
    sensor = diagram.GetSubsystemByName("hand_controller").GetSubsystemByName("fingertip_sensor")
    context = sensor.GetMyContextFromRoot(simulator.get_context())
    forces, inertial = [], []
    for time in np.arange(1.0, scenario.grasp.close_at, scenario.grasp.period):
        simulator.AdvanceTo(time)
        J_WT = sensor.GetOutputPort("J_WT").Eval(context).reshape(N, 3, NQ)
        torques = sensor.GetInputPort("net_actuation").Eval(context)
        forces.append(sensor.GetOutputPort("f_T_W").Eval(context))
        inertial.append(HAND.kinematics.tip_forces(J_WT, torques))
    assert np.max(np.abs(forces)) < most
    if engine == "drake":  # MuJoCo's drives have come to rest at the end of a tick.
        assert np.max(np.abs(inertial)) > 1.0


def test_measured_forces_follow_with_a_time_constant():
    sensor = resting_sensor(Q, np.zeros(NQ))
    sensor.fix(net_actuation=joint_torques(FORCES))
    sensor.tick()  # These torques are those from now on.
    before = sensor.context.get_time()
    for _ in range(8):
        sensor.tick()
        expected = 1 - np.exp((before - sensor.context.get_time()) / 0.01)
        np.testing.assert_allclose(felt(sensor), expected * FORCES, atol=1e-6)


def test_a_clock_that_is_set_back_makes_no_force():
    sensor = resting_sensor(Q, np.zeros(NQ))
    sensor.at(0.0, hand_state=np.append(Q, np.ones(NQ)))
    sensor.update()
    np.testing.assert_allclose(felt(sensor), 0, atol=1e-9)


@pytest.mark.parametrize("period", [0.0, -0.01, np.nan])
def test_a_sensor_needs_a_period(period):
    with pytest.raises(InvalidArgumentError, match="period must be greater than 0 s"):
        FingertipSensor(HAND.kinematics, period)
