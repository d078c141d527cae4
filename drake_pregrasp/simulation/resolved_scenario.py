"""A scenario with everything that follows from its data: surface, hand, contacts, settings."""

import itertools
import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlantConfig

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.finger_config import capability_at, remaining_contacts
from drake_pregrasp.config.hand_description import Arm, HandDescription
from drake_pregrasp.config.object_config import (
    Box,
    Conveyor,
    Mesh,
    PoseStream,
    Push,
    Revolved,
    Toss,
)
from drake_pregrasp.config.planner_config import MeasuresConfig, PlannerConfig
from drake_pregrasp.contacts.assignment import assign_fingers, ring_contacts
from drake_pregrasp.contacts.hand_above_object import StartContacts
from drake_pregrasp.diagrams import feasibility, start_grasp
from drake_pregrasp.diagrams.approaches import Approach, approaching_hands
from drake_pregrasp.diagrams.expected_path import Motion, expected_poses, initial_pose, read_motion
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.object_plant import TABLE
from drake_pregrasp.diagrams.palm_base import PalmCarrier
from drake_pregrasp.errors import (
    InvalidArgumentError,
    NoSurfaceError,
    ScenarioError,
    errors_at,
    raise_first,
)
from drake_pregrasp.estimation.recorded_poses import RecordedPoses
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.fast.kernels import Kernels
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.geometry.motion_profiles import VelocityProfile
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.simulation import scenario_check
from drake_pregrasp.simulation.grasp_check import grasp_problems, model_problems
from drake_pregrasp.simulation.hand_file import HandFile, HandSource, read_hand
from drake_pregrasp.simulation.obstacle_config import moving_solid
from drake_pregrasp.simulation.scenario import TIME_STEP, Scenario
from drake_pregrasp.simulation.sensor_check import unseen_problems
from drake_pregrasp.systems.sources import MovingSolid

_TOSS_STEP = 0.001  # Longest default time step for a tossed object, in seconds.
_SUNK = 1e-3  # Depth in the table at which an object may be waited for, in metres.
_STEP_LENGTH = 5e-4  # Largest distance that a pusher moves in a default time step, in metres.


@dataclass(frozen=True, eq=False)
class ResolvedScenario:
    """A scenario that can be simulated, with all that files and searches add to its data.

    Attributes:
        scenario: The data.
        motion: Motion of the object, with recorded poses.
        shape: Shape of the object in O.
        surface: Surface of the object, sampled as `scenario.surface` configures.
        X_WO: Initial pose of the object.
        X_WO_waiting: Pose of an object over which the hand starts.
        hand: Model of the hand with its approach; None without a hand.
        start: Initial contacts in O, which of them have a place, and the palm's yaw.
        planner: Configuration of the planner, with the limits of the hand.
        plant_config: Configuration of the plant, with a time step for the hand and the motion.
        kernels: Implementation of what takes most of a tick, for planner and hand.
    """

    scenario: Scenario
    motion: Motion
    shape: Shape
    surface: ObjectSurface
    X_WO: RigidTransform
    X_WO_waiting: RigidTransform
    hand: HandModel | None
    start: StartContacts
    planner: PlannerConfig
    plant_config: MultibodyPlantConfig
    kernels: Kernels = field(default_factory=default_kernels)

    @property
    def num_contacts(self) -> int:
        """Number of contacts n."""
        return len(self.start.p_OC)

    @property
    def _has_plant(self) -> bool:
        """Whether a plant moves the object. Without a hand, recorded poses need none."""
        return self.hand is not None or not isinstance(self.scenario.motion, PoseStream)

    @property
    def obstacle_bodies(self) -> list[MovingSolid]:
        """Obstacles that are bodies; none if there is no plant."""
        return [moving_solid(o) for o in self.scenario.obstacles if o.body and self._has_plant]

    @property
    def seen_solid(self) -> MeshSolid | None:
        """The object in O for an estimate from points and contacts; None if it needs neither."""
        if not (self.scenario.depth_sensor.cameras or self.planner.estimator.bias_std):
            return None
        solid, scale = self.shape.solid, self.scenario.depth_sensor.mesh_scale
        if isinstance(solid, MeshSolid) and scale == 1:
            return solid
        return MeshSolid.of(self.shape.mesh.copy().apply_scale(scale))

    @property
    def no_touch_volumes(self) -> list[MovingSolid]:
        """Obstacles that are no bodies."""
        return [
            moving_solid(o) for o in self.scenario.obstacles if not (o.body and self._has_plant)
        ]

    @property
    def obstacle_names(self) -> dict[int, str]:
        """Names of the planner's obstacles that are not in `obstacles`, by their index.

        With a hand there is one: the conveyor's top, which no fingertip may touch.
        """
        return {len(self.scenario.obstacles): "the table"} if self.hand else {}

    def sampled_surface(self, spacing: float) -> ObjectSurface:
        """Returns the surface of the object, sampled with another spacing in metres."""
        hand = None if self.hand is None else self.hand.description
        return _surface(self.scenario, self.shape, hand, spacing)

    @property
    def measures(self) -> MeasuresConfig:
        """Assumptions of the logged measures, with the contact model of the hand's fingertips."""
        radii = self.hand.description.patch_radii if self.hand else ()
        return self.scenario.measures.resolved(radii)

    def remaining_contacts(self, time: float = math.inf) -> list[int]:
        """Returns the contacts that are not lost at a time in seconds; by default, at the end."""
        return remaining_contacts(self.scenario.damage, self.num_contacts, time)

    def capability_at(self, time: float) -> FloatArray:
        """Returns the capability of each finger at a time in seconds, shape (n,)."""
        return capability_at(self.scenario.capability, self.num_contacts, time)


