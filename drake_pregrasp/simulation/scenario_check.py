"""Cross-field validation of scenarios."""

import itertools
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import SLACK, tick_index
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.config.object_config import Box, Conveyor, PoseStream, Push, Toss
from drake_pregrasp.config.sensor_config import check_sensor
from drake_pregrasp.config.surface_config import check_surface
from drake_pregrasp.contacts.strategies import BLEND, STRATEGIES
from drake_pregrasp.diagrams.hand_parsing import failures_as_errors
from drake_pregrasp.diagrams.object_plant import push_direction
from drake_pregrasp.errors import first_line
from drake_pregrasp.estimation.recorded_poses import read_recorded_poses
from drake_pregrasp.geometry.surface import CONTACT_TOLERANCE, ObjectSurface
from drake_pregrasp.resources import resolve_path
from drake_pregrasp.simulation.grasp_check import Problems, errors_at, grasp_problems, raise_first
from drake_pregrasp.simulation.obstacle_config import check_obstacles
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.simulation_diagram import hand_planner

MAX_TICKS = 5_000_000
"""Most planning ticks of a run, and control ticks of its hand: each is a row of a log."""

MAX_STEPS = 100_000_000
"""Most time steps of the plant."""

MAX_FRAMES = 100_000
"""Most frames of a recording, which is kept in memory."""

MAX_TILES = 100_000
"""Most tiles with which a recording draws regions."""

_PROFILE_LIMITS = ((1, 10.0, "m/s"), (2, 100.0, "rad/s"))  # Column of a row, its limit, its unit.


def validate(scenario: Scenario, source: str = "scenario") -> None:
    """Checks that the values of a scenario fit together.

    Args:
        scenario: Scenario whose keys, types and ranges have been checked.
        source: Name of its origin, for error messages.

    Raises:
        ScenarioError: If the scenario can't be simulated.
    """
    surface = check_surface(source, scenario.object, scenario.surface)
    check_obstacles(source, scenario.obstacles)
    check_sensor(source, scenario.sensor, scenario.planner.period)
    raise_first(source, _problems(scenario, surface))


def _problems(scenario: Scenario, surface: ObjectSurface) -> Problems:
    yield from _scenario_problems(scenario, surface)
    yield from grasp_problems(scenario, surface)
    limits = hand_planner(scenario).limits
    yield from _limits_problems(limits, scenario.num_contacts, surface)
    yield from _reach_problems(scenario, limits, surface)
    yield from _drake_problems(scenario)


def check_recording(source: str, scenario: Scenario, surface: ObjectSurface) -> None:
    """Raises a `ScenarioError` if a run is too long, or its surface too large, to be recorded.

    Args:
        source: Name of the scenario's origin, for error messages.
        scenario: Scenario whose keys, types and ranges have been checked.
        surface: Surface of its object.
    """
    raise_first(source, _recording_problems(scenario, surface))


def _recording_problems(scenario: Scenario, surface: ObjectSurface) -> Problems:
    period, tile = scenario.recording.publish_period, scenario.recording.tile_size
    frames, tiles = scenario.simulation_duration / period, float(surface.areas.sum()) / tile**2
    yield from _count_problems("recording.publish_period", period, frames, MAX_FRAMES, "frames")
    yield from _count_problems("recording.tile_size", tile, tiles, MAX_TILES, "tiles")


def _count_problems(key: str, value: float, count: float, most: int, what: str) -> Problems:
    if count > most:
        problem = f"{value:g} makes {count:.3g} {what}, at most {most}; choose a larger one"
        yield key, f"{problem}, or a shorter simulation_duration"


