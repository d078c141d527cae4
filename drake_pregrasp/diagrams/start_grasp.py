"""Start contacts of a hand over an object, chosen or given, and the planner's limits for it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.config.grasp_config import GraspConfig, hand_limits
from drake_pregrasp.config.hand_description import HandDescription
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.contacts.assignment import assign_fingers_round, make_room, palm_turn
from drake_pregrasp.contacts.start_contacts import (
    HandOverObject,
    StartContacts,
    choose_start_contacts,
)
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.solids import SignedDistance, Solid
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.grasping.grasp_state import GraspSettings
from drake_pregrasp.regions.constraints import Obstacles, RegionConstraints
from drake_pregrasp.regions.finger_measures import FingerMeasures
from drake_pregrasp.systems.grasp_sequencer import GRAVITY
from drake_pregrasp.systems.hand_scene import LINK_CLEARANCE
from drake_pregrasp.systems.palm_posture import FROM_ABOVE, reach_frame

ConstraintsAt = Callable[[float], RegionConstraints]
"""Function from a yaw of the palm, in radians, to the constraints of the contacts in O."""


def start_constraints(
    limits: LimitsConfig,
    X_WO: RigidTransform,
    fixed: Sequence[Solid],
    yaw_range: tuple[float, float],
    X_LA: RigidTransform = FROM_ABOVE,
    measures: FingerMeasures | None = None,
) -> ConstraintsAt:
    """Returns the constraints of a hand's contacts as a function of the palm's yaw.

    Args:
        limits: Limits of the planner, with those of the hand.
        X_WO: Pose of the object.
        fixed: Solids in W that fingertips avoid, such as the table.
        yaw_range: Smallest and largest angle of the palm, in radians.
        X_LA: Approach of the palm; see `HandModel`.
        measures: Measures of the fingers in the palm's frame; None if no limit needs them.
    """
    R_OW, least = X_WO.rotation().matrix().T, limits.least_measures()
    shared = RegionConstraints(
        obstacles=Obstacles(tuple(fixed)).moved(R_OW, -R_OW @ X_WO.translation()),
        clearance=limits.clearance,
        tip_radii=np.array(limits.tip_radii),
        tip_gap=limits.tip_gap,
        standoff=limits.standoff,
        reach=limits.reaches(),
        closed=limits.closed(),
    )

    def at(yaw: float) -> RegionConstraints:
        R_OH = R_OW @ reach_frame(X_WO, yaw, yaw_range, X_LA).rotation().matrix()
        R_OU, p_OA = R_OW @ X_LA.rotation().matrix() @ _turned(yaw), R_OW @ X_LA.translation()
        fingers = measures and replace(measures, least=least, R_OU=R_OU, p_OU=p_OA)
        return replace(shared, reach_pose=(R_OH, p_OA), finger_measures=fingers)

    return at


def choose_contacts(
    hand: HandModel,
    config: GraspConfig,
    limits: LimitsConfig,
    surface: ObjectSurface,
    *,
    solid: SignedDistance,
    mass: float,
    X_WO: RigidTransform,
    fixed: Sequence[Solid],
    path: Sequence[RigidTransform] = (),
) -> StartContacts:
    """Returns the fingers, the contacts and the palm's yaw with which a hand starts.

    Args:
        hand: Model of the hand.
        config: Configuration of the grasp.
        limits: Limits of the planner, with those of the hand; see `hand_planner`.
        surface: Surface of the object.
        solid: The object in O.
        mass: Mass of the object, in kg.
        X_WO: Pose of the object.
        fixed: Solids in W that fingertips avoid, such as the table.
        path: Expected poses of the object, over which an arm must hold the palm as well.

    Raises:
        NoGraspError: If there is no grasp; the message says what is missing.
    """
    R_WO, yaw_range = X_WO.rotation().matrix(), hand.yaw_range(config.yaw_range)
    settings = config.make_settings(hand.description.fingertips)
    least = np.full(len(hand.azimuths), settings.least_force)

    R_OW, X_LA = R_WO.T, hand.X_LA
    R_OA, p_OA = R_OW @ X_LA.rotation().matrix(), R_OW @ X_LA.translation()

    is_above = X_LA.rotation().IsExactlyIdentity()
    measures = hand.finger_measures(surface) if np.any(limits.least_measures()) else None

    def holds_palm(yaw: float) -> bool:
        try:
            check_palm(hand, [X_WO, *path], yaw, yaw_range, raised_places(hand, config))
        except InvalidArgumentError:
            return False
        height = float((X_WO.translation() + X_LA.translation())[2])
        return is_above or hand.side_depth(yaw) + LINK_CLEARANCE <= height

    return choose_start_contacts(
        surface,
        solid,
        HandOverObject(
            constraints_at=start_constraints(limits, X_WO, fixed, yaw_range, X_LA, measures),
            p_OT_at=lambda yaw: hand.p_HT @ (R_OA @ _turned(yaw)).T + p_OA,
            azimuths=hand.azimuths,
            R_AO=R_OA.T,
            p_AO=-p_OA @ R_OA,
            wrench=np.append(R_OW @ [0.0, 0.0, -GRAVITY * mass], np.zeros(3)),
            friction=config.planned_friction,
            normal_forces=np.array([least, settings.largest_force]),
            yaw_range=yaw_range,
            least_fingers=GraspSettings.least_fingers,
            holds_palm=holds_palm,
            in_workspace=lambda yaw, p_OT: hand.in_workspace((p_OT - p_OA) @ R_OA @ _turned(yaw)),
        ),
    )


def hand_planner(config: PlannerConfig, grasp: GraspConfig, hand: HandDescription) -> PlannerConfig:
    """Returns a planner's configuration with the limits of a hand.

    Limits of the configuration take precedence over those of the hand. The forbidden faces of a
    finger are those of both.

    Args:
        config: Configuration of the planner.
        grasp: Configuration of the grasp.
        hand: Description of the hand.
    """
    own, default = config.limits, LimitsConfig()
    limits = hand_limits(hand, grasp, reach=grasp.use_reach)
    given = {name: value for name, value in vars(own).items() if value != getattr(default, name)}
    if len(own.forbidden_faces) == len(limits.forbidden_faces):
        both = zip(own.forbidden_faces, limits.forbidden_faces, strict=True)
        given["forbidden_faces"] = [list(dict.fromkeys([*a, *b])) for a, b in both]
    return replace(config, limits=replace(limits, **given))


def assigned_contacts(
    hand: HandModel,
    yaw_range: tuple[float, float],
    p_OC: FloatArray,
    *,
    p_OCoM: FloatArray,
    R_WO: FloatArray,
) -> FloatArray:
    """Returns given contacts in the order of the fingers, shape (n, 3), in metres.

    Args:
        hand: Model of the hand.
        yaw_range: Smallest and largest angle of the palm, in radians.
        p_OC: Contacts in O, shape (n, 3), in metres.
        p_OCoM: Centre of mass of the object in O, shape (3,), in metres.
        R_WO: Orientation of the object.

    Raises:
        InvalidArgumentError: If there is not one contact for each finger, or one is out of reach.
    """
    check_count(hand.description, len(p_OC))
    p_CoMC_W = (p_OC - p_OCoM) @ R_WO.T
    order, _ = assign_fingers_round(
        hand.azimuths,
        np.arctan2(p_CoMC_W[:, 1], p_CoMC_W[:, 0]),
        largest_offset=hand.largest_offsets,
        yaw_range=yaw_range,
    )
    return np.array(p_OC[order])


def contacts_with_room(
    hand: HandModel,
    limits: LimitsConfig,
    yaw_range: tuple[float, float],
    surface: ObjectSurface,
    p_OC: FloatArray,
    *,
    X_WO: RigidTransform,
    fixed: Sequence[Solid],
) -> tuple[FloatArray, BoolArray]:
    """Returns contacts beside each other, shape (n, 3), and which have room, shape (n,).

    Contacts whose fingertips overlap are replaced by others on the allowed surface. A finger for
    which there is none within its reach stays away from the object.

    Args:
        hand: Model of the hand.
        limits: Limits of the planner, with those of the hand; see `hand_planner`.
        yaw_range: Smallest and largest angle of the palm, in radians.
        surface: Surface of the object.
        p_OC: Contacts in O, in the order of the fingers, shape (n, 3), in metres.
        X_WO: Pose of the object.
        fixed: Solids in W that fingertips avoid, such as the table.
    """
    R_WO = X_WO.rotation().matrix()
    yaw = palm_turn((p_OC - surface.p_OCoM) @ R_WO.T, hand.azimuths, 0.0, yaw_range)
    constraints = start_constraints(limits, X_WO, fixed, yaw_range)(yaw)
    return make_room(surface, p_OC, constraints, up=R_WO[2])


def grasp_problems(
    config: GraspConfig,
    planner: PlannerConfig,
    hand: HandDescription,
    *,
    mass: float,
    time_step: float,
) -> Iterator[tuple[str, str]]:
    """Yields the key and a description of each reason why settings of a grasp do not go together.

    Args:
        config: Configuration of the grasp.
        planner: Configuration of the planner.
        hand: Description of the hand.
        mass: Mass of the object, in kg.
        time_step: Time step of the plant, in seconds.
    """
    if time_step > config.period:
        problem = f"{time_step} must be at most {config.period}, the hand's period"
        yield "plant_config.time_step", problem
    if ahead := planner.estimator.lookahead:
        yield "planner.estimator.lookahead", f"{ahead} must be 0: a hand looks ahead itself"
    largest = np.min(config.make_settings(hand.fingertips).largest_force)
    if config.least_force > largest:
        problem = f"{config.least_force} must be at most {largest}, the largest force"
        yield "grasp.least_force", problem
    if config.touch_force >= config.least_force:
        problem = f"{config.touch_force} must be less than {config.least_force}, the least force"
        yield "grasp.touch_force", problem
    weight, lift = GRAVITY * mass, config.largest_lift(hand.fingertips)
    if lift < weight:
        fingers = len(hand.fingertips)
        problem = f"{fingers} fingers of {config.largest_force} N hold {lift:.3g} N with friction"
        problem = f"{problem} {config.planned_friction}; the object weighs {weight:.3g} N"
        yield "grasp.largest_force", problem


def check_count(hand: HandDescription, count: int) -> None:
    """Checks that a hand has one fingertip for each contact.

    Raises:
        InvalidArgumentError: If it has more, or fewer.
    """
    if (fingers := len(hand.fingertips)) != count:
        problem = f"{fingers} fingertips must be {count}, one for each contact"
        raise InvalidArgumentError(f"{problem}; without initial_contacts the hand chooses them")


def check_room(hand: HandDescription, has_room: BoolArray) -> None:
    """Checks that enough fingers of a hand reach the object with room beside each other.

    Args:
        hand: Description of the hand.
        has_room: Mask of the fingers that do, shape (n,).

    Raises:
        InvalidArgumentError: If too few do; the message names the others.
    """
    there, least = int(np.sum(has_room)), GraspSettings.least_fingers
    away = [tip.frame for tip, room in zip(hand.fingertips, has_room, strict=True) if not room]
    if away and there < least:
        problem = f"only {there} fingers reach it and have room, {least} are needed"
        raise InvalidArgumentError(f"{problem}; there is no place for {', '.join(away)}")


def check_palm(
    hand: HandModel,
    poses: Sequence[RigidTransform],
    yaw: float,
    yaw_range: tuple[float, float],
    places: Sequence[FloatArray],
) -> None:
    """Checks that a hand can hold its palm at an object.

    Args:
        hand: Model of the hand.
        poses: Poses of the object, with which the palm turns.
        yaw: Yaw of the palm over the first pose, in radians.
        yaw_range: Smallest and largest angle of the palm, in radians.
        places: Places of G relative to the object's origin at each pose, in W, in metres.

    Raises:
        InvalidArgumentError: If an arm cannot hold the palm.
    """
    upright = hand.X_LA.rotation().matrix()[2, 2]  # The palm turns with the object.
    first, *_ = turns = [RollPitchYaw(X_WO.rotation()).yaw_angle() for X_WO in poses]
    for X_WO, turn in zip(poses, turns, strict=True):
        turned = float(np.clip(yaw + (turn - first) * upright, *yaw_range))
        for place in places:
            hand.home(X_WO.translation() + place, turned)


def raised_places(hand: HandModel, config: GraspConfig) -> list[FloatArray]:
    """Returns places of G relative to the object's origin between which a hand moves, in W."""
    settings = config.make_settings()
    back = settings.approach_height * hand.X_LA.rotation().matrix()[:, 2]
    return [np.zeros(3), back, settings.lift_height * config.lift_axis]


def _turned(yaw: float) -> FloatArray:
    R: FloatArray = RotationMatrix.MakeZRotation(yaw).matrix()
    return R
