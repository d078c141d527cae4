"""Messages over LCM: poses in, commands out, and the watchdog. Nothing leaves this machine."""

import os
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from drake import lcmt_allegro_command, lcmt_iiwa_status, lcmt_panda_command, lcmt_scope
from pydrake.lcm import DrakeLcm
from pydrake.manipulation import PandaCommandReceiver, PandaControlMode
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.lcm import LcmSubscriberSystem
from pydrake.systems.primitives import (
    ConstantVectorSource,
    LogVectorOutput,
    TrajectorySource,
    ZeroOrderHold,
)
from pydrake.trajectories import PiecewisePolynomial

from drake_pregrasp import AddPregraspPlanner, InvalidArgumentError, PlannerConfig, box_surface
from drake_pregrasp.interfaces.lcm import (
    ALLEGRO_CHANNEL,
    PANDA_CHANNEL,
    POSE_CHANNEL,
    AddCommandPublisher,
    AddPoseSubscriber,
    run_lcm_loop,
)
from drake_pregrasp.interfaces.lcm_status import AddStatusSubscriber

PERIOD = 0.01
INITIAL = np.array([0.0, 0.5, -0.5])
DESIRED = np.array([0.1, 0.5, -1.5, 3.0, 3.0, 3.0])  # Positions, then velocities.
P_OC = np.array([[0.05, 0.0, 0.0], [-0.05, 0.01, 0.0], [-0.05, -0.01, 0.02]])


def send_pose(lcm, utime, x, quaternion=(1.0, 0.0, 0.0, 0.0)):
    message = lcmt_scope()
    message.utime, message.value = utime, [x, 0.0, 0.05, *quaternion]
    message.size = len(message.value)
    lcm.Publish(POSE_CHANNEL, message.encode())


class Loop:
    """A planner between two LCM channels; the first of three joints is not the driver's."""

    def __init__(self, lcm, channel, **options):
        self.lcm, builder = lcm, DiagramBuilder()
        self.poses = AddPoseSubscriber(builder, lcm)
        surface = box_surface([0.1, 0.1, 0.1], spacing=0.02)
        config = PlannerConfig(period=PERIOD, static_duration=0.0)
        planner = AddPregraspPlanner(builder, config, surface, P_OC)
        for name in ("X_WO_measured", "measurement_time"):
            builder.Connect(self.poses.GetOutputPort(name), planner.GetInputPort(name))
        self.sender = AddCommandPublisher(
            builder, lcm, channel, [1, 2], INITIAL, period=PERIOD, **options
        )
        wanted = builder.AddSystem(ConstantVectorSource(DESIRED))
        builder.Connect(wanted.get_output_port(), self.sender.GetInputPort("desired_state"))
        age = planner.GetOutputPort("time_since_measurement")
        builder.Connect(age, self.sender.GetInputPort("time_since_measurement"))
        self.ages = LogVectorOutput(age, builder, PERIOD)
        self.driver = None
        if channel == PANDA_CHANNEL:
            modes = PandaControlMode
            mode = modes.kVelocity if options.get("velocity") else modes.kPosition
            self.driver = builder.AddSystem(PandaCommandReceiver(2, mode))
            wire = LcmSubscriberSystem.Make(channel, lcmt_panda_command, lcm, True)
            builder.AddSystem(wire)
            builder.Connect(wire.get_output_port(), self.driver.get_message_input_port())
            if mode == modes.kPosition:
                measured = builder.AddSystem(ConstantVectorSource([9.0, 9.0]))
                port = self.driver.get_position_measured_input_port()
                builder.Connect(measured.get_output_port(), port)
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.simulator.Initialize()

    def advance(self, ticks):
        for _ in range(ticks):
            self.lcm.HandleSubscriptions(0)
            self.simulator.AdvanceTo(self.simulator.get_context().get_time() + PERIOD)
        self.lcm.HandleSubscriptions(0)

    def value(self, system, port):
        return system.GetOutputPort(port).Eval(
            system.GetMyContextFromRoot(self.simulator.get_context())
        )


