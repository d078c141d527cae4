"""Schema of scenario files, which configure a simulation."""

import contextlib
import math
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from weakref import WeakKeyDictionary

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import SimulatorConfig

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.config import object_config
from drake_pregrasp.config.finger_config import CapabilityProfile, DamageEvent
from drake_pregrasp.config.grasp_config import ABOVE, GraspConfig
from drake_pregrasp.config.planner_config import MeasuresConfig, PlannerConfig
from drake_pregrasp.config.sensor_config import SensorConfig
from drake_pregrasp.config.surface_config import SurfaceConfig
from drake_pregrasp.contacts.assignment import FREE_TURN, assign_fingers, ring_contacts
from drake_pregrasp.contacts.start_contacts import StartContacts
from drake_pregrasp.diagrams import start_grasp
from drake_pregrasp.diagrams.approaches import best_approach, candidate_approaches
from drake_pregrasp.diagrams.expected_path import expected_poses, initial_pose
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.hand_station import TABLE
from drake_pregrasp.diagrams.start_grasp import start_contacts_of
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.simulation.hand_file import HandConfig, load_hand, load_hand_model
from drake_pregrasp.simulation.obstacle_config import ObstacleConfig, moving_solid
from drake_pregrasp.systems.palm_frames import FROM_ABOVE
from drake_pregrasp.systems.pose_sensor import MAX_SEED
from drake_pregrasp.systems.sources import MovingSolid


@dataclass
class RecordingConfig:
    """Settings of the Meshcat recording."""

    # Seconds between frames.
    publish_period: float = field(default=0.05, metadata={"at_least": 1e-3})

    # Largest edge of the drawn tiles of regions, in metres. A few thousand tiles are fast.
    tile_size: float = field(default=0.005, metadata={"at_least": 0.001})


_TIME_STEP = 0.025  # Default time step of the plant without a hand, in seconds.
_LANDING_STEP = 0.0025  # Longest default time step for an object that lands on a table, in seconds.
_STEP_LENGTH = 5e-4  # Largest distance that a pusher moves in a default time step, in metres.

_PAPER_CONTACTS = (
    (-0.335, 1.0, -0.7),
    (0.7, 1.0, -0.246),
    (-0.201, 1.0, 0.701),
    (0.568, -1.0, 0.661),
    (1.0, -0.142, -0.701),
)


