"""A scenario's hand with its planner as one diagram, simulated or over LCM."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from pydrake.lcm import DrakeLcmInterface
from pydrake.systems.framework import Diagram, DiagramBuilder, System
from pydrake.systems.primitives import MatrixGain

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.diagrams.grasping_hand import GraspingHand
from drake_pregrasp.diagrams.hand_instances import add_selector
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.wiring import connect, export_inputs, export_outputs
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import resolve
from drake_pregrasp.simulation.simulation_diagram import (
    add_hand,
    add_hand_station,
    contact_weights_of,
)

# Ports of each model instance, in the order in which a selector has the values as inputs.
_JOINT_PORTS = ("position_measured", "velocity_estimated", "torque_measured", "position_commanded")


class PregraspStation(Diagram):
    """Plans and grasps with the hand of a scenario, in simulation or over LCM.

    .. pydrake_system::

        name: PregraspStation
        input_ports:
        - X_WO_measured
        - measurement_time
        - close
        output_ports:
        - NAME.position_measured
        - NAME.velocity_estimated
        - NAME.torque_measured
        - NAME.position_commanded
        - grasp_report
        - tracking_status
        - X_WO_estimated
        - X_WO
        - query_object

    NAME is that of a model instance, such as `panda` and `allegro` of `allegro_panda.yaml`; each
    has these four ports. Values are in the order of the joints in the plant.

    Port `X_WO_measured` accepts a `RigidTransform`: the measured pose of the object.

    Port `measurement_time` (optional) accepts a vector of 1, as `PoseEstimator` does.

    Port `close` accepts a vector of 1: the command to grasp, as `GraspSequencer` does.

    Port `NAME.position_measured` emits a vector: measured positions, in radians or metres.

    Port `NAME.velocity_estimated` emits a vector: velocities, in rad/s or m/s.

    Port `NAME.torque_measured` emits a vector: torques or forces of the actuators, in N m or N.

    Port `NAME.position_commanded` emits a vector: positions that the controller asks for.

    Port `grasp_report` emits a vector of 4, as `GraspSequencer` does: the phase first.

    Port `tracking_status` emits a vector of 1, as `PoseEstimator` does.

    Port `X_WO_estimated` emits a `RigidTransform`: the estimated pose of the object.

    Port `X_WO` emits a `RigidTransform`: the true pose of the object, in simulation only.

    Port `query_object` emits SceneGraph's `QueryObject` for visualizers, in simulation only.

    Over LCM, the station sends a command every `grasp.period`, stops on silence (`CommandSender`),
    and leaves `grasp.bump_force` out. Before the first status the joints are taken to be at
    `initial`: bring the robot there first.

    The attribute `initial` holds the initial positions of the joints by the names of the model
    instances.

    Args:
        scenario: Scenario with a hand. Over LCM, its object and motion tell where the object is
            expected and what it weighs.
        lcm: Bus of the robot's drivers; None for a simulation.
        drivers: Drivers of the model instances by their names: ALLEGRO, IIWA or PANDA. One listens
            to commands on the channel ALLEGRO_COMMAND, for example, and sends ALLEGRO_STATUS. An
            ALLEGRO must have the description's gains, and no desired velocity; fingers need it,
            because they press with position commands.

    Raises:
        ScenarioError: If the scenario has no hand, or cannot be simulated.
        InvalidArgumentError: If `drivers` does not name another driver for each model instance.
    """

    initial: dict[str, FloatArray]

    def __init__(
        self,
        scenario: Scenario | ResolvedScenario,
        *,
        lcm: DrakeLcmInterface | None = None,
        drivers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__()
        resolved, builder = resolve(scenario), DiagramBuilder()
        if (model := resolved.hand) is None:
            raise ScenarioError("scenario", "hand.file", "it is empty, and must name a hand")
        if lcm is not None:
            resolved = _without_bumps(resolved)
        weights = builder.AddNamedSystem("contact_weights", contact_weights_of(resolved))
        hand = add_hand(builder, resolved, model, weights)
        joints = _joints_by_instance(model)
        self.initial = {name: hand.controller.initial[i] for name, i in joints.items()}
        export_inputs(builder, "X_WO_measured measurement_time", hand.planner)
        export_inputs(builder, "close", hand.controller)
        if lcm is None:
            robot: System = add_hand_station(builder, resolved, model, hand.controller)
        else:
            period = resolved.scenario.grasp.period
            robot = _add_drivers(builder, lcm, drivers or {}, joints, model, hand, period)
        sizes = {name: robot.GetOutputPort(name).size() for name in ("hand_state", "net_actuation")}
        starts = np.cumsum([0, *[len(hand.controller.initial)] * (len(_JOINT_PORTS) - 1)])
        outputs = {
            f"{name}.{port}": (start + places).tolist()
            for name, places in joints.items()
            for start, port in zip(starts, _JOINT_PORTS, strict=True)
        }
        sizes["desired_state"] = sizes["hand_state"]
        selector = add_selector(builder, "joints", sizes, outputs)
        connect(builder, robot, "hand_state net_actuation", selector)
        connect(builder, hand.controller, "desired_state", selector)
        export_outputs(builder, selector, " ".join(outputs))
        export_outputs(builder, hand.controller, "grasp_report")
        export_outputs(builder, hand.planner, "tracking_status X_WO_estimated")
        if lcm is None:
            export_outputs(builder, robot, "X_WO query_object")
        builder.BuildInto(self)


def _without_bumps(resolved: ResolvedScenario) -> ResolvedScenario:
    """Returns a scenario whose hand does not yield before it closes.

    Over LCM, fingertips feel forces while an arm accelerates, so that a hand which moves off such a
    false touch feels the next one.
    """
    scenario = resolved.scenario
    grasp = replace(scenario.grasp, bump_force=0.0)
    return replace(resolved, scenario=replace(scenario, grasp=grasp))


def _joints_by_instance(model: HandModel) -> dict[str, IntArray]:
    """Returns the indices of joints in `hand_state`, by the names of their model instances."""
    hand = model.instances
    names = [hand.plant.GetModelInstanceName(j.model_instance()) for j in hand.moving_joints()]
    return {name: np.flatnonzero(np.array(names) == name) for name in dict.fromkeys(names)}


def _add_drivers(
    builder: DiagramBuilder,
    lcm: DrakeLcmInterface,
    drivers: Mapping[str, str],
    joints: Mapping[str, IntArray],
    model: HandModel,
    hand: GraspingHand,
    period: float,
) -> System:
    """Adds publishers of commands and subscribers to statuses, and connects them to a hand.

    Args:
        builder: Builder of the diagram, with the hand.
        lcm: Bus of the drivers.
        drivers: Names of the drivers, by the names of model instances.
        joints: Indices of joints in `desired_state`, by the names of model instances.
        model: Model of the hand.
        hand: Controller and planner of the hand.
        period: Seconds between commands.

    Returns:
        System with the outputs `hand_state` and `net_actuation`.
    """
    # LCM's messages are imported only where they are needed.
    from drake_pregrasp.interfaces.lcm import AddCommandPublisher
    from drake_pregrasp.interfaces.lcm_status import AddStatusSubscriber

    if drivers.keys() != joints.keys() or len(set(drivers.values())) < len(drivers):
        problem = f"there must be another one for each of {', '.join(joints)}, not"
        raise InvalidArgumentError(f"drivers: {problem} {dict(drivers)}")
    initial, sizes, receivers = hand.controller.initial, dict[str, int](), []
    q, v, torque = (np.zeros(len(initial), dtype=int) for _ in range(3))
    # A driver that knows no desired velocity presses as hard if the damping moves its position.
    kinematics, n = model.kinematics, len(initial)
    lead = np.diag(kinematics.damping / kinematics.stiffness)
    gain = np.block([[np.eye(n), lead], [np.zeros((n, n)), np.eye(n)]])
    pressed = builder.AddNamedSystem("drive_positions", MatrixGain(gain))
    connect(builder, hand.controller, "desired_state:u0", pressed)
    for name, places in joints.items():
        sender = AddCommandPublisher(
            builder, lcm, f"{drivers[name]}_COMMAND", places.tolist(), initial, period=period
        )
        if drivers[name] == "ALLEGRO":
            builder.Connect(pressed.get_output_port(), sender.GetInputPort("desired_state"))
        else:
            connect(builder, hand.controller, "desired_state", sender)
        connect(builder, hand.planner, "time_since_measurement", sender)
        receiver = AddStatusSubscriber(builder, lcm, f"{drivers[name]}_STATUS", initial[places])
        receivers += [(name, receiver)]
        q[places], v[places], torque[places] = sum(sizes.values()) + np.arange(
            3 * len(places)
        ).reshape(3, -1)
        sizes |= {f"{name}.state": 2 * len(places), f"{name}.torque": len(places)}
    outputs = {"hand_state": [*q.tolist(), *v.tolist()], "net_actuation": torque.tolist()}
    robot = add_selector(builder, "hand_status", sizes, outputs)
    for name, receiver in receivers:
        connect(builder, receiver, f"state_estimated:{name}.state", robot)
        connect(builder, receiver, f"torque_measured:{name}.torque", robot)
    connect(builder, robot, "hand_state net_actuation", hand.controller)
    return robot
