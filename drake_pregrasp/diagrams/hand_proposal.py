"""Proposal of a hand's description, from the structure of its model."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydrake.geometry import SceneGraphInspector
from pydrake.math import RollPitchYaw, RotationMatrix
from pydrake.multibody.tree import Joint, JointActuator, PrismaticJoint, RigidBody
from pydrake.planning import RobotDiagram, RobotDiagramBuilder

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.hand_description import (
    Arm,
    BaseConfig,
    Carrier,
    Drive,
    Fingertip,
    HandDescription,
    LockedJoint,
    Mount,
)
from drake_pregrasp.config.limits_config import SectorReach
from drake_pregrasp.diagrams.hand_instances import HandInstances
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.hand_parsing import add_read_model
from drake_pregrasp.diagrams.model_files import CheckedModel
from drake_pregrasp.diagrams.palm_base import JOINT_KINDS, PalmArm
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.grasping.finger_homes import Finger, Grip, find_grip
from drake_pregrasp.systems.hand_kinematics import finite_limits, frame_names, moving_joints
from drake_pregrasp.systems.hand_scene import link_balls
from drake_pregrasp.systems.palm_frames import pose_error

_ARM_JOINTS = 6  # Least number of an arm.
_SLAB = 0.01  # Length of the end of a link that is its fingertip, in metres.
_PAD = 0.02  # Length of the end of a jaw that is its pad, in metres.
_FLUSH = 0.2  # Largest angle between a pad and the surface that it touches, in radians.
_LEAST_RADIUS, _LARGEST_RADIUS = 0.003, 0.03  # Of a fingertip, in metres.
_HALF_ANGLE = 1.1  # Of a proposed reach, in radians.
_ANYWHERE = SectorReach(half_angle=np.pi, incidence=np.pi)
_SLIDE = Drive(stiffness=1000.0, damping=70.0, rotor_inertia=1.0, effort=40.0)  # As gripper.sdf.
_ARM_STIFFNESS, _ARM_DAMPING = 100.0, 7.0  # Over the effort of a joint, in 1/rad and s/rad.
_ARM_INERTIA, _ARM_EFFORT = 0.1, 50.0  # Of a joint of an arm, in kg m² and N m.
_STARTS = 20  # Number of positions of an arm from which its home is sought.
_ARM_STEPS = 200  # Largest number of steps from each of them.
_NEAR_BASE = 0.25  # Distance from an arm's base within which no object is expected, in metres.
_TIE = 5e-4  # Depth of the points of a face, in metres.
_STILL = 1e-6  # Largest step of a joint that ends them, in radians.
_ARRIVED = 1e-3  # Error of a palm that is held there, in metres and radians.
_PLACE = (0.5, 0.0, 0.05)  # Place of an object relative to such a base, in metres.
HOME_YAWS = (0.0, 1.0, -1.0, 2.0, -2.0, 3.0)
"""Yaws at which an arm may hold the palm over an object at home, in radians."""

_SIDES = np.vstack([np.eye(3), -np.eye(3)])


@dataclass
class _Chain:
    """The joints of one finger alone, and its fingertip."""

    joints: list[Joint]
    tip: Fingertip


def propose_hand(model: str, source: CheckedModel) -> HandDescription:
    """Returns a description of a model, which `HandModel` accepts.

    Fingertips are the ends of the links on which no other link hangs. Joints that move all of them
    are an arm if there are six or more, and the axes of a carrier if they slide along x, y and z
    and turn about z; others, such as those of a wrist, are locked. At home, fingertips surround an
    object of medium size.

    Args:
        model: Name of the model, as in `HandDescription.model`.
        source: The model, from `read_model`. Warnings about it are logged.

    Raises:
        InvalidArgumentError: If the model cannot be loaded, or has fewer than two fingers.
    """
    diagram, hand = _parse(model, source)
    joints = hand.moving_joints()
    chains, shared = _chains(model, diagram, hand, joints)
    base, carrying = _base(model, hand, shared, chains)
    used = {id(joint) for joint in carrying} | {id(j) for chain in chains for j in chain.joints}
    locked = [LockedJoint(hand.name_of(j), _zero(j)) for j in joints if id(j) not in used]
    drives = _drives(hand, [j for j in joints if id(j) in used], carrying, bool(_mount(base)))
    first = HandDescription(model, base, [chain.tip for chain in chains], drives, locked)
    return _with_homes(first, source, [list(map(hand.name_of, chain.joints)) for chain in chains])


def _parse(model: str, source: CheckedModel) -> tuple[RobotDiagram, HandInstances]:
    builder, bare = RobotDiagramBuilder(time_step=0.0), HandDescription(model)
    models = add_read_model(builder.plant(), source, bare, warns=True)
    builder.plant().Finalize()
    diagram = builder.Build()
    return diagram, HandInstances(diagram.plant(), models)


def _chains(
    model: str, diagram: RobotDiagram, hand: HandInstances, joints: Sequence[Joint]
) -> tuple[list[_Chain], list[Joint]]:
    """Returns the fingers, and the joints that move all of them."""
    moves = {b.index(): moving_joints(hand.plant, b.body_frame()) for b in hand.bodies()}
    masks = {mask.tobytes(): mask for mask in moves.values() if mask.any()}.values()
    ends = [m for m in masks if not any(np.all(o >= m) and np.any(o > m) for o in masks)]
    is_own = [end & (np.sum(ends, axis=0) == 1) for end in ends]
    ends = [end for end, own in zip(ends, is_own, strict=True) if np.any(own)]
    is_own = [own for own in is_own if np.any(own)]
    if len(ends) < 2:
        raise InvalidArgumentError(
            f"model: {model}: {len(ends)} chains of links end in a fingertip; a hand has two or"
            " more, each with joints of its own"
        )
    inspector, chains = diagram.scene_graph().model_inspector(), []
    links = [[b for b in hand.bodies() if np.array_equal(moves[b.index()], end)] for end in ends]
    balls = [_balls(hand, inspector, own) for own in links]
    middle = np.mean([np.mean(own[:, :3], axis=0) for own in balls], axis=0)
    prefix, names = "tip", [name for i in hand.instances for name in frame_names(hand.plant, i)]
    while any(name.startswith(f"{prefix}_") for name in names):
        prefix = f"finger{prefix}"
    for index, own in enumerate(is_own):
        mine = [joints[int(j)] for j in np.flatnonzero(own)]
        tip = _fingertip(hand, links[index], balls[index], mine, middle, f"{prefix}_{index}")
        chains.append(_Chain(mine, replace(tip, home=[_middle(joint) for joint in mine])))
    return chains, [joints[int(j)] for j in np.flatnonzero(np.all(ends, axis=0))]


def _slides(joint: Joint) -> bool:
    return bool(joint.type_name() == PrismaticJoint.kTypeName)


def _limits(joint: Joint) -> tuple[float, float]:
    return float(joint.position_lower_limits()[0]), float(joint.position_upper_limits()[0])


def _zero(joint: Joint) -> float:
    """Returns the position of a joint that is closest to zero."""
    return float(np.clip(0.0, *_limits(joint)))


def _middle(joint: Joint) -> float:
    """Returns the middle of a joint's range, or zero if it has no limits."""
    low, high = _limits(joint)
    return (low + high) / 2 if np.isfinite(high - low) else _zero(joint)


