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

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.config.object_config import Box, Conveyor, MotionConfig, PoseStream, Push, Toss
from drake_pregrasp.config.sensor_config import check_sensor
from drake_pregrasp.config.surface_config import check_surface
from drake_pregrasp.contacts.strategies import BLEND, STRATEGIES
from drake_pregrasp.diagrams.hand_parsing import failures_as_errors
from drake_pregrasp.diagrams.object_plant import push_direction
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError, first_line
from drake_pregrasp.estimation.recorded_poses import read_recorded_poses
from drake_pregrasp.geometry.surface import CONTACT_TOLERANCE, ObjectSurface
from drake_pregrasp.resources import resolve_path
from drake_pregrasp.simulation.grasp_check import check_grasp
from drake_pregrasp.simulation.hand_wiring import hand_planner
from drake_pregrasp.simulation.obstacle_config import check_obstacles
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.ticks import SLACK, tick_index

MAX_TICKS = 5_000_000
"""Planning ticks of a run, and control ticks of its hand: each is a row of a log."""

MAX_STEPS = 100_000_000
"""Time steps of its plant."""

MAX_FRAMES = 100_000
"""Frames of its recording, which is kept in memory."""

MAX_TILES = 100_000
"""Tiles that its recording draws regions with."""


def check_size(source: str, scenario: Scenario) -> None:
    """Raises a `ScenarioError` if a run is too long.

    Args:
        source: Where the scenario is from, for the message.
        scenario: Loaded, with keys and types checked.
    """
    duration = scenario.simulation_duration
    checks = [
        ("planner.period", scenario.planner.period, MAX_TICKS, "ticks"),
        ("plant_config.time_step", scenario.plant_config.time_step, MAX_STEPS, "steps"),
    ]
    if scenario.grasp.has_hand:
        checks.append(("grasp.period", scenario.grasp.period, MAX_TICKS, "ticks"))
    for key, period, most, what in checks:
        _check_number(source, key, period, duration / period, most, what)


def check_recording(source: str, scenario: Scenario, surface: ObjectSurface) -> None:
    """Raises a `ScenarioError` if a run is too much to record.

    Args:
        source: Where the scenario is from, for the message.
        scenario: Loaded, with keys and types checked.
        surface: The object's.
    """
    period, tile = scenario.recording.publish_period, scenario.recording.tile_size
    frames = scenario.simulation_duration / period
    _check_number(source, "recording.publish_period", period, frames, MAX_FRAMES, "frames")
    tiles = float(surface.areas.sum()) / tile**2
    _check_number(source, "recording.tile_size", tile, tiles, MAX_TILES, "tiles")


def _check_number(source: str, key: str, value: float, count: float, most: int, what: str) -> None:
    if count > most:
        problem = f"{value:g} makes {count:.3g} {what}, at most {most}; choose a larger one"
        raise ScenarioError(source, key, f"{problem}, or a shorter simulation_duration")


PROFILE_LIMITS = ((1, 10.0, "m/s"), (2, 100.0, "rad/s"))
"""For each velocity in a row of a profile: its place there, its largest value, and the unit."""


def check_motion(source: str, motion: MotionConfig, surface: ObjectSurface) -> None:
    """Raises a `ScenarioError` unless the object can be moved so.

    Args:
        source: Where the scenario is from, for the message.
        motion: Loaded, with keys and types checked.
        surface: The object's.
    """
    if isinstance(motion, Conveyor):
        _check_profile(source, motion.profile)
    elif isinstance(motion, Toss):
        R_WO = Rotation.from_euler("xyz", motion.rpy)
        below = -float(np.min(R_WO.apply(surface.mesh.vertices - surface.p_OCoM)[:, 2]))
        if motion.table and motion.position[2] < below:
            raise ScenarioError(
                source,
                "motion.position[2]",
                f"{motion.position[2]} must be at least {below:.4g}, to start above the table",
            )
    elif isinstance(motion, Push):
        rear = -float(np.min((surface.mesh.vertices - surface.p_OCoM) @ push_direction(motion)))
        if motion.start_distance < rear:
            raise ScenarioError(
                source,
                "motion.start_distance",
                f"{motion.start_distance} must be at least {rear:.4g}, where the object ends",
            )
    elif isinstance(motion, PoseStream):
        try:
            read_recorded_poses(resolve_path(motion.file, Path.cwd()))
        except InvalidArgumentError as error:
            raise ScenarioError(source, "motion.file", str(error)) from error