@dataclass
class Scenario:
    """Configuration of one simulation. Every field has a default."""

    # One line of text for lists and titles. Keys that --scenario_text overrides empty it.
    description: str = ""

    # Seed of the measurement noise and of faults. The same scenario gives the same log.
    random_seed: int = field(default=0, metadata={"at_least": 0, "at_most": MAX_SEED})

    # Duration of the simulation, in seconds.
    simulation_duration: float = field(default=60.0, metadata={"above": 0, "at_most": 1e6})

    # Configuration of Drake's simulator.
    simulator_config: SimulatorConfig = field(default_factory=SimulatorConfig)

    # Configuration of Drake's plant. The time step is half the planning period, so that both fall
    # on exactly the same times. Without sampled output ports, the plant steps in the same pass as
    # the planner, which then sees the same pose as loggers and visualizers. The contact model
    # is Drake's default, hydroelastic and `lagged`: with `sap`, sliding objects hop. With a hand,
    # half its control period replaces the default time step; an object that lands on a table, or a
    # fast pusher, divides it further.
    plant_config: MultibodyPlantConfig = field(
        default_factory=lambda: MultibodyPlantConfig(
            time_step=_TIME_STEP, use_sampled_output_ports=False
        )
    )

    object: object_config.ObjectConfig = field(default_factory=object_config.Box)
    motion: object_config.MotionConfig = field(default_factory=object_config.Conveyor)
    sensor: SensorConfig = field(default_factory=SensorConfig)
    surface: SurfaceConfig = field(default_factory=SurfaceConfig)
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    measures: MeasuresConfig = field(default_factory=MeasuresConfig)

    # Initial contacts, one row each, in half extents of the object's bounding box from its centre:
    # 1 and -1 are a box's faces. On a box they must lie on its surface. On other objects, each
    # contact starts at the nearest allowed point. The default is calibrated to the static rows of
    # the paper's Table II, for all sizes. With a hand, the default or an empty list means that
    # fingers, contacts and the palm's yaw are chosen for the hand and the object.
    initial_contacts: list[list[float]] = field(
        default_factory=lambda: [list(contact) for contact in _PAPER_CONTACTS],
        metadata={"elements": {"length": 3}},
    )

    # Number of contacts that start on a ring around the centre of mass; 0 for `initial_contacts`.
    ring_contacts: int = field(default=0, metadata={"at_least": 0, "at_most": 64})

    # Weight h_i of each contact, in m^2: a larger one gives a larger region. Empty: all 0.
    contact_weights: list[float] = field(
        default_factory=list, metadata={"at_least": -1, "at_most": 1}
    )

    # Capability of fingers over time, which adds to their weights; other fingers have 1. A stronger
    # finger has a larger region.
    capability: list[CapabilityProfile] = field(default_factory=list)

    # Distance of two contacts, in metres, at which their capabilities divide the surface between
    # them in proportion. 0: the smallest distance of the tick, so that each contact stays in its
    # own region.
    capability_length: float = field(default=0.0, metadata={"at_least": 0, "at_most": 10})

    # Losses of fingers, which reach the planner through its port contact_weights.
    damage: list[DamageEvent] = field(default_factory=list)

    # Solids in W that contacts must keep clear of: bodies, or no-touch volumes.
    obstacles: list[ObstacleConfig] = field(default_factory=list)

    hand: HandConfig = field(default_factory=HandConfig)

    # Simulated hand that follows the goals and grasps; by default there is none.
    grasp: GraspConfig = field(default_factory=GraspConfig)
    recording: RecordingConfig = field(default_factory=RecordingConfig)

    @property
    def num_contacts(self) -> int:
        """Number of contacts n."""
        if self.chooses_contacts:
            return len(load_hand(self.grasp.hand).fingertips)
        return self.ring_contacts or len(self.initial_contacts)

    @property
    def plant_settings(self) -> MultibodyPlantConfig:
        """The plant's configuration; its default time step suits the hand and the motion."""
        settings, motion = copy(self.plant_config), self.motion
        if settings.time_step == _TIME_STEP:
            step = self.grasp.period / 2 if self.grasp.has_hand else _TIME_STEP
            longest = (
                _STEP_LENGTH / motion.speed if isinstance(motion, object_config.Push) else math.inf
            )
            if isinstance(motion, object_config.Toss) and motion.table:
                longest = _LANDING_STEP
            settings.time_step = step / max(1, math.ceil(step / longest))
        return settings

    @property
    def chooses_contacts(self) -> bool:
        """Whether start contacts are chosen, because there is a hand, and no contacts are given."""
        given = [tuple(contact) for contact in self.initial_contacts]
        is_given = self.ring_contacts > 0 or given not in ([], list(_PAPER_CONTACTS))
        return self.grasp.has_hand and not is_given

    @property
    def obstacle_bodies(self) -> list[MovingSolid]:
        """Obstacles that are bodies; none if the motion is recorded, because it has no plant."""
        simulated = not isinstance(self.motion, object_config.PoseStream)
        return [moving_solid(o) for o in self.obstacles if o.body and simulated]

    @property
    def no_touch_volumes(self) -> list[MovingSolid]:
        """Obstacles that are no bodies."""
        recorded = isinstance(self.motion, object_config.PoseStream)
        return [moving_solid(o) for o in self.obstacles if not o.body or recorded]

    @property
    def obstacle_names(self) -> dict[int, str]:
        """Names of the planner's obstacles that are not in `obstacles`, by their index.

        With a hand there is one: the conveyor's top, which no fingertip may touch.
        """
        return {len(self.obstacles): "the table"} if self.grasp.has_hand else {}

    def make_surface(self, spacing: float | None = None) -> ObjectSurface:
        """Returns the object's surface, sampled as `surface` configures, or with another spacing.

        A hand's fingertips need a place on it.

        Raises:
            InvalidArgumentError: If the object is invalid, or no surface is allowed for contacts.
        """
        tip = None
        if self.grasp.has_hand:
            tip = self.grasp.tip_size(load_hand(self.grasp.hand).fingertips)
        return self.surface.make_surface(self.object, spacing, tip)

    def load_hand_model(self, yaw_range: tuple[float, float] = FREE_TURN) -> HandModel:
        """Loads the hand's model with its description for the scenario's object and approach.

        Args:
            yaw_range: Range of the palm's yaw in radians; see `HandModel`.
        """
        return self._hand_from(self.approach, yaw_range)

    def _hand_from(
        self, X_LA: RigidTransform, yaw_range: tuple[float, float] = FREE_TURN
    ) -> HandModel:
        R_WO = initial_pose(self.motion, self.object).rotation()
        R_AO = (X_LA.rotation().inverse() @ R_WO).matrix()
        shape = self.object.make_shape()
        top = float(np.max((shape.mesh.vertices - shape.p_OCoM) @ R_AO[2]))
        return load_hand_model(self.grasp.hand, yaw_range, object_top=top, X_LA=X_LA)

    @property
    def approach(self) -> RigidTransform:
        """Approach X_LA of the palm (see `HandModel`), the one with the best start contacts."""
        if self.grasp.approaches == [ABOVE]:
            return FROM_ABOVE
        key = _approach_key(self)
        if key not in _approaches:
            surface, X_WO = self.make_surface(), initial_pose(self.motion, self.object)
            hand = self._hand_from(FROM_ABOVE)
            found = candidate_approaches(self.grasp, hand, X_WO, surface.p_OCoM)
            _approaches[key] = found[0]  # If there are no start contacts at all.
            with contextlib.suppress(InvalidArgumentError):
                hands = [self._hand_from(X_LA) for X_LA in found]
                best = best_approach(hands, partial(_contacts_from, self, surface))
                _approaches[key] = best.hand.X_LA
        return _approaches[key]

    def remaining_contacts(self, time: float = math.inf) -> list[int]:
        """Returns the indices of the contacts that are not lost at a time; by default, at the end.

        Args:
            time: Time in seconds.
        """
        lost = {c for event in self.damage if event.holds_at(time) for c in event.contacts}
        return [i for i in range(self.num_contacts) if i not in lost]

    def capability_at(self, time: float) -> FloatArray:
        """Returns the capability of each finger at a time in seconds, shape (n,)."""
        capability = np.ones(self.num_contacts)
        for profile in self.capability:
            capability[profile.contact] = np.interp(time, profile.times, profile.values)
        return capability

    def initial_p_OC(self, surface: ObjectSurface) -> FloatArray:
        """Returns the initial contacts in the object frame O, shape (n, 3), in metres.

        Args:
            surface: Surface of the object, from `make_surface`.

        Raises:
            InvalidArgumentError: If the hand's fingers cannot be assigned to the contacts.
        """
        if self.grasp.has_hand:
            return start_contacts(self, surface).p_OC
        p_OC, X_WO = self.given_p_OC(surface), initial_pose(self.motion, self.object)
        if not self.hand.fingertips:
            return p_OC
        X_OH = X_WO.inverse() @ self.hand.initial_X_WH(X_WO)
        p_OF: FloatArray = (X_OH @ np.array(self.hand.fingertips).T).T
        return np.array(p_OC[assign_fingers(p_OF, p_OC)])

    def given_p_OC(self, surface: ObjectSurface) -> FloatArray:
        """Returns the contacts of the keys in O, in their order, shape (n, 3), in metres."""
        if self.ring_contacts:
            return ring_contacts(surface, self.ring_contacts)
        low, high = surface.mesh.bounds
        p_OC: FloatArray = (low + high) / 2 + np.array(self.initial_contacts) * (high - low) / 2
        return p_OC if isinstance(self.object, object_config.Box) else surface.project(p_OC)[0]


