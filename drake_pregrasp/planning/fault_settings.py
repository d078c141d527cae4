"""What may go wrong with measurements of a pose, and how often."""

from collections.abc import Sequence
from dataclasses import dataclass

from drake_pregrasp.planning.ticks import first_tick

FOREVER = 1e7
"""When faults end by default, in seconds: after any run."""


@dataclass(frozen=True)
class MeasurementFaults:
    """Faults of a pose sensor; by default there are none.

    Attributes:
        noise_factor: By which the noise is larger.
        position_bias: Added to the position, in W, shape (3,), in metres.
        orientation_bias: A rotation vector in W by which the orientation is off, shape (3,), in
            radians.
        degrees_of_freedom: Of Student's t, in place of the normal noise; 0 for normal noise.
        outlier_probability: That a measurement is an outlier.
        outlier_position: How far the position of an outlier is off, in metres.
        outlier_orientation: How far its orientation is off, in radians.
        dropout_rate: How many occlusions start per second, on average.
        dropout_duration: Their mean length, in seconds.
        delay: From taking a measurement to its arrival, in seconds.
        jitter: Largest random addition to the delay, in seconds.
        out_of_order: Whether a measurement that others have overtaken counts when it arrives.
        freeze_rate: How often per second the value freezes, on average.
        freeze_duration: Mean length of that, in seconds.
        sign_flip_probability: That the quaternion of a measurement has the other sign.
        nan_probability: That a measurement is not a number.
        sample_period: Seconds between measurements; 0 for one each tick.
        start: Faults act on what is measured from this time on, in seconds.
        end: Until just before this time, in seconds.
    """

    noise_factor: float = 1.0
    position_bias: Sequence[float] = (0.0, 0.0, 0.0)
    orientation_bias: Sequence[float] = (0.0, 0.0, 0.0)
    degrees_of_freedom: float = 0.0
    outlier_probability: float = 0.0
    outlier_position: float = 0.1
    outlier_orientation: float = 0.5
    dropout_rate: float = 0.0
    dropout_duration: float = 0.5
    delay: float = 0.0
    jitter: float = 0.0
    out_of_order: bool = False
    freeze_rate: float = 0.0
    freeze_duration: float = 0.5
    sign_flip_probability: float = 0.0
    nan_probability: float = 0.0
    sample_period: float = 0.0
    start: float = 0.0
    end: float = FOREVER

    @property
    def need_memory(self) -> bool:
        """Whether what a sensor emits depends on earlier measurements."""
        return any(
            (self.dropout_rate, self.delay, self.jitter, self.freeze_rate, self.sample_period)
        )

    @property
    def are_any(self) -> bool:
        """Whether there is any fault at all."""
        return self.need_memory or any(
            (
                self.noise_factor != 1,
                *self.position_bias,
                *self.orientation_bias,
                self.degrees_of_freedom,
                self.outlier_probability,
                self.sign_flip_probability,
                self.nan_probability,
            )
        )

    def act_at(self, tick: int, period: float) -> bool:
        """Returns whether they act on what is measured at a tick.

        Args:
            tick: Its index; it is at tick * period.
            period: Seconds between ticks.
        """
        return first_tick(self.start, period) <= tick < first_tick(self.end, period)