def resolve_scenario(
    scenario: Scenario,
    source: str = "scenario",
    *,
    hand: HandSource | None = None,
    shape: Shape | None = None,
    keep: ResolvedScenario | None = None,
) -> ResolvedScenario:
    """Returns a scenario with all that follows from its data, after a check that all of it fits.

    Args:
        scenario: Scenario whose keys, types and ranges have been checked.
        source: Name of the scenario's origin, for error messages.
        hand: The hand, if its file has been read.
        shape: Shape of the object, if it has been made.
        keep: Resolved scenario with the same object and hand, whose surface, hand and start
            contacts are kept.

    Raises:
        ScenarioError: If the scenario cannot be simulated; the message names key and value.
    """
    try:
        return _resolved(scenario, hand, shape, keep)
    except ScenarioError as error:
        raise ScenarioError(source, error.key, error.problem) from error.__cause__


def _resolved(
    scenario: Scenario,
    source: HandSource | None,
    shape: Shape | None,
    keep: ResolvedScenario | None,
) -> ResolvedScenario:
    plant_config = _plant_config(scenario)
    shape = keep.shape if keep else shape or _shape(scenario)
    if keep and keep.hand:
        source = HandSource(keep.hand.description, keep.hand.model)
    elif scenario.has_hand and source is None:
        with errors_at("hand.file"):
            source = read_hand(scenario.hand_file)
    hand = None if source is None else source.description
    surface = keep.surface if keep else _checked_surface(scenario, shape, hand)
    count = scenario.ring_contacts or len(scenario.initial_contacts)
    if hand and scenario.chooses_contacts:
        count = len(hand.fingertips)
    has_end = keep is None
    raise_first(
        scenario_check.scenario_problems(scenario, count, surface, plant_config, has_end=has_end)
    )
    with errors_at("motion.file"):
        motion = read_motion(scenario.motion)
        if isinstance(motion, RecordedPoses):
            motion.check_moves_within(scenario.simulation_duration)
    X_WO, model, planner = initial_pose(motion, shape), None, scenario.planner
    waiting = X_WO
    if source is None:
        start = keep.start if keep else _given_start(scenario, surface, X_WO)
    else:
        raise_first(grasp_problems(scenario, source.description, count, plant_config))
        waiting = _waiting_pose(scenario, shape, X_WO)
        path = [(0.0, waiting)]
        if not scenario.grasp.meeting.wait_at:  # A hand that waits says then whether it can follow.
            path = _followed_path(scenario, source.description, motion, shape)
        if keep and keep.hand:
            model, start = keep.hand, keep.start
        else:
            there = shape, surface, X_WO, waiting
            model, start = _hand_and_start(scenario, source, *there, [X for _, X in path])
        planner = start_grasp.hand_planner(planner, scenario.grasp, model.description)
        _check_base(scenario, model, start.yaw, shape, path)
    raise_first(scenario_check.obstacle_problems(scenario, shape))
    raise_first(unseen_problems(scenario, motion, shape))
    raise_first(scenario_check.limit_problems(scenario, planner.limits, count, surface))
    if model is not None:
        with errors_at("object.mass"):
            mass, grasp, v_W = scenario.object.mass, scenario.grasp, np.zeros(3)
            if isinstance(motion, Conveyor):
                rest = grasp.earliest_rest(model.description.fingertips)
                v_W[0] = VelocityProfile(motion.velocities()).at(rest)[1][0]
            feasibility.check_torques(model, grasp, surface, start, X_WO, mass, v_W)
    raise_first(scenario_check.engine_problems(scenario))
    raise_first(scenario_check.drake_problems(scenario, plant_config))
    return ResolvedScenario(
        scenario, motion, shape, surface, X_WO, waiting, model, start, planner, plant_config
    )


