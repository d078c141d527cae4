"""Hand-centric measures: how well a hand's joints can move the object or a fingertip.

Each is a function of a Jacobian J (..., r, k) from k joint velocities to r velocities, r = 3 or 6;
for several at once the results have the leading shape. They are the measures of Roa & Suárez,
"Grasp quality measures: review and performance", Autonomous Robots 38, 2015, section 4. None needs
to know the hand. Where J mixes lengths and angles, rotational rows want dividing by a length first.
"""

import numpy as np

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import FloatArray


def distance_to_singularity(J: FloatArray) -> FloatArray:
    """Returns the smallest singular value of J: zero at a singular configuration.

    With fewer joints than rows, k < r, it is always zero: some velocity can't be made.

    Args:
        J: Shape (..., r, k).

    Raises:
        InvalidArgumentError: If J has another shape.
    """
    return _singular_values(J)[..., -1]


def manipulability_volume(J: FloatArray) -> FloatArray:
    """Returns the product of the singular values, sqrt(det(J Jᵀ)).

    It is the volume of the manipulability ellipsoid up to a constant (Yoshikawa, 1985).

    Args:
        J: Shape (..., r, k).

    Raises:
        InvalidArgumentError: If J has another shape.
    """
    volume: FloatArray = np.prod(_singular_values(J), axis=-1)
    return volume


def uniformity_of_transformation(J: FloatArray) -> FloatArray:
    """Returns the smallest over the largest singular value, in [0, 1]; zero for J = 0.

    It is 1 where all directions are equally easy. Roa & Suárez state its inverse, the condition
    number (after Salisbury & Craig, 1982); this way round, more is better.

    Args:
        J: Shape (..., r, k).

    Raises:
        InvalidArgumentError: If J has another shape.
    """
    sigma = _singular_values(J)
    largest = np.where(sigma[..., 0] > 0, sigma[..., 0], 1)
    uniformity: FloatArray = sigma[..., -1] / largest
    return uniformity


def _singular_values(J: FloatArray) -> FloatArray:
    """Returns r singular values in falling order, with zeros where there are fewer columns."""
    if J.ndim < 2 or J.shape[-2] not in (3, 6) or J.shape[-1] == 0:
        raise InvalidArgumentError(
            f"a Jacobian must have shape (..., 3, k) or (..., 6, k), k >= 1, not {J.shape}"
        )
    sigma = np.linalg.svd(J, compute_uv=False)
    padded = np.zeros((*J.shape[:-2], J.shape[-2]))
    padded[..., : sigma.shape[-1]] = sigma
    return padded
