"""How a measured pose differs from the true one."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.fault_draws import FaultChannel, fault_generator
from drake_pregrasp.planning.fault_settings import MeasurementFaults
from drake_pregrasp.planning.rotation_vectors import rotation_matrix


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
