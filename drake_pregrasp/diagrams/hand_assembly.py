"""Completion of a hand's model by its description: axes, drives, frames, and fixed joints."""

from collections.abc import Iterator

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    Joint,
    PdControllerGains,
    PrismaticJoint,
    RevoluteJoint,
    SpatialInertia,
    WeldJoint,
)

from drake_pregrasp.config.hand_description import (
    Carrier,
    Drive,
    HandDescription,
    LockedJoint,
    Mount,
)
from drake_pregrasp.diagrams.hand_instances import HandInstances
from drake_pregrasp.diagrams.palm_base import PAN, check_home
from drake_pregrasp.errors import InvalidArgumentError, ProblemCollector

# The axes of five_finger_hand.sdf, whose comment names their data sheets: drives, ranges in metres
# or radians, and masses in kg.
_SLIDE = Drive([], 1e5, 2000.0, rotor_inertia=2.0, effort=350.0, speed=1.5, acceleration=10.0)
_WRIST = Drive([], 400.0, 20.0, rotor_inertia=1.8e-2, effort=9.9, speed=4.08, acceleration=80.0)
_DRIVES, _RANGES, _MASSES = 3 * [_SLIDE] + [_WRIST], (1.5, 1.5, 1.5, 31.4), (3.0, 3.0, 2.0, 0.6)
# A turn about the vertical through the origin of W moves all axes of a hand from the side: as stiff
# as the slides at a metre, and as fast as the wrist. Limits are in radians, masses in kg.
_PAN = Drive([], 1e5, 2000.0, rotor_inertia=2.0, effort=350.0, speed=4.08, acceleration=20.0)
_PAN_RANGE, _PAN_MASS = 31.4, 3.0
_RADIUS = 0.05  # Radius of the balls whose inertias the axes have, in metres.


def assemble_hand(
    hand: HandInstances,
    description: HandDescription,
    X_WB: RigidTransform | None = None,
    *,
    pans: bool = False,
) -> None:
    """Adds axes, drives and frames of a description to a parsed hand, and fixes locked joints.

    Args:
        hand: The hand, in a plant that is not finalized.
        description: Description of the hand.
        X_WB: Pose in W of the frame B that the model calls its world; None: the hand stays where it
            is.
        pans: Whether a joint turns the hand, with B, about z of W.

    Raises:
        InvalidArgumentError: If the model lacks a link or a joint that the description names, a
            joint cannot be locked, the mounted link hangs on another one, or a joint that moves has
            no drive, or two.
    """
    plant = hand.plant
    _drop_second_welds(hand)
    with ProblemCollector() as collector:
        for locked in description.locked:
            with collector.part():
                _lock(hand, locked)
        for index, tip in enumerate(description.fingertips):
            with collector.part():
                if tip.link:
                    link = hand.body(tip.link, f"fingertips[{index}].link")
                    X_BT, owner = RigidTransform(tip.center), link.model_instance()
                    plant.AddFrame(FixedOffsetFrame(tip.frame, link.body_frame(), X_BT, owner))
        for name in (name for drive in description.drives for name in drive.joints):
            if not (isinstance(description.base, Carrier) and name in description.base.joints):
                with collector.part():
                    hand.joint(name, "drives")
    pairs = [(name, drive) for drive in description.drives for name in drive.joints or [""]]
    if len(drives := dict(pairs)) < len(pairs):
        raise InvalidArgumentError("drives: a joint, or all others, must have one drive only")
    if isinstance(description.base, Carrier) and description.base.mount.link:
        axes = description.base.joints
        _add_axes(hand, axes, description.base.mount)
        drives = dict(zip(axes, _DRIVES, strict=True)) | drives
    parent: Frame = _add_pan(hand) if pans else plant.world_frame()
    if X_WB is not None:
        _place_base(hand, X_WB, parent)
    joints = list(_in_order(hand, parent.body().index())) if drives else []
    named = {hand.joint(name, "drives").index(): drive for name, drive in drives.items() if name}
    for joint in joints:
        if (drive := named.pop(joint.index(), drives.get(""))) is None:
            raise InvalidArgumentError(f"drives: none for joint {joint.name()}")
        _drive(plant, joint, drive)
    for index in named:
        name = plant.get_joint(index).name()
        raise InvalidArgumentError(f"drives: joint {name} does not move with the hand")


def _drop_second_welds(hand: HandInstances) -> None:
    """Removes welds to the world, as of links in an MJCF, from links that hang on another one."""
    joints, world = list(hand.joints()), hand.plant.world_body()
    for joint in joints:
        if isinstance(joint, WeldJoint) and joint.parent_body() is world:
            others = [other for other in joints if other.child_body() is joint.child_body()]
            if any(other.parent_body() is not world for other in others):
                hand.plant.RemoveJoint(joint)


def _lock(hand: HandInstances, locked: LockedJoint) -> None:
    """Replaces a joint by a fixed one."""
    joint = hand.joint(locked.joint, "locked")
    ends, X = (joint.frame_on_parent(), joint.frame_on_child()), _moved(joint, locked.position)
    name = joint.name()
    _remove(hand.plant, joint)  # The link is then free.
    hand.plant.AddJoint(WeldJoint(name, *ends, X))