@pytest.fixture
def lcm():
    return DrakeLcm("memq://")


def test_poses_of_messages_are_measured_when_they_come(lcm):
    loop = Loop(lcm, ALLEGRO_CHANNEL)
    loop.advance(3)
    assert loop.value(loop.poses, "measurement_time") == -np.inf
    send_pose(lcm, 7, 0.25, (0.0, 0.0, 0.0, 1.001))  # A few digits are enough.
    loop.advance(3)
    X_WO = loop.value(loop.poses, "X_WO_measured")
    np.testing.assert_array_equal(X_WO.translation(), [0.25, 0.0, 0.05])
    np.testing.assert_allclose(X_WO.rotation().matrix(), np.diag([-1.0, -1.0, 1.0]), atol=1e-15)
    assert 0.02 < loop.value(loop.poses, "measurement_time")[0] < 0.05
    for bad in ((0.0, 0.0, 0.0, 0.0), (np.nan, 0.0, 0.0, 1.0), (1e200,) * 4, (1.0, 0.0)):
        send_pose(lcm, 8, 0.0, bad)
        loop.advance(1)
        assert np.all(np.isnan(loop.value(loop.poses, "X_WO_measured").translation()))
    send_pose(lcm, 9, 250.0)  # In millimetres.
    loop.advance(1)
    assert np.all(np.isnan(loop.value(loop.poses, "X_WO_measured").translation()))


def test_commands_are_drakes_and_wait_for_a_pose(lcm):
    received = []
    lcm.Subscribe(ALLEGRO_CHANNEL, lambda data: received.append(lcmt_allegro_command.decode(data)))
    loop = Loop(lcm, ALLEGRO_CHANNEL, max_speed=2.0)
    loop.advance(5)
    send_pose(lcm, 1, 0.0)
    loop.advance(3)
    now = time.time_ns() // 1000
    for command in received:
        assert (command.num_joints, command.num_torques) == (2, 0)
        assert 0 <= now - command.utime < 60e6
    positions = np.array([command.joint_position for command in received])
    moving = positions[:, 1] < INITIAL[2]
    assert not moving[:5].any()
    assert moving[-1]
    np.testing.assert_array_equal(positions[:, 0], DESIRED[1])
    assert np.abs(np.diff(positions, axis=0)).max() == pytest.approx(2.0 * PERIOD)


@pytest.mark.parametrize("velocity", [False, True])
def test_a_panda_stops_on_silence_and_goes_on_with_the_next_pose(lcm, velocity):
    loop = Loop(lcm, PANDA_CHANNEL, velocity=velocity, timeout=0.05, max_speed=1.0)
    port = "velocity" if velocity else "position"
    still = np.zeros(2)
    for round_ in range(2):
        for k in range(10):
            send_pose(lcm, 100 * round_ + k + 1, 0.001 * k)
            loop.advance(1)
        assert loop.value(loop.sender, "is_stopped") == 0
        moved = loop.value(loop.driver, port).copy()
        if velocity:
            np.testing.assert_allclose(moved, [0.0, -1.0])
        loop.advance(8)  # Silence.
        assert loop.value(loop.sender, "is_stopped") == 1
        held = loop.value(loop.driver, port).copy()
        loop.advance(5)
        np.testing.assert_array_equal(loop.value(loop.driver, port), held)
        if velocity:
            np.testing.assert_array_equal(held, still)
        else:  # It stops a timeout after the last pose.
            np.testing.assert_allclose(held, moved - [0.0, 0.05], atol=1.5 * PERIOD)
            assert held[1] > DESIRED[2]


