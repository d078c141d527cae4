"""What a simulation is made of: the schema of scenario files."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from drake_pregrasp.diagrams.object_plant import MotionConfig, ObjectConfig
from drake_pregrasp.diagrams.pregrasp_planner import PlannerConfig
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.blends import BLEND
from drake_pregrasp.planning.contact_models import CONTACT_MODELS
from drake_pregrasp.planning.force_closure import FRICTION, TORSIONAL_FRICTION
from drake_pregrasp.planning.strategies import STRATEGIES
from drake_pregrasp.planning.surface import (
    BOX_FACES,
    CONTACT_TOLERANCE,
    ObjectSurface,
    box_surface,
)
from drake_pregrasp.systems.noise_source import MAX_SEED
from drake_pregrasp.systems.tick import SLACK, tick_index


@dataclass
class SensorConfig:
    """White noise of the simulated pose measurements, per axis."""

    # Standard deviation of the position, in metres.
    position_std: float = field(default=0.0005, metadata={"at_least": 0, "at_most": 10})

    # Standard deviation of the orientation's rotation vector, in radians.
    orientation_std: float = field(default=0.0035, metadata={"at_least": 0, "at_most": 10})


@dataclass
class SurfaceConfig:
    """How the object's surface is sampled."""

    # Largest distance between neighbouring candidate points Y, in metres.
    spacing: float = field(default=0.005, metadata={"at_least": 0.0005})

    # Faces that become forbidden points Z, by their outward normals in the object frame.
    forbidden_faces: list[str] = field(
        default_factory=lambda: ["-z", "+z"], metadata={"one_of": BOX_FACES}
    )

    # Largest distance between neighbouring forbidden points, in metres.
    forbidden_spacing: float = field(default=0.02, metadata={"at_least": 0.0005})

    # Radius R_j of each forbidden point, in metres.
    forbidden_radius: float = field(default=0.005, metadata={"at_least": 0, "at_most": 10})


@dataclass
class DamageEvent:
    """Fingers that are lost during the run."""

    # When, in seconds.
    at: float = field(default=0.0, metadata={"required": True, "at_least": 0})

    # Which contacts, by their index in initial_contacts.
    contacts: list[int] = field(
        default_factory=list, metadata={"required": True, "min_length": 1, "at_least": 0}
    )


@dataclass
class MeasuresConfig:
    """What the logged measures and the margins in the summary assume of the contacts."""

    # Contact model of the grasp matrix. The margins need a friction cone: for the complete model,
    # whose contacts pull as well, they are those of the hard finger.
    contact_model: str = field(default="complete", metadata={"one_of": CONTACT_MODELS})

    # Coulomb's coefficient.
    friction: float = field(default=FRICTION, metadata={"at_least": 0, "at_most": 10})

    # For soft fingers: moment about the normal per newton of normal force, in metres.
    torsional_friction: float = field(
        default=TORSIONAL_FRICTION, metadata={"at_least": 0, "at_most": 10}
    )

    # Unit of lever arms, in metres. 0: the longest one on the object; but one metre in the measures
    # of the complete model, as in the paper.
    length: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1000})


@dataclass
class RecordingConfig:
    """The Meshcat recording."""

    # Seconds between frames.
    publish_period: float = field(default=0.05, metadata={"at_least": 1e-3})

    # Largest edge of the tiles that draw the regions, in metres. A few thousand tiles are light.
    tile_size: float = field(default=0.005, metadata={"at_least": 0.001})


