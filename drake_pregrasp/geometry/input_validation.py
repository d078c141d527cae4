"""Validates values from input ports, and substitutes safe values for unusable ones."""

import math

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray

FARTHEST = 1e7
"""Largest coordinate that is used, in metres; largest rate, in m/s or rad/s. Beyond it rounding
alone is of the order of what fingertips may overlap."""

LARGEST_WEIGHT = 1e4
"""Largest size of a contact's weight h_i, in m²: one contact then has all ground, or none."""

LARGEST_VARIANCE = 100.0
"""Largest element of a covariance, in m²: over any object Eq. 3 then is flat."""

_ORTHONORMAL = 1e-5  # Largest error of a rotation, in Rᵀ R - I: as of one in single precision.
_ASYMMETRY = 1e-9  # Share of the least variance by which a matrix may differ from its transpose.
_CLEARLY = 1e-6  # Share of what a determinant can be at most, above which rounding can't matter.
_I = np.eye(3)


def is_usable_pose(R: FloatArray, p: FloatArray) -> bool:
    """Returns whether a pose is one: finite, not too far, and with a rotation.

    Args:
        R: Shape (3, 3).
        p: Shape (3,), in metres.
    """
    # Three coordinates are compared sooner one by one than by numpy; NaN fails each comparison.
    x, y, z = p.tolist()
    if not (abs(x) <= FARTHEST and abs(y) <= FARTHEST and abs(z) <= FARTHEST):
        return False
    # Columns are of unit length, at right angles, and not mirrored.
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


def are_usable_points(points: FloatArray) -> BoolArray:
    """Returns which points are finite and not too far, shape (n,).

    Args:
        points: Shape (n, 3), in metres.
    """
    usable: BoolArray = np.logical_and.reduce(np.abs(points) <= FARTHEST, axis=1)
    return usable


def usable_rates(rates: FloatArray) -> FloatArray:
    """Returns rates as they are if all are finite and not too large, or else zeros.

    Args:
        rates: Of any shape, in m/s or rad/s.
    """
    return rates if np.all(np.abs(rates) <= FARTHEST) else np.zeros_like(rates)


def known_numbers(numbers: FloatArray) -> FloatArray:
    """Returns numbers with NaN in place of those that are infinite or beyond `FARTHEST`.

    Args:
        numbers: Of any shape.
    """
    return np.where(np.abs(numbers) <= FARTHEST, numbers, np.nan)


def usable_weights(contact_weights: FloatArray) -> FloatArray:
    """Returns weights h_i within `LARGEST_WEIGHT`, shape (n,), in m².

    Those that are -inf stay so: their fingers are lost. A weight that is no number is one of those.

    Args:
        contact_weights: Shape (n,), in m².
    """
    if all(abs(weight) <= LARGEST_WEIGHT for weight in contact_weights.tolist()):
        return contact_weights.copy()
    usable = np.clip(contact_weights, -LARGEST_WEIGHT, LARGEST_WEIGHT)
    usable[~(contact_weights > -np.inf)] = -np.inf
    return usable


def usable_covariance(covariance_W: FloatArray, R_WO: FloatArray, spread: float) -> FloatArray:
    """Returns Sigma of Eq. 3 in O with the spread added, shape (3, 3), in m², positive definite.

    A covariance that isn't finite is left out: what the spread alone weighs is what that of a
    filter, of millimetres, hardly changes. One that is too large is scaled down, and of a matrix
    that is no covariance the nearest one is taken.

    Args:
        covariance_W: In W, shape (3, 3), in m².
        R_WO: Rotation of O in W, shape (3, 3).
        spread: Standard deviation to add, in metres.
    """
    largest = np.abs(covariance_W).max()
    if not math.isfinite(largest):
        covariance_W = np.zeros((3, 3))
    elif largest > LARGEST_VARIANCE:
        covariance_W = covariance_W / largest * LARGEST_VARIANCE
    added = spread**2 * _I
    covariance_O: FloatArray = R_WO.T @ covariance_W @ R_WO + added
    if _is_clearly_definite(covariance_O):
        return covariance_O
    asymmetry = np.abs(covariance_O - covariance_O.T).max()
    if asymmetry <= _ASYMMETRY * covariance_O.diagonal().min():
        try:
            np.linalg.cholesky(covariance_O)
        except np.linalg.LinAlgError:
            pass
        else:
            return covariance_O
    variances, axes = np.linalg.eigh((covariance_O + covariance_O.T) / 2 - added)
    nearest: FloatArray = axes * np.maximum(variances, 0) @ axes.T + added
    return nearest


def _is_clearly_definite(covariance: FloatArray) -> bool:
    """Whether a matrix is symmetric, and positive definite by its minors, beyond any doubt.

    So it is at nearly each tick, and nine numbers are compared sooner one by one than by numpy.
    """
    (a, d, e), (d2, b, f), (e2, f2, c) = covariance.tolist()
    rounding = _ASYMMETRY * min(a, b, c)
    if not (abs(d - d2) <= rounding and abs(e - e2) <= rounding and abs(f - f2) <= rounding):
        return False
    determinant = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)
    minors = ((a, a), (a * b - d * d, a * b), (determinant, a * b * c))
    return all(minor > _CLEARLY * largest for minor, largest in minors)