def _scenario_problems(scenario: Scenario, surface: ObjectSurface) -> Problems:
    count, places = scenario.num_contacts, len(surface.p_OQ)
    spacing, extent = scenario.surface.spacing, np.max(surface.mesh.extents)
    if spacing > extent:
        yield "surface.spacing", f"{spacing} is more than the object's own {extent:.3g} m"
    if scenario.ring_contacts > places:
        problem = f"{count} is more than the {places} places there are on this surface"
        yield "ring_contacts", problem
    rows = len(scenario.hand.fingertips)
    if rows not in (0, count):
        yield "hand.fingertips", f"{rows} rows must be none or one for each of the {count} contacts"
    periods = [
        ("planner.period", scenario.planner.period, MAX_TICKS, "ticks"),
        ("plant_config.time_step", scenario.plant_config.time_step, MAX_STEPS, "steps"),
    ]
    if scenario.grasp.has_hand:
        periods.append(("grasp.period", scenario.grasp.period, MAX_TICKS, "ticks"))
    for key, period, most, what in periods:
        yield from _count_problems(key, period, scenario.simulation_duration / period, most, what)
    if isinstance(scenario.object, Box) and not scenario.ring_contacts:
        p_OC = np.array(scenario.initial_contacts) * surface.mesh.extents / 2
        for index, distance in enumerate(np.abs(surface.distance(p_OC))):
            if distance > CONTACT_TOLERANCE:
                yield (
                    f"initial_contacts[{index}]",
                    f"{scenario.initial_contacts[index]} is {1e3 * distance:.3g} mm off the"
                    f" surface; at most {1e3 * CONTACT_TOLERANCE} mm, so one coordinate must be"
                    " 1 or -1 and none beyond",
                )
    weights = scenario.contact_weights
    if len(weights) not in (0, count):
        problem = f"{weights} must be empty or one number for each of the {count} contacts"
        yield "contact_weights", problem
    yield from _damage_problems(scenario)
    if not isinstance(scenario.object, Box) and scenario.plant_config.contact_model == "point":
        yield (
            "plant_config.contact_model",
            "point contact fills what is hollow, and only boxes stand on it;"
            " choose hydroelastic_with_fallback",
        )
    estimator = scenario.planner.estimator
    if estimator.coast_after > estimator.lost_after:
        problem = f"{estimator.coast_after} must be at most lost_after, {estimator.lost_after}"
        yield "planner.estimator.coast_after", problem
    yield from _motion_problems(scenario, surface)
    if scenario.planner.strategy == BLEND and not any(vars(scenario.planner.blend).values()):
        names = ", ".join(STRATEGIES)
        yield "planner.blend", f"all weights are 0; a {BLEND} needs one above 0 out of: {names}"


def _damage_problems(scenario: Scenario) -> Problems:
    left = set(range(scenario.num_contacts))
    period, duration = scenario.planner.period, scenario.simulation_duration
    last_tick = period * tick_index(duration, period)
    for index, event in enumerate(scenario.damage):
        key = f"damage[{index}]"
        if event.at > last_tick + SLACK * period:
            yield (
                f"{key}.at",
                f"{event.at} is after the end, the last tick is at {last_tick:g} s;"
                f" simulation_duration is {duration}",
            )
        for contact in event.contacts:
            if contact not in left:
                names = ", ".join(map(str, sorted(left)))
                problem = f"there is no contact {contact} left to lose; there are: {names}"
                yield f"{key}.contacts", problem
            left.discard(contact)
        if not left:
            yield f"{key}.contacts", f"{event.contacts} leaves no contact; one must stay"


def _motion_problems(scenario: Scenario, surface: ObjectSurface) -> Problems:
    motion = scenario.motion
    if isinstance(motion, Conveyor):
        yield from _profile_problems(motion.profile)
    elif isinstance(motion, Toss):
        R_WO = Rotation.from_euler("xyz", motion.rpy)
        below = -float(np.min(R_WO.apply(surface.mesh.vertices - surface.p_OCoM)[:, 2]))
        if motion.table and motion.position[2] < below:
            problem = f"{motion.position[2]} must be at least {below:.4g}, to start above the table"
            yield "motion.position[2]", problem
    elif isinstance(motion, Push):
        rear = -float(np.min((surface.mesh.vertices - surface.p_OCoM) @ push_direction(motion)))
        if motion.start_distance < rear:
            problem = f"{motion.start_distance} must be at least {rear:.4g}, where the object ends"
            yield "motion.start_distance", problem
    elif isinstance(motion, PoseStream):
        with errors_at("motion.file"):
            read_recorded_poses(resolve_path(motion.file, Path.cwd()))


