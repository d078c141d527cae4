"""What others give as a number, which may be none."""

import math
from numbers import Integral, Real

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


def number_or_nan(value: object) -> float:
    """Returns a number as a float, and NaN, which fails each comparison, for what is none."""
    if not isinstance(value, Real):
        return math.nan
    try:
        return float(value)
    except OverflowError:  # An integer may be too large for a float.
        return math.nan


def is_whole(value: object, least: int, most: float = math.inf) -> bool:
    """Whether it is a whole number within limits, by its type too: 2.0 is none.

    Args:
        value: Anything.
        least: The lower limit.
        most: The upper limit.
    """
    return isinstance(value, Integral) and least <= int(value) <= most


def finite_vector(value: object, size: int) -> FloatArray | None:
    """Returns a copy of a vector of finite numbers, shape (size,), or None for what is none.

    Args:
        value: Anything.
        size: How many numbers it has to have.
    """
    try:
        vector = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return None
    return vector if vector.shape == (size,) and np.all(np.isfinite(vector)) else None
