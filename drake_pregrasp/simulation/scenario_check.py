"""Cross-field validation of scenarios."""

from typing import Any

import numpy as np
import trimesh
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from scipy.spatial.transform import Rotation
from trimesh.remesh import subdivide_to_size

from drake_pregrasp.arrays import SLACK, tick_index
from drake_pregrasp.config.finger_config import capability_at, remaining_contacts
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.config.object_config import (
    PLACED,
    SETTLED,
    STABLE,
    Ball,
    Box,
    Conveyor,
    ObjectConfig,
    PoseStream,
    Push,
    Toss,
)
from drake_pregrasp.contacts.strategies import BLEND, STRATEGIES
from drake_pregrasp.diagrams.expected_path import expected_poses
from drake_pregrasp.diagrams.hand_parsing import failures_as_errors
from drake_pregrasp.diagrams.object_plant import MUJOCO
from drake_pregrasp.errors import Problems, ScenarioError, errors_at, first_line, raise_first
from drake_pregrasp.geometry.resting import FIRM, settled_rotation
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.geometry.surface import CONTACT_TOLERANCE, ObjectSurface
from drake_pregrasp.regions.coordinates import GIVEN, QUANTITIES
from drake_pregrasp.regions.finger_measures import FINGER_MEASURES
from drake_pregrasp.simulation.obstacle_config import moving_solid
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.sensor_check import sensor_problems
from drake_pregrasp.systems.mujoco_model import import_mujoco

MAX_TICKS = 5_000_000
"""Largest number of planning ticks of a run, and of control ticks: each is a row of a log."""

MAX_STEPS = 100_000_000
"""Largest number of time steps of the plant."""

MAX_FRAMES = 100_000
"""Largest number of frames of a recording, which is kept in memory."""

MAX_TILES = 100_000
"""Largest number of tiles in the regions of a recording."""

_PARTS = 20  # Parts of the object's longest edge in which obstacles are looked for.
_LIMITS = ((10.0, "m/s"), (100.0, "rad/s"))  # Largest velocities of a motion profile.


def scenario_problems(
    scenario: Scenario,
    count: int,
    surface: ObjectSurface,
    plant: MultibodyPlantConfig,
    *,
    has_end: bool = True,
) -> Problems:
    """Yields the key and a description of each reason why the values of a scenario do not fit.

    Args:
        scenario: Scenario whose keys, types and ranges have been checked.
        count: Number of contacts.
        surface: Surface of the object.
        plant: Configuration of the plant.
        has_end: Whether the run ends after `simulation_duration`; a live one may go on.
    """
    yield from sensor_problems(scenario)
    for index, obstacle in enumerate(scenario.obstacles):
        with errors_at(f"obstacles[{index}]"):
            obstacle.make_solid()
    if (place := scenario.grasp.meeting.wait_at) and not scenario.has_hand:
        yield "grasp.meeting.wait_at", f"{place} needs a hand that waits, and hand.file is empty"
    yield from _contact_problems(scenario, count, surface)
    yield from _duration_problems(scenario, plant)
    yield from _damage_problems(scenario, count, has_end)
    yield from _capability_problems(scenario, count)
    if plant.contact_model == "point":
        problem = "objects hop and sink with point contact"
        yield "plant_config.contact_model", f"{problem}; choose hydroelastic_with_fallback"
    yield from _planner_problems(scenario, count)
    yield from _motion_problems(scenario, surface)


def _contact_problems(scenario: Scenario, count: int, surface: ObjectSurface) -> Problems:
    places, extents = len(surface.p_OQ), surface.mesh.extents
    yield from _size_problems("surface.spacing", scenario.surface.spacing, np.max(extents))
    if scenario.ring_contacts > places:
        yield "ring_contacts", f"{count} is more than the {places} candidates of this surface"
    if count == 0:
        yield "initial_contacts", "has none; give at least one, or a hand that chooses them"
    yield from _length_problems("hand.fingertips", scenario.hand_frame.fingertips, count)
    body = scenario.object
    if isinstance(body, Box) and body.is_aligned and not scenario.ring_contacts:
        p_OC = np.reshape(scenario.initial_contacts, (-1, 3)) * extents / 2
        for index, distance in enumerate(np.abs(surface.distance(p_OC))):
            if distance > CONTACT_TOLERANCE:
                problem = f"{scenario.initial_contacts[index]} is {1e3 * distance:.3g} mm off the"
                rule = f"at most {1e3 * CONTACT_TOLERANCE} mm, so one coordinate must be 1 or -1"
                yield f"initial_contacts[{index}]", f"{problem} surface; {rule} and none beyond"
    yield from _length_problems("contact_weights", scenario.contact_weights, count)


