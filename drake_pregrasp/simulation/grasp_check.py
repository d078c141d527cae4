"""Cross-field validation of a scenario's hand and grasp."""

from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlantConfig

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.grasp_config import ABOVE, SIDE, GraspConfig
from drake_pregrasp.config.hand_description import HandDescription
from drake_pregrasp.config.object_config import PoseStream, Toss
from drake_pregrasp.contacts.assignment import palm_turn
from drake_pregrasp.diagrams import start_grasp
from drake_pregrasp.diagrams.approaches import least_side_height
from drake_pregrasp.diagrams.expected_path import expected_poses
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.errors import Problems, errors_at
from drake_pregrasp.geometry.shapes import Shape
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
    if isinstance(scenario.motion, PoseStream):
        problem = "recorded poses move the object in no plant, so no hand can lift it"
        yield "motion", f"{problem}; choose another motion, or no hand"
    if isinstance(scenario.motion, Toss) and not scenario.motion.table:
        yield "motion.table", "must be true with a hand, which does not catch objects in the air"
    if isinstance(scenario.motion, Toss) and (gravity := scenario.planner.estimator.gravity):
        problem = f"{gravity} must be 0 with a hand: the estimate would fall on after the landing"
        yield "planner.estimator.gravity", problem
    with errors_at("grasp.lift_direction"):
        _ = grasp.lift_axis
    if isinstance(scenario.motion, Toss) and SIDE in grasp.approaches:
        problem = f"must be [{ABOVE}] for a !Toss: the object lands at another height"
        yield "grasp.approaches", f"{grasp.approaches} {problem}"
    with errors_at("hand.file"):
        start_grasp.check_count(hand, count)
    if plant.discrete_contact_approximation == "tamsi":
        problem = "tamsi has no drives for a hand's joints; choose sap, similar or lagged"
        yield "plant_config.discrete_contact_approximation", problem
    yield from start_grasp.grasp_problems(
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


def followed_path(
    scenario: Scenario, hand: HandModel, shape: Shape
) -> list[tuple[float, RigidTransform]]:
    """Returns some times, in seconds, and expected poses X_WO until the hand comes to rest."""
    rest = scenario.grasp.latest_rest(hand.description.fingertips)
    end = min(scenario.simulation_duration, rest)
    poses = expected_poses(scenario.motion, end, shape)
    return poses[:: max(1, len(poses) // 3)]


def check_arm(scenario: Scenario, hand: HandModel, p_OC: FloatArray, shape: Shape) -> None:
    """Raises an error unless the hand can hold its palm at the object at all times, and lift it.

    Args:
        scenario: Scenario of the grasp.
        hand: Model of the hand with its approach.
        p_OC: Start contacts in O, shape (n, 3), in metres.
        shape: Shape of the object.
    """
    (_, start), *_ = path = followed_path(scenario, hand, shape)
    p_AC = hand.around_axis(p_OC, start.rotation().matrix(), shape.p_OCoM)
    yaw_range = hand.yaw_range(scenario.grasp.yaw_range)
    first = palm_turn(p_AC, hand.azimuths, 0.0, yaw_range)
    for time, X_WO in path:
        with errors_at("motion", f"at {time:.3g} s the object is out of the arm's reach: "):
            start_grasp.check_palm(hand, scenario.grasp, [start, X_WO], shape.p_OCoM, first)
