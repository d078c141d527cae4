"""The station: its ports by the names of model instances, and a grasp through them."""

import functools
import os
import re
import time

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
from pydrake.lcm import DrakeLcm, DrakeLcmParams
from pydrake.manipulation import ApplyDriverConfig, IiwaDriver
from pydrake.multibody.parsing import (
    LoadModelDirectivesFromString,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.lcm import ApplyLcmBusConfig
from pydrake.systems.primitives import ConstantVectorSource

import drake_pregrasp as dp
from drake_pregrasp.diagrams.hand_instances import HandInstances, set_default_positions
from drake_pregrasp.interfaces.lcm import POSE_CHANNEL, AddPoseSubscriber
from drake_pregrasp.robots.robot_models import robot_model
from drake_pregrasp.systems.hand_kinematics import hand_links
from drake_pregrasp.systems.hand_scene import separate_fingers

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


def send_pose(lcm, tick, X_WO):
    message = lcmt_scope()
    message.utime, message.size = tick + 1, 7
    message.value = [*X_WO.translation(), *X_WO.rotation().ToQuaternion().wxyz()]
    lcm.Publish(POSE_CHANNEL, message.encode())


class Robot:
    """A simulated robot behind LCM, whose drivers know positions only."""

    def __init__(self, resolved, lcm, drivers, initial):
        self.lcm, self.period, ends = lcm, resolved.scenario.grasp.period, 0
        self.commanded = np.concatenate(list(initial.values()))
        self.last, self.places = self.commanded.copy(), {}
        for name, driver in drivers.items():
            self.places[driver] = slice(ends, ends := ends + len(initial[name]))
            lcm.Subscribe(f"{driver}_COMMAND", lambda data, d=driver: self.receive(d, data))
        scenario = resolved.scenario
        self.plant = dp.HandStation(
            scenario.object,
            scenario.motion,
            resolved.plant_config,
            resolved.hand,
            friction=resolved.scenario.grasp.friction,
            initial=self.commanded,
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
        send_pose(self.lcm, tick, self.output("X_WO"))


def deliver(lcm, count):
    """Handles a number of messages, which come late where the machine is busy."""
    end = time.monotonic() + 1.0
    while count > 0 and time.monotonic() < end:
        count -= lcm.HandleSubscriptions(10)


def grasp_over_lcm(scenario, drivers, url="memq://", make_robot=Robot, text=None):
    """Returns a station as client of a robot, when it holds or after 8 s, and the robot."""
    resolved, lcm, builder = dp.load_resolved(scenario, text=text), DrakeLcm(url), DiagramBuilder()
    station = builder.AddSystem(dp.PregraspStation(resolved, lcm=lcm, drivers=drivers))
    poses = AddPoseSubscriber(builder, lcm)
    for name in ("X_WO_measured", "measurement_time"):
        builder.Connect(poses.GetOutputPort(name), station.GetInputPort(name))
    close = builder.AddSystem(ConstantVectorSource([1.0]))
    builder.Connect(close.get_output_port(), station.GetInputPort("close"))
    client, robot = Simulator(builder.Build()), make_robot(resolved, lcm, drivers, station.initial)
    for tick in range(round(8.0 / robot.period)):
        robot.send(tick)
        deliver(lcm, len(drivers) + 1)  # Their states and the pose.
        client.AdvanceTo((tick + 1e-3) * robot.period)  # Sends what the tick commands.
        deliver(lcm, sum(driver != "IIWA" for driver in drivers.values()))
        robot.drive()
        robot.simulator.AdvanceTo((tick + 1) * robot.period)
        if phase(station, client.get_context()) is dp.GraspPhase.HOLD:
            break
    return station, client.get_context(), robot


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "drivers"),
    [
        ("grasp_five_finger", {"hand": "ALLEGRO"}),
        ("grasp_allegro_panda", {"panda": "PANDA", "allegro": "ALLEGRO"}),
        ("grasp_allegro_panda", {"panda": "IIWA", "allegro": "ALLEGRO"}),
    ],
)
def test_the_scenario_of_a_simulation_grasps_over_lcm(scenario, drivers, request):
    if "panda" in drivers:
        request.getfixturevalue("allegro_panda")
    station, context, robot = grasp_over_lcm(scenario, drivers)
    assert port_names(station)[1][-3:] == OUTPUTS[:3]  # The true pose is not known.
    assert phase(station, context) is dp.GraspPhase.HOLD
    lift = dp.load_scenario(scenario).grasp.lift_height
    start = dp.load_resolved(scenario).X_WO.translation()[2]
    assert robot.output("X_WO").translation()[2] - start == pytest.approx(lift, abs=3e-3)


URL = f"udpm://239.255.76.67:{20_000 + os.getpid() % 20_000}?ttl=0"
"""Bus of a simulator with Drake's drivers, on this machine."""

ARM = """
directives:
- add_model: {{name: table, file: package://drake_pregrasp/table.sdf}}
- add_model: {{name: panda, file: {panda}}}
- add_model: {{name: allegro, file: {allegro}}}
- add_weld: {{parent: world, child: panda::panda_link0, X_PC: {{translation: [-0.55, 0, 0]}}}}
- add_weld:
    parent: panda::panda_link8
    child: allegro::palm_link
    X_PC: {{translation: [-0.02, 0.0, 0.045], rotation: !Rpy {{deg: [180, -90, 0]}}}}
"""