def _duration_problems(scenario: Scenario, plant: MultibodyPlantConfig) -> Problems:
    periods = [
        ("planner.period", scenario.planner.period, MAX_TICKS, "ticks"),
        ("plant_config.time_step", plant.time_step, MAX_STEPS, "steps"),
    ]
    if scenario.has_hand:
        periods.append(("grasp.period", scenario.grasp.period, MAX_TICKS, "ticks"))
    for key, period, most, what in periods:
        yield from _count_problems(key, period, scenario.simulation_duration / period, most, what)


def _planner_problems(scenario: Scenario, count: int) -> Problems:
    planner = scenario.planner
    coast, lost = planner.estimator.coast_after, planner.estimator.lost_after
    if coast > lost:
        yield "planner.estimator.coast_after", f"{coast} must be at most lost_after, {lost}"
    if planner.strategy == BLEND and not any(vars(planner.blend).values()):
        names = ", ".join(STRATEGIES)
        yield "planner.blend", f"all weights are 0; a {BLEND} needs one above 0 out of: {names}"
    for name in ("tip_radii", "reach", "forbidden_faces"):
        yield from _length_problems(f"planner.limits.{name}", getattr(planner.limits, name), count)
    if planner.needs_finger_measures and not scenario.has_hand:
        names = ", ".join(FINGER_MEASURES)
        yield "hand.file", f"none is given, but weights or limits of {names} need one"
    for index, coordinate in enumerate(planner.coordinates):
        key = f"planner.coordinates[{index}]"
        yield from _length_problems(f"{key}.fingers", coordinate.fingers, count)
        if coordinate.candidates == GIVEN:
            names = ", ".join(QUANTITIES)
            yield f"{key}.candidates", f"nothing is connected to the port; choose one of: {names}"
        before = [axis.label for axis in planner.coordinates[:index]]
        if coordinate.label in before:
            problem = f"coordinates[{before.index(coordinate.label)}] is called so, too"
            yield f"{key}.name", f"{coordinate.label} must be unique: {problem}"


def obstacle_problems(scenario: Scenario, shape: Shape) -> Problems:
    """Yields obstacles that are bodies, but that the object starts in or is carried into.

    Args:
        scenario: Scenario whose other values have been checked.
        shape: Shape of the object.
    """
    grasp, duration = scenario.grasp, scenario.simulation_duration
    if scenario.has_hand:
        duration = min(duration, grasp.latest_rest())
    mesh, longest = shape.mesh, np.max(shape.mesh.extents)
    for index, obstacle in enumerate(scenario.obstacles):
        if not obstacle.body or isinstance(scenario.motion, PoseStream):
            continue
        p_OV, _ = subdivide_to_size(mesh.vertices, mesh.faces, longest / _PARTS)
        moving = moving_solid(obstacle)
        for time, X_WO in expected_poses(scenario.motion, duration, shape):
            depth = -float(np.min(moving.at(time).distance((X_WO @ p_OV.T).T)))
            if depth >= 0:
                problem = f"at {time:.3g} s the object is {1e3 * depth:.3g} mm inside this body"
                yield f"obstacles[{index}]", f"{problem}; move it, or set body: false"
                break


def check_recording(source: str, scenario: Scenario, surface: ObjectSurface) -> None:
    """Raises a `ScenarioError` if a run is too long, or its surface too large, for a recording.

    Args:
        source: Name of the scenario's origin, for error messages.
        scenario: Scenario whose keys, types and ranges have been checked.
        surface: Surface of the scenario's object.
    """
    period, tile = scenario.recording.publish_period, scenario.recording.tile_size
    frames, tiles = scenario.simulation_duration / period, float(surface.areas.sum()) / tile**2
    key = "recording.publish_period"
    try:
        raise_first(_count_problems(key, period, frames, MAX_FRAMES, "frames"))
        raise_first(_count_problems("recording.tile_size", tile, tiles, MAX_TILES, "tiles"))
    except ScenarioError as error:
        raise ScenarioError(source, error.key, error.problem) from None


def _count_problems(key: str, value: float, count: float, most: int, what: str) -> Problems:
    if count > most:
        problem = f"{value:g} makes {count:.3g} {what}, at most {most}; choose a larger one"
        yield key, f"{problem}, or a shorter simulation_duration"


def _length_problems(key: str, values: list[Any], n: int) -> Problems:
    if len(values) not in (0, n):
        yield key, f"has {len(values)}; give one for each of the {n} contacts, or none"


