"""What the estimator assumes, and when it gives an object up."""

from dataclasses import dataclass, field

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.pose_belief import PoseFilterNoise
from drake_pregrasp.systems.pose_estimator import MOST_LATE, PoseEstimator


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


def make_estimator(config: EstimatorConfig, period: float, p_OCoM: FloatArray) -> PoseEstimator:
    """Returns the estimator that a configuration describes.

    Args:
        config: Its settings.
        period: Seconds between measurements.
        p_OCoM: The object's centre of mass in O, shape (3,), in metres.

    Raises:
        InvalidArgumentError: If settings don't go together.
    """
    return PoseEstimator(
        period=period,
        noise=filter_noise(config),
        p_OCoM=p_OCoM,
        lookahead=config.lookahead,
        gate=config.gate,
        reacquire_after=config.reacquire_after,
        refuse_repeats=config.refuse_repeats,
        late_measurements=config.late_measurements,
        coast_after=config.coast_after,
        lost_after=config.lost_after,
    )