def _waiting_pose(scenario: Scenario, shape: Shape, X_WO: RigidTransform) -> RigidTransform:
    """Returns the pose of an object over which the hand starts, turned as the object at X_WO."""
    if not (place := scenario.grasp.meeting.wait_at):
        return X_WO
    p_LV = (shape.mesh.vertices - shape.p_OCoM) @ X_WO.rotation().matrix().T
    if place[2] < (least := -float(np.min(p_LV[:, 2]))) - _SUNK:
        problem = (
            f"{place} is {place[2]:g} m over the table, and must be at least {least:.3g} m, so"
        )
        problem += " that an object with its centre of mass there is not inside of the table"
        raise ScenarioError("", "grasp.meeting.wait_at", problem)
    return RigidTransform(X_WO.rotation(), place - X_WO.rotation() @ shape.p_OCoM)


def _plant_config(scenario: Scenario) -> MultibodyPlantConfig:
    """Returns the plant's configuration; its default time step suits the hand and the motion."""
    settings, motion = copy(scenario.plant_config), scenario.motion
    if settings.time_step == TIME_STEP:
        step = scenario.grasp.period / 2 if scenario.has_hand else TIME_STEP
        longest = _STEP_LENGTH / motion.speed if isinstance(motion, Push) else math.inf
        if isinstance(motion, Toss):
            longest = _TOSS_STEP
        settings.time_step = step / max(1, math.ceil(step / longest))
    return settings


def _shape(scenario: Scenario) -> Shape:
    key = {Mesh: "file", Revolved: "profile"}.get(type(scenario.object), "rest")
    with errors_at(f"object.{key}"):
        return scenario.object.make_shape()


def _surface(
    scenario: Scenario, shape: Shape, hand: HandDescription | None, spacing: float | None = None
) -> ObjectSurface:
    tip = scenario.grasp.tip_size(hand.fingertips) if hand else None
    return scenario.surface.make_surface(scenario.object, shape=shape, spacing=spacing, tip=tip)


def _checked_surface(
    scenario: Scenario, shape: Shape, hand: HandDescription | None
) -> ObjectSurface:
    sampling = scenario.surface
    for index, area in enumerate(sampling.no_touch):
        with errors_at(f"surface.no_touch[{index}]"):
            area.make_area(shape)
    try:
        return _surface(scenario, shape, hand)
    except NoSurfaceError as error:
        key = "no_touch" if sampling.no_touch else "forbidden_faces"
        raise ScenarioError("", f"surface.{key}", str(error)) from error
    except InvalidArgumentError as error:
        key = "forbidden_spacing" if "forbidden_spacing" in str(error) else "spacing"
        raise ScenarioError("", f"surface.{key}", str(error)) from error


def _given_contacts(scenario: Scenario, surface: ObjectSurface) -> FloatArray:
    """Returns the contacts of the keys in O, in their order, shape (n, 3), in metres."""
    if scenario.ring_contacts:
        return ring_contacts(surface, scenario.ring_contacts)
    low, high = surface.mesh.bounds
    p_OC: FloatArray = (low + high) / 2 + np.array(scenario.initial_contacts) * (high - low) / 2
    is_on_faces = isinstance(scenario.object, Box) and scenario.object.is_aligned
    return p_OC if is_on_faces else surface.project(p_OC)[0]