def _size_problems(key: str, size: float, largest: float, hint: str = "") -> Problems:
    if size > largest:
        yield key, f"{size} is more than the object's own {largest:.3g} m{hint}"


def _damage_problems(scenario: Scenario, n: int, has_end: bool) -> Problems:
    damage = scenario.damage
    period, duration = scenario.planner.period, scenario.simulation_duration
    last_tick = period * tick_index(duration, period)
    for index, event in enumerate(damage):
        key = f"damage[{index}]"
        for name, time in (("at", event.at), ("until", event.until)):
            if has_end and time > last_tick + SLACK * period:
                problem = f"{time} is after the end, the last tick is at {last_tick:g} s"
                yield f"{key}.{name}", f"{problem}; simulation_duration is {duration}"
        if 0 < event.until <= event.at:
            yield f"{key}.until", f"{event.until} must be after {event.at}, the time of the loss"
        # Two losses overlap if one of them holds when the other begins.
        before = [e for e in damage[:index] if e.holds_at(event.at) or event.holds_at(e.at)]
        left = set(range(n)) - {contact for other in before for contact in other.contacts}
        for contact in event.contacts:
            if contact not in left:
                names = ", ".join(map(str, sorted(left)))
                problem = f"there is no contact {contact} left to lose; there are: {names}"
                yield f"{key}.contacts", problem
            left.discard(contact)
        if not remaining_contacts(damage, n, event.at):
            yield f"{key}.contacts", f"{event.contacts} leaves no contact; one must stay"


def _capability_problems(scenario: Scenario, n: int) -> Problems:
    left = set(range(n))
    for index, profile in enumerate(scenario.capability):
        key, contact, times = f"capability[{index}]", profile.contact, profile.times
        if contact not in left:
            names = ", ".join(map(str, sorted(left)))
            yield f"{key}.contact", f"{contact} must be a contact without a profile: {names}"
        left.discard(contact)
        if len(profile.values) != len(times):
            yield f"{key}.values", f"has {len(profile.values)}; give one for each of the times"
        if not np.all(np.diff(times) > 0):
            yield f"{key}.times", f"{times} must increase"
    changes = {0.0, *(time for profile in scenario.capability for time in profile.times)}
    for time in sorted(changes | {event.at for event in scenario.damage}):
        remaining = remaining_contacts(scenario.damage, n, time)
        is_left = np.any(capability_at(scenario.capability, n, time)[remaining] > 0)
        if time <= scenario.simulation_duration and not is_left:
            yield "capability", f"leaves no finger above 0 at {time:g} s; one must stay"


LARGEST_SIDEWAYS = 0.1
"""Largest distance of an object's start from the axis of the turntable, in metres."""


def _motion_problems(scenario: Scenario, surface: ObjectSurface) -> Problems:
    motion = scenario.motion
    if isinstance(motion, Conveyor | Push):
        yield from _rest_problems(scenario.object, surface.mesh)
    if isinstance(motion, Conveyor):
        yield from _profile_problems(motion.profile)
        if abs(y := motion.position[1]) > LARGEST_SIDEWAYS:
            sideways = f"from {-LARGEST_SIDEWAYS} to {LARGEST_SIDEWAYS}"
            yield "motion.position[1]", f"{y} must be {sideways}, on the turntable"
    elif isinstance(motion, Toss):
        R_WO = Rotation.from_euler("xyz", motion.rpy)
        below = -float(np.min(R_WO.apply(surface.mesh.vertices - surface.p_OCoM)[:, 2]))
        if motion.table and motion.position[2] < below:
            problem = f"{motion.position[2]} must be at least {below:.4g}, above the table"
            yield "motion.position[2]", problem
    elif isinstance(motion, Push):
        rear = -float(np.min((surface.mesh.vertices - surface.p_OCoM) @ motion.unit_vector()))
        if motion.start_distance < rear:
            problem = f"{motion.start_distance} must be at least {rear:.4g}, the object's rear end"
            yield "motion.start_distance", problem


def _rest_problems(config: ObjectConfig, mesh: trimesh.Trimesh) -> Problems:
    if isinstance(config, Ball) or config.rest != PLACED:
        return
    tilt = float(np.arccos(np.clip(settled_rotation(mesh)[2, 2], -1, 1)))
    if tilt > FIRM:
        degrees = f"{np.degrees(tilt):.3g}°, at most {np.degrees(FIRM):g}°"
        problem = f"{config.rest} leaves the object where it does not rest: it tips by {degrees}"
        yield "object.rest", f"{problem}; choose {SETTLED} or {STABLE}, or another rpy"


