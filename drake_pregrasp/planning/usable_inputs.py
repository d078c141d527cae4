"""Which of others' numbers can be used, and what stands in for those that can't."""

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.tracking_status import TrackingStatus

FARTHEST = 1e7
"""Largest coordinate that is used, in metres; largest rate, in m/s or rad/s. Beyond it rounding
alone is of the order of what fingertips may overlap."""

LARGEST_WEIGHT = 1e4
"""Largest size of a contact's weight h_i, in m²: one contact then has all ground, or none."""

LARGEST_VARIANCE = 100.0
"""Largest element of a covariance, in m²: over any object Eq. 3 then is flat."""

_ORTHONORMAL = 1e-5  # Largest error of a rotation, in R'R - 1: as of one in single precision.
_ASYMMETRY = 1e-9  # Share of the largest element that rounding puts between a matrix and R'.


def is_usable_pose(R: FloatArray, p: FloatArray) -> bool:
    """Returns whether a pose is one: finite, not too far, and with a rotation.

    Args:
        R: Shape (3, 3).
        p: Shape (3,), in metres.
    """
    # Three coordinates are compared sooner one by one than by numpy; NaN fails each comparison.
    if not all(abs(coordinate) <= FARTHEST for coordinate in p.tolist()):
        return False
    x, y, z = R.T.tolist()
    units = (_dot(x, x), _dot(y, y), _dot(z, z))
    level = (_dot(x, y), _dot(y, z), _dot(z, x))
    third = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]
    return (
        all(abs(unit - 1) <= _ORTHONORMAL for unit in units)
        and all(abs(cosine) <= _ORTHONORMAL for cosine in level)
        and _dot(third, z) > 0
    )


def _dot(a: list[float], b: list[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def usable_status(number: float) -> TrackingStatus:
    """Returns the status that a number of a port stands for; `LOST` if it stands for none."""
    known = {float(status): status for status in TrackingStatus}
    return known.get(float(number), TrackingStatus.LOST)


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
    largest = np.max(np.abs(covariance_W))
    if not np.isfinite(largest):
        covariance_W = np.zeros((3, 3))
    elif largest > LARGEST_VARIANCE:
        covariance_W = covariance_W / largest * LARGEST_VARIANCE
    added = spread**2 * np.eye(3)
    covariance_O: FloatArray = R_WO.T @ covariance_W @ R_WO + added
    if np.max(np.abs(covariance_O - covariance_O.T)) <= _ASYMMETRY * np.max(np.abs(covariance_O)):
        try:
            np.linalg.cholesky(covariance_O)
        except np.linalg.LinAlgError:
            pass
        else:
            return covariance_O
    variances, axes = np.linalg.eigh((covariance_O + covariance_O.T) / 2 - added)
    nearest: FloatArray = axes * np.maximum(variances, 0) @ axes.T + added
    return nearest