def hand_planner(scenario: Scenario) -> PlannerConfig:
    """Returns the planner's configuration, with the limits of the scenario's hand if it has one."""
    if not scenario.grasp.has_hand:
        return scenario.planner
    hand = scenario.load_hand_model().description
    return start_grasp.hand_planner(scenario.planner, scenario.grasp, hand)


def initial_contacts(scenario: Scenario, surface: ObjectSurface) -> tuple[FloatArray, BoolArray]:
    """Returns the initial contacts in O, shape (n, 3), in metres, and which have room, shape (n,).

    Given contacts whose fingertips overlap are replaced by others on the allowed surface. A finger
    for which there is none within its reach stays away from the object.

    Args:
        scenario: Scenario whose other values have been checked.
        surface: Surface of the object, from `scenario.make_surface()`.
    """
    if not scenario.grasp.has_hand:
        p_OC = scenario.initial_p_OC(surface)
        return p_OC, np.ones(len(p_OC), dtype=bool)
    start = start_contacts(scenario, surface)
    return start.p_OC, start.has_contact


def _approach_key(scenario: Scenario) -> str:
    return repr(replace(scenario, description="", random_seed=0))


def keep_start(before: Scenario, after: Scenario, surface: ObjectSurface) -> None:
    """Lets a changed scenario have the approach and the start contacts of the one before.

    Args:
        before: Scenario whose start contacts have been chosen.
        after: The same object and hand, with other settings.
        surface: Surface of the object, from `before.make_surface()`.
    """
    if not before.chooses_contacts:
        return
    _approaches[_approach_key(after)] = before.approach
    start = start_contacts(before, surface)
    _chosen[surface][_contacts_key(after, after.load_hand_model())] = start