def _profile_problems(profile: list[list[float]]) -> Problems:
    before = None
    for index, (time, *velocities) in enumerate(profile):
        key = f"motion.profile[{index}]"
        if before is None and time != 0:
            yield f"{key}[0]", f"{time} must be 0, the first time"
        if before is not None and time <= before:
            yield f"{key}[0]", f"{time} must be more than {before}, the previous time"
        before = time
        for place, (value, (limit, unit)) in enumerate(zip(velocities, _LIMITS, strict=True), 1):
            if abs(value) > limit:
                yield f"{key}[{place}]", f"{value} must be from {-limit:g} to {limit:g} {unit}"


def limit_problems(
    scenario: Scenario, limits: LimitsConfig, count: int, surface: ObjectSurface
) -> Problems:
    """Yields the key and a description of each limit on goals that does not fit.

    Args:
        scenario: Scenario whose other values have been checked.
        limits: Limits of the planner, with those of the hand.
        count: Number of contacts.
        surface: Surface of the object.
    """
    key, radii = "planner.limits", limits.tip_radii
    longest, extent = float(np.linalg.norm(surface.mesh.extents)), np.max(surface.mesh.extents)
    for index, reach in enumerate(limits.reach):
        with errors_at(f"{key}.reach[{index}]"):
            reach.make_reach()
    for name in ("tip_gap", "standoff"):
        if (value := getattr(limits, name)) > 0 and not radii:
            yield f"{key}.{name}", f"{value} needs tip_radii, the radii of the fingertips"
    for index, pair in enumerate(limits.pairs):
        pair_key, first, second = f"{key}.pairs[{index}]", pair.first, pair.second
        if (contact := max(first, second)) >= count:
            yield pair_key, f"there is no contact {contact}; there are 0 to {count - 1}"
        if first == second:
            yield pair_key, f"contact {first} cannot follow itself"
        yield from _size_problems(f"{pair_key}.distance", pair.distance, longest)
        if radii and 0 < pair.distance < (room := radii[first] + radii[second]):
            problem = f"contradicts tip_radii, which keep the two {room:.3g} m apart"
            yield f"{pair_key}.distance", f"{pair.distance} {problem}"
    with errors_at(f"{key}.pairs"):
        limits.make_limits(period=1.0, friction=1.0)
    with errors_at(f"{key}.reassign"):
        limits.reassign.check(limits.reaches(), bool(limits.pairs))
    radius = limits.independent_radius
    yield from _size_problems(f"{key}.independent_radius", radius, longest, ": no slip is longer")
    yield from _size_problems(f"{key}.deadband", limits.deadband, longest, ": no goal would move")
    # Fingertips need room, if not on the allowed surface itself, then over its convex hull.
    hint = "; radii are in metres"
    yield from _size_problems(f"{key}.tip_radii", max(radii, default=0.0), extent, hint)
    yield from _reach_problems(scenario, limits, surface)


def _reach_problems(scenario: Scenario, limits: LimitsConfig, surface: ObjectSurface) -> Problems:
    """Yields problems of fingers that can never reach the object, if the hand follows it."""
    if not scenario.hand_frame.follow:
        return
    p_HO = scenario.hand_frame.initial_X_WH(RigidTransform()).inverse().translation()
    farthest = float(np.max(np.linalg.norm(surface.p_OQ, axis=1)))
    for index, reach in enumerate(limits.reach):
        # The object may rotate relative to the hand: only the distance of its origin is known.
        solid = reach.make_reach().solid
        gap = -np.inf if solid is None else float(solid.distance(p_HO[None])[0]) - farthest
        if gap > 0:
            problem = f"the object is never nearer to it than {gap:.3g} m: move or enlarge it"
            yield f"planner.limits.reach[{index}]", problem


def engine_problems(scenario: Scenario) -> Problems:
    """Yields the reasons why an engine other than Drake cannot simulate a scenario."""
    if scenario.engine == MUJOCO:
        if isinstance(scenario.motion, PoseStream):
            yield "engine", f"{MUJOCO} moves no object along recorded poses; leave it out"
        with errors_at("engine"):
            import_mujoco()


def drake_problems(scenario: Scenario, plant: MultibodyPlantConfig) -> Problems:
    """Yields Drake's own errors about its settings."""
    try:
        with failures_as_errors():
            AddMultibodyPlant(plant, DiagramBuilder())
    except RuntimeError as error:
        yield "plant_config", first_line(error)
    try:
        with failures_as_errors():
            simulator = Simulator(ConstantVectorSource([0.0]))
            ApplySimulatorConfig(scenario.simulator_config, simulator)
    except (RuntimeError, ValueError) as error:
        yield "simulator_config", first_line(error)
