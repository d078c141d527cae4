"""Cross-field validation of a scenario's hand and grasp."""

from collections.abc import Iterator

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

Problems = Iterator[tuple[str, str]]
"""Pairs of a key and what is wrong with its value; what follows the first may depend on it."""

_MOMENTS = 4  # Number of times at which the arm's reach is checked.


def grasp_problems(scenario: Scenario, surface: ObjectSurface) -> Problems:
    """Yields the key and a description of each reason why the hand can't grasp the object.

    Args:
        scenario: Scenario whose keys, types and ranges have been checked.
        surface: Surface of its object.
    """
    grasp, plant = scenario.grasp, scenario.plant_config
    if not grasp.has_hand:
        return
    if not isinstance(scenario.object, Box):
        yield "object", "a hand takes a !Box only; choose one, or no hand"
        return
    if not isinstance(scenario.motion, Conveyor):
        yield "motion", "a hand takes what is on a !Conveyor only"
        return
    try:
        hand = load_hand(grasp.hand)
    except ScenarioError as error:
        yield "grasp.hand", str(error)
        return
    if scenario.hand != HandConfig():
        yield "hand", "has no use beside grasp.hand, which says where it is"
    fingers, count = len(hand.fingertips), scenario.num_contacts
    if fingers != count:
        yield "grasp.hand", f"{fingers} fingertips must be {count}, one a contact"
    if plant.time_step > grasp.period:
        problem = f"{plant.time_step} must be at most {grasp.period}, the hand's period"
        yield "plant_config.time_step", problem
    if plant.discrete_contact_approximation == "tamsi":
        problem = "tamsi has no drives for a hand's joints; choose sap, similar or lagged"
        yield "plant_config.discrete_contact_approximation", problem
    if lookahead := scenario.planner.estimator.lookahead:
        problem = f"{lookahead} must be 0 for a hand; it looks ahead itself"
        yield "planner.estimator.lookahead", problem
    try:
        model = load_hand_model(grasp.hand)
    except InvalidArgumentError as error:
        yield "grasp.hand", f"{grasp.hand}: {error}"
        return
    try:
        yaw_range = model.yaw_range(grasp.yaw_range)
    except InvalidArgumentError as error:
        yield "grasp.wrist_range", str(error)
        return
    largest = np.min(grasp.make_settings(hand.fingertips).largest_force)
    if grasp.least_force > largest:
        yield (
            "grasp.least_force",
            f"{grasp.least_force} must be at most {largest}, the largest force",
        )
    if grasp.touch_force >= grasp.least_force:
        problem = f"{grasp.touch_force} must be less than {grasp.least_force}, the least force"
        yield "grasp.touch_force", problem
    weight, lift = GRAVITY * scenario.object.mass, grasp.largest_lift(hand.fingertips)
    if lift < weight:
        yield (
            "grasp.largest_force",
            f"{fingers} fingers of {grasp.largest_force} N hold {lift:.3g} N"
            f" with friction {grasp.planned_friction}; the object weighs {weight:.3g} N",
        )
    try:
        p_OC = scenario.initial_p_OC(surface)
    except InvalidArgumentError as error:
        yield "initial_contacts", str(error)
        return
    yield from _face_problems(hand, surface, p_OC)
    yield from _arm_problems(scenario, scenario.motion, model, yaw_range, p_OC)


def _face_problems(hand: HandDescription, surface: ObjectSurface, p_OC: FloatArray) -> Problems:
    """Finds initial contacts on faces that are forbidden to their fingers."""
    _, normals = surface.project(p_OC)
    for tip, point, normal in zip(hand.fingertips, p_OC, normals, strict=True):
        for face in tip.forbidden_faces:
            if AxisArea(face).holds(normal[None])[0]:
                place = ", ".join(f"{x:.3g}" for x in point)
                yield (
                    "initial_contacts",
                    f"the contact at ({place}) m is nearest to {tip.frame}, to which {face} is"
                    f" forbidden; forbidden to it are: {', '.join(tip.forbidden_faces)}",
                )


def _arm_problems(
    scenario: Scenario,
    motion: Conveyor,
    model: HandModel,
    yaw_range: tuple[float, float],
    p_OC: FloatArray,
) -> Problems:
    """Finds times at which the arm can't reach the object or lift it."""
    grasp, settings = scenario.grasp, scenario.grasp.make_settings()
    profile = VelocityProfile(motion.velocities())
    X_WO = initial_pose(motion, scenario.object)
    first = palm_turn(p_OC, model.azimuths, 0.0, yaw_range)
    end = min(scenario.simulation_duration, grasp.latest_rest(model.description.fingertips))
    for time in np.linspace(0.0, end, _MOMENTS):
        slid, turned = profile.at(time)[0]
        yaw = float(np.clip(first + turned, *yaw_range))
        for height in (0.0, max(settings.lift_height, settings.approach_height)):
            try:
                model.home(X_WO.translation() + np.array([slid, 0.0, height]), yaw)
            except InvalidArgumentError as error:
                yield "motion", f"at {time:.3g} s the object is out of the arm's reach: {error}"
