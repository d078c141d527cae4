"""Start contacts of a hand over an object, chosen or given, and the planner's limits for it."""

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from pydrake.math import RigidTransform

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.config.grasp_config import GraspConfig, hand_limits
from drake_pregrasp.config.hand_description import HandDescription, least_fingers
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.config.object_config import GRAVITY
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.contacts.assignment import (
    assign_fingers_round,
    make_room,
    palm_turn,
    turned_within,
)
from drake_pregrasp.contacts.hand_above_object import HandAboveObject, StartContacts
from drake_pregrasp.contacts.start_contacts import choose_start_contacts
from drake_pregrasp.diagrams.approaches import Approach, best_approach, table_height
from drake_pregrasp.diagrams.feasibility import least_palm_height, palm_problem
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.errors import InvalidArgumentError, Lack, NoGraspError, OutOfReachError
from drake_pregrasp.geometry.rotations import turn_about_z
from drake_pregrasp.geometry.solids import SignedDistance, Solid
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.grasping.clearances import LINK_CLEARANCE, TIP_LEAD
from drake_pregrasp.grasping.grasp_state import GENTLE
from drake_pregrasp.regions.constraints import Obstacles, RegionConstraints
from drake_pregrasp.regions.finger_measures import FingerMeasures
from drake_pregrasp.systems.palm_frames import reach_frame
from drake_pregrasp.systems.squeeze_program import LOAD_CHANGE

_PASSING = 100.0  # Weight of free ways along the palm's axis for objects that come along it.
_PALM_YAWS = 13  # Yaws at which the palm is checked if there is no grasp.


def _start_constraints(
    hand: HandModel,
    limits: LimitsConfig,
    X_WO: RigidTransform,
    fixed: Sequence[Solid],
    yaw_range: tuple[float, float],
    p_OCoM: FloatArray,
    measures: FingerMeasures | None = None,
) -> Callable[[float], RegionConstraints]:
    """Returns the constraints in O of a hand's contacts as a function of the palm's yaw."""
    R_OW, least = X_WO.rotation().matrix().T, limits.least_measures()
    p_OA = p_OCoM + R_OW @ hand.X_LA.translation()
    shared = RegionConstraints(
        len(hand.tip_radii),
        obstacles=Obstacles(tuple(fixed)).moved(R_OW, -R_OW @ X_WO.translation()),
        clearance=limits.clearance,
        tip_radii=np.array(limits.tip_radii),
        tip_gap=limits.tip_gap,
        standoff=limits.standoff,
        reach=limits.reaches(),
        closed=limits.closed(),
    )

    def at(yaw: float) -> RegionConstraints:
        R_OH = R_OW @ reach_frame(p_OCoM, yaw, yaw_range, hand.X_LA).rotation().matrix()
        R_OU = R_OW @ hand.X_LA.rotation().matrix() @ turn_about_z(yaw)
        fingers = measures and replace(measures, least=least, R_OU=R_OU, p_OU=p_OA)
        return replace(shared, reach_pose=(R_OH, p_OA), finger_measures=fingers)

    return at


def best_start(
    hands: Iterable[Sequence[HandModel]],
    config: GraspConfig,
    planner: PlannerConfig,
    surface: ObjectSurface,
    *,
    solid: SignedDistance,
    mass: float,
    X_WO: RigidTransform,
    fixed: Sequence[Solid],
    path: Sequence[RigidTransform] = (),
    p_OC: FloatArray | None = None,
) -> Approach:
    """Returns the approach with the best fingers, contacts and yaw of the palm for the start.

    Of the palm's heights, it is the first one at which there is a grasp.

    Given contacts are in the order of the fingers, beside each other, without a margin. Those whose
    fingertips overlap are replaced by others on the allowed surface. A finger for which there is
    none within its reach stays away from the object. Of two approaches the one with more fingers
    whose joints get there, and then with homes nearer to the contacts, scores higher.

    Args:
        hands: Models of the hand from `approaching_hands`, for each height of the palm.
        config: Configuration of the grasp.
        planner: Configuration of the planner; limits of the hand are added.
        surface: Surface of the object.
        solid: The object in O.
        mass: Mass of the object, in kg.
        X_WO: Pose of the object.
        fixed: Solids in W that fingertips avoid, such as the table.
        path: Expected poses of the object, over which an arm, and at which any palm from the side,
            must be held as well.
        p_OC: Given contacts in O, shape (n, 3), in metres; None to choose them.

    Raises:
        NoGraspError: If contacts are to be chosen, but there is no grasp; the message says what is
            missing.
        InvalidArgumentError: If there is not one given contact for each finger, one is out of reach
            or on a face that is forbidden to its finger, too few have room, or a palm from the side
            has no place there.
    """
    poses = [X_WO, *path]

    def start_of(hand: HandModel) -> StartContacts:
        limits = hand_planner(planner, config, hand.description).limits
        if p_OC is not None:
            return _given_contacts(hand, config, limits, surface, p_OC, poses, fixed)
        gravity = planner.estimator.gravity
        return _chosen_contacts(hand, config, limits, surface, solid, mass, poses, fixed, gravity)

    return best_approach(hands, start_of)


