"""Completion of a hand's model by its description: axes, drives, frames, and fixed joints."""

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
    SpatialInertia,
    WeldJoint,
)

from drake_pregrasp.config.hand_description import Carrier, Drive, HandDescription, Mount
from drake_pregrasp.diagrams.palm_base import check_home
from drake_pregrasp.errors import InvalidArgumentError

# The axes of five_finger_hand.sdf, whose comment names their data sheets: drives, ranges in metres
# or radians, and masses in kg.
_SLIDE = Drive([], 1e5, 2000.0, rotor_inertia=2.0, effort=350.0, speed=1.5, acceleration=10.0)
_WRIST = Drive([], 400.0, 20.0, rotor_inertia=1.8e-2, effort=9.9, speed=4.08, acceleration=80.0)
_DRIVES, _RANGES, _MASSES = 3 * [_SLIDE] + [_WRIST], (1.5, 1.5, 1.5, 31.4), (3.0, 3.0, 2.0, 0.6)
_RADIUS = 0.05  # Radius of the balls whose inertias the axes have, in metres.


def assemble_hand(
    plant: MultibodyPlant,
    hand: ModelInstanceIndex,
    description: HandDescription,
    R_WA: RotationMatrix | None = None,
) -> None:
    """Adds axes, drives and frames of a description to a parsed hand, and fixes locked joints.

    Args:
        plant: Plant with the hand, which is not finalized.
        hand: Model instance of the hand.
        description: Description of the hand.
        R_WA: Orientation of added axes in W; None for upright.

    Raises:
        InvalidArgumentError: If a joint cannot be locked, the mounted link hangs on another one, or
            a joint that moves has no drive, or two.
        RuntimeError: If the model lacks a link or a joint that the description names.
    """
    for locked in description.locked:
        joint = plant.GetMutableJointByName(locked.joint, hand)
        ends, X = (joint.frame_on_parent(), joint.frame_on_child()), _moved(joint, locked.position)
        _remove(plant, joint)  # Which frees it.
        plant.AddJoint(WeldJoint(locked.joint, *ends, X))
    for tip in description.fingertips:
        if tip.link:
            link = plant.GetFrameByName(tip.link, hand)
            plant.AddFrame(FixedOffsetFrame(tip.frame, link, RigidTransform(tip.center), hand))
    pairs = [(name, drive) for drive in description.drives for name in drive.joints or [""]]
    if len(drives := dict(pairs)) < len(pairs):
        raise InvalidArgumentError("drives: a joint, or all others, must have one drive only")
    if isinstance(description.base, Carrier) and description.base.mount.link:
        axes = description.base.joints
        X_WA = RigidTransform(R_WA or RotationMatrix(), np.zeros(3))
        _add_axes(plant, hand, axes, description.base.mount, X_WA)
        drives = dict(zip(axes, _DRIVES, strict=True)) | drives
    joints = list(_in_order(plant, hand, plant.world_body().index())) if drives else []
    if unknown := set(drives) - {"", *(joint.name() for joint in joints)}:
        raise InvalidArgumentError(f"drives: no joint {unknown.pop()} hangs on the world and moves")
    for joint in joints:
        if (drive := drives.get(joint.name(), drives.get(""))) is None:
            raise InvalidArgumentError(f"drives: none for joint {joint.name()}")
        _drive(plant, joint, drive)


def _moved(joint: Joint, position: float) -> RigidTransform:
    """Returns the pose of a joint's child in its parent."""
    if not isinstance(joint, PrismaticJoint | RevoluteJoint):
        raise InvalidArgumentError(f"locked: {joint.name()} must slide or turn")
    limits = joint.position_lower_limits(), joint.position_upper_limits()
    check_home("locked", [joint.name()], [position], *limits)
    if isinstance(joint, PrismaticJoint):
        return RigidTransform(position * joint.translation_axis())
    return RigidTransform(RotationMatrix(AngleAxis(position, joint.revolute_axis())), np.zeros(3))


def _remove(plant: MultibodyPlant, joint: Joint) -> None:
    _remove_actuator(plant, joint)
    plant.RemoveJoint(joint)


def _remove_actuator(plant: MultibodyPlant, joint: Joint) -> None:
    for actuator in map(plant.get_joint_actuator, plant.GetJointActuatorIndices()):
        if actuator.joint() is joint:
            plant.RemoveJointActuator(actuator)


def _add_axes(
    plant: MultibodyPlant,
    hand: ModelInstanceIndex,
    names: list[str],
    mount: Mount,
    X_WA: RigidTransform,
) -> None:
    """Adds three slides and a wrist, which carries a link of the hand."""
    link = plant.GetBodyByName(mount.link, hand)
    carrier = plant.AddFrame(FixedOffsetFrame("approach", plant.world_frame(), X_WA, hand))
    for joint in map(plant.get_joint, plant.GetJointIndices(hand)):
        if joint.child_body() is link:  # As of links on the world in an MJCF.
            if (parent := joint.parent_body()) is not plant.world_body():
                raise InvalidArgumentError(
                    f"base.mount.link: {mount.link} hangs on {parent.name()}; mount the first link"
                )
            _remove(plant, joint)
    for axis, (name, mass, most) in enumerate(zip(names, _MASSES, _RANGES, strict=True)):
        inertia = SpatialInertia.SolidSphereWithMass(mass, _RADIUS)
        body = plant.AddRigidBody(f"{name}_axis", hand, inertia)
        ends = carrier, body.body_frame()
        joint = plant.AddJoint(
            PrismaticJoint(name, *ends, np.eye(3)[axis])
            if axis < len(names) - 1
            else RevoluteJoint(name, *ends, np.array([0.0, 0.0, 1.0]))
        )
        joint.set_position_limits([-most], [most])
        carrier = body.body_frame()
    X = RigidTransform(RollPitchYaw(mount.rpy), mount.position)
    plant.WeldFrames(carrier, link.body_frame(), X)


def _in_order(plant: MultibodyPlant, hand: ModelInstanceIndex, parent: int) -> Iterator[Joint]:
    """Yields the joints that move, in the order of their positions in a finalized plant."""
    for index in plant.GetJointIndices(hand):
        joint = plant.get_mutable_joint(index)
        if joint.parent_body().index() == parent:
            if joint.num_velocities() == 1:
                yield joint
            yield from _in_order(plant, hand, joint.child_body().index())


def _drive(plant: MultibodyPlant, joint: Joint, drive: Drive) -> None:
    """Adds an actuator behind all others, in place of that of the model."""
    _remove_actuator(plant, joint)
    actuator = plant.AddJointActuator(joint.name(), joint, drive.effort)
    actuator.set_default_rotor_inertia(drive.rotor_inertia)
    actuator.set_controller_gains(PdControllerGains(p=drive.stiffness, d=drive.damping))
    joint.set_default_damping_vector([0.0])
    if drive.speed:
        joint.set_velocity_limits([-drive.speed], [drive.speed])
    if drive.acceleration:
        joint.set_acceleration_limits([-drive.acceleration], [drive.acceleration])
