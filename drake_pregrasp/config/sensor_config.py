"""What the simulated pose sensor does: noise and faults."""

import math
from dataclasses import dataclass, field

from drake_pregrasp.errors import ScenarioError
from drake_pregrasp.estimation.fault_settings import FOREVER, MeasurementFaults, find_flaw

_VECTOR = {"length": 3, "at_least": -10, "at_most": 10}
_ANGLES = {"length": 3, "at_least": -math.pi, "at_most": math.pi}
_PROBABILITY = {"at_least": 0, "at_most": 1}
_RATE = {"at_least": 0, "at_most": 1000}
_DURATION = {"above": 0, "at_most": 100}
_LAG = {"at_least": 0, "at_most": 100}


@dataclass
class FaultsConfig:
    """What goes wrong with measurements; by default nothing does."""

    # Times the noise.
    noise_factor: float = field(default=1.0, metadata={"at_least": 0, "at_most": 1000})

    # Added to the position, along the axes of W, in metres.
    position_bias: list[float] = field(default_factory=lambda: [0.0] * 3, metadata=_VECTOR)

    # A rotation vector in W by which the orientation is off, at most half a turn, in radians.
    orientation_bias: list[float] = field(default_factory=lambda: [0.0] * 3, metadata=_ANGLES)

    # Heavy tails: the noise is Student's t with so many degrees of freedom, at least 1, and the
    # sensor's standard deviations are its scale. 0: the noise is normal.
    degrees_of_freedom: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1e6})

    # Probability that a measurement is an outlier.
    outlier_probability: float = field(default=0.0, metadata=_PROBABILITY)

    # How far off an outlier's position is, in a random direction, in metres.
    outlier_position: float = field(default=0.1, metadata={"at_least": 0, "at_most": 10})

    # How far it is turned, about a random axis, in radians.
    outlier_orientation: float = field(default=0.5, metadata={"at_least": 0, "at_most": math.pi})

    # Occlusions per second, on average, during which nothing is measured.
    dropout_rate: float = field(default=0.0, metadata=_RATE)

    # Mean length of an occlusion, in seconds; lengths are exponential, up to five times that.
    dropout_duration: float = field(default=0.5, metadata=_DURATION)

    # Seconds from a measurement to its arrival. With jitter at most a thousand planning periods.
    delay: float = field(default=0.0, metadata=_LAG)

    # Largest addition to the delay, in seconds; it is uniform from 0 on.
    jitter: float = field(default=0.0, metadata=_LAG)

    # Whether measurements that were overtaken on their way count when they arrive; otherwise they
    # are dropped. Needs a jitter longer than the time between measurements.
    out_of_order: bool = False

    # How often per second, on average, the measured value freezes: it repeats, with new times.
    freeze_rate: float = field(default=0.0, metadata=_RATE)

    # Mean length of that, in seconds, as of occlusions.
    freeze_duration: float = field(default=0.5, metadata=_DURATION)

    # Probability that a measured quaternion has the other sign. The rotation is the same.
    sign_flip_probability: float = field(default=0.0, metadata=_PROBABILITY)

    # Probability that a measurement is not a number.
    nan_probability: float = field(default=0.0, metadata=_PROBABILITY)

    # Seconds between measurements, at least planner.period; 0 for one each planning tick.
    sample_period: float = field(default=0.0, metadata={"at_least": 0, "at_most": 1000})

    # Faults act on what is measured from this time on, in seconds.
    start: float = field(default=0.0, metadata={"at_least": 0, "at_most": FOREVER})

    # Until just before this time, in seconds.
    end: float = field(default=FOREVER, metadata={"above": 0, "at_most": FOREVER})

    def settings(self) -> MeasurementFaults:
        """Returns the same for `NoisyPoseSensor`."""
        return MeasurementFaults(**vars(self))


@dataclass
class SensorConfig:
    """The simulated pose measurements: white noise, per axis, and faults."""

    # Standard deviation of the position, in metres.
    position_std: float = field(default=0.0005, metadata={"at_least": 0, "at_most": 10})

    # Standard deviation of the orientation's rotation vector, in radians.
    orientation_std: float = field(default=0.0035, metadata={"at_least": 0, "at_most": 10})

    # What else is wrong with them.
    faults: FaultsConfig = field(default_factory=FaultsConfig)


def check_sensor(source: str, sensor: SensorConfig, period: float) -> None:
    """Raises a `ScenarioError` unless the sensor's faults fit together.

    Args:
        source: Where the scenario is from, for the message.
        sensor: Loaded, with keys and types checked.
        period: Seconds between planning ticks.
    """
    flaw = find_flaw(sensor.faults.settings(), period)
    if flaw is not None:
        raise ScenarioError(source, f"sensor.faults.{flaw.name}", flaw.problem)
