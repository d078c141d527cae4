"""Schema of scenario files, which configure a simulation."""

from dataclasses import dataclass, field

from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import SimulatorConfig

from drake_pregrasp.config import object_config
from drake_pregrasp.config.camera_config import DepthSensorConfig
from drake_pregrasp.config.finger_config import CapabilityProfile, DamageEvent
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.planner_config import MeasuresConfig, PlannerConfig
from drake_pregrasp.config.sensor_config import AnySensorConfig, SensorConfig
from drake_pregrasp.config.surface_config import SurfaceConfig
from drake_pregrasp.diagrams.object_plant import DRAKE, ENGINES
from drake_pregrasp.simulation.hand_file import HandConfig, HandFile, HandFrame
from drake_pregrasp.simulation.obstacle_config import ObstacleConfig
from drake_pregrasp.systems.pose_sensor import MAX_SEED


@dataclass
class RecordingConfig:
    """Settings of the Meshcat recording."""

    # Seconds between frames.
    publish_period: float = field(default=0.05, metadata={"at_least": 1e-3})

    # Largest edge of the drawn tiles of regions, in metres. A few thousand tiles are fast.
    tile_size: float = field(default=0.005, metadata={"at_least": 0.001})


TIME_STEP = 0.025
"""Default time step of the plant without a hand, in seconds."""

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
            time_step=TIME_STEP, use_sampled_output_ports=False
        )
    )

    # What simulates the plant: `drake`, or `mujoco` (extra `mujoco`) with the same bodies, joints,
    # drives and geometries, but another model of contact.
    engine: str = field(default=DRAKE, metadata={"one_of": ENGINES})

    object: object_config.ObjectConfig = field(default_factory=object_config.Box)
    motion: object_config.MotionConfig = field(default_factory=object_config.Conveyor)
    sensor: AnySensorConfig = field(default_factory=SensorConfig)

    # Depth cameras in the scene, which take the place of the pose sensor.
    depth_sensor: DepthSensorConfig = field(default_factory=DepthSensorConfig)

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

    # Simulated hand that follows the goals and grasps, or the frame of a hand that is not
    # simulated. By default there is neither.
    hand: HandConfig = field(default_factory=HandFile)

    # How a simulated hand follows, closes, squeezes and lifts.
    grasp: GraspConfig = field(default_factory=GraspConfig)

    # Settings of the Meshcat recording.
    recording: RecordingConfig = field(default_factory=RecordingConfig)

    @property
    def hand_file(self) -> str:
        """File of the simulated hand; empty without one."""
        return self.hand.file if isinstance(self.hand, HandFile) else ""

    @property
    def has_hand(self) -> bool:
        """Whether there is a simulated hand."""
        return bool(self.hand_file)

    @property
    def hand_frame(self) -> HandFrame:
        """Frame of a hand that is not simulated, in which the reach of the fingers is given."""
        return self.hand if isinstance(self.hand, HandFrame) else HandFrame()

    @property
    def chooses_contacts(self) -> bool:
        """Whether start contacts are chosen, because there is a hand, and no contacts are given."""
        given = [tuple(contact) for contact in self.initial_contacts]
        is_given = self.ring_contacts > 0 or given not in ([], list(_PAPER_CONTACTS))
        return self.has_hand and not is_given