@dataclass
class Scenario:
    """One simulation. Every field has a default; `scenarios/paper.yaml` shows how to differ."""

    # One line for lists and titles.
    description: str = ""

    # Seed of the measurement noise. A run is a function of its scenario: the same gives the same.
    random_seed: int = field(default=0, metadata={"at_least": 0, "at_most": MAX_SEED})

    # Seconds to simulate.
    simulation_duration: float = field(default=60.0, metadata={"above": 0, "at_most": 1e6})

    # Drake's own settings.
    simulator_config: SimulatorConfig = field(default_factory=SimulatorConfig)

    # Drake's own settings. The time step is half the planning period, so that both fall on
    # exactly the same times; without sampled output ports, the plant steps in the same pass as the
    # planner, which then sees the pose that loggers and visualizers see; and with the lower SAP
    # threshold the object sinks into the table by micrometres instead of half a millimetre.
    plant_config: MultibodyPlantConfig = field(
        default_factory=lambda: MultibodyPlantConfig(
            time_step=0.025,
            use_sampled_output_ports=False,
            sap_near_rigid_threshold=0.1,
            contact_model="point",
            discrete_contact_approximation="sap",
        )
    )

    object: ObjectConfig = field(default_factory=ObjectConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)
    surface: SurfaceConfig = field(default_factory=SurfaceConfig)
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    measures: MeasuresConfig = field(default_factory=MeasuresConfig)

    # Where the contacts start, one row each, in half edge lengths of the object: 1 and -1 are its
    # faces. The default is calibrated to the static rows of the paper's Table II, for all sizes.
    initial_contacts: list[list[float]] = field(
        default_factory=lambda: [
            [-0.335, 1.0, -0.7],
            [0.7, 1.0, -0.246],
            [-0.201, 1.0, 0.701],
            [0.568, -1.0, 0.661],
            [1.0, -0.142, -0.701],
        ],
        metadata={"min_length": 1, "elements": {"length": 3}},
    )

    # h_i of Eq. 1 for each contact, in m^2: larger ones have larger regions. Empty: all zero.
    contact_weights: list[float] = field(
        default_factory=list, metadata={"at_least": -1, "at_most": 1}
    )

    # Fingers that are lost, which the planner hears of through its port contact_weights.
    damage: list[DamageEvent] = field(default_factory=list)

    recording: RecordingConfig = field(default_factory=RecordingConfig)

    def make_surface(self, spacing: float | None = None) -> ObjectSurface:
        """Returns the object's surface, sampled as `surface` says, or with another spacing."""
        return box_surface(
            self.object.size,
            spacing=self.surface.spacing if spacing is None else spacing,
            forbidden_faces=self.surface.forbidden_faces,
            forbidden_spacing=self.surface.forbidden_spacing,
            forbidden_radius=self.surface.forbidden_radius,
        )

    def remaining_contacts(self) -> list[int]:
        """Returns the indices of the contacts that no damage event takes."""
        lost = {contact for event in self.damage for contact in event.contacts}
        return [i for i in range(len(self.initial_contacts)) if i not in lost]

    def initial_p_OC(self) -> FloatArray:
        """Returns the initial contacts in the object frame O, shape (n, 3), in metres."""
        p_OC: FloatArray = np.array(self.initial_contacts) * np.array(self.object.size) / 2
        return p_OC


def validate(scenario: Scenario, source: str = "scenario") -> None:
    """Checks what no single key shows.

    Args:
        scenario: Loaded, with keys and types checked.
        source: Where it is from, for the message.

    Raises:
        ScenarioError: If the scenario can't be simulated.
    """
    try:
        distances = scenario.make_surface().distance(scenario.initial_p_OC())
    except InvalidArgumentError as error:
        raise ScenarioError(source, "surface.forbidden_faces", str(error)) from error
    for index, distance in enumerate(distances):
        if distance > CONTACT_TOLERANCE:
            raise ScenarioError(
                source,
                f"initial_contacts[{index}]",
                f"{scenario.initial_contacts[index]} is {1e3 * distance:.3g} mm off the surface;"
                f" at most {1e3 * CONTACT_TOLERANCE} mm, so one coordinate must be 1 or -1"
                " and none beyond",
            )
    count = len(scenario.initial_contacts)
    if scenario.contact_weights and len(scenario.contact_weights) != count:
        raise ScenarioError(
            source,
            "contact_weights",
            f"{scenario.contact_weights} must be empty or one number for each of the"
            f" {count} initial_contacts",
        )
    _validate_damage(scenario, source)
    if scenario.planner.strategy == BLEND and not any(vars(scenario.planner.blend).values()):
        raise ScenarioError(
            source,
            "planner.blend",
            f"all weights are 0; a {BLEND} needs one above 0 out of: {', '.join(STRATEGIES)}",
        )
    try:
        AddMultibodyPlant(scenario.plant_config, DiagramBuilder())
    except RuntimeError as error:
        raise ScenarioError(source, "plant_config", _first_line(error)) from error
    try:
        ApplySimulatorConfig(scenario.simulator_config, Simulator(ConstantVectorSource([0.0])))
    except (RuntimeError, ValueError) as error:
        raise ScenarioError(source, "simulator_config", _first_line(error)) from error


def _validate_damage(scenario: Scenario, source: str) -> None:
    left = set(range(len(scenario.initial_contacts)))
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


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0]
