"""Comparison of a hand in a user's plant with the model of its description."""

from collections.abc import Iterator

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex, Joint

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.diagrams.hand_instances import HandInstances
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.systems.hand_kinematics import moving_joints
from drake_pregrasp.systems.palm_frames import pose_error

_POSTURES = 3  # Postures in which poses of links are compared.
_UNLIMITED = np.pi  # Largest position in these postures, in radians or metres.
_SAME_POSE = 1e-6  # Largest difference of two equal poses, in metres and radians.
_SAME = 1e-3  # Largest relative difference of other equal values.


def matching_joints(hand: HandModel, robot: HandInstances) -> list[Joint]:
    """Returns the joints in a plant in the order of the positions of a hand's model.

    Args:
        hand: Model of the hand.
        robot: The hand in a finalized plant.

    Raises:
        InvalidArgumentError: If one lacks a joint of the other one.
    """
    own = hand.instances
    joints = [robot.joint(own.scoped_name(joint), "robot") for joint in own.moving_joints()]
    for joint in robot.moving_joints():
        if not any(joint is known for known in joints):
            raise InvalidArgumentError(
                f"robot: joint {robot.scoped_name(joint)} of the plant moves, but not in the hand's"
                " model; weld it, or leave its model instance out"
            )
    tip = robot.frame(hand.description.fingertips[0].frame, "fingertips[0].frame")
    moves = moving_joints(robot.plant, tip)
    moves[[joint.velocity_start() for joint in joints]] = False
    for joint in map(robot.plant.get_joint, robot.plant.GetJointIndices()):
        if joint.num_velocities() and moves[joint.velocity_start()]:
            raise InvalidArgumentError(
                f"robot: joint {robot.scoped_name(joint)} moves the base in the plant; weld it"
            )
    return joints


def base_pose(hand: HandModel, robot: HandInstances) -> RigidTransform:
    """Returns the pose X_WB in which the base of a hand stands in a plant.

    Args:
        hand: Model of the hand, for any base.
        robot: The hand in a finalized plant.

    Raises:
        InvalidArgumentError: If the hand in the plant is another one than that of the description;
            the message has both values.
    """
    for problem in _problems(hand, robot):
        raise InvalidArgumentError(f"robot: {problem}")
    q = hand.base.at_home(hand.fingers_home)
    tip = hand.instances.frame(hand.description.fingertips[0].frame, "fingertips[0].frame").body()
    X_WL, X_WL_own = _poses(hand, robot, q)[tip.index()]
    X_WB = X_WL @ X_WL_own.inverse() @ hand.X_WB
    lower, upper = hand.kinematics.lower, hand.kinematics.upper
    random = np.random.default_rng(0)
    for _ in range(_POSTURES):
        low, high = np.maximum(lower, -_UNLIMITED), np.minimum(upper, _UNLIMITED)
        _check_poses(hand, robot, random.uniform(low, high), X_WB @ hand.X_WB.inverse())
    return X_WB


def _problems(hand: HandModel, robot: HandInstances) -> Iterator[str]:
    """Yields what the plant has, and what the model of the description has instead."""
    plant = robot.plant
    own, theirs = hand.instances.moving_joints(), matching_joints(hand, robot)
    if np.any(plant.gravity_field().gravity_vector()):
        for instance in robot.instances:
            if plant.is_gravity_enabled(instance):
                name = plant.GetModelInstanceName(instance)
                yield (
                    f"gravity acts on {name} in the plant, and not on the hand's model; call"
                    " complete_hand_model, or set_gravity_enabled, before Finalize"
                )
    drives = {}
    for actuator in map(plant.get_joint_actuator, plant.GetJointActuatorIndices()):
        if actuator.has_controller():
            drives[actuator.joint().index()] = actuator
    for i, (joint, there) in enumerate(zip(own, theirs, strict=True)):
        name = robot.scoped_name(there)
        if there.type_name() != joint.type_name():
            yield _both(f"{name}: the joint is", there.type_name(), joint.type_name())
        if (actuator := drives.get(there.index())) is None:
            yield (
                f"joint {name} has no drive with gains in the plant; call complete_hand_model"
                " before Finalize, or give it drake:controller_gains"
            )
            continue
        gains, kinematics = actuator.get_controller_gains(), hand.kinematics
        for what, value, expected in (
            ("stiffness", gains.p, kinematics.stiffness[i]),
            ("damping", gains.d, kinematics.damping[i]),
        ):
            if not np.isclose(value, expected, rtol=_SAME, atol=0):
                yield _both(f"{name}: the {what} is", f"{value:g}", f"{expected:g}")
        if actuator.effort_limit() < (1 - _SAME) * kinematics.efforts[i]:
            effort, expected = actuator.effort_limit(), kinematics.efforts[i]
            yield _both(f"{name}: the effort is", f"{effort:g}", f"{expected:g}")
        for what, (low, high), (least, most) in (
            ("positions", _range(there, "position"), _range(joint, "position")),
            ("speeds", _range(there, "velocity"), _range(joint, "velocity")),
            ("accelerations", _range(there, "acceleration"), _range(joint, "acceleration")),
        ):
            if low > least + _SAME or high < most - _SAME:
                limits = f"from {low:g} to {high:g}", f"from {least:g} to {most:g}"
                yield _both(f"{name}: {what} are", *limits)
    for index, tip in enumerate(hand.description.fingertips):
        key = f"fingertips[{index}].frame"
        body, there = (at.frame(tip.frame, key).body() for at in (hand.instances, robot))
        M, M_own = (b.default_spatial_inertia().CopyToFullMatrix6() for b in (there, body))
        if np.abs(M - M_own).max() > _SAME * np.abs(M_own).max():
            masses = [f"a mass of {b.default_mass():.4g} kg" for b in (there, body)]
            yield _both(f"{there.name()}: the link has another inertia, and", *masses)