def test_a_command_contains_what_its_tick_has_stored(lcm):
    received, builder = [], DiagramBuilder()
    lcm.Subscribe(ALLEGRO_CHANNEL, lambda data: received.append(lcmt_allegro_command.decode(data)))
    ramp = builder.AddSystem(
        TrajectorySource(PiecewisePolynomial.FirstOrderHold([0, 1], np.eye(2)))
    )
    hold = builder.AddSystem(ZeroOrderHold(PERIOD, 2))
    age = builder.AddSystem(ConstantVectorSource([1e-6]))
    sender = AddCommandPublisher(
        builder, lcm, ALLEGRO_CHANNEL, [0], [1.0], period=PERIOD, max_speed=9.0
    )
    builder.Connect(ramp.get_output_port(), hold.get_input_port())
    builder.Connect(hold.get_output_port(), sender.GetInputPort("desired_state"))
    builder.Connect(age.get_output_port(), sender.GetInputPort("time_since_measurement"))
    simulator = Simulator(builder.Build())
    for tick in range(20):
        simulator.AdvanceTo(tick * PERIOD + 1e-4)
        lcm.HandleSubscriptions(0)
    assert received[-1].joint_position[0] == pytest.approx(1 - 19 * PERIOD)


def test_another_channel_needs_a_driver(lcm):
    known = "start with ALLEGRO_COMMAND or IIWA_COMMAND or PANDA_COMMAND"
    with pytest.raises(InvalidArgumentError, match=known):
        AddCommandPublisher(DiagramBuilder(), lcm, "WSG_COMMAND", [0], INITIAL, period=PERIOD)
    AddCommandPublisher(DiagramBuilder(), lcm, "PANDA_COMMAND_LEFT", [0], INITIAL, period=PERIOD)


def test_a_status_that_cannot_be_used_leaves_the_last_one(lcm):
    builder = DiagramBuilder()
    receiver = AddStatusSubscriber(builder, lcm, "IIWA_STATUS", INITIAL[:2])
    simulator = Simulator(builder.Build())
    context, seen = receiver.GetMyContextFromRoot(simulator.get_context()), []
    for tick, q in enumerate(([], [0.1, 0.2], [0.3, np.nan], [0.4])):
        message = lcmt_iiwa_status()
        message.num_joints = len(q)
        for field in message.__slots__[2:]:
            setattr(message, field, list(q))
        lcm.Publish("IIWA_STATUS", message.encode())
        lcm.HandleSubscriptions(0)
        simulator.AdvanceTo((tick + 1) * PERIOD)
        ports = ("state_estimated", "torque_measured")
        seen.append([receiver.GetOutputPort(port).Eval(context).tolist() for port in ports])
    assert seen[0] == [[*INITIAL[:2], 0.0, 0.0], [0.0, 0.0]]
    assert seen[1:] == 3 * [[[0.1, 0.2, 0.1, 0.2], [-0.1, -0.2]]]


@pytest.mark.slow
def test_a_loop_on_this_machine_answers_each_pose():
    url = f"udpm://239.255.76.67:{20_000 + os.getpid() % 20_000}?ttl=0"
    loop, camera, answers = Loop(DrakeLcm(url), ALLEGRO_CHANNEL), DrakeLcm(url), []
    camera.Subscribe(ALLEGRO_CHANNEL, answers.append)

    def film():
        for k in range(50):
            send_pose(camera, k + 1, 0.001 * k)
            camera.HandleSubscriptions(0)
            time.sleep(PERIOD)

    thread = threading.Thread(target=film)
    thread.start()
    run_lcm_loop(loop.simulator, loop.lcm, period=PERIOD, duration=1.0)
    thread.join()
    camera.HandleSubscriptions(1000)  # If the loop was slower than the camera.
    assert loop.simulator.get_context().get_time() == pytest.approx(1.0, abs=2 * PERIOD)
    assert answers
    assert loop.value(loop.poses, "X_WO_measured").translation()[0] == pytest.approx(0.049)


class TimedCamera:
    """A bus that sends poses at the rate of ticks but at another phase, on a clock of its own."""

    def __init__(self, lcm, phase, period=PERIOD):
        self.lcm, self.phase, self.period, self.now, self.sent = lcm, phase, period, 0.0, 0

    def HandleSubscriptions(self, timeout_millis):
        due, latest = self.phase + self.sent * self.period, self.now + timeout_millis / 1000
        if due > latest:
            self.now = latest
            return 0
        self.now = max(self.now, due)
        self.sent += 1
        send_pose(self.lcm, self.sent, 0.0)
        return self.lcm.HandleSubscriptions(0)