def _chosen_contacts(
    hand: HandModel,
    config: GraspConfig,
    limits: LimitsConfig,
    surface: ObjectSurface,
    solid: SignedDistance,
    mass: float,
    poses: Sequence[RigidTransform],
    fixed: Sequence[Solid],
    gravity: float,
) -> StartContacts:
    X_WO, forces = poses[0], config.make_settings(hand.description.fingertips)
    R_OW, p_OCoM = X_WO.rotation().matrix().T, surface.p_OCoM
    R_OA = R_OW @ hand.X_LA.rotation().matrix()
    p_OA = p_OCoM + R_OW @ hand.X_LA.translation()

    table = table_height(fixed)

    def fits_palm(yaw: float, p_OC: FloatArray) -> BoolArray:
        heights = (X_WO @ p_OC.T)[2] - table
        return np.asarray(heights >= least_palm_height(hand, yaw))

    measures = hand.fingers.measures if np.any(limits.least_measures()) else None
    yaw_range = hand.yaw_range(config.yaw_range)
    problem_at = partial(palm_problem, hand, config, poses, p_OCoM, table)

    def R_OU_at(yaw: float) -> FloatArray:
        return np.asarray(R_OA @ turn_about_z(yaw))

    def link_gaps(yaw: float, finger: int, p_OT: FloatArray) -> FloatArray:
        R_OU = R_OU_at(yaw)
        return hand.fingers.link_gaps(
            finger, (p_OT - p_OA) @ R_OU, lambda p_UP: solid.distance(p_UP @ R_OU.T + p_OA)
        )

    def compliance(yaw: float, finger: int, p_OT: FloatArray) -> FloatArray:
        R_OU = R_OU_at(yaw)
        return R_OU @ hand.fingers.compliance(finger, (p_OT - p_OA) @ R_OU) @ R_OU.T

    return _contacts_or_reason(
        problem_at,
        surface,
        solid,
        HandAboveObject(
            constraints_at=_start_constraints(
                hand, limits, X_WO, fixed, yaw_range, p_OCoM, measures
            ),
            p_OT_at=lambda yaw: hand.p_HT @ R_OU_at(yaw).T + p_OA,
            azimuths=hand.azimuths,
            R_AO=R_OA.T,
            p_AO=-p_OA @ R_OA,
            wrench=np.append(R_OW @ [0.0, 0.0, -GRAVITY * mass], np.zeros(3)),
            friction=config.planned_friction,
            normal_forces=np.array(np.broadcast_arrays(forces.least_force, forces.largest_force)),
            touch_force=GENTLE * forces.touch_force,
            yaw=hand.home_yaw,
            yaw_range=yaw_range,
            least_fingers=forces.least_fingers,
            patch_radii=hand.description.patch_radii,
            pairs=tuple(limits.pairs),
            opening=hand.fingers.opening(hand.description.jaws) - 2 * config.standoff,
            holds_palm=lambda yaw: not problem_at(yaw),
            fits_palm=fits_palm,
            workspace_gaps=lambda yaw, p_OT, largest: hand.fingers.workspace_gaps(
                (p_OT - p_OA) @ R_OU_at(yaw), largest
            ),
            link_gaps=link_gaps,
            compliance=compliance,
            load_change=LOAD_CHANGE * GRAVITY * mass,
            least_link_gaps=(TIP_LEAD, LINK_CLEARANCE),
            clearance_weight=_clearance_weight(hand, gravity),
        ),
    )


def _clearance_weight(hand: HandModel, gravity: float) -> float:
    """Returns the weight of contacts that other parts of the object hide from the palm."""
    if gravity:  # The object passes between the fingertips.
        return _PASSING
    return float(hand.X_LA.IsExactlyIdentity())  # Fingers from the side reach around.


def _contacts_or_reason(
    palm_problem: Callable[[float], InvalidArgumentError | None],
    surface: ObjectSurface,
    solid: SignedDistance,
    hand: HandAboveObject,
) -> StartContacts:
    """Returns the start contacts of a hand, or raises an error that says what is missing.

    It is the arm's reach if the palm is held at no yaw, or if only that prevents a grasp.
    """
    turns = np.linspace(-np.pi, np.pi, _PALM_YAWS).tolist()
    yaws = sorted({turned_within(yaw, hand.yaw_range) for yaw in turns}, key=abs)
    missed = list(itertools.takewhile(bool, map(palm_problem, yaws)))
    if len(missed) == len(yaws):
        nearest = min(filter(None, missed), key=_miss)
        raise NoGraspError(Lack.ARM, str(nearest), _miss(nearest))
    try:
        return choose_start_contacts(surface, solid, hand)
    except NoGraspError as error:
        if not (missed := list(filter(None, map(palm_problem, yaws)))):
            raise
        try:
            choose_start_contacts(surface, solid, replace(hand, holds_palm=lambda yaw: True))
        except NoGraspError:
            raise error from None
        held = f"the palm is held at {len(yaws) - len(missed)} of {len(yaws)} yaws"
        detail = f"{held}, and fingers grasp at none of these: {missed[0]}"
        raise NoGraspError(Lack.ARM, detail) from error