def _both(what: str, plant: str, model: str) -> str:
    return f"{what} {plant} in the plant, and {model} in the model of the description"


def _place(X: RigidTransform) -> str:
    return f"({', '.join(f'{round(x, 4) + 0.0:g}' for x in X.translation())}) m"


def _range(joint: Joint, kind: str) -> tuple[float, float]:
    (low,) = getattr(joint, f"{kind}_lower_limits")()
    (high,) = getattr(joint, f"{kind}_upper_limits")()
    return low, high


def _poses(
    hand: HandModel, robot: HandInstances, q: FloatArray
) -> dict[BodyIndex, tuple[RigidTransform, RigidTransform]]:
    """Returns the poses in W of links that both have, in the plant and in the hand's model.

    Args:
        hand: Model of the hand, whose links have the indices of the result.
        robot: The hand in the plant.
        q: Positions of the hand's joints, shape (nq,).
    """
    plant, own = robot.plant, hand.kinematics.plant
    context, own_context = plant.CreateDefaultContext(), own.CreateDefaultContext()
    own.SetPositions(own_context, q)
    positions = plant.GetPositions(context)
    positions[[joint.position_start() for joint in matching_joints(hand, robot)]] = q
    plant.SetPositions(context, positions)
    found = {}
    for body in hand.instances.bodies():
        name = hand.instances.scoped_name(body)
        if there := robot.find_body(name):
            X_WL = plant.EvalBodyPoseInWorld(context, there)
            found[body.index()] = X_WL, own.EvalBodyPoseInWorld(own_context, body)
        elif own.GetCollisionGeometriesForBody(body):
            raise InvalidArgumentError(
                f"robot: the plant has no link {name}, which the model of the description has"
            )
    return found


def _check_poses(hand: HandModel, robot: HandInstances, q: FloatArray, X: RigidTransform) -> None:
    """Checks that links stand as in the hand's model, moved by X, and names the first pair."""
    own, poses = hand.kinematics.plant, _poses(hand, robot, q)
    world = own.world_body().index()
    pairs = [(j.parent_body().index(), j.child_body().index()) for j in hand.instances.joints()]
    pairs = [pair for pair in pairs if world not in pair] + [(world, link) for link in poses]
    poses[world] = X, RigidTransform()
    for parent, child in pairs:
        if parent not in poses or child not in poses:
            continue
        (X_WP, X_WP_own), (X_WC, X_WC_own) = poses[parent], poses[child]
        X_PC, X_PC_own = X_WP.InvertAndCompose(X_WC), X_WP_own.InvertAndCompose(X_WC_own)
        error = pose_error(X_PC, X_PC_own)
        if np.abs(error).max() > _SAME_POSE:
            x, x_own = map(_place, (X_PC, X_PC_own))
            where = f"link {own.get_body(child).name()} in {own.get_body(parent).name()} is at"
            turn = f"turned by {np.linalg.norm(error[:3]):.3g} rad"
            raise InvalidArgumentError(f"robot: {_both(where, x, x_own)}, {turn} to each other")