def _add_pan(hand: HandInstances) -> Frame:
    """Adds a joint that turns the whole hand about the vertical, and returns the frame it moves."""
    plant = hand.plant
    inertia = SpatialInertia.SolidSphereWithMass(_PAN_MASS, _RADIUS)
    body = plant.AddRigidBody(f"{PAN}_axis", hand.instances[-1], inertia)
    up = np.array([0.0, 0.0, 1.0])
    joint = plant.AddJoint(RevoluteJoint(PAN, plant.world_frame(), body.body_frame(), up))
    joint.set_position_limits([-_PAN_RANGE], [_PAN_RANGE])
    _drive(plant, joint, _PAN)
    return body.body_frame()


def _place_base(hand: HandInstances, X_WB: RigidTransform, parent: Frame) -> None:
    """Joins to a parent, with B, what is joined to the world, and welds links without a joint to B.

    The parent is the frame of the world, or one that coincides with it while the hand does not pan.
    """
    plant, world = hand.plant, hand.plant.world_body()
    joints = list(hand.joints())
    hanging = {joint.child_body().index() for joint in joints}
    for body in list(hand.bodies()):
        if body.index() not in hanging:
            plant.WeldFrames(parent, body.body_frame(), X_WB)
    if X_WB.IsExactlyIdentity() and parent.is_world_frame():
        return
    for joint in joints:
        if joint.parent_body() is world and joint.child_body() is not parent.body():
            X_WF = X_WB @ joint.frame_on_parent().GetFixedPoseInBodyFrame()
            _rejoin(plant, joint, parent, X_WF)


def _rejoin(plant: MultibodyPlant, joint: Joint, parent: Frame, X_WF: RigidTransform) -> None:
    """Puts another joint in place of one on the world, with its frame at X_WF on a parent."""
    name, child = joint.name(), joint.frame_on_child()
    frame = FixedOffsetFrame(f"{name}_base", parent, X_WF, joint.model_instance())
    frame = plant.AddFrame(frame)
    if isinstance(joint, WeldJoint):
        X_FM = joint.X_FM()
        plant.RemoveJoint(joint)
        plant.AddJoint(WeldJoint(name, frame, child, X_FM))
        return
    if isinstance(joint, PrismaticJoint):
        moved: Joint = PrismaticJoint(name, frame, child, joint.translation_axis())
    elif isinstance(joint, RevoluteJoint):
        moved = RevoluteJoint(name, frame, child, joint.revolute_axis())
    else:
        raise InvalidArgumentError(f"{name}: a {joint.type_name()} joint cannot be the first one")
    drives = _remove_actuator(plant, joint)
    limits = [  # Copies: Drake returns views of the joint, which is freed.
        np.array([getattr(joint, f"{kind}_{side}_limits")() for side in ("lower", "upper")])
        for kind in ("position", "velocity", "acceleration")
    ]
    damping, default = np.array(joint.default_damping_vector()), np.array(joint.default_positions())
    plant.RemoveJoint(joint)
    moved = plant.AddJoint(moved)
    moved.set_position_limits(*limits[0])
    moved.set_velocity_limits(*limits[1])
    moved.set_acceleration_limits(*limits[2])
    moved.set_default_damping_vector(damping)
    moved.set_default_positions(default)
    for effort, rotor_inertia, gear_ratio, gains in drives:
        actuator = plant.AddJointActuator(name, moved, effort)
        actuator.set_default_rotor_inertia(rotor_inertia)
        actuator.set_default_gear_ratio(gear_ratio)
        if gains is not None:
            actuator.set_controller_gains(gains)


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


def _remove_actuator(
    plant: MultibodyPlant, joint: Joint
) -> list[tuple[float, float, float, PdControllerGains | None]]:
    """Removes the actuators of a joint; returns efforts, rotor inertias, gear ratios and gains."""
    removed = []
    for actuator in map(plant.get_joint_actuator, plant.GetJointActuatorIndices()):
        if actuator.joint() is joint:
            gains = actuator.get_controller_gains() if actuator.has_controller() else None
            rotor = actuator.default_rotor_inertia(), actuator.default_gear_ratio()
            removed.append((actuator.effort_limit(), *rotor, gains))
            plant.RemoveJointActuator(actuator)
    return removed


def _add_axes(hand: HandInstances, names: list[str], mount: Mount) -> None:
    """Adds three slides and a wrist, which carries a link of the hand."""
    plant = hand.plant
    link = hand.body(mount.link, "base.mount.link")
    carrier: Frame = plant.world_frame()
    for joint in list(hand.joints()):
        if joint.child_body() is link:  # As of links on the world in an MJCF.
            if (parent := joint.parent_body()) is not plant.world_body():
                raise InvalidArgumentError(
                    f"base.mount.link: {mount.link} hangs on {parent.name()}; mount the first link"
                )
            _remove(plant, joint)
    for axis, (name, mass, most) in enumerate(zip(names, _MASSES, _RANGES, strict=True)):
        inertia = SpatialInertia.SolidSphereWithMass(mass, _RADIUS)
        body = plant.AddRigidBody(f"{name}_axis", link.model_instance(), inertia)
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


def _in_order(hand: HandInstances, parent: int) -> Iterator[Joint]:
    """Yields the joints that move, in the order of their positions in a finalized plant."""
    for joint in hand.joints():
        if joint.parent_body().index() == parent:
            if joint.num_velocities() == 1:
                yield joint
            yield from _in_order(hand, joint.child_body().index())


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