def _given_start(scenario: Scenario, surface: ObjectSurface, X_WO: RigidTransform) -> StartContacts:
    """Returns the given contacts, in the order of the fingers of a hand's frame if it has any."""
    p_OC, frame = _given_contacts(scenario, surface), scenario.hand_frame
    if frame.fingertips:
        X_OH = X_WO.inverse() @ frame.initial_X_WH(X_WO)
        p_OF: FloatArray = (X_OH @ np.array(frame.fingertips).T).T
        p_OC = p_OC[assign_fingers(p_OF, p_OC)]
    return StartContacts(p_OC, np.ones(len(p_OC), dtype=bool), 0.0, np.nan, np.nan)


def _hand_and_start(
    scenario: Scenario,
    source: HandSource,
    shape: Shape,
    surface: ObjectSurface,
    X_WO: RigidTransform,
    waiting: RigidTransform,
    path: Sequence[RigidTransform],
) -> Approach:
    grasp, file, (description, read) = scenario.grasp, scenario.hand_file, source
    X_WB = scenario.hand.X_WB if isinstance(scenario.hand, HandFile) else None
    if X_WB is not None and not isinstance(description.base, Arm):
        problem = f"only an arm can stand elsewhere, and {file} has none"
        raise ScenarioError("", "hand.position", problem)
    with errors_at("hand.file", f"{file}: "):
        upright = HandModel(description, X_WB=X_WB, model=read, warns=True)
    raise_first(model_problems(grasp, upright))
    incoming, fixed = None, [TABLE.solid]
    if grasp.meeting.wait_at:
        incoming = grasp.meeting.wait_at - X_WO @ shape.p_OCoM
    with errors_at("hand.file", f"{file}: "):
        groups = approaching_hands(
            *(upright, grasp, surface, waiting),
            fixed=fixed,
            X_WB=X_WB,
            incoming=incoming,
            pans=incoming is None,
        )
        hands = next(groups)
    where = ""
    if not (X_LA := hands[0].X_LA).rotation().IsExactlyIdentity():
        height = (waiting @ shape.p_OCoM + X_LA.translation())[2]
        where = f"from the side, with the palm's axis {height:.3g} m over the table: "
    chooses = scenario.chooses_contacts
    with errors_at("object" if chooses else "initial_contacts", where):
        return start_grasp.best_start(
            itertools.chain([hands], groups),
            grasp,
            scenario.planner,
            surface,
            solid=shape.solid,
            mass=scenario.object.mass,
            X_WO=waiting,
            fixed=fixed,
            path=path,
            p_OC=None if chooses else _given_contacts(scenario, surface),
        )


def _followed_path(
    scenario: Scenario, hand: HandDescription, motion: Motion, shape: Shape
) -> list[tuple[float, RigidTransform]]:
    """Returns some times, in seconds, and expected poses X_WO until the hand comes to rest."""
    end = min(scenario.simulation_duration, scenario.grasp.latest_rest(hand.fingertips))
    poses = expected_poses(motion, end, shape)
    return poses[:: max(1, len(poses) // 3)]


def _check_base(
    scenario: Scenario,
    hand: HandModel,
    yaw: float,
    shape: Shape,
    path: Sequence[tuple[float, RigidTransform]],
) -> None:
    """Raises an error unless the hand can hold its palm at the object at all times, and lift it.

    A carrier must follow a conveyor until the earliest time of rest only. Mostly, it waits for no
    finger, and has lifted the object before the latest one.

    Args:
        scenario: Scenario of the grasp.
        hand: Model of the hand with its approach.
        yaw: Yaw of the palm at the start, in radians.
        shape: Shape of the object.
        path: Times in seconds and expected poses X_WO of the object, until the hand rests.
    """
    _, start = path[0]
    base = "carrier" if isinstance(hand.base, PalmCarrier) else "arm"
    for time, X_WO in path:
        with errors_at("motion", f"at {time:.3g} s the object is out of the {base}'s reach: "):
            feasibility.check_palm(hand, scenario.grasp, [start, X_WO], shape.p_OCoM, yaw)
    if isinstance(scenario.motion, Conveyor) and not scenario.grasp.meeting.wait_at:
        rest = scenario.grasp.earliest_rest(hand.description.fingertips)
        end, profile = min(scenario.simulation_duration, rest), scenario.motion.velocities()
        p_WCoM = start @ shape.p_OCoM
        with errors_at("motion"):
            feasibility.check_carrier(
                hand, scenario.grasp, VelocityProfile(profile), end, p_WCoM, yaw
            )
