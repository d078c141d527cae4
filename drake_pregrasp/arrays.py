"""Array types, ticks, validation of values from users and ports, vector forms of dataclasses."""

import dataclasses
import math
from collections.abc import Callable
from enum import Enum
from numbers import Real
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

FARTHEST = 1e7
"""Largest valid coordinate, in metres, and largest valid rate, in m/s or rad/s. Rounding of larger
numbers is of the order of the overlap that fingertips may have."""

LARGEST_WEIGHT = 1e4
"""Largest size of a contact's weight h_i, in m²: one contact then has the whole surface or none."""

LARGEST_VARIANCE = 100.0
"""Largest element of a covariance, in m²: the Gaussian weights are then flat over any object."""

_ORTHONORMAL = 1e-5  # Largest error of a rotation, in Rᵀ R - I: as of one in single precision.
_ASYMMETRY = 1e-9  # Share of the least variance by which a matrix may differ from its transpose.

SLACK = 1e-6
"""Share of a period by which rounding may move a tick: k * period must not count as k - 1."""

TIME_ROUNDING = 1e-9
"""Seconds by which rounding may set the time of a tick too low or too high."""

_NEVER = -(10**18)

_I = np.eye(3)

Record = TypeVar("Record", bound="DataclassInstance")


def tick_index(time: float, period: float) -> int:
    """Returns the number of the last tick at or before `time`.

    The time -inf, which stands for never, comes before every tick.
    """
    return _NEVER if time == -math.inf else math.floor(time / period + SLACK)


def first_tick(time: float, period: float) -> int:
    """Returns the number of the first tick at or after `time`, which is finite."""
    return math.ceil(time / period - SLACK)


def number_or_nan(value: object) -> float:
    """Returns a number as a float, or NaN, which fails each comparison, if it is not a number."""
    if not isinstance(value, Real):
        return math.nan
    try:
        return float(value)
    except OverflowError:  # An integer may be too large for a float.
        return math.nan


def finite_vector(value: object, size: int) -> FloatArray | None:
    """Returns a copy of a vector of finite numbers, shape (size,), or None if it is not one.

    Args:
        value: Any object.
        size: Required number of elements.
    """
    try:
        vector = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return None
    return vector if vector.shape == (size,) and np.all(np.isfinite(vector)) else None


def is_valid_pose(X: FloatArray) -> bool:
    """Returns whether the first columns of X are a rotation and the last lies within `FARTHEST`.

    Args:
        X: Candidate rotation matrix and position, shape (3, 4).
    """
    # Twelve numbers are compared faster one by one than by numpy; NaN fails each comparison.
    (a, b, c, x), (d, e, f, y), (g, h, i, z) = X.tolist()
    if not (abs(x) <= FARTHEST and abs(y) <= FARTHEST and abs(z) <= FARTHEST):
        return False
    # Columns have unit length, are orthogonal, and form a right-handed frame.
    is_rotation: bool = (
        abs(a * a + d * d + g * g - 1) <= _ORTHONORMAL
        and abs(b * b + e * e + h * h - 1) <= _ORTHONORMAL
        and abs(c * c + f * f + i * i - 1) <= _ORTHONORMAL
        and abs(a * b + d * e + g * h) <= _ORTHONORMAL
        and abs(b * c + e * f + h * i) <= _ORTHONORMAL
        and abs(c * a + f * d + i * g) <= _ORTHONORMAL
        and a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) > 0
    )
    return is_rotation


def are_valid_points(points: FloatArray) -> BoolArray:
    """Returns which points are finite and within `FARTHEST`, shape (n,).

    Args:
        points: Points, shape (n, 3), in metres.
    """
    valid: BoolArray = np.logical_and.reduce(np.abs(points) <= FARTHEST, axis=1)
    return valid


def norms(vectors: FloatArray) -> FloatArray:
    """Returns the lengths of vectors along the last axis, for a few faster than numpy's norm."""
    squares: FloatArray = np.add.reduce(vectors * vectors, axis=-1)
    return np.sqrt(squares)


def validated_rates(rates: FloatArray) -> FloatArray:
    """Returns rates unchanged if all are finite and within `FARTHEST`, or else zeros.

    Args:
        rates: Rates of any shape, in m/s or rad/s.
    """
    return rates if are_valid(rates) else np.zeros_like(rates)


def are_valid(numbers: FloatArray) -> bool:
    """Returns whether all numbers are finite and within `FARTHEST`.

    Args:
        numbers: Numbers of any shape.
    """
    # Mostly their norm is small enough, which is faster to find than the largest of them. With a
    # NaN, both are NaN, which fails each comparison.
    if np.vdot(numbers, numbers) <= FARTHEST**2:
        return True
    return bool(np.maximum.reduce(np.abs(numbers), axis=None, initial=0.0) <= FARTHEST)


