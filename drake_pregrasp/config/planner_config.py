"""Configuration of the planner and of its pose estimator."""

from dataclasses import dataclass, field

from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.contacts.strategies import BLEND, READINGS, STRATEGIES
from drake_pregrasp.estimation.pose_filter import PoseFilterNoise
from drake_pregrasp.quality.force_closure import FRICTION
from drake_pregrasp.regions.walls import WALL_TESTS

MOST_LATE = 1000
"""Largest number of used measurements that may be newer than an out-of-sequence one."""


@dataclass
class EstimatorConfig:
    """What the pose filter assumes; standard deviations are per axis."""

    # Noise of a measured position, in metres.
    position_std: float = field(default=0.0005, metadata={"above": 0, "at_most": 10})

    # Noise of a measured orientation, in radians.
    orientation_std: float = field(default=0.0035, metadata={"above": 0, "at_most": 10})

    # Root of the density of the object's random acceleration, in m/s^2/sqrt(Hz).
    acceleration: float = field(default=0.001, metadata={"above": 0, "at_most": 1000})

    # The same for its angular acceleration, in rad/s^2/sqrt(Hz).
    angular_acceleration: float = field(default=0.01, metadata={"above": 0, "at_most": 1000})

    # Velocity to expect before the first measurement, in m/s.
    initial_velocity_std: float = field(default=0.1, metadata={"above": 0, "at_most": 1000})

    # Angular velocity to expect before the first measurement, in rad/s.
    initial_angular_velocity_std: float = field(default=0.5, metadata={"above": 0, "at_most": 1000})

    # Mean acceleration along -z of W, in m/s^2: 0 for an object that something carries, 9.81 for
    # one in free flight.
    gravity: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1000})

    # Seconds by which the estimate, and so the goals, are predicted ahead. Measures and errors
    # compare them with the object's pose at the time itself all the same.
    lookahead: float = field(default=0.0, metadata={"at_least": 0, "at_most": 10})

    # Mahalanobis distance from its prediction beyond which a measured position or orientation is an
    # outlier; 0 to take all.
    gate: float = field(default=7.0, metadata={"at_least": 0, "at_most": 1e6})

    # How many outliers in a row that agree with each other are a jump, and not outliers.
    reacquire_after: int = field(default=3, metadata={"at_least": 1, "at_most": 1000})

    # Whether a measurement that repeats the last one to the last bit is refused, while the object
    # moves and the sensor has shown noise.
    refuse_repeats: bool = True

    # How many measurements back a late one may go; older ones are refused.
    late_measurements: int = field(default=20, metadata={"at_least": 1, "at_most": MOST_LATE})

    # Seconds by which a measurement is overdue after which goals go on by prediction: coasting.
    coast_after: float = field(default=0.1, metadata={"at_least": 0, "at_most": 1e6})

    # Seconds by which it is overdue after which the object is lost, and goals stand still; at least
    # as long.
    lost_after: float = field(default=1.0, metadata={"at_least": 0, "at_most": 1e6})


def filter_noise(config: EstimatorConfig) -> PoseFilterNoise:
    """Returns the noise that the pose filter assumes."""
    return PoseFilterNoise(
        position=config.position_std,
        orientation=config.orientation_std,
        acceleration=config.acceleration,
        angular_acceleration=config.angular_acceleration,
        initial_velocity=config.initial_velocity_std,
        initial_angular_velocity=config.initial_angular_velocity_std,
        gravity=config.gravity,
    )


@dataclass
class BlendConfig:
    """How much each strategy counts in a blend; their ratios matter."""

    position: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1e6})
    msv: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1e6})
    gii: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1e6})
    vew: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1e6})
    margin: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1e6})


@dataclass
class PlannerConfig:
    """How contact goals are planned."""

    # Seconds between planning ticks.
    period: float = field(default=0.05, metadata={"at_least": 1e-4, "at_most": 10})

    # Seconds for which the initial contacts are held on the object before they adapt.
    static_duration: float = field(default=4.0, metadata={"at_least": 0, "at_most": 1e6})

    # While the object isn't tracked, the targets of fingertips are that far off its surface, in
    # metres.
    lost_standoff: float = field(default=0.02, metadata={"at_least": 0, "at_most": 10})

    # How a contact moves inside its safe region: position tracking (Eq. 3), a measure (Eq. 5-7),
    # the force-closure margin, or the blend of them that is stated below.
    strategy: str = field(default="position", metadata={"one_of": (*STRATEGIES, BLEND)})

    # For strategy blend, where one weight at least must be above 0.
    blend: BlendConfig = field(default_factory=BlendConfig)

    # For measures: the matrix of the candidate alone, or that of the hand with it.
    reading: str = field(default="hand", metadata={"one_of": READINGS})

    # For measures: whether weights are stretched over each region, b_n - min b.
    stretch: bool = True

    # For measures: exponent of the weights. The larger, the nearer the centroid is to the best
    # point.
    power: float = field(default=1.0, metadata={"above": 0, "at_most": 100})

    # For the margin: Coulomb's coefficient between fingertip and object.
    friction: float = field(default=FRICTION, metadata={"at_least": 0, "at_most": 10})

    # Whether contacts move one after another, each seeing where those before it went, not all as if
    # the others stayed. It brings measures to rest, at the cost of weighing once a contact.
    in_turns: bool = False

    # Whether a contact moves to the candidate of the largest weight, not to the centroid of Eq. 4.
    best_point: bool = False

    # Standard deviation added to the filter's covariance in Eq. 3, in metres.
    position_spread: float = field(default=0.04, metadata={"at_least": 1e-6, "at_most": 1000})

    # How a region is kept from reaching through a thin wall to its other side: not at all, by the
    # angle between outward normals, or by the way over the surface.
    wall_test: str = field(default="none", metadata={"one_of": WALL_TESTS})

    # If above zero, Eq. 1 is over six coordinates: places and, times this length in metres, outward
    # normals, so that regions keep to ground that faces the way of their contact's.
    normal_length: float = field(default=0.0, metadata={"at_least": 0, "at_most": 10})

    limits: LimitsConfig = field(default_factory=LimitsConfig)

    # Whether to check every active goal against the mesh, and stop with an error if it is not on
    # the allowed surface. It takes time: a switch for finding faults.
    verify_contacts: bool = False

    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)