def _miss(problem: InvalidArgumentError) -> float:
    return problem.miss if isinstance(problem, OutOfReachError) else np.inf


def _given_contacts(
    hand: HandModel,
    config: GraspConfig,
    limits: LimitsConfig,
    surface: ObjectSurface,
    p_OC: FloatArray,
    poses: Sequence[RigidTransform],
    fixed: Sequence[Solid],
) -> StartContacts:
    check_count(hand.description, len(p_OC))
    X_WO, yaw_range = poses[0], hand.yaw_range(config.yaw_range)
    R_WO, X_LA, p_OCoM = X_WO.rotation().matrix(), hand.X_LA, surface.p_OCoM
    p_AC = hand.around_axis(p_OC, R_WO, p_OCoM)
    order, _ = assign_fingers_round(
        hand.azimuths,
        np.arctan2(p_AC[:, 1], p_AC[:, 0]),
        largest_offset=hand.largest_offsets,
        yaw_range=yaw_range,
    )
    p_OC, p_AC = p_OC[order], p_AC[order]
    hand.check_contacts(p_OC, surface.project(p_OC)[1])
    yaw = palm_turn(p_AC, hand.azimuths, 0.0, yaw_range)
    # From above, an arm is checked along the path, by a message that tells the time.
    problem_at = partial(palm_problem, hand, config, poses, p_OCoM, table_height(fixed))
    if not X_LA.IsExactlyIdentity() and (problem := problem_at(yaw)):
        raise InvalidArgumentError(f"{problem}, with a palm from the side at these contacts")
    constraints = _start_constraints(hand, limits, X_WO, fixed, yaw_range, p_OCoM)(yaw)
    R_OA = R_WO.T @ X_LA.rotation().matrix()
    p_OC, has_room = make_room(surface, p_OC, constraints, up=R_OA[:, 2])
    _check_room(hand.description, has_room)
    p_OT = p_OC + hand.tip_radii[:, None] * surface.project(p_OC)[1]
    p_AT = hand.around_axis(p_OT, R_WO, p_OCoM) @ turn_about_z(yaw)
    reached = has_room & (hand.fingers.workspace_gaps(p_AT[:, None], 0.0)[:, 0] == 0)
    away = np.mean(np.linalg.norm(hand.p_HT - p_AT, axis=1))
    return StartContacts(p_OC, has_room, yaw, np.nan, float(np.sum(reached) - away))


def _check_room(hand: HandDescription, has_room: BoolArray) -> None:
    there, least = int(np.sum(has_room)), least_fingers(hand.fingertips)
    away = [tip.frame for tip, room in zip(hand.fingertips, has_room, strict=True) if not room]
    if away and there < least:
        problem = f"only {there} fingers reach the object and have room, {least} are needed"
        raise InvalidArgumentError(f"{problem}; there is no place for {', '.join(away)}")


def hand_planner(config: PlannerConfig, grasp: GraspConfig, hand: HandDescription) -> PlannerConfig:
    """Returns a planner's configuration with the limits of a hand.

    Limits of the configuration that are not at their defaults take precedence over those of the
    hand. The forbidden faces of a finger are those of both.

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


def settings_problems(
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
    if (count := len(hand.fingertips)) < least_fingers(hand.fingertips):
        problem = f"{count} hard fingertips do not resist a moment about the line through them"
        yield "hand.file", f"{problem}; flat ones need a patch_radius, or the hand a third finger"
    largest = np.min(config.make_settings(hand.fingertips).largest_force)
    if config.least_force > largest:
        problem = f"{config.least_force} must be at most {largest}, the largest force"
        yield "grasp.least_force", problem
    if config.touch_force >= config.least_force:
        problem = f"{config.touch_force} must be less than {config.least_force}, the least force"
        yield "grasp.touch_force", problem
    weight, lift = GRAVITY * mass, config.largest_lift(hand.fingertips)
    if lift < weight:
        forces = config.largest_forces(hand.fingertips)
        fingers = f"fingers of {', '.join(f'{force:g}' for force in forces)} N"
        problem = f"{fingers} hold {lift:.3g} N with friction {config.planned_friction}"
        key = "grasp.largest_force" if max(forces) == config.largest_force else "hand.file"
        yield key, f"{problem}; the object weighs {weight:.3g} N"


def check_count(hand: HandDescription, count: int) -> None:
    """Checks that a hand has one fingertip for each contact.

    Raises:
        InvalidArgumentError: If it has more, or fewer.
    """
    if (fingers := len(hand.fingertips)) != count:
        problem = f"{fingers} fingertips must be {count}, one for each contact"
        raise InvalidArgumentError(f"{problem}; without initial_contacts the hand chooses them")
