"""Cross-field validation of a scenario's hand and grasp."""

import contextlib
from collections.abc import Iterator

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.grasp_config import ABOVE, SIDE
from drake_pregrasp.config.object_config import PoseStream, Toss
from drake_pregrasp.contacts.assignment import palm_turn
from drake_pregrasp.diagrams import start_grasp
from drake_pregrasp.diagrams.approaches import least_side_height
from drake_pregrasp.diagrams.expected_path import initial_pose
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.start_grasp import check_count, check_palm, check_room
from drake_pregrasp.errors import PregraspError, ScenarioError
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.simulation.hand_file import HandConfig, load_hand, load_hand_model
from drake_pregrasp.simulation.scenario import Scenario, followed_path, initial_contacts

Problems = Iterator[tuple[str, str]]
"""Pairs of a key and the problem of its value. Later pairs may follow from the first one."""


def raise_first(source: str, problems: Problems) -> None:
    """Raises a `ScenarioError` for the first problem, if any.

    Args:
        source: Name of the scenario's origin, for the error message.
        problems: Lazy iterator over the problems.
    """
    try:
        for key, problem in problems:
            raise ScenarioError("", key, problem)
    except ScenarioError as error:
        raise ScenarioError(source, error.key, error.problem) from error.__cause__


@contextlib.contextmanager
def errors_at(key: str, prefix: str = "") -> Iterator[None]:
    """Turns an error in the `with` block into the problem of a key, for `raise_first`."""
    try:
        yield
    except PregraspError as error:
        raise ScenarioError("", key, f"{prefix}{error}") from error


def grasp_problems(scenario: Scenario, surface: ObjectSurface) -> Problems:
    """Yields the key and a description of each reason why the hand cannot grasp the object.

    Args:
        scenario: Scenario whose keys, types and ranges have been checked.
        surface: Surface of the scenario's object.
    """
    grasp, plant = scenario.grasp, scenario.plant_settings
    if not grasp.has_hand:
        return
    if isinstance(scenario.motion, PoseStream):
        problem = "recorded poses move the object in no plant, so no hand can lift it"
        yield "motion", f"{problem}; choose another motion, or no hand"
    if isinstance(scenario.motion, Toss) and not scenario.motion.table:
        yield "motion.table", "must be true with a hand, which does not catch objects in the air"
    if isinstance(scenario.motion, Toss) and (gravity := scenario.planner.estimator.gravity):
        problem = f"{gravity} must be 0 with a hand: the estimate would fall on after the landing"
        yield "planner.estimator.gravity", problem
    with errors_at("grasp.hand"):
        hand = load_hand(grasp.hand)
    if scenario.hand != HandConfig():
        yield "hand", "has no effect with grasp.hand, which sets the pose; leave it out"
    with errors_at("grasp.lift_direction"):
        _ = grasp.lift_axis
    if isinstance(scenario.motion, Toss) and SIDE in grasp.approaches:
        problem = f"must be [{ABOVE}] for a !Toss: the object lands at another height"
        yield "grasp.approaches", f"{grasp.approaches} {problem}"
    with errors_at("grasp.hand"):
        check_count(hand, scenario.num_contacts)
    if plant.discrete_contact_approximation == "tamsi":
        problem = "tamsi has no drives for a hand's joints; choose sap, similar or lagged"
        yield "plant_config.discrete_contact_approximation", problem
    with errors_at("grasp.hand", f"{grasp.hand}: "):
        least = least_side_height(load_hand_model(grasp.hand)) if SIDE in grasp.approaches else 0.0
    if 0 < grasp.side_height < least:
        problem = f"{grasp.side_height} must be at least {least:.3g}"
        yield "grasp.side_height", f"{problem}, so that the hand clears the table"
    with errors_at("grasp.hand", f"{grasp.hand}: "):
        model = scenario.load_hand_model()
    with errors_at("grasp.wrist_range"):
        model.yaw_range(grasp.yaw_range)
    yield from start_grasp.grasp_problems(
        grasp, scenario.planner, hand, mass=scenario.object.mass, time_step=plant.time_step
    )
    X_WO, where = initial_pose(scenario.motion, scenario.object), ""
    if not model.X_LA.rotation().IsExactlyIdentity():
        height = (X_WO @ surface.p_OCoM + model.X_LA.translation())[2]
        where = f"from the side, with the palm's axis {height:.3g} m over the table: "
    with errors_at("object" if scenario.chooses_contacts else "initial_contacts", where):
        p_OC = scenario.initial_p_OC(surface)
    _check_arm(scenario, model, p_OC, surface.p_OCoM)


def check_fingers_have_room(scenario: Scenario, surface: ObjectSurface) -> None:
    """Raises an error if too few fingers of a hand reach the object with room beside each other.

    Args:
        scenario: Scenario whose other values have been checked.
        surface: Surface of the scenario's object.
    """
    if not scenario.grasp.has_hand:
        return
    _, has_room = initial_contacts(scenario, surface)
    with errors_at("object"):
        check_room(load_hand(scenario.grasp.hand), has_room)


def _check_arm(scenario: Scenario, model: HandModel, p_OC: FloatArray, p_OCoM: FloatArray) -> None:
    """Raises an error unless the arm can reach the object at all times, and lift it."""
    grasp = scenario.grasp
    (_, start), *_ = path = followed_path(scenario, model)
    p_AC = model.around_axis(p_OC, start.rotation().matrix(), p_OCoM)
    first = palm_turn(p_AC, model.azimuths, 0.0, model.yaw_range(grasp.yaw_range))
    for time, X_WO in path:
        with errors_at("motion", f"at {time:.3g} s the object is out of the arm's reach: "):
            check_palm(model, grasp, [start, X_WO], p_OCoM, first)
