"""The station: its ports by the names of model instances, and a grasp through them."""

import numpy as np
import pytest
from drake import (
    lcmt_allegro_command,
    lcmt_allegro_status,
    lcmt_iiwa_command,
    lcmt_iiwa_status,
    lcmt_panda_command,
    lcmt_panda_status,
    lcmt_scope,
)
from pydrake.lcm import DrakeLcm
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

import drake_pregrasp as dp
from drake_pregrasp.interfaces.lcm import POSE_CHANNEL, AddPoseSubscriber

JOINT_PORTS = ["position_measured", "velocity_estimated", "torque_measured", "position_commanded"]
INPUTS = ["X_WO_measured", "measurement_time", "close"]
OUTPUTS = ["grasp_report", "tracking_status", "X_WO_estimated", "X_WO", "query_object"]


def port_names(system):
    ports = [system.get_input_port(i) for i in range(system.num_input_ports())]
    others = [system.get_output_port(i) for i in range(system.num_output_ports())]
    return [port.get_name() for port in ports], [port.get_name() for port in others]


def sizes(station, name):
    return {station.GetOutputPort(f"{name}.{port}").size() for port in JOINT_PORTS}


def phase(station, context):
    report = station.GetOutputPort("grasp_report").Eval(station.GetMyContextFromRoot(context))
    return dp.GraspPhase(int(report[0]))


@pytest.mark.slow
@pytest.mark.usefixtures("allegro_panda")
def test_an_arm_and_its_hand_have_ports_of_their_own():
    station = dp.PregraspStation(dp.load_scenario("grasp_allegro_panda"))
    joints = [f"{name}.{port}" for name in ("panda", "allegro") for port in JOINT_PORTS]
    assert port_names(station) == (INPUTS, joints + OUTPUTS)
    assert (sizes(station, "panda"), sizes(station, "allegro")) == ({7}, {16})
    context = station.CreateDefaultContext()
    for name, q in station.initial.items():
        measured = station.GetOutputPort(f"{name}.position_measured").Eval(context)
        np.testing.assert_array_equal(measured, q)


@pytest.mark.slow
def test_a_grasp_through_the_ports_holds_the_object_and_commands_what_is_measured():
    builder = DiagramBuilder()
    station = builder.AddSystem(dp.PregraspStation(dp.load_scenario("grasp_five_finger")))
    close = builder.AddSystem(ConstantVectorSource([1.0]))
    builder.Connect(station.GetOutputPort("X_WO"), station.GetInputPort("X_WO_measured"))
    builder.Connect(close.get_output_port(), station.GetInputPort("close"))
    simulator = Simulator(builder.Build())
    assert phase(station, simulator.get_context()) is dp.GraspPhase.APPROACH
    simulator.AdvanceTo(5.0)
    assert phase(station, simulator.get_context()) is dp.GraspPhase.HOLD
    context = station.GetMyContextFromRoot(simulator.get_context())
    q, v, _, commanded = (station.GetOutputPort(f"hand.{p}").Eval(context) for p in JOINT_PORTS)
    np.testing.assert_allclose(q[:4], commanded[:4], atol=2e-3)  # Axes, which press on nothing.
    assert 0 < np.max(np.abs(v)) < 0.05
    X_WO = station.GetOutputPort("X_WO").Eval(context)
    X_WO_estimated = station.GetOutputPort("X_WO_estimated").Eval(context)
    assert X_WO_estimated.IsNearlyEqualTo(X_WO, 1e-3)


def test_a_scenario_without_a_hand_is_refused():
    with pytest.raises(dp.ScenarioError, match=r"hand.file: it is empty"):
        dp.PregraspStation(dp.load_scenario("a_base"))


TYPES = {
    "ALLEGRO": (lcmt_allegro_command, lcmt_allegro_status),
    "IIWA": (lcmt_iiwa_command, lcmt_iiwa_status),
    "PANDA": (lcmt_panda_command, lcmt_panda_status),
}
"""Types of the commands and the status of each driver."""


