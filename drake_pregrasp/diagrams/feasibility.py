"""Checks that a hand can follow an object, hold its palm there, and lift the object."""

from collections.abc import Sequence

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from scipy.linalg import block_diag

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.object_config import GRAVITY
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.contacts.hand_above_object import StartContacts
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.palm_base import WRIST, PalmCarrier
from drake_pregrasp.errors import InvalidArgumentError, Lack, NoGraspError
from drake_pregrasp.geometry.motion_profiles import VelocityProfile
from drake_pregrasp.geometry.rotations import turn_about_z
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.grasping.clearances import LINK_CLEARANCE
from drake_pregrasp.grasping.grasp_state import GiveUp
from drake_pregrasp.systems.grasp_sequencer import lift_load
from drake_pregrasp.systems.squeeze_program import plan_lift

_TIMES = 200  # Times at which the joints of a carrier are compared with their limits.
_REACHED = 0.002  # Largest distance of a fingertip from its place that counts as there, in metres.
_HALVINGS = 8  # Halvings of the load's share that torques hold.
_REST = np.zeros(3)
_ROUNDING = 1e-6  # Of velocities that are computed from positions, as a share.


def check_palm(
    hand: HandModel,
    config: GraspConfig,
    poses: Sequence[RigidTransform],
    p_OCoM: FloatArray,
    yaw: float,
) -> None:
    """Checks that a hand can hold its palm at an object, before it, and where it lifts it.

    Args:
        hand: Model of the hand.
        config: Configuration of the grasp.
        poses: Poses of the object, with which the palm turns.
        p_OCoM: Centre of mass of the object in O, shape (3,), in metres.
        yaw: Yaw of the palm over the first pose, in radians.

    Raises:
        InvalidArgumentError: If an arm cannot hold the palm, or a carrier cannot over the first
            pose.
    """
    axis, settings = hand.X_LA.rotation().matrix()[:, 2], config.make_settings()
    lift = settings.lift_height * config.lift_axis
    places = np.zeros(3), settings.approach_height * axis, lift
    for place, when in zip(places, ("", "", "after the lift, "), strict=True):
        if problem := travel_problem(hand, poses[0] @ p_OCoM + place):
            raise InvalidArgumentError(when + problem)
    first, *_ = turns = [RollPitchYaw(X_WO.rotation()).yaw_angle() for X_WO in poses]
    for X_WO, turn in zip(poses, turns, strict=True):
        # The palm turns with the object.
        turned = yaw + (turn - first) * axis[2]
        turned = float(np.clip(turned, *hand.yaw_range(config.yaw_range)))
        for place in places:
            hand.home(X_WO @ p_OCoM + place, turned)


def travel_problem(hand: HandModel, p_WL: FloatArray) -> str:
    """Returns which slide of a carrier ends before it holds the palm over a point; empty if none.

    Args:
        hand: Model of the hand.
        p_WL: The point in W, shape (3,), in metres.
    """
    if isinstance(hand.base, PalmCarrier):
        q, model = hand.home(p_WL, 0.0), hand.kinematics
        for name, axis in zip(hand.base.names[:WRIST], hand.base.joints[:WRIST], strict=True):
            low, high = model.lower[axis], model.upper[axis]
            if not low <= q[axis] <= high:
                there = f"joint {name} would be at {q[axis]:.3g} m"
                return f"{there}, its range is {low:g} to {high:g} m"
    return ""


def check_carrier(
    hand: HandModel,
    config: GraspConfig,
    profile: VelocityProfile,
    end: float,
    p_WCoM: FloatArray,
    yaw: float,
) -> None:
    """Checks that a carrier can follow a conveyor within the travel and the speeds of its joints.

    Args:
        hand: Model of the hand; a palm on an arm is not checked.
        config: Configuration of the grasp.
        profile: Linear and angular velocity of the conveyor, in m/s and rad/s.
        end: Time until which the hand follows, in seconds.
        p_WCoM: Initial centre of mass of the object in W, shape (3,), in metres.
        yaw: Initial yaw of the palm, in radians.

    Raises:
        InvalidArgumentError: If a joint cannot follow; the message names it, its limit and what is
            needed.
    """
    if not isinstance(hand.base, PalmCarrier):
        return
    times, model, joints = np.linspace(0.0, end, _TIMES), hand.kinematics, hand.base.joints
    slid, turned = np.array([profile.at(time)[0] for time in times]).T
    # Fingers of a palm with a limited range need not go round with the object.
    follows = hand.yaw_range(config.yaw_range) == FREE_TURN
    yaws = yaw + follows * hand.X_LA.rotation().matrix()[2, 2] * turned
    q = [
        hand.base.rest_posture(hand.fingers_home, p_WCoM + np.array([x, 0.0, 0.0]), *turns)[joints]
        for x, *turns in zip(slid, yaws, hand.pans * turned, strict=True)
    ]
    positions, rates = np.array(q), np.abs(np.diff(q, axis=0)) / np.diff(times)[:, None]
    for index, (name, joint) in enumerate(zip(hand.base.names, joints, strict=True)):
        unit = "rad" if index >= WRIST else "m"
        limit, travel = model.rate_limit[joint], (model.lower[joint], model.upper[joint])
        if np.any(fast := rates[:, index] > (1 + _ROUNDING) * limit):
            time, rate = times[np.argmax(fast)], np.max(rates[:, index])
            raise InvalidArgumentError(
                f"from {time:.3g} s the object is too fast for the carrier: joint {name} would have"
                f" to follow it at {rate:.4g} {unit}/s, its limit is {limit:.4g} {unit}/s"
            )
        inside = np.clip(positions[:, index], *travel)
        if np.any(beyond := inside != positions[:, index]):
            late = int(np.argmax(beyond))
            farthest = positions[np.argmax(np.abs(positions[:, index] - inside)), index]
            raise InvalidArgumentError(
                f"at {times[late]:.3g} s the object leaves the carrier's travel: joint {name} ends"
                f" at {inside[late]:.3g} {unit}, and would have to go to {farthest:.3g}"
                f" {unit} until the hand has gripped, at {end:.3g} s; let it close earlier"
            )


