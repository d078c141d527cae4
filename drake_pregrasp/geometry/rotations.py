"""Exponential map of rotations, its inverse and its left Jacobian, for one or a few rotations.

`scipy.spatial.transform.Rotation` does the same for many at once; for a single one, these functions
take less time.
"""

import math

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError

SMALL = 1e-2  # Angle in radians, below which the series are exact to rounding.
MOST_EQUIVALENT = 120
"""Largest number of equivalent poses of a symmetric object, such as that of an icosahedron with its
60 rotations, or of a round one in steps of three degrees."""

_SAME = 1e-6  # Squared angle between rotations that are the same but for rounding.
_I = np.eye(3)
_CROSS = np.cross(np.eye(3)[:, None], np.eye(3)).swapaxes(1, 2).reshape(3, 9)


def skew(r: FloatArray) -> FloatArray:
    """Returns [r]x with [r]x a = r x a, shape (..., 3, 3), of vectors, shape (..., 3)."""
    matrices: FloatArray = (r @ _CROSS).reshape(*r.shape, 3)
    return matrices


def rotation_vector(R: FloatArray) -> FloatArray:
    """Returns the shortest theta with Exp(theta) = R, shape (..., 3), in radians.

    It is computed from the largest component of the unit quaternion (Shepperd, "Quaternion from
    rotation matrix", 1978), so that it is also exact at half a turn.

    Args:
        R: Rotation matrices, shape (..., 3, 3).
    """
    thetas = [rotation_components(*rows) for rows in R.reshape(-1, 9).tolist()]
    return np.array(thetas).reshape(R.shape[:-1])


def rotation_components(
    a: float, b: float, c: float, d: float, e: float, f: float, g: float, h: float, i: float
) -> tuple[float, float, float]:
    """Returns the components of `rotation_vector` from the elements of R, row by row."""
    largest = max(a + e + i, a, e, i)
    if largest == a + e + i:
        w, x, y, z = 1 + a + e + i, h - f, c - g, d - b
    elif largest == a:
        w, x, y, z = h - f, 1 + a - e - i, b + d, c + g
    elif largest == e:
        w, x, y, z = c - g, b + d, 1 + e - a - i, f + h
    else:
        w, x, y, z = d - b, c + g, f + h, 1 + i - a - e
    if w < 0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)  # Sine and cosine times the same factor.
    half = math.atan2(sine, w)
    scale = 2 * half / sine if sine > 0 else 0.0
    return scale * x, scale * y, scale * z


def rotation_matrix(theta: FloatArray, *, order: int = 0) -> FloatArray:
    """Returns Exp(theta), shape (..., 3, 3), by Rodrigues' formula.

    Order 1 is the left Jacobian J, with Exp(theta + e) = Exp(J e) Exp(theta) to first order in e.
    With an order above 0 it is the sum over k of [theta]x^k / (k + order)!, of which order 0 is the
    exponential. In closed form that is I + a [theta]x + b [theta]x², with s = |theta| and a, b two
    neighbours of sin(s)/s, (1 - cos(s))/s² and (s - sin(s))/s³.

    Args:
        theta: Rotation vectors, shape (..., 3), in radians.
        order: Order of the series, 0 or 1.
    """
    matrices = [rotation_rows(x, y, z, order) for x, y, z in theta.reshape(-1, 3).tolist()]
    return np.array(matrices).reshape(*theta.shape, 3)


Row = tuple[float, float, float]
"""A row of a matrix of shape (3, 3)."""


def rotation_rows(x: float, y: float, z: float, order: int) -> tuple[Row, Row, Row]:
    """Returns the rows of `rotation_matrix` from the components of theta."""
    square = x * x + y * y + z * z
    if square < SMALL**2:
        sinc = 1 - square / 6 * (1 - square / 20 * (1 - square / 42))
        versine = (1 - square / 12 * (1 - square / 30 * (1 - square / 56))) / 2
        third = (1 - square / 20 * (1 - square / 42 * (1 - square / 72))) / 6
    else:
        angle = math.sqrt(square)
        sine = math.sin(angle)
        sinc = sine / angle
        versine = 2 * math.sin(angle / 2) ** 2 / square
        third = (angle - sine) / (square * angle)
    a, b = (versine, third) if order else (sinc, versine)
    return (
        (1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y),
        (b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x),
        (b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y)),
    )


def rotation_group(thetas: FloatArray) -> FloatArray:
    """Returns all products of rotations, with the identity, shape (s, 3, 3).

    Args:
        thetas: Rotation vectors of the generators, shape (g, 3), in radians.

    Raises:
        InvalidArgumentError: If there are more than `MOST_EQUIVALENT` products.
    """
    generators, group = list(rotation_matrix(np.asarray(thetas))), [_I]
    for R in group:  # It grows while it is read.
        for product in (R @ generator for generator in generators):
            if np.einsum("ij,sij->s", product, np.array(group)).max() < 3 - _SAME:
                group.append(product)
        if len(group) > MOST_EQUIVALENT:
            raise InvalidArgumentError(
                f"symmetry: the rotations make more than {MOST_EQUIVALENT} equivalent poses; angles"
                " must be parts of a turn, such as 3.14159265"
            )
    return np.array(group)


def turn_about_z(angle: float) -> FloatArray:
    """Returns the matrix of a turn about z by an angle in radians, shape (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def angle_about_z(R: FloatArray) -> float:
    """Returns the angle of the turn about z that is nearest to a rotation, in radians.

    Args:
        R: Rotation matrix, shape (3, 3).
    """
    return math.atan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])