def _balls(
    hand: HandInstances, inspector: SceneGraphInspector, links: Sequence[RigidBody]
) -> FloatArray:
    """Returns the centres in W and the radii of `link_balls` of links, shape (k, 4), in metres."""
    context = hand.plant.CreateDefaultContext()
    balls = [np.append(link.EvalPoseInWorld(context).translation(), 0.0) for link in links]
    for link in links:
        for geometry in hand.plant.GetCollisionGeometriesForBody(link):
            own = link_balls(inspector, geometry)
            balls += list(
                np.column_stack([(link.EvalPoseInWorld(context) @ own[:, :3].T).T, own[:, 3]])
            )
    return np.array(balls)


def _fingertip(
    hand: HandInstances,
    links: Sequence[RigidBody],
    balls: FloatArray,
    joints: Sequence[Joint],
    middle: FloatArray,
    name: str,
) -> Fingertip:
    """Returns the fingertip at the end of the last links of a finger, toward a middle of all."""
    plant, context = hand.plant, hand.plant.CreateDefaultContext()
    frame_J = joints[-1].frame_on_child()
    p_WJ = frame_J.CalcPoseInWorld(context).translation()
    center, radius = _end(balls, p_WJ)
    if len(joints) == 1 and _slides(joints[0]) and not balls[:, 3].any():
        R_WJ = frame_J.CalcPoseInWorld(context).rotation().matrix()
        axis = R_WJ @ joints[0].translation_axis()
        inward = axis * np.sign(axis @ (middle - np.mean(balls[:, :3], axis=0)))
        center, radius = _pad(balls[:, :3], p_WJ, inward)
    for link in links:
        instance = link.model_instance()
        for frame_name in frame_names(plant, instance):
            frame = plant.GetFrameByName(frame_name, instance)
            p_WF = frame.CalcPoseInWorld(context).translation()
            if frame.body() is link and np.linalg.norm(p_WF - center) < radius:
                return Fingertip(hand.name_of(frame), radius=radius, reach=_ANYWHERE)
    p_BT = links[-1].EvalPoseInWorld(context).inverse() @ center
    return Fingertip(
        name,
        link=hand.name_of(links[-1]),
        center=_rounded(p_BT),
        radius=radius,
        reach=_ANYWHERE,
    )


