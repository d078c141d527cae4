"""Stiffness with which fingers keep an object that they hold in its place."""

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.rotations import skew

LARGEST_GAIN = 4.0
"""Largest ratio of the commanded stiffness to the least stiffness of a finger."""

_GAIN_TIMES_PERIOD = 0.04
"""Largest product of this ratio and the control period, in seconds.

Forces come late by about the period. In the Allegro hand, whose drives have a time constant
(damping over stiffness) of 30 ms, boxes rang at a product of 0.08, a mug and a carton at 0.14."""


def holding_gain(period: float) -> float:
    """Returns the ratio of the commanded stiffness to the least stiffness of a finger.

    Args:
        period: Control period, in seconds.
    """
    return min(LARGEST_GAIN, _GAIN_TIMES_PERIOD / period)


def restoring_forces(
    p_T: FloatArray, d: FloatArray, stiffness: FloatArray, gain: float
) -> FloatArray:
    """Returns forces of fingertips against the motion of an object that they hold, shape (n, 3).

    With the displacements d_i of fingertips that stick to it, and stiffnesses k_i, the object
    has moved by the rotation vector θ and the translation t that minimize

        Σ k_i |d_i - e_i|²  with  e_i = t + θ x p_i.

    The forces are -g k_i e_i with the gain g: those of springs beside the fingers. A strain that
    moves fingertips only against each other, as a squeeze does, is no motion of the object.
    Tahara, Arimoto and Yoshida (ICRA 2010) also tell an object's pose from the fingertips alone.

    Args:
        p_T: Fingertips' centres p_i, shape (n, 3), in metres, from any point.
        d: Their displacements since the object was in its place, shape (n, 3), in metres, in the
            same frame as the forces.
        stiffness: Least stiffness k_i of each finger over all directions, shape (n,), in N/m. It
            counts for all directions, so that no loop gain exceeds g.
        gain: Ratio g of the forces to those of the fingers' stiffness (`holding_gain`).
    """
    moved = np.concatenate([-skew(p_T), np.tile(np.eye(3), (len(d), 1, 1))], axis=2)
    weights = np.sqrt(stiffness)[:, None]
    A = (weights[:, :, None] * moved).reshape(-1, 6)
    twist = np.linalg.lstsq(A, (weights * d).ravel(), rcond=1e-6)[0]
    return np.asarray(-gain * stiffness[:, None] * (moved @ twist))
