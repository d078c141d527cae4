"""Where contacts start, if nobody says so."""

import numpy as np

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.surface import ObjectSurface

_FACING = 0.5
"""Cosine of the angle between a normal and the way outwards up to which ground faces a finger."""


def ring_contacts(surface: ObjectSurface, count: int) -> FloatArray:
    """Returns contacts on a ring round the centre of mass, as of a hand that closes on it.

    For each, a ray goes out level from the centre of mass, at equal angles about z of O from x on.
    The contact is the candidate that is nearest to the ray, among those that face its way if there
    are any.

    Args:
        surface: The object's surface.
        count: n, at least 1.

    Returns:
        Shape (n, 3), in O, in metres.

    Raises:
        InvalidArgumentError: If the surface has fewer candidates than that.
    """
    if not 1 <= count <= len(surface.p_OQ):
        raise InvalidArgumentError(
            f"there is ground for 1 to {len(surface.p_OQ)} contacts, not for {count}"
        )
    angles = 2 * np.pi * np.arange(count) / count
    p_OC = np.empty((count, 3))
    is_free = np.ones(len(surface.p_OQ), dtype=bool)
    for index, angle in enumerate(angles):
        outward = np.array([np.cos(angle), np.sin(angle), 0.0])
        r = surface.p_OQ - surface.p_OCoM
        along = r @ outward
        across = np.linalg.norm(r - along[:, None] * outward, axis=1)
        facing = is_free & (surface.nhat_OQ @ outward >= _FACING) & (along > 0)
        choices = np.flatnonzero(facing if np.any(facing) else is_free)
        # Of ground that is equally near to the ray, the outermost is what a finger meets first.
        best = choices[np.argmin(across[choices] - 1e-3 * along[choices])]
        p_OC[index] = surface.p_OQ[best]
        is_free[best] = False
    return p_OC