def _end(balls: FloatArray, p_WJ: FloatArray) -> tuple[FloatArray, float]:
    """Returns the centre and the radius of the ball that fills the far end of a link.

    Args:
        balls: Centres and radii of balls that fill the link, or points of its surface with radii of
            0, shape (k, 4), in metres.
        p_WJ: Origin of its joint, shape (3,), in metres.
    """
    places, radii = balls[:, :3], balls[:, 3]
    end = int(np.argmax(np.linalg.norm(places - p_WJ, axis=1) + radii))
    if radii[end] > 0:
        return places[end], float(radii[end])
    along = places[end] - p_WJ
    along = along / max(float(np.linalg.norm(along)), 1e-9)
    slab = places[(places[end] - places) @ along < _SLAB]
    middle = (np.max(slab, axis=0) + np.min(slab, axis=0)) / 2
    across = slab - middle - np.outer((slab - middle) @ along, along)
    widths = np.ptp(across @ np.linalg.svd(across)[2][:2].T, axis=0)
    radius = round(float(np.clip(np.min(widths) / 2, _LEAST_RADIUS, _LARGEST_RADIUS)), 4)
    return middle + ((places[end] - middle) @ along - radius) * along, radius


def _pad(places: FloatArray, p_WJ: FloatArray, inward: FloatArray) -> tuple[FloatArray, float]:
    """Returns the centre and the radius of a ball that touches the middle of a jaw's inner face.

    Args:
        places: Points of the jaw's surface, shape (k, 3), in metres.
        p_WJ: Origin of its joint, shape (3,), in metres.
        inward: Unit vector in which it closes, shape (3,).
    """
    along = np.mean(places, axis=0) - p_WJ
    along = along - (along @ inward) * inward
    along = along / max(float(np.linalg.norm(along)), 1e-9)
    axes = np.array([along, np.cross(inward, along), inward])
    x, _, z = local = axes @ places.T
    end = x >= np.max(x) - _PAD
    face = local[:, end & (z >= np.max(z[end]) - _TIE)]
    radius = np.clip(np.min(np.ptp(face[:2], axis=1)) / 2, _LEAST_RADIUS, _LARGEST_RADIUS)
    middle = (np.max(face, axis=1) + np.min(face, axis=1)) / 2
    return axes.T @ (middle - [0.0, 0.0, radius]), round(float(radius), 4)


def _base(
    model: str, hand: HandInstances, shared: list[Joint], chains: Sequence[_Chain]
) -> tuple[BaseConfig, list[Joint]]:
    """Returns the base of a palm, and those of the shared joints that belong to it."""
    names = list(map(hand.name_of, shared))
    if tuple(joint.type_name() for joint in shared) == JOINT_KINDS:
        return Carrier(names, palm_height=0.0), shared
    if len(shared) >= _ARM_JOINTS:
        palm = hand.name_of(chains[0].joints[0].parent_body().body_frame())
        return Arm(palm, names, [round(_middle(joint), 4) for joint in shared]), shared
    for body in hand.bodies():
        if not moving_joints(hand.plant, body.body_frame()).any():
            return Carrier(palm_height=0.0, mount=Mount(hand.name_of(body))), []
    raise InvalidArgumentError(
        f"model: {model}: fingers hang on the world, as Drake calls a link named world, and not on"
        " a palm; rename this link"
    )