def validated_numbers(numbers: FloatArray) -> FloatArray:
    """Returns numbers with NaN in place of those that are infinite or beyond `FARTHEST`.

    If all are valid, the same array is returned.

    Args:
        numbers: Numbers of any shape.
    """
    if are_valid(numbers):
        return numbers
    return np.where(np.abs(numbers) <= FARTHEST, numbers, np.nan)


def validated_weights(contact_weights: FloatArray) -> FloatArray:
    """Returns weights h_i clipped to `LARGEST_WEIGHT`, shape (n,), in m².

    The weight -inf, which marks a lost finger, is kept, and NaN becomes -inf.

    Args:
        contact_weights: Weights h_i, shape (n,), in m².
    """
    validated = np.minimum(np.maximum(contact_weights, -LARGEST_WEIGHT), LARGEST_WEIGHT)
    validated[~(contact_weights > -np.inf)] = -np.inf
    return validated


def validated_covariance(covariance_W: FloatArray, R_WO: FloatArray, spread: float) -> FloatArray:
    """Returns Sigma of the Gaussian weights in O with the spread added, shape (3, 3), in m².

    A covariance that is not finite counts as zero: the spread is usually much larger than the
    filter's covariance. One that is too large is scaled down, and a matrix that is not a covariance
    is replaced by the nearest one.

    Args:
        covariance_W: Covariance of the object's position in W, shape (3, 3), in m².
        R_WO: Rotation of O in W, shape (3, 3).
        spread: Standard deviation to add, in metres.
    """
    if not np.vdot(covariance_W, covariance_W) <= LARGEST_VARIANCE**2:  # Mostly it is small.
        largest = np.abs(covariance_W).max()
        if not math.isfinite(largest):
            covariance_W = np.zeros((3, 3))
        elif largest > LARGEST_VARIANCE:
            covariance_W = covariance_W / largest * LARGEST_VARIANCE
    added = spread**2 * _I
    covariance_O: FloatArray = R_WO.T @ covariance_W @ R_WO + added
    (a, b, c), (d, e, f), (g, h, i) = covariance_O.tolist()
    if max(abs(b - d), abs(c - g), abs(f - h)) <= _ASYMMETRY * min(a, e, i):
        minor = a * e - b * d  # Sylvester's criterion: all leading minors are positive.
        if minor > 0 and i * minor + f * (b * g - a * h) + c * (d * h - e * g) > 0:
            return covariance_O
    variances, axes = np.linalg.eigh((covariance_O + covariance_O.T) / 2 - added)
    nearest: FloatArray = axes * np.maximum(variances, 0) @ axes.T + added
    return nearest


def pack(record: "DataclassInstance") -> FloatArray:
    """Returns all fields of a dataclass in one vector, as discrete state; see `unpacker`.

    Args:
        record: Dataclass instance of at least two numbers, enumerations, arrays, and dataclasses of
            such.
    """
    return np.concatenate(_values(record), axis=None, dtype=float)


def _values(record: Any) -> list[Any]:
    """Returns the values in a dataclass instance and in those inside it, in order."""
    values = []
    for name in record.__dataclass_fields__:
        value = getattr(record, name)
        if isinstance(value, Enum):
            values.append(value.value)  # numpy takes long to find out that it is a number.
        elif isinstance(value, _PLAIN):
            values.append(value)
        else:
            values += _values(value)
    return values


def unpacker(template: Record) -> Callable[[FloatArray], Record]:
    """Returns the inverse of `pack`: a function that makes instances of vectors, which it copies.

    Args:
        template: Instance of the same class whose fields have the types and shapes to restore.
    """
    restorers, start = [], 0
    for field in dataclasses.fields(template):
        value = getattr(template, field.name)
        size = np.size(value) if isinstance(value, _PLAIN) else len(pack(value))
        restorers.append(_restorer(value, start, start + size))
        start += size

    def unpack(vector: FloatArray) -> Record:
        copied = vector.copy()
        return type(template)(*[restore(copied) for restore in restorers])

    return unpack


_PLAIN = (np.ndarray, int, float, np.generic)  # Types of the fields that are no dataclasses.


def _restorer(value: Any, start: int, stop: int) -> Callable[[FloatArray], Any]:
    """Returns the function that restores a field, like a value, from a part of a vector."""
    kind = type(value)
    if not isinstance(value, _PLAIN):
        unpack = unpacker(value)
        return lambda vector: unpack(vector[start:stop])
    if not isinstance(value, np.ndarray):
        return lambda vector: kind(vector[start])
    shape, dtype = value.shape, value.dtype
    if dtype == np.float64:
        return lambda vector: vector[start:stop].reshape(shape)
    return lambda vector: vector[start:stop].reshape(shape).astype(dtype)
