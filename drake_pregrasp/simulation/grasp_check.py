"""Checks of a grasp's settings against the scenario, the hand's description and its model."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlantConfig

from drake_pregrasp.config.grasp_config import ABOVE, SIDE, GraspConfig
from drake_pregrasp.config.hand_description import Carrier, HandDescription
from drake_pregrasp.config.object_config import Toss, is_free_flight
from drake_pregrasp.diagrams import start_grasp
from drake_pregrasp.diagrams.approaches import least_side_height
from drake_pregrasp.diagrams.feasibility import travel_problem
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.errors import Problems, errors_at
from drake_pregrasp.simulation.scenario import Scenario


def grasp_problems(
    scenario: Scenario, hand: HandDescription, count: int, plant: MultibodyPlantConfig
) -> Problems:
    """Yields the key and a description of each reason why settings of a grasp do not fit.

    Args:
        scenario: Scenario whose keys, types and ranges have been checked.
        hand: Description of the hand.
        count: Number of contacts.
        plant: Configuration of the plant.
    """
    grasp = scenario.grasp
    if len(grasp.meeting.wait_at) not in (0, 3):
        problem = f"{grasp.meeting.wait_at} must be empty, or three coordinates"
        yield "grasp.meeting.wait_at", problem
    elif grasp.meeting.wait_at and not isinstance(hand.base, Carrier):
        problem = "must be empty for a hand on an arm: only carriers meet objects"
        yield "grasp.meeting.wait_at", problem
    if not grasp.meeting.earliest <= grasp.meeting.latest:
        problem = f"{grasp.meeting.earliest} must be at most latest, {grasp.meeting.latest}"
        yield "grasp.meeting.earliest", problem
    in_air = is_free_flight(scenario.motion)
    if in_air and not grasp.meeting.wait_at:
        problem = "must be true for a hand that starts over the object"
        yield "motion.table", f"{problem}; with grasp.meeting.wait_at it waits elsewhere"
    if (gravity := scenario.planner.estimator.gravity) and not in_air:
        problem = f"{gravity} must be 0 for a hand, because the table carries the object"
        yield "planner.estimator.gravity", problem
    with errors_at("grasp.lift_direction"):
        _ = grasp.lift_axis
    if isinstance(scenario.motion, Toss) and not in_air and SIDE in grasp.approaches:
        problem = f"must be [{ABOVE}] for a !Toss: the object lands at another height"
        yield "grasp.approaches", f"{grasp.approaches} {problem}"
    with errors_at("hand.file"):
        start_grasp.check_count(hand, count)
    if plant.discrete_contact_approximation == "tamsi":
        problem = "tamsi has no drives for a hand's joints; choose sap, similar or lagged"
        yield "plant_config.discrete_contact_approximation", problem
    if plant.use_sampled_output_ports:
        problem = (
            "must be false with a hand, whose joints the controller would see a time step late"
        )
        yield "plant_config.use_sampled_output_ports", f"true {problem}"
    yield from start_grasp.settings_problems(
        grasp, scenario.planner, hand, mass=scenario.object.mass, time_step=plant.time_step
    )


def model_problems(grasp: GraspConfig, hand: HandModel) -> Problems:
    """Yields the key and a description of each setting of a grasp that a hand's model does not fit.

    Args:
        grasp: Configuration of the grasp.
        hand: Model of the hand, from above, with the range of its own wrist.
    """
    least = least_side_height(hand) if SIDE in grasp.approaches else 0.0
    if 0 < grasp.side_height < least:
        problem = f"{grasp.side_height} must be at least {least:.3g}"
        yield "grasp.side_height", f"{problem}, so that the hand clears the table"
    with errors_at("grasp.wrist_range"):
        hand.yaw_range(grasp.yaw_range)
    if (place := grasp.meeting.wait_at) and (problem := travel_problem(hand, np.array(place))):
        yield "grasp.meeting.wait_at", f"{place}: {problem}"