_approaches: dict[str, RigidTransform] = {}
_chosen: WeakKeyDictionary[ObjectSurface, dict[str, StartContacts]] = WeakKeyDictionary()


def start_contacts(scenario: Scenario, surface: ObjectSurface) -> StartContacts:
    """Returns the start contacts of a scenario's hand, chosen or given, from a cache if possible.

    Args:
        scenario: Scenario whose other values have been checked.
        surface: Surface of the object, from `scenario.make_surface()`.

    Raises:
        NoGraspError: If there are none to choose.
        InvalidArgumentError: If fingers cannot be assigned to given ones.
    """
    return _contacts_from(scenario, surface, scenario.load_hand_model())


def _contacts_from(scenario: Scenario, surface: ObjectSurface, hand: HandModel) -> StartContacts:
    key = _contacts_key(scenario, hand)
    known = _chosen.setdefault(surface, {})
    if key not in known:
        shape = scenario.object
        known[key] = start_contacts_of(
            hand,
            scenario.grasp,
            scenario.planner,
            surface,
            solid=shape.make_shape().solid,
            mass=shape.mass,
            X_WO=initial_pose(scenario.motion, shape),
            fixed=[TABLE.solid],
            path=[X for _, X in followed_path(scenario, hand)],
            p_OC=None if scenario.chooses_contacts else scenario.given_p_OC(surface),
        )
    return known[key]


def _contacts_key(scenario: Scenario, hand: HandModel) -> str:
    """Returns all that the choice of start contacts depends on, besides the surface."""
    grasp, X_WO = scenario.grasp, initial_pose(scenario.motion, scenario.object)
    limits = start_grasp.hand_planner(scenario.planner, grasp, hand.description).limits
    path = [X for _, X in followed_path(scenario, hand)]
    poses = [X.GetAsMatrix4().tolist() for X in (X_WO, *path)]
    given = scenario.initial_contacts, scenario.ring_contacts
    return repr((hand.description, hand.X_LA, given, grasp, limits, scenario.object.mass, poses))


def followed_path(scenario: Scenario, hand: HandModel) -> list[tuple[float, RigidTransform]]:
    """Returns some times, in seconds, and expected poses X_WO until the hand comes to rest."""
    rest = scenario.grasp.latest_rest(hand.description.fingertips)
    end = min(scenario.simulation_duration, rest)
    poses = expected_poses(scenario.motion, end, scenario.object)
    return poses[:: max(1, len(poses) // 3)]
