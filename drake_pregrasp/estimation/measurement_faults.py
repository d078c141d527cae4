"""When measurements are taken, lost, frozen, and when they arrive.

Each is a function of the seed and the tick. While faults don't act, a measurement is taken at each
tick, and arrives at once.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.estimation.fault_settings import (
    FaultChannel,
    MeasurementFaults,
    fault_generator,
    in_burst,
)
from drake_pregrasp.geometry.rotations import rotation_matrix
from drake_pregrasp.ticks import first_tick


class Disturbance(NamedTuple):
    """The measured pose M of the object O is p_WM = p_WO + offset, R_WM = turn R_WO.

    Attributes:
        offset: In W, shape (3,), in metres.
        turn: In W, shape (3, 3).
    """

    offset: FloatArray
    turn: FloatArray


def white_disturbance(
    noise: FloatArray, position_std: float, orientation_std: float
) -> Disturbance:
    """Returns what noise does to a pose: offset = position_std n, turn = Exp(orientation_std n).

    Args:
        noise: Numbers n without unit, three for the position and three for the orientation.
        position_std: Their scale for the position, in metres.
        orientation_std: Their scale for the orientation, in radians.
    """
    return Disturbance(position_std * noise[:3], rotation_matrix(orientation_std * noise[3:]))


def faulty_disturbance(
    noise: FloatArray,
    position_std: float,
    orientation_std: float,
    faults: MeasurementFaults,
    *,
    tick: int,
    seed: int,
) -> Disturbance:
    """Returns what noise and faults do to a pose that is measured while faults act.

    With the noise n times its factor, bias b, an outlier o, and the same for the orientation,

        offset = position_std n + b + o,  turn = Exp(o_R) Exp(orientation_std n_R) Exp(b_R).

    A quaternion of the other sign stands for the same rotation, so no rotation matrix can show a
    sign flip; it is put on the quaternion of the turn, which negates that of the whole orientation.
    A measurement that is not a number is so in all its numbers.

    Args:
        noise: Standard normal numbers, shape (6,).
        position_std: Standard deviation per axis, or the scale of Student's t, in metres.
        orientation_std: The same for the orientation's rotation vector, in radians.
        faults: What goes wrong. Those that concern time are `SensorMemory`'s.
        tick: Index of the planning tick.
        seed: Of the random numbers.
    """
    if faults.degrees_of_freedom:
        noise = _heavy_tailed(noise, faults.degrees_of_freedom, tick, seed)
    offset, turn = white_disturbance(faults.noise_factor * noise, position_std, orientation_std)
    offset = offset + np.asarray(faults.position_bias)
    turn = turn @ rotation_matrix(np.asarray(faults.orientation_bias, dtype=float))
    outliers = fault_generator(seed, tick, FaultChannel.OUTLIERS)
    if outliers.random() < faults.outlier_probability:
        offset = offset + faults.outlier_position * _direction(outliers)
        turn = rotation_matrix(faults.outlier_orientation * _direction(outliers)) @ turn
    if faults.sign_flip_probability:
        draw = fault_generator(seed, tick, FaultChannel.SIGN_FLIPS).random()
        turn = _by_quaternion(turn, flipped=draw < faults.sign_flip_probability)
    if fault_generator(seed, tick, FaultChannel.NAN).random() < faults.nan_probability:
        return Disturbance(np.full(3, np.nan), np.full((3, 3), np.nan))
    return Disturbance(offset, turn)


def _heavy_tailed(noise: FloatArray, degrees_of_freedom: float, tick: int, seed: int) -> FloatArray:
    """Returns numbers of Student's t in place of standard normal ones, shape (6,).

    A normal vector over the root of a chi-square number by its degrees of freedom is a vector of
    the multivariate t (Lange, Little & Taylor, "Robust statistical modeling using the t
    distribution", 1989): each number has Student's t, and no direction is preferred. Position and
    orientation have a chi-square number each.
    """
    generator = fault_generator(seed, tick, FaultChannel.TAILS)
    scales = np.sqrt(generator.chisquare(degrees_of_freedom, size=2) / degrees_of_freedom)
    return np.asarray(noise / np.repeat(scales, 3))


def _direction(generator: np.random.Generator) -> FloatArray:
    """Returns a unit vector, shape (3,), uniform on the sphere (Muller, 1959)."""
    vector = generator.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))


def _by_quaternion(turn: FloatArray, *, flipped: bool) -> FloatArray:
    """Returns a rotation by way of its quaternion, whose sign is flipped before it comes back."""
    quaternion = Rotation.from_matrix(turn).as_quat()
    return np.asarray(Rotation.from_quat(-quaternion if flipped else quaternion).as_matrix())


def is_taken(tick: int, faults: MeasurementFaults, period: float) -> bool:
    """Returns whether a measurement is taken at a tick.

    Turn n is at n * sample_period, and its measurement is taken at the first tick that isn't
    earlier.

    Args:
        tick: Its index.
        faults: Of which the sample period counts, at least `period`; with 0 each tick has one.
        period: Seconds between ticks.
    """
    if not faults.sample_period or not faults.act_at(tick, period):
        return True
    turn = first_tick(tick * period, faults.sample_period)
    return tick in (first_tick(n * faults.sample_period, period) for n in (turn - 1, turn))


def arrival_tick(tick: int, faults: MeasurementFaults, period: float, seed: int) -> int:
    """Returns at which tick a measurement arrives: the first one after delay and jitter.

    Args:
        tick: Index of the tick at which it is taken.
        faults: Of which delay and jitter count.
        period: Seconds between ticks.
        seed: Of the random numbers.
    """
    if not faults.act_at(tick, period):
        return tick
    share = fault_generator(seed, tick, FaultChannel.JITTER).random()
    return tick + first_tick(faults.delay + share * faults.jitter, period)


def is_frozen(tick: int, faults: MeasurementFaults, period: float, seed: int) -> bool:
    """Returns whether the value is frozen at a tick.

    Args:
        tick: Its index.
        faults: Of which `freeze_rate` and `freeze_duration` count.
        period: Seconds between ticks.
        seed: Of the random numbers.
    """
    return faults.act_at(tick, period) and in_burst(
        tick,
        rate=faults.freeze_rate,
        duration=faults.freeze_duration,
        period=period,
        seed=seed,
        channel=FaultChannel.FREEZING,
    )


def is_occluded(tick: int, faults: MeasurementFaults, period: float, seed: int) -> bool:
    """Returns whether a measurement of a tick is lost.

    Args:
        tick: Its index.
        faults: Of which `dropout_rate` and `dropout_duration` count.
        period: Seconds between ticks.
        seed: Of the random numbers.
    """
    return faults.act_at(tick, period) and in_burst(
        tick,
        rate=faults.dropout_rate,
        duration=faults.dropout_duration,
        period=period,
        seed=seed,
        channel=FaultChannel.DROPOUTS,
    )