class HardwareSim:
    """A simulator as Drake's hardware_sim, with its IiwaDriver, and with a driver for fingers."""

    def __init__(self, resolved, lcm, drivers, initial, folder):
        self.lcm, self.period = lcm, resolved.scenario.grasp.period
        builder, self.commanded = DiagramBuilder(), initial["allegro"].copy()
        settings = MultibodyPlantConfig(time_step=0.001)
        self.plant, scene_graph = AddMultibodyPlant(settings, builder)
        dp.add_to_package_map(parser := Parser(self.plant))
        files = {"allegro": robot_model("robots://allegro_hand.urdf"), "panda": motorized(folder)}
        text = ARM.format(**{name: file.as_uri() for name, file in files.items()})
        models = ProcessModelDirectives(LoadModelDirectivesFromString(text), parser)
        by_name = {model.model_name: model for model in models}
        self.hand = by_name["allegro"].model_instance
        for name, q in initial.items():
            robot = HandInstances(self.plant, [by_name[name].model_instance])
            moving = [joint for joint in robot.joints() if joint.num_positions()]
            set_default_positions(moving, q)
        kinematics = resolved.hand.kinematics
        gains = zip(moving, kinematics.stiffness[-16:], kinematics.damping[-16:], strict=True)
        for joint, p, d in gains:
            drive = self.plant.AddJointActuator(joint.name(), joint, 0.9)
            drive.set_controller_gains(PdControllerGains(p=p, d=d))
            drive.set_default_rotor_inertia(5e-4)
        self.box = dp.add_object(self.plant, resolved.shape, 0.25, friction=0.7)
        self.plant.SetDefaultFloatingBaseBodyPose(self.box, resolved.X_WO)
        self.plant.Finalize()
        tips = resolved.hand.description.fingertips
        frames = [self.plant.GetFrameByName(tip.frame) for tip in tips]
        radii, inspector = [tip.radius for tip in tips], scene_graph.model_inspector()
        links = hand_links(self.plant, frames, radii, inspector)
        separate_fingers(scene_graph.collision_filter_manager(), links)
        buses = ApplyLcmBusConfig({"default": DrakeLcmParams(lcm_url=URL)}, builder)
        driver = IiwaDriver(hand_model_name="allegro", control_mode="position_only")
        ApplyDriverConfig(driver, "panda", self.plant, by_name, buses, builder)
        self.simulator = Simulator(builder.Build())
        root = self.simulator.get_mutable_context()
        self.context = self.plant.GetMyMutableContextFromRoot(root)
        lcm.Subscribe("ALLEGRO_COMMAND", self.receive)
        self.drive()

    def receive(self, data):
        self.commanded[:] = lcmt_allegro_command.decode(data).joint_position

    def drive(self):
        desired = np.append(self.commanded, np.zeros(16))
        self.plant.get_desired_state_input_port(self.hand).FixValue(self.context, desired)

    def send(self, tick):
        state = self.plant.get_state_output_port(self.hand).Eval(self.context)
        torque = self.plant.get_net_actuation_output_port(self.hand).Eval(self.context)
        message = lcmt_allegro_status()
        message.num_joints = 16
        message.joint_position_measured, message.joint_velocity_estimated = np.split(state, 2)
        message.joint_position_commanded = self.commanded
        message.joint_torque_commanded = torque
        self.lcm.Publish("ALLEGRO_STATUS", message.encode())
        send_pose(self.lcm, tick, self.output("X_WO"))

    def output(self, _):
        return self.plant.EvalBodyPoseInWorld(self.context, self.box)


def motorized(folder):
    """Returns the Panda with transmissions, without which Drake drives no joint of a URDF."""
    model = robot_model("robots://panda.urdf")
    text = re.sub(
        r'filename="(?![/a-z]+:)([^"]+)"',
        lambda name: f'filename="{(model.parent / name[1]).as_uri()}"',
        model.read_text(encoding="utf-8"),
    )
    drives = "".join(
        f'<transmission name="t{i}"><type>transmission_interface/SimpleTransmission</type>'
        f'<joint name="panda_joint{i}"/><actuator name="a{i}"/></transmission>'
        for i in range(1, 8)
    )
    file = folder / "panda.urdf"
    file.write_text(text.replace("</robot>", f"{drives}</robot>"), encoding="utf-8")
    return file


@pytest.mark.slow
@pytest.mark.usefixtures("allegro_panda")
def test_the_station_is_a_client_of_the_iiwa_driver_of_hardware_sim(tmp_path):
    drivers = {"panda": "IIWA", "allegro": "ALLEGRO"}
    make_robot = functools.partial(HardwareSim, folder=tmp_path)
    # The driver's arm follows late and swings, by which fingers in the air feel up to 0.36 N.
    text = "{grasp: {touch_force: 0.4}}"
    station, context, robot = grasp_over_lcm("grasp_allegro_panda", drivers, URL, make_robot, text)
    assert phase(station, context) is dp.GraspPhase.HOLD
    start = dp.load_resolved("grasp_allegro_panda").X_WO.translation()[2]
    assert robot.output("X_WO").translation()[2] - start == pytest.approx(0.1, abs=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("drivers", [None, {"arm": "IIWA"}, {"hand": "WSG"}])
def test_drivers_that_do_not_fit_are_refused(drivers):
    lcm = DrakeLcm("memq://")
    with pytest.raises(dp.InvalidArgumentError, match=r"drivers: |channel must start with"):
        dp.PregraspStation(dp.load_scenario("grasp_five_finger"), lcm=lcm, drivers=drivers)