def _check_profile(source: str, profile: list[list[float]]) -> None:
    key = "motion.profile"
    if profile and profile[0][0] != 0:
        raise ScenarioError(source, f"{key}[0][0]", f"{profile[0][0]} must be 0, the first time")
    for index, (row, following) in enumerate(itertools.pairwise(profile), start=1):
        if not following[0] > row[0]:
            raise ScenarioError(
                source,
                f"{key}[{index}][0]",
                f"{following[0]} must be more than {row[0]}, the time before it",
            )
    for index, row in enumerate(profile):
        for place, limit, unit in PROFILE_LIMITS:
            if abs(row[place]) > limit:
                raise ScenarioError(
                    source,
                    f"{key}[{index}][{place}]",
                    f"{row[place]} must be from {-limit:g} to {limit:g} {unit}",
                )


def check_limits(
    source: str, limits: LimitsConfig, num_contacts: int, surface: ObjectSurface
) -> None:
    """Raises a `ScenarioError` if limits contradict each other, or the object.

    Args:
        source: Where the scenario is from, for the message.
        limits: Loaded, with keys and types checked.
        num_contacts: n.
        surface: The object's.
    """
    key = "planner.limits"
    for name in ("tip_radii", "reach", "forbidden_faces"):
        count = len(getattr(limits, name))
        if count not in (0, num_contacts):
            raise ScenarioError(
                source,
                f"{key}.{name}",
                f"{count} elements must be none or one for each of the {num_contacts} contacts",
            )
    for index, reach in enumerate(limits.reach):
        try:
            reach.make_reach()
        except InvalidArgumentError as error:
            raise ScenarioError(source, f"{key}.reach[{index}]", str(error)) from error
    if max(limits.tip_gap, limits.standoff) > 0 and not limits.tip_radii:
        name = "tip_gap" if limits.tip_gap > 0 else "standoff"
        problem = f"{getattr(limits, name)} needs tip_radii, whose tips it keeps clear"
        raise ScenarioError(source, f"{key}.{name}", problem)
    longest = float(np.linalg.norm(surface.mesh.extents))
    for index, pair in enumerate(limits.pairs):
        pair_key = f"{key}.pairs[{index}]"
        for contact in (pair.first, pair.second):
            if contact >= num_contacts:
                problem = f"there is no contact {contact}; there are 0 to {num_contacts - 1}"
                raise ScenarioError(source, pair_key, problem)
        if pair.first == pair.second:
            raise ScenarioError(source, pair_key, f"contact {pair.first} can't follow itself")
        if pair.distance > longest:
            raise ScenarioError(
                source,
                f"{pair_key}.distance",
                f"{pair.distance} is more than the object's own {longest:.3g} m",
            )
        if limits.tip_radii:
            room = limits.tip_radii[pair.first] + limits.tip_radii[pair.second]
            if pair.distance < room:
                raise ScenarioError(
                    source,
                    f"{pair_key}.distance",
                    f"{pair.distance} contradicts tip_radii, which keep the two {room:.3g} m apart",
                )
    try:
        limits.make_limits(period=1.0, friction=1.0)
    except InvalidArgumentError as error:
        raise ScenarioError(source, f"{key}.pairs", str(error)) from error
    if limits.deadband > longest:
        raise ScenarioError(
            source,
            f"{key}.deadband",
            f"{limits.deadband} is more than the object's own {longest:.3g} m: no goal would move",
        )
    _check_room(source, limits, surface)


def check_reach(
    source: str, limits: LimitsConfig, p_HO: FloatArray, surface: ObjectSurface
) -> None:
    """Raises a `ScenarioError` if a finger of a hand that follows can never reach the object.

    Args:
        source: Where the scenario is from, for the message.
        limits: With the reach of each finger.
        p_HO: The object's origin in the hand's frame, shape (3,), in metres.
        surface: The object's.
    """
    farthest = float(np.max(np.linalg.norm(surface.p_OQ, axis=1)))
    for index, reach in enumerate(limits.reach):
        # The hand doesn't turn, but the object may: only the distance of its origin is sure.
        solid = reach.make_reach().solid
        gap = -np.inf if solid is None else float(solid.distance(p_HO[None])[0]) - farthest
        if gap > 0:
            raise ScenarioError(
                source,
                f"planner.limits.reach[{index}]",
                f"the object is never nearer to it than {gap:.3g} m: move or enlarge it",
            )


def _check_room(source: str, limits: LimitsConfig, surface: ObjectSurface) -> None:
    """Fingertips need room, if not on the ground itself, then over its convex hull."""
    if not limits.tip_radii:
        return
    largest = max(limits.tip_radii)
    extent = float(np.max(surface.mesh.extents))
    if largest > extent:
        raise ScenarioError(
            source,
            "planner.limits.tip_radii",
            f"{largest} is more than the object's own {extent:.3g} m; radii are in metres",
        )


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
