"""What a description adds to a hand's model: axes that carry it, drives, and fixed joints."""

from collections.abc import Iterator

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Joint,
    ModelInstanceIndex,
    PdControllerGains,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    SpatialInertia,
    WeldJoint,
)

from drake_pregrasp.config.hand_description import Carrier, Drive, HandDescription, Mount
from drake_pregrasp.errors import InvalidArgumentError

# The axes of five_finger_hand.sdf, whose comment names their data sheets: drives, ranges in metres
# or radians, accelerations in m/s² or rad/s², and masses in kg.
_SLIDE = Drive(stiffness=1e5, damping=2000, rotor_inertia=2.0, effort=350, speed=1.5)
_WRIST = Drive(stiffness=400, damping=20, rotor_inertia=1.8e-2, effort=9.9, speed=4.08)
_DRIVES = (_SLIDE, _SLIDE, _SLIDE, _WRIST)
_RANGES, _ACCELERATIONS, _MASSES = (1.5, 1.5, 1.5, 31.4), (10, 10, 10, 80), (3.0, 3.0, 2.0, 0.6)
_RADIUS = 0.05  # Radius of the balls whose inertias the axes have, in metres.


def assemble_hand(
    plant: MultibodyPlant, hand: ModelInstanceIndex, description: HandDescription
) -> None:
    """Adds to a parsed hand what its description adds to the model.

    Args:
        plant: Plant with the hand, which is not finalized.
        hand: Model instance of the hand.
        description: Description of the hand.

    Raises:
        InvalidArgumentError: If the model lacks a link or a joint that the description names.
    """
    for index, locked in enumerate(description.locked):
        joint = _joint(plant, hand, locked.joint, f"locked[{index}].joint")
        _remove(plant, joint)
        ends = joint.frame_on_parent(), joint.frame_on_child()
        plant.AddJoint(WeldJoint(joint.name(), *ends, _moved(joint, locked.position)))
    for index, tip in enumerate(description.fingertips):
        if tip.link:
            frame = _link(plant, hand, tip.link, f"fingertips[{index}].link").body_frame()
            plant.AddFrame(FixedOffsetFrame(tip.frame, frame, RigidTransform(tip.center), hand))
    drives = {
        _joint(plant, hand, name, f"drives[{index}].joints").name() if name else "": drive
        for index, drive in enumerate(description.drives)
        for name in drive.joints or [""]
    }
    base = description.base
    if isinstance(base, Carrier) and base.mount.link:
        _add_axes(plant, hand, base.joints, base.mount)
        drives |= dict(zip(base.joints, _DRIVES, strict=True))
    if drives:
        for joint in list(_in_order(plant, hand, plant.world_body().index())):
            if joint.num_velocities() == 1:
                _drive(plant, joint, drives.get(joint.name(), drives.get("")))


def _joint(plant: MultibodyPlant, hand: ModelInstanceIndex, name: str, key: str) -> Joint:
    """Returns a joint that slides or turns, by its name."""
    joints = [plant.get_mutable_joint(index) for index in plant.GetJointIndices(hand)]
    there = {j.name(): j for j in joints if isinstance(j, PrismaticJoint | RevoluteJoint)}
    if name not in there:
        raise InvalidArgumentError(
            f"{key}: no joint {name} slides or turns; of: {', '.join(there)}"
        )
    return there[name]


def _link(plant: MultibodyPlant, hand: ModelInstanceIndex, name: str, key: str) -> RigidBody:
    if not plant.HasBodyNamed(name, hand):
        there = ", ".join(plant.get_body(i).name() for i in plant.GetBodyIndices(hand))
        raise InvalidArgumentError(f"{key}: there is no link {name}; of: {there}")
    return plant.GetBodyByName(name, hand)


def _moved(joint: Joint, position: float) -> RigidTransform:
    """Returns the pose of a joint's child in its parent."""
    if isinstance(joint, PrismaticJoint):
        return RigidTransform(position * joint.translation_axis())
    return RigidTransform(RotationMatrix(AngleAxis(position, joint.revolute_axis())), np.zeros(3))


def _remove(plant: MultibodyPlant, joint: Joint) -> None:
    for index in plant.GetJointActuatorIndices():
        if plant.get_joint_actuator(index).joint() is joint:
            plant.RemoveJointActuator(plant.get_joint_actuator(index))
    plant.RemoveJoint(joint)


def _add_axes(
    plant: MultibodyPlant, hand: ModelInstanceIndex, names: list[str], mount: Mount
) -> None:
    """Adds three slides and a wrist, which carries a link of the hand."""
    link, carrier = _link(plant, hand, mount.link, "base.mount.link"), plant.world_body()
    for index in plant.GetJointIndices(hand):
        if plant.get_joint(index).child_body() is link:  # As of links on the world in an MJCF.
            _remove(plant, plant.get_joint(index))
    for axis, name in enumerate(names):
        inertia = SpatialInertia.SolidSphereWithMass(_MASSES[axis], _RADIUS)
        body = plant.AddRigidBody(f"{name}_axis", hand, inertia)
        frames = carrier.body_frame(), body.body_frame()
        is_slide = axis < len(names) - 1
        joint = plant.AddJoint(
            PrismaticJoint(name, *frames, np.eye(3)[axis])
            if is_slide
            else RevoluteJoint(name, *frames, np.array([0.0, 0.0, 1.0]))
        )
        joint.set_position_limits([-_RANGES[axis]], [_RANGES[axis]])
        joint.set_acceleration_limits([-_ACCELERATIONS[axis]], [_ACCELERATIONS[axis]])
        carrier = body
    X = RigidTransform(RollPitchYaw(mount.rpy), mount.position)
    plant.WeldFrames(carrier.body_frame(), link.body_frame(), X)


def _in_order(plant: MultibodyPlant, hand: ModelInstanceIndex, parent: int) -> Iterator[Joint]:
    """Yields the joints of a hand in the order of their positions in a finalized plant."""
    for index in plant.GetJointIndices(hand):
        joint = plant.get_mutable_joint(index)
        if joint.parent_body().index() == parent:
            yield joint
            yield from _in_order(plant, hand, joint.child_body().index())


def _drive(plant: MultibodyPlant, joint: Joint, drive: Drive | None) -> None:
    """Adds an actuator behind all others, with the values of a drive or else of the model."""
    effort, gains, rotor, gears = np.inf, None, 0.0, 1.0
    for index in plant.GetJointActuatorIndices():
        old = plant.get_joint_actuator(index)
        if old.joint() is joint:
            effort, rotor, gears = (
                old.effort_limit(),
                old.default_rotor_inertia(),
                old.default_gear_ratio(),
            )
            gains = old.get_controller_gains() if old.has_controller() else None
            plant.RemoveJointActuator(old)
    if drive is not None:
        effort = drive.effort or effort
        gains, rotor, gears = (
            PdControllerGains(p=drive.stiffness, d=drive.damping),
            drive.rotor_inertia,
            1.0,
        )
        joint.set_default_damping_vector([0.0])
        if drive.speed:
            joint.set_velocity_limits([-drive.speed], [drive.speed])
    actuator = plant.AddJointActuator(joint.name(), joint, effort)
    actuator.set_default_rotor_inertia(rotor)
    actuator.set_default_gear_ratio(gears)
    if gains is not None:
        actuator.set_controller_gains(gains)
