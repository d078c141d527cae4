"""What no single key of a grasp shows."""

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.hand_description import HandDescription
from drake_pregrasp.config.object_config import Box, Conveyor
from drake_pregrasp.contacts.assignment import palm_turn
from drake_pregrasp.diagrams.expected_path import initial_pose
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.geometry.motion_profiles import VelocityProfile
from drake_pregrasp.geometry.no_touch import AxisArea
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.simulation.hand_file import HandConfig, load_hand, load_hand_model
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.grasp_sequencer import GRAVITY

_MOMENTS = 4  # At which an arm's reach is tried.


def check_grasp(source: str, scenario: Scenario, surface: ObjectSurface) -> None:
    """Raises a `ScenarioError` unless the hand can do what it is asked to.

    Args:
        source: Where the scenario is from, for the message.
        scenario: Loaded, with keys and types checked.
        surface: The object's.
    """
    grasp = scenario.grasp
    if not grasp.has_hand:
        return
    if not isinstance(scenario.object, Box):
        raise ScenarioError(source, "object", "a hand takes a !Box only; choose one, or no hand")
    if not isinstance(scenario.motion, Conveyor):
        raise ScenarioError(source, "motion", "a hand takes what is on a !Conveyor only")
    try:
        hand = load_hand(grasp.hand)
    except ScenarioError as error:
        raise ScenarioError(source, "grasp.hand", str(error)) from error
    if scenario.hand != HandConfig():
        raise ScenarioError(source, "hand", "has no use beside grasp.hand, which says where it is")
    fingers, count = len(hand.fingertips), scenario.num_contacts
    if fingers != count:
        raise ScenarioError(
            source, "grasp.hand", f"{fingers} fingertips must be {count}, one a contact"
        )
    if scenario.plant_config.time_step > grasp.period:
        raise ScenarioError(
            source,
            "plant_config.time_step",
            f"{scenario.plant_config.time_step} must be at most {grasp.period}, the hand's period",
        )
    if scenario.plant_config.discrete_contact_approximation == "tamsi":
        raise ScenarioError(
            source,
            "plant_config.discrete_contact_approximation",
            "tamsi has no drives for a hand's joints; choose sap, similar or lagged",
        )
    if scenario.planner.estimator.lookahead:
        raise ScenarioError(
            source,
            "planner.estimator.lookahead",
            f"{scenario.planner.estimator.lookahead} must be 0 for a hand; it looks ahead itself",
        )
    try:
        model = load_hand_model(grasp.hand)
    except InvalidArgumentError as error:
        raise ScenarioError(source, "grasp.hand", f"{grasp.hand}: {error}") from error
    try:
        yaw_range = model.yaw_range(grasp.yaw_range)
    except InvalidArgumentError as error:
        raise ScenarioError(source, "grasp.wrist_range", str(error)) from error
    largest = np.min(grasp.make_settings(hand.fingertips).largest_force)
    if grasp.least_force > largest:
        raise ScenarioError(
            source,
            "grasp.least_force",
            f"{grasp.least_force} must be at most {largest}, the largest force",
        )
    if grasp.touch_force >= grasp.least_force:
        raise ScenarioError(
            source,
            "grasp.touch_force",
            f"{grasp.touch_force} must be less than {grasp.least_force}, the least force",
        )
    weight, lift = GRAVITY * scenario.object.mass, grasp.largest_lift(hand.fingertips)
    if lift < weight:
        raise ScenarioError(
            source,
            "grasp.largest_force",
            f"{fingers} fingers of {grasp.largest_force} N hold {lift:.3g} N"
            f" with friction {grasp.planned_friction}; the object weighs {weight:.3g} N",
        )
    try:
        p_OC = scenario.initial_p_OC(surface)
    except InvalidArgumentError as error:
        raise ScenarioError(source, "initial_contacts", str(error)) from error
    _check_faces(source, hand, surface, p_OC)
    _check_arm(source, scenario, model, yaw_range, scenario.motion, p_OC)


def _check_faces(
    source: str, hand: HandDescription, surface: ObjectSurface, p_OC: FloatArray
) -> None:
    """Each finger starts at ground that it may touch."""
    _, normals = surface.project(p_OC)
    for tip, point, normal in zip(hand.fingertips, p_OC, normals, strict=True):
        for face in tip.forbidden_faces:
            if AxisArea(face).holds(normal[None])[0]:
                place = ", ".join(f"{x:.3g}" for x in point)
                raise ScenarioError(
                    source,
                    "initial_contacts",
                    f"the contact at ({place}) m is nearest to {tip.frame}, to which {face} is"
                    f" forbidden; forbidden to it are: {', '.join(tip.forbidden_faces)}",
                )


def _check_arm(
    source: str,
    scenario: Scenario,
    model: HandModel,
    yaw_range: tuple[float, float],
    motion: Conveyor,
    p_OC: FloatArray,
) -> None:
    """An arm can follow the object as far as it goes, and lift it there."""
    grasp, settings = scenario.grasp, scenario.grasp.make_settings()
    profile = VelocityProfile(motion.velocities())
    X_WO = initial_pose(motion, scenario.object)
    first = palm_turn(p_OC, model.azimuths, 0.0, yaw_range)
    end = min(scenario.simulation_duration, grasp.latest_rest(model.description.fingertips))
    for time in np.linspace(0.0, end, _MOMENTS):
        slid, turned = profile.at(time)[0]
        for height in (0.0, max(settings.lift_height, settings.approach_height)):
            try:
                model.home(
                    X_WO.translation() + np.array([slid, 0.0, height]),
                    float(np.clip(first + turned, *yaw_range)),
                )
            except InvalidArgumentError as error:
                problem = f"at {time:.3g} s the object is out of the arm's reach: {error}"
                raise ScenarioError(source, "motion", problem) from error
