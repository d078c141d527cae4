"""Array types, ticks, validation of values from users and ports, vector forms of dataclasses."""

import dataclasses
import functools
import math
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

_NEVER = -(10**18)

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


def is_valid_pose(R: FloatArray, p: FloatArray) -> bool:
    """Returns whether R is a rotation matrix and p lies within `FARTHEST`.

    Args:
        R: Candidate rotation matrix, shape (3, 3).
        p: Position, shape (3,), in metres.
    """
    # Twelve numbers are compared faster one by one than by numpy; NaN fails each comparison.
    x, y, z = p.tolist()
    if not (abs(x) <= FARTHEST and abs(y) <= FARTHEST and abs(z) <= FARTHEST):
        return False
    # Columns have unit length, are orthogonal, and form a right-handed frame.
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
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


def validated_rates(rates: FloatArray) -> FloatArray:
    """Returns rates unchanged if all are finite and within `FARTHEST`, or else zeros.

    Args:
        rates: Rates of any shape, in m/s or rad/s.
    """
    return rates if (np.abs(rates) <= FARTHEST).all() else np.zeros_like(rates)


def validated_numbers(numbers: FloatArray) -> FloatArray:
    """Returns numbers with NaN in place of those that are infinite or beyond `FARTHEST`.

    Args:
        numbers: Numbers of any shape.
    """
    return np.where(np.abs(numbers) <= FARTHEST, numbers, np.nan)


def validated_weights(contact_weights: FloatArray) -> FloatArray:
    """Returns weights h_i clipped to `LARGEST_WEIGHT`, shape (n,), in m².

    The weight -inf, which marks a lost finger, is kept, and NaN becomes -inf.

    Args:
        contact_weights: Weights h_i, shape (n,), in m².
    """
    validated = np.clip(contact_weights, -LARGEST_WEIGHT, LARGEST_WEIGHT)
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
    largest = np.abs(covariance_W).max()
    if not math.isfinite(largest):
        covariance_W = np.zeros((3, 3))
    elif largest > LARGEST_VARIANCE:
        covariance_W = covariance_W / largest * LARGEST_VARIANCE
    added = spread**2 * np.eye(3)
    covariance_O: FloatArray = R_WO.T @ covariance_W @ R_WO + added
    (a, b, c), (d, e, f), (g, h, i) = covariance_O.tolist()
    if max(abs(b - d), abs(c - g), abs(f - h)) <= _ASYMMETRY * min(a, e, i):
        minor = a * e - b * d  # Sylvester's criterion: all leading minors are positive.
        if minor > 0 and i * minor + f * (b * g - a * h) + c * (d * h - e * g) > 0:
            return covariance_O
    variances, axes = np.linalg.eigh((covariance_O + covariance_O.T) / 2 - added)
    nearest: FloatArray = axes * np.maximum(variances, 0) @ axes.T + added
    return nearest


_PLAIN = (np.ndarray, int, float, np.generic)  # Types of the fields that are no dataclasses.


def pack(record: "DataclassInstance") -> FloatArray:
    """Returns all fields of a dataclass in one vector, as discrete state; `unpack` is the inverse.

    Args:
        record: Dataclass instance of numbers, arrays, and dataclasses of such.
    """
    parts: list[Any] = [[]]  # Arrays, and one list for each run of numbers between them.
    for name in _field_names(type(record)):
        value = getattr(record, name)
        if isinstance(value, np.ndarray):
            parts += [value, []]
        elif isinstance(value, _PLAIN):
            parts[-1].append(value)
        else:
            parts += [pack(value), []]
    return np.concatenate(parts, axis=None, dtype=float)


def unpack(template: Record, vector: FloatArray) -> Record:
    """Returns the dataclass instance that `pack` made a vector of.

    Args:
        template: Instance of the same class whose fields have the types and shapes to restore.
        vector: Packed instance, which is copied.
    """
    vector, values, start = np.array(vector), list[Any](), 0
    for name in _field_names(type(template)):
        value = getattr(template, name)
        if isinstance(value, np.ndarray):
            stop = start + value.size
            part = vector[start:stop].reshape(value.shape)
            values.append(part if value.dtype == float else part.astype(value.dtype))
        elif isinstance(value, _PLAIN):
            stop = start + 1
            values.append(type(value)(vector[start]))
        else:
            stop = start + len(pack(value))
            values.append(unpack(value, vector[start:stop]))
        start = stop
    return type(template)(*values)


@functools.cache
def _field_names(record_type: type["DataclassInstance"]) -> list[str]:
    return [field.name for field in dataclasses.fields(record_type)]
