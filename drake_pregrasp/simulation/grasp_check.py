"""What no single key of a grasp shows."""

from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.motion_config import Conveyor
from drake_pregrasp.diagrams.object_config import Box
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.planning.surface import ObjectSurface
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.grasp_sequencer import GRAVITY


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
    fingers, count = len(grasp.hand.fingertips), scenario.num_contacts
    if fingers != count:
        raise ScenarioError(
            source, "grasp.hand.fingertips", f"{fingers} frames must be {count}, one a contact"
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
        HandModel(grasp.hand)
    except InvalidArgumentError as error:
        raise ScenarioError(source, "grasp.hand", str(error)) from error
    if grasp.least_force > grasp.largest_force:
        raise ScenarioError(
            source,
            "grasp.least_force",
            f"{grasp.least_force} must be at most {grasp.largest_force}, the largest force",
        )
    weight = GRAVITY * scenario.object.mass
    if grasp.largest_lift(fingers) < weight:
        raise ScenarioError(
            source,
            "grasp.largest_force",
            f"{fingers} fingers of {grasp.largest_force} N hold {grasp.largest_lift(fingers):.3g} N"
            f" with friction {grasp.planned_friction}; the object weighs {weight:.3g} N",
        )
    try:
        scenario.initial_p_OC(surface)
    except InvalidArgumentError as error:
        raise ScenarioError(source, "initial_contacts", str(error)) from error