def _mount(base: BaseConfig) -> str:
    return base.mount.link if isinstance(base, Carrier) else ""


def _drives(
    hand: HandInstances, joints: Sequence[Joint], carrying: Sequence[Joint], has_mount: bool
) -> list[Drive]:
    """Returns drives for all joints; none if the model has them and nothing is added to it."""
    indices = hand.plant.GetJointActuatorIndices()
    actuators = {a.joint().index(): a for a in map(hand.plant.get_joint_actuator, indices)}
    own = [actuators.get(joint.index()) for joint in joints]
    if all(a is not None and a.has_controller() for a in own) and not has_mount:
        return []
    kinds: dict[tuple[float, ...], list[str]] = {}
    by_default: dict[str, list[str]] = {}
    for joint, actuator in zip(joints, own, strict=True):
        name, usual = hand.name_of(joint), _SLIDE if _slides(joint) else Drive()
        drive = _drive(actuator, usual, is_arm=joint in carrying)
        kinds.setdefault(drive, []).append(name)
        if actuator is None or not np.isfinite(actuator.effort_limit()):
            effort = f"{drive[-1]:g} {'N' if _slides(joint) else 'N m'}"
            by_default.setdefault(effort, []).append(name)
    for effort, names in by_default.items():
        words = "%s: effort %s by default; in a URDF, Drake reads it only with a <transmission>"
        logging.getLogger(__name__).warning(words, ", ".join(names), effort)
    drives = [Drive(names, *values) for values, names in kinds.items()]
    most = max(range(len(drives)), key=lambda i: len(drives[i].joints))
    drives[most] = replace(drives[most], joints=[])  # No names: all other joints.
    return drives


def _drive(
    actuator: JointActuator | None, usual: Drive, *, is_arm: bool
) -> tuple[float, float, float, float]:
    """Returns stiffness, damping, rotor inertia and effort of a joint's drive."""
    effort = _ARM_EFFORT if is_arm else usual.effort
    if actuator is not None and np.isfinite(actuator.effort_limit()):
        effort = float(actuator.effort_limit())
    if actuator is not None and actuator.has_controller():
        gains, inertia = actuator.get_controller_gains(), actuator.default_reflected_inertia()
        critical = 2 * np.sqrt(gains.p * inertia)
        return float(gains.p), round(float(gains.d or critical), 4), float(inertia), effort
    if is_arm:
        return _ARM_STIFFNESS * effort, _ARM_DAMPING * effort, _ARM_INERTIA, effort
    return usual.stiffness, usual.damping, usual.rotor_inertia, effort


def _with_homes(
    first: HandDescription, source: CheckedModel, names: Sequence[Sequence[str]]
) -> HandDescription:
    """Returns a description with the palm over an object, and fingers at home around it.

    Args:
        first: Description with the palm's frame in the object's centre.
        source: Its model.
        names: Names of the joints of each finger.
    """
    model = HandModel(first, model=source)
    q = model.base.at_home(model.fingers_home)
    plant = model.kinematics.plant
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    fingers, flush = [], list[dict[str, float]]()
    for chain, tip, own in zip(model.fingers.chains, first.fingertips, names, strict=True):
        joints = [model.instances.joint(name, "fingertips") for name in own]
        p_WJ = [j.frame_on_child().CalcPoseInWorld(context).translation() for j in joints]
        origins = (model.base.X_AW @ np.array(p_WJ).T).T
        fingers.append(Finger(chain, origins, tip.radius))
        flush.append({"incidence": _FLUSH} if len(joints) == 1 and _slides(joints[0]) else {})
    is_fixed = isinstance(first.base, Carrier) and not first.base.mount.link
    axes = np.eye(3)[2:] if is_fixed else _SIDES
    grip = find_grip(fingers, list(axes), on_axis=is_fixed)
    R_HP = RotationMatrix() if is_fixed else _palm_rotation(grip)
    p_HT = (R_HP @ (grip.p_UT - grip.center).T).T
    tips = [
        replace(
            tip,
            home=_rounded(home),
            reach=SectorReach(round(float(np.arctan2(p[1], p[0])), 3), _HALF_ANGLE, **incidence),
            patch_radius=tip.radius if len(home) == 1 else 0.0,
        )
        for tip, home, p, incidence in zip(first.fingertips, grip.homes, p_HT, flush, strict=True)
    ]
    base = _placed(first.base, R_HP, -(R_HP @ grip.center))
    return _with_arm_home(replace(first, base=base, fingertips=tips), source)