def palm_problem(
    hand: HandModel,
    config: GraspConfig,
    path: Sequence[RigidTransform],
    p_OCoM: FloatArray,
    table: float,
    yaw: float,
) -> InvalidArgumentError | None:
    """Returns why a hand cannot hold its palm at a yaw along a path; None if it can.

    Args:
        hand: Model of the hand.
        config: Configuration of the grasp.
        path: Poses of the object.
        p_OCoM: Centre of mass of the object in O, shape (3,), in metres.
        table: Height of the table in W, in metres.
        yaw: Yaw of the palm over the first pose, in radians.
    """
    try:
        check_palm(hand, config, path, p_OCoM, yaw)
    except InvalidArgumentError as error:
        return error
    height = float((path[0] @ p_OCoM + hand.X_LA.translation())[2]) - table
    if (needed := least_palm_height(hand, yaw)) <= height:
        return None
    return InvalidArgumentError(
        f"the hand at home needs a palm {needed:.3g} m over the table, and it is at {height:.3g} m"
    )


def least_palm_height(hand: HandModel, yaw: float) -> float:
    """Returns the least height of a palm's axis over the table; -inf from above, in metres.

    Args:
        hand: Model of the hand with its approach.
        yaw: Yaw of the palm, in radians.
    """
    if hand.X_LA.rotation().IsExactlyIdentity():
        return -np.inf
    return float(hand.fingers.depth(yaw) + LINK_CLEARANCE)


def check_torques(
    hand: HandModel,
    config: GraspConfig,
    surface: ObjectSurface,
    start: StartContacts,
    X_WO: RigidTransform,
    mass: float,
    v_W: FloatArray = _REST,
) -> None:
    """Checks that the joints of the fingers are strong enough to stop and lift an object.

    Nothing is checked if a finger cannot be placed at its start contact, from which it may move.

    Args:
        hand: Model of the hand with its approach.
        config: Configuration of the grasp.
        surface: Surface of the object.
        start: Start contacts.
        X_WO: Initial pose of the object.
        mass: Mass of the object, in kg.
        v_W: Velocity of the object before the hand stops it, in W, shape (3,), in m/s.

    Raises:
        NoGraspError: If no squeeze at the start contacts balances the largest load of the lift
            within the torques, but one would without these limits.
    """
    R_OW, p_OCoM, fingers = X_WO.rotation().matrix().T, surface.p_OCoM, start.has_contact
    p_OC, efforts, columns = start.p_OC[fingers], [], []
    nhat = surface.project(p_OC)[1]
    R_OU = R_OW @ hand.X_LA.rotation().matrix() @ turn_about_z(start.yaw)
    p_OU = p_OCoM + R_OW @ hand.X_LA.translation()
    p_UT = (p_OC + hand.tip_radii[fingers, None] * nhat - p_OU) @ R_OU
    for place, finger in zip(p_UT, np.flatnonzero(fingers), strict=True):
        chain = hand.fingers.chains[finger]
        tips, jacobians = chain.tips(chain.postures(place[None]))
        if np.linalg.norm(tips[0] - place) > _REACHED:
            return
        efforts.append(chain.efforts)
        columns.append(R_OU @ jacobians[0])
    J_OT = np.stack(np.split(block_diag(*columns), len(columns)))
    settings = config.make_settings(hand.description.fingertips)
    load, stop = lift_load(mass, settings, config.lift_axis, v_W)

    def lack(share: float) -> GiveUp:
        """Returns what is missing to balance a share of the load."""
        squeeze = plan_lift(
            *(p_OC - p_OCoM, nhat, fingers, settings),
            load=share * R_OW @ load,
            stop=share * R_OW @ stop,
            friction=config.planned_friction,
            patch_radii=hand.description.patch_radii,
            jacobians=J_OT,
            efforts=np.concatenate(efforts),
        )
        return squeeze.lack if squeeze.residual > settings.imbalance else GiveUp.NONE

    if lack(1.0) != GiveUp.NEEDS_TORQUE:
        return
    held = 0.0
    for power in range(1, _HALVINGS):
        held += 0.5**power * (lack(held + 0.5**power) == GiveUp.NONE)
    needed = float(np.linalg.norm(load))
    holds = f"the torques of the hand's joints hold {held * needed:.3g} N at the start contacts"
    weigh = f"{mass:g} kg weigh {GRAVITY * mass:.3g} N and need {needed:.3g} N in the lift"
    raise NoGraspError(Lack.TORQUE, f"{holds}, and {weigh}")