class Robot:
    """A simulated robot behind LCM, whose drivers know positions only."""

    def __init__(self, resolved, lcm, drivers, initial):
        self.lcm, self.period, ends = lcm, resolved.scenario.grasp.period, 0
        self.commanded = np.concatenate(list(initial.values()))
        self.last, self.places = self.commanded.copy(), {}
        for name, driver in drivers.items():
            self.places[driver] = slice(ends, ends := ends + len(initial[name]))
            lcm.Subscribe(f"{driver}_COMMAND", lambda data, d=driver: self.receive(d, data))
        grasp, scenario = resolved.scenario.grasp, resolved.scenario
        self.plant = dp.HandStation(
            scenario.object,
            scenario.motion,
            resolved.plant_config,
            resolved.hand.description,
            friction=grasp.friction,
            initial=self.commanded,
            yaw_range=grasp.yaw_range,
            X_WB=resolved.hand.X_WB,
        )
        self.simulator = Simulator(self.plant)
        self.context = self.simulator.get_mutable_context()
        self.drive()

    def receive(self, driver, data):
        command = TYPES[driver][0].decode(data)
        self.commanded[self.places[driver]] = command.joint_position

    def drive(self):
        """Arms differentiate their commands, as Drake's IiwaDriver does, and fingers do not."""
        v = (self.commanded - self.last) / self.period
        if "ALLEGRO" in self.places:
            v[self.places["ALLEGRO"]] = 0.0
        desired = np.append(self.commanded, v)
        self.plant.GetInputPort("desired_state").FixValue(self.context, desired)
        self.last = self.commanded.copy()

    def output(self, name):
        return self.plant.GetOutputPort(name).Eval(self.context)

    def send(self, tick):
        state = np.split(self.output("hand_state"), 2)
        for driver, i in self.places.items():
            q, v, torque = (x[i] for x in (*state, self.output("net_actuation")))
            message = TYPES[driver][1]()
            values = {
                "joint_position": q,
                "joint_position_measured": q,
                "joint_velocity": v,
                "joint_velocity_estimated": v,
                "joint_torque": torque,
                "joint_torque_measured": -torque,  # The sign of an iiwa.
                "joint_torque_commanded": torque,
            }
            message.num_joints = len(q)
            for field in message.__slots__:
                if field.startswith("joint_"):
                    setattr(message, field, values.get(field, np.zeros(len(q))).tolist())
            self.lcm.Publish(f"{driver}_STATUS", message.encode())
        X_WO, message = self.output("X_WO"), lcmt_scope()
        message.utime, message.size = tick + 1, 7
        message.value = [*X_WO.translation(), *X_WO.rotation().ToQuaternion().wxyz()]
        self.lcm.Publish(POSE_CHANNEL, message.encode())


def grasp_over_lcm(scenario, drivers, duration):
    """Returns a station as client of a robot, after a grasp, and the robot."""
    resolved, lcm, builder = dp.load_resolved(scenario), DrakeLcm("memq://"), DiagramBuilder()
    station = builder.AddSystem(dp.PregraspStation(resolved, lcm=lcm, drivers=drivers))
    poses = AddPoseSubscriber(builder, lcm)
    for name in ("X_WO_measured", "measurement_time"):
        builder.Connect(poses.GetOutputPort(name), station.GetInputPort(name))
    close = builder.AddSystem(ConstantVectorSource([1.0]))
    builder.Connect(close.get_output_port(), station.GetInputPort("close"))
    client, robot = Simulator(builder.Build()), Robot(resolved, lcm, drivers, station.initial)
    for tick in range(round(duration / robot.period)):
        robot.send(tick)
        lcm.HandleSubscriptions(0)
        client.AdvanceTo((tick + 1e-3) * robot.period)  # Sends what the tick commands.
        lcm.HandleSubscriptions(0)
        robot.drive()
        robot.simulator.AdvanceTo((tick + 1) * robot.period)
    return station, client.get_context(), robot


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "drivers", "duration"),
    [
        ("grasp_five_finger", {"hand": "ALLEGRO"}, 4.5),
        ("grasp_allegro_panda", {"panda": "PANDA", "allegro": "ALLEGRO"}, 5.5),
        ("grasp_allegro_panda", {"panda": "IIWA", "allegro": "ALLEGRO"}, 5.5),
    ],
)
def test_the_scenario_of_a_simulation_grasps_over_lcm(scenario, drivers, duration, request):
    if "panda" in drivers:
        request.getfixturevalue("allegro_panda")
    station, context, robot = grasp_over_lcm(scenario, drivers, duration)
    assert port_names(station)[1][-3:] == OUTPUTS[:3]  # The true pose is not known.
    assert phase(station, context) is dp.GraspPhase.HOLD
    lift = dp.load_scenario(scenario).grasp.lift_height
    start = dp.load_resolved(scenario).X_WO.translation()[2]
    assert robot.output("X_WO").translation()[2] - start == pytest.approx(lift, abs=3e-3)


@pytest.mark.parametrize("drivers", [None, {"arm": "IIWA"}, {"hand": "WSG"}])
def test_drivers_that_do_not_fit_are_refused(drivers):
    lcm = DrakeLcm("memq://")
    with pytest.raises(dp.InvalidArgumentError, match=r"drivers: |channel must start with"):
        dp.PregraspStation(dp.load_scenario("grasp_five_finger"), lcm=lcm, drivers=drivers)