def _profile_problems(profile: list[list[float]]) -> Problems:
    key = "motion.profile"
    if profile and profile[0][0] != 0:
        yield f"{key}[0][0]", f"{profile[0][0]} must be 0, the first time"
    for index, (row, following) in enumerate(itertools.pairwise(profile), start=1):
        if not following[0] > row[0]:
            problem = f"{following[0]} must be more than {row[0]}, the time before it"
            yield f"{key}[{index}][0]", problem
    for index, row in enumerate(profile):
        for place, limit, unit in _PROFILE_LIMITS:
            if abs(row[place]) > limit:
                problem = f"{row[place]} must be from {-limit:g} to {limit:g} {unit}"
                yield f"{key}[{index}][{place}]", problem


def _limits_problems(limits: LimitsConfig, num_contacts: int, surface: ObjectSurface) -> Problems:
    key, radii = "planner.limits", limits.tip_radii
    longest, extent = np.linalg.norm(surface.mesh.extents), np.max(surface.mesh.extents)
    for name in ("tip_radii", "reach", "forbidden_faces"):
        count = len(getattr(limits, name))
        if count not in (0, num_contacts):
            yield (
                f"{key}.{name}",
                f"{count} elements must be none or one for each of the {num_contacts} contacts",
            )
    for index, reach in enumerate(limits.reach):
        with errors_at(f"{key}.reach[{index}]"):
            reach.make_reach()
    for name in ("tip_gap", "standoff"):
        value = getattr(limits, name)
        if value > 0 and not radii:
            yield f"{key}.{name}", f"{value} needs tip_radii, whose tips it keeps clear"
    for index, pair in enumerate(limits.pairs):
        pair_key, distance_key = f"{key}.pairs[{index}]", f"{key}.pairs[{index}].distance"
        for contact in (pair.first, pair.second):
            if contact >= num_contacts:
                yield pair_key, f"there is no contact {contact}; there are 0 to {num_contacts - 1}"
        if pair.first == pair.second:
            yield pair_key, f"contact {pair.first} can't follow itself"
        if pair.distance > longest:
            yield distance_key, f"{pair.distance} is more than the object's own {longest:.3g} m"
        room = radii[pair.first] + radii[pair.second] if radii else 0.0
        if pair.distance < room:
            yield (
                distance_key,
                f"{pair.distance} contradicts tip_radii, which keep the two {room:.3g} m apart",
            )
    with errors_at(f"{key}.pairs"):
        limits.make_limits(period=1.0, friction=1.0)
    if limits.deadband > longest:
        yield (
            f"{key}.deadband",
            f"{limits.deadband} is more than the object's own {longest:.3g} m: no goal would move",
        )
    # Fingertips need room, if not on the allowed surface itself, then over its convex hull.
    if radii and max(radii) > extent:
        yield (
            f"{key}.tip_radii",
            f"{max(radii)} is more than the object's own {extent:.3g} m; radii are in metres",
        )


def _reach_problems(scenario: Scenario, limits: LimitsConfig, surface: ObjectSurface) -> Problems:
    """Finds fingers of a hand that follows the object which can never reach it."""
    if not scenario.hand.follow:
        return
    p_HO = scenario.hand.initial_X_WH(RigidTransform()).inverse().translation()
    farthest = float(np.max(np.linalg.norm(surface.p_OQ, axis=1)))
    for index, reach in enumerate(limits.reach):
        # The object may rotate relative to the hand: only the distance of its origin is known.
        solid = reach.make_reach().solid
        gap = -np.inf if solid is None else float(solid.distance(p_HO[None])[0]) - farthest
        if gap > 0:
            problem = f"the object is never nearer to it than {gap:.3g} m: move or enlarge it"
            yield f"planner.limits.reach[{index}]", problem


def _drake_problems(scenario: Scenario) -> Problems:
    """Yields the errors of Drake about its own settings."""
    try:
        with failures_as_errors():
            AddMultibodyPlant(scenario.plant_config, DiagramBuilder())
    except RuntimeError as error:
        yield "plant_config", first_line(error)
    try:
        with failures_as_errors():
            simulator = Simulator(ConstantVectorSource([0.0]))
            ApplySimulatorConfig(scenario.simulator_config, simulator)
    except (RuntimeError, ValueError) as error:
        yield "simulator_config", first_line(error)
