"""Stiffness with which fingers keep an object that they hold in its place."""

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.rotations import skew

HOLDING_GAIN = 2.0
"""Ratio of the commanded stiffness to the least stiffness of a finger.

With 4, boxes ring in the Allegro hand and slip if its control period is 20 ms."""


def restoring_forces(p_CoMT: FloatArray, d: FloatArray, stiffness: FloatArray) -> FloatArray:
    """Returns forces of fingertips against the motion of an object that they hold, shape (n, 3).

    With the displacements d_i of fingertips that stick to it, and stiffnesses k_i, the object
    has moved by the rotation vector θ and the translation t that minimize

        Σ k_i |d_i - e_i|²  with  e_i = t + θ x p_i.

    The forces are -g k_i e_i with g = `HOLDING_GAIN`: those of springs beside the fingers. A strain
    that moves fingertips only against each other, as a squeeze does, is no motion of the object.
    Tahara, Arimoto and Yoshida (ICRA 2010) also tell an object's pose from the fingertips alone.

    Args:
        p_CoMT: Fingertips' centres p_i from the object's centre of mass, shape (n, 3), in metres.
        d: Their displacements since the object was in its place, shape (n, 3), in metres, in the
            same frame as the forces.
        stiffness: Least stiffness k_i of each finger over all directions, shape (n,), in N/m. It
            counts for all directions, so that no loop gain exceeds g.
    """
    moved = np.concatenate([-skew(p_CoMT), np.tile(np.eye(3), (len(d), 1, 1))], axis=2)
    weights = np.sqrt(stiffness)[:, None]
    A = (weights[:, :, None] * moved).reshape(-1, 6)
    twist = np.linalg.lstsq(A, (weights * d).ravel(), rcond=1e-6)[0]
    return np.asarray(-HOLDING_GAIN * stiffness[:, None] * (moved @ twist))