def _with_arm_home(description: HandDescription, source: CheckedModel) -> HandDescription:
    """Returns a description whose arm holds the palm over an object at home, if it can."""
    if not isinstance(description.base, Arm):
        return description
    model = HandModel(description, model=source)
    base, plant = model.base, model.kinematics.plant
    assert isinstance(base, PalmArm)
    context, place = plant.CreateDefaultContext(), usual_place(model)
    lower, upper = finite_limits(base.lower, base.upper, 0.0)
    middle, half = base.at_home(model.fingers_home), (upper - lower) / 2
    for yaw in HOME_YAWS:
        X_WP, random, found = base.palm_goal(place, yaw), np.random.default_rng(0), []
        for start in range(_STARTS):
            q = np.array(middle)
            if start:
                q[base.joints] = random.uniform(lower, upper)
            for _ in range(_ARM_STEPS):
                before, q = q, base.step_to(context, q, X_WP, middle)
                if np.max(np.abs(q - before)) < _STILL:
                    break
            plant.SetPositions(context, q)
            if np.max(np.abs(pose_error(base.palm_pose(context), X_WP))) < _ARRIVED:
                found.append(q[base.joints])
        if found:
            home = min(found, key=lambda q: float(np.max(np.abs(q - lower - half) / half)))
            return replace(description, base=replace(description.base, home=_rounded(home)))
    return description


def usual_place(model: HandModel) -> FloatArray:
    """Returns a place at which a hand should hold its palm over an object, shape (3,), in metres.

    It is over the origin of W, unless the base of an arm is there.

    Args:
        model: Model of the hand.
    """
    place, base = np.array([0.0, 0.0, _PLACE[2]]), model.description.base
    if isinstance(base, Arm):
        context = model.kinematics.plant.CreateDefaultContext()
        frame = model.instances.joint(base.joints[0], "base.joints").frame_on_parent()
        p_WB = frame.CalcPoseInWorld(context).translation() * [1.0, 1.0, 0.0]
        if np.linalg.norm(p_WB) < _NEAR_BASE:
            place = p_WB + _PLACE
    return place


def _palm_rotation(grip: Grip) -> RotationMatrix:
    """Returns the orientation of the palm's frame, with the axis up and most fingertips along x."""
    level = [side for side in _SIDES if abs(side @ grip.axis) < 0.5]
    spread = [np.sum(((grip.p_UT - grip.center) @ side) ** 2) for side in level]
    most = [np.sum((grip.p_UT - grip.center) @ side) for side in level]
    x = level[max(range(len(level)), key=lambda i: (round(spread[i], 9), most[i]))]
    return RotationMatrix(np.array([x, np.cross(grip.axis, x), grip.axis]))


def _placed(base: BaseConfig, R_HP: RotationMatrix, p_HP: FloatArray) -> BaseConfig:
    rpy = _rounded(RollPitchYaw(R_HP).vector())
    x, y, z = _rounded(p_HP)
    if isinstance(base, Arm):
        return replace(base, palm_position=[x, y, z], palm_rpy=rpy)
    if not base.mount.link:
        return replace(base, palm_height=z)
    mount = replace(base.mount, position=[x, y, 0.0], rpy=rpy)
    return replace(base, palm_height=z, mount=mount)


def _rounded(values: FloatArray) -> list[float]:
    return [round(float(value), 4) + 0.0 for value in values]
