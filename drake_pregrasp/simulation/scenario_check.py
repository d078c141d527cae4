"""What no single key of a scenario shows."""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from drake_pregrasp.diagrams.drake_failures import failures_as_errors
from drake_pregrasp.diagrams.object_config import Box
from drake_pregrasp.errors import ScenarioError, first_line
from drake_pregrasp.planning.blends import BLEND
from drake_pregrasp.planning.strategies import STRATEGIES
from drake_pregrasp.planning.surface import CONTACT_TOLERANCE, ObjectSurface
from drake_pregrasp.planning.ticks import SLACK, tick_index
from drake_pregrasp.simulation.grasp_check import check_grasp
from drake_pregrasp.simulation.hand_planner import hand_planner
from drake_pregrasp.simulation.limits_check import check_limits, check_reach
from drake_pregrasp.simulation.motion_check import check_motion
from drake_pregrasp.simulation.obstacle_config import check_obstacles
from drake_pregrasp.simulation.run_size import check_size
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.sensor_config import check_sensor
from drake_pregrasp.simulation.surface_config import check_surface


def validate(scenario: Scenario, source: str = "scenario") -> None:
    """Checks what no single key shows.

    Args:
        scenario: Loaded, with keys and types checked.
        source: Where it is from, for the message.

    Raises:
        ScenarioError: If the scenario can't be simulated.
    """
    surface = check_surface(source, scenario.object, scenario.surface)
    count = scenario.num_contacts
    if scenario.ring_contacts > len(surface.p_OQ):
        problem = f"{count} is more than the {len(surface.p_OQ)} places there are on this surface"
        raise ScenarioError(source, "ring_contacts", problem)
    if scenario.hand.fingertips and len(scenario.hand.fingertips) != count:
        raise ScenarioError(
            source,
            "hand.fingertips",
            f"{len(scenario.hand.fingertips)} rows must be none or one for each of the {count}"
            " contacts",
        )
    check_size(source, scenario)
    check_obstacles(source, scenario.obstacles)
    if isinstance(scenario.object, Box) and not scenario.ring_contacts:
        _validate_contacts_on_a_box(scenario, source, surface)
    if scenario.contact_weights and len(scenario.contact_weights) != count:
        raise ScenarioError(
            source,
            "contact_weights",
            f"{scenario.contact_weights} must be empty or one number for each of the"
            f" {count} contacts",
        )
    _validate_damage(scenario, source)
    if not isinstance(scenario.object, Box) and scenario.plant_config.contact_model == "point":
        raise ScenarioError(
            source,
            "plant_config.contact_model",
            "point contact fills what is hollow, and only boxes stand on it;"
            " choose hydroelastic_with_fallback",
        )
    estimator = scenario.planner.estimator
    if estimator.coast_after > estimator.lost_after:
        raise ScenarioError(
            source,
            "planner.estimator.coast_after",
            f"{estimator.coast_after} must be at most lost_after, {estimator.lost_after}",
        )
    check_motion(source, scenario.motion, surface)
    check_sensor(source, scenario.sensor, scenario.planner.period)
    check_grasp(source, scenario, surface)
    limits = hand_planner(scenario).limits
    check_limits(source, limits, count, surface)
    if scenario.hand.follow:
        X_WH = scenario.hand.initial_X_WH(RigidTransform())
        check_reach(source, limits, X_WH.inverse() @ np.zeros(3), surface)
    if scenario.planner.strategy == BLEND and not any(vars(scenario.planner.blend).values()):
        raise ScenarioError(
            source,
            "planner.blend",
            f"all weights are 0; a {BLEND} needs one above 0 out of: {', '.join(STRATEGIES)}",
        )
    try:
        with failures_as_errors():
            AddMultibodyPlant(scenario.plant_config, DiagramBuilder())
    except RuntimeError as error:
        raise ScenarioError(source, "plant_config", first_line(error)) from error
    try:
        with failures_as_errors():
            simulator = Simulator(ConstantVectorSource([0.0]))
            ApplySimulatorConfig(scenario.simulator_config, simulator)
    except (RuntimeError, ValueError) as error:
        raise ScenarioError(source, "simulator_config", first_line(error)) from error


def _validate_contacts_on_a_box(scenario: Scenario, source: str, surface: ObjectSurface) -> None:
    p_OC = np.array(scenario.initial_contacts) * surface.mesh.extents / 2
    for index, distance in enumerate(np.abs(surface.distance(p_OC))):
        if distance > CONTACT_TOLERANCE:
            raise ScenarioError(
                source,
                f"initial_contacts[{index}]",
                f"{scenario.initial_contacts[index]} is {1e3 * distance:.3g} mm off the surface;"
                f" at most {1e3 * CONTACT_TOLERANCE} mm, so one coordinate must be 1 or -1"
                " and none beyond",
            )


def _validate_damage(scenario: Scenario, source: str) -> None:
    left = set(range(scenario.num_contacts))
    for index, event in enumerate(scenario.damage):
        key = f"damage[{index}]"
        period = scenario.planner.period
        last_tick = period * tick_index(scenario.simulation_duration, period)
        if event.at > last_tick + SLACK * period:
            raise ScenarioError(
                source,
                f"{key}.at",
                f"{event.at} is after the end, the last tick is at {last_tick:g} s;"
                f" simulation_duration is {scenario.simulation_duration}",
            )
        for contact in event.contacts:
            if contact not in left:
                raise ScenarioError(
                    source,
                    f"{key}.contacts",
                    f"there is no contact {contact} left to lose"
                    f"; there are: {', '.join(map(str, sorted(left)))}",
                )
            left.remove(contact)
        if not left:
            raise ScenarioError(
                source, f"{key}.contacts", f"{event.contacts} leaves no contact; one must stay"
            )
