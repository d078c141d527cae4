"""The model instances of a plant that together are a hand and what carries it."""

import contextlib
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, Joint, ModelInstanceIndex, RigidBody
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import Selector, SelectorParams

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.systems.hand_kinematics import frame_names
from drake_pregrasp.systems.mujoco_plant import MujocoPlant

SCOPE = "::"
"""Separator of the names of a model instance and of its element."""


class HandInstances:
    """Finds joints, links and frames of a hand by their names in one or several model instances.

    A name is that of the element, or `model_instance::element` if several instances have it.

    Args:
        plant: Plant with the hand.
        instances: Model instances of the hand and of what carries it, or the only one.
        are_named: Whether the instances have the names of the description's model. If not, the name
            of the instance does not count where only one has the element.

    Raises:
        InvalidArgumentError: If the list is empty, names a model instance twice, or one that the
            plant does not have.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        instances: ModelInstanceIndex | Sequence[ModelInstanceIndex],
        *,
        are_named: bool = False,
    ) -> None:
        if isinstance(instances, ModelInstanceIndex):
            instances = [instances]
        is_list = isinstance(instances, Sequence) and len(instances) > 0
        if not is_list or not all(isinstance(index, ModelInstanceIndex) for index in instances):
            problem = f"{instances!r} must be a model instance, or a list of one at least"
            raise InvalidArgumentError(f"robot: {problem}, as Drake's parser returns it")
        self.plant, self.instances, self._are_named = plant, list(instances), are_named
        there = [ModelInstanceIndex(i) for i in range(plant.num_model_instances())]
        if len(set(map(int, self.instances))) < len(self.instances):
            raise InvalidArgumentError("robot: a model instance is listed twice")
        for index in self.instances:
            if index not in there:
                titles = ", ".join(f"{int(i)} {plant.GetModelInstanceName(i)}" for i in there)
                problem = f"the plant has no model instance {int(index)}; there are: {titles}"
                raise InvalidArgumentError(f"robot: {problem}")

    def joint(self, name: str, key: str) -> Joint:
        """Returns a joint.

        Args:
            name: Name of the joint.
            key: Key that names it, for error messages.

        Raises:
            InvalidArgumentError: If there is none, or more than one.
        """
        instance, bare = self._owner(name, f"{key}: ", "joint")
        return self.plant.GetMutableJointByName(bare, instance)

    def body(self, name: str, key: str) -> RigidBody:
        """Returns a link."""
        instance, bare = self._owner(name, f"{key}: ", "link")
        return self.plant.GetBodyByName(bare, instance)

    def find_body(self, name: str) -> RigidBody | None:
        """Returns a link; None if there is none, or more than one."""
        with contextlib.suppress(InvalidArgumentError):
            return self.body(name, "link")
        return None

    def frame(self, name: str, key: str) -> Frame:
        """Returns a frame; links have frames of their names."""
        instance, bare = self._owner(name, f"{key}: ", "frame")
        return self.plant.GetFrameByName(bare, instance)

    def scoped_name(self, element: Joint | RigidBody | Frame) -> str:
        """Returns the name of an element behind that of its model instance."""
        instance = self.plant.GetModelInstanceName(element.model_instance())
        return f"{instance}{SCOPE}{element.name()}"

    def name_of(self, element: Joint | RigidBody | Frame) -> str:
        """Returns the name by which an element is found, with its model instance if need be."""
        kinds = {"joint": Joint, "link": RigidBody, "frame": Frame}
        kind = next(kind for kind, own in kinds.items() if isinstance(element, own))
        having = [i for i in self.instances if element.name() in self._names(i, kind)]
        return element.name() if len(having) == 1 else self.scoped_name(element)

    def joints(self) -> Iterator[Joint]:
        """Yields all joints, those that do not move among them."""
        for instance in self.instances:
            yield from map(self.plant.get_mutable_joint, self.plant.GetJointIndices(instance))

    def bodies(self) -> Iterator[RigidBody]:
        """Yields all links."""
        for instance in self.instances:
            yield from map(self.plant.get_body, self.plant.GetBodyIndices(instance))

    def moving_joints(self) -> list[Joint]:
        """Returns the joints that move, in the order of their positions in a finalized plant."""
        moving = [joint for joint in self.joints() if joint.num_positions()]
        return sorted(moving, key=lambda joint: joint.position_start())

    def _owner(self, name: str, prefix: str, kind: str) -> tuple[ModelInstanceIndex, str]:
        """Returns the model instance of an element, and its name there."""
        scope, _, bare = name.rpartition(SCOPE)
        names = {i: self._names(i, kind) for i in self.instances}
        having = [i for i in self.instances if bare in names[i]]
        titles = {i: self.plant.GetModelInstanceName(i) for i in self.instances}
        if scope and self._are_named and scope not in titles.values():
            there = ", ".join(titles.values())
            problem = f"there is no model {scope} with a {kind} {bare}; models are: {there}"
            raise InvalidArgumentError(f"{prefix}{problem}")
        if scope and self._are_named:
            having = [i for i in having if titles[i] == scope]
        elif scope and len(having) > 1:
            having = [i for i in having if titles[i] == scope] or having
        if len(having) == 1:
            return having[0], bare
        if having:
            choices = " or ".join(f"{titles[i]}{SCOPE}{bare}" for i in having)
            raise InvalidArgumentError(f"{prefix}{kind} {name} is ambiguous; write {choices}")
        there = ", ".join(dict.fromkeys(name for own in names.values() for name in own))
        raise InvalidArgumentError(f"{prefix}there is no {kind} {name}; there are: {there}")

    def _names(self, instance: ModelInstanceIndex, kind: str) -> list[str]:
        plant = self.plant
        if kind == "frame":
            return frame_names(plant, instance)
        if kind == "link":
            return [plant.get_body(index).name() for index in plant.GetBodyIndices(instance)]
        return [plant.get_joint(index).name() for index in plant.GetJointIndices(instance)]


def check_inertias(plant: MultibodyPlant, prefix: str = "") -> None:
    """Checks that all joints of a finalized plant move something with inertia.

    Drake finds a mass matrix that is not positive definite only in the first step.

    Args:
        plant: The plant.
        prefix: Beginning of the message.

    Raises:
        InvalidArgumentError: If one moves links without mass, or without moments of inertia about
            its axis, and its drive has no rotor inertia; the message names the link.
    """
    inertias, directions = np.linalg.eigh(plant.CalcMassMatrix(plant.CreateDefaultContext()))
    if not len(inertias) or inertias[0] > np.finfo(float).eps * len(inertias) * inertias[-1]:
        return
    worst = int(np.argmax(np.abs(directions[:, 0])))
    joints = map(plant.get_joint, plant.GetJointIndices())
    joint = next(j for j in joints if 0 <= worst - j.velocity_start() < j.num_velocities())
    link, moved = joint.child_body(), plant.GetBodiesKinematicallyAffectedBy([joint.index()])
    mass = sum(plant.get_body(index).default_mass() for index in moved)
    weighs = f"{link.name()} and what it carries have a mass of {mass:g} kg"
    needs = f"give link {link.name()} a mass and moments of inertia above 0"
    if joint.num_velocities() == 1:
        needs += f", or the drive of joint {joint.name()} a rotor_inertia"
    raise InvalidArgumentError(f"{prefix}{weighs}, and no inertia resists a motion; {needs}")


def set_default_positions(joints: Sequence[Joint], q: FloatArray) -> None:
    """Sets the default positions of joints of one position each.

    Args:
        joints: The joints.
        q: Position of each joint, in radians or metres.
    """
    for joint, position in zip(joints, q, strict=True):
        joint.set_default_positions([position])


def hand_ports(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    joints: Sequence[Joint],
    dynamics: MultibodyPlant | MujocoPlant | None = None,
) -> tuple[InputPort, OutputPort, OutputPort]:
    """Adds systems that select the values of a hand's joints from the ports of a plant.

    Args:
        builder: Builder of the diagram, with the plant.
        plant: A finalized plant with the hand.
        joints: The hand's joints in the order of the values, all driven.
        dynamics: System that simulates the plant; None for the plant itself.

    Returns:
        Port for the desired positions and velocities, and ports with the positions and velocities,
        and with the torques or forces of the actuators, in N m or N.
    """
    dynamics = dynamics or plant
    actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    inputs = {int(drive.joint().index()): drive.input_start() for drive in actuators}
    order = {int(joint.index()): place for place, joint in enumerate(joints)}
    nq, count = plant.num_positions(), len(joints)
    measured = [joint.position_start() for joint in joints]
    measured += [nq + joint.velocity_start() for joint in joints]
    state = add_selector(
        builder, "hand_state", {"u": plant.num_multibody_states()}, {"y": measured}
    )
    builder.Connect(dynamics.get_state_output_port(), state.get_input_port(0))
    driven = [inputs[int(joint.index())] for joint in joints]
    actuation = add_selector(
        builder, "hand_actuation", {"u": plant.num_actuated_dofs()}, {"y": driven}
    )
    builder.Connect(dynamics.get_net_actuation_output_port(), actuation.get_input_port(0))
    instances = sorted({joint.model_instance() for joint in joints}, key=int)
    wanted = {}
    for instance in instances:
        own = plant.GetJointActuatorIndices(instance)
        places = [order[int(plant.get_joint_actuator(i).joint().index())] for i in own]
        title = plant.GetModelInstanceName(instance)
        wanted[title] = [*places, *(count + place for place in places)]
    desired = add_selector(builder, "hand_drives", {"u": 2 * count}, wanted)
    for port, instance in enumerate(instances):
        goal = dynamics.get_desired_state_input_port(instance)
        builder.Connect(desired.get_output_port(port), goal)
    return desired.get_input_port(0), state.get_output_port(0), actuation.get_output_port(0)


def add_selector(
    builder: DiagramBuilder,
    name: str,
    inputs: Mapping[str, int],
    outputs: Mapping[str, Sequence[int]],
) -> Selector:
    """Adds a system that emits chosen elements of its inputs.

    Args:
        builder: Builder of the diagram.
        name: Name of the system.
        inputs: Sizes of the input ports by their names.
        outputs: Indices into all inputs, one after another, by the names of the output ports.
    """
    offsets = [(port, i) for port, size in enumerate(inputs.values()) for i in range(size)]
    params = SelectorParams(
        inputs=[
            SelectorParams.InputPortParams(name=port, size=size) for port, size in inputs.items()
        ],
        outputs=[
            SelectorParams.OutputPortParams(
                name=port,
                selections=[
                    SelectorParams.OutputSelection(
                        input_port_index=offsets[index][0], input_offset=offsets[index][1]
                    )
                    for index in indices
                ],
            )
            for port, indices in outputs.items()
        ],
    )
    return builder.AddNamedSystem(name, Selector(params))