def set_clock(monkeypatch, monotonic):
    clock = SimpleNamespace(monotonic=monotonic, time_ns=time.time_ns)
    monkeypatch.setattr("drake_pregrasp.interfaces.lcm.time", clock)


@pytest.mark.slow
@pytest.mark.parametrize("period", [PERIOD / 18, PERIOD / 50])
def test_a_flood_of_poses_does_not_change_the_clock(lcm, monkeypatch, caplog, period):
    loop, camera = Loop(lcm, ALLEGRO_CHANNEL), TimedCamera(lcm, 0.0, period)
    set_clock(monkeypatch, lambda: camera.now)
    run_lcm_loop(loop.simulator, camera, period=PERIOD, duration=1.0)
    assert camera.now == pytest.approx(1.0, rel=0.05)
    assert ("more than 20 in a tick" in caplog.text) == (period < PERIOD / 20)


GOOD = lcmt_scope()
GOOD.utime, GOOD.size, GOOD.value = 7, 7, [0.25, 0.0, 0.05, 1.0, 0.0, 0.0, 0.0]
ENCODED = GOOD.encode()
MALFORMED = [
    b"",
    b"\0" * 8,
    lcmt_allegro_command().encode(),
    ENCODED[:-1],
    ENCODED[:18],
    ENCODED[:16] + b"\xff" * 4 + ENCODED[20:],
    ENCODED[:16] + b"\x7f\xff\xff\xff" + ENCODED[20:],
]


def test_malformed_messages_are_ignored_and_counted(lcm, caplog):
    loop = Loop(lcm, ALLEGRO_CHANNEL)
    lcm.Publish(POSE_CHANNEL, ENCODED)
    loop.advance(2)
    for message in MALFORMED * 2:
        lcm.Publish(POSE_CHANNEL, message)
        loop.advance(1)
        assert loop.value(loop.poses, "X_WO_measured").translation()[0] == 0.25
    assert f"1 malformed messages on {POSE_CHANNEL}" in caplog.text
    assert "10 malformed messages" in caplog.text
    send_pose(lcm, 8, 0.26)
    loop.advance(1)
    assert loop.value(loop.poses, "X_WO_measured").translation()[0] == 0.26


def test_joints_stop_on_silence_even_if_simulated_time_lags(lcm, monkeypatch):
    now = [100.0]
    set_clock(monkeypatch, lambda: now[0])
    loop = Loop(lcm, ALLEGRO_CHANNEL, timeout=0.2)
    for k in range(10):
        now[0] += 10.0  # A slow machine, but each command has a new pose.
        send_pose(lcm, k + 1, 0.001 * k)
        loop.advance(1)
    assert loop.value(loop.sender, "is_stopped") == 0
    now[0] += 0.1
    loop.advance(2)
    assert loop.value(loop.sender, "is_stopped") == 0
    now[0] += 0.25
    loop.advance(1)
    assert loop.value(loop.sender, "is_stopped") == 1


@pytest.mark.parametrize("phase", [0.0001, 0.0051])
def test_ticks_run_when_poses_come(lcm, phase, monkeypatch):
    loop, camera = Loop(lcm, ALLEGRO_CHANNEL), TimedCamera(lcm, phase)
    set_clock(monkeypatch, lambda: camera.now)
    run_lcm_loop(loop.simulator, camera, period=PERIOD, duration=1.2)
    ages = loop.ages.FindLog(loop.simulator.get_context()).data()[0]
    assert len(ages) == pytest.approx(1.2 / PERIOD, abs=2)
    assert ages[80:].max() < 1.1e-3  # One wait for messages; then the pose is used at once.
    assert camera.sent == pytest.approx(len(ages), abs=2)
