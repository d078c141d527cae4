"""How far a grasp is from losing force closure: the normalised min-weight margin."""

import numpy as np
from scipy.optimize import linprog

from drake_pregrasp.planning.arrays import FloatArray

CONE_EDGES = 8
"""Edges of the pyramid that stands for a friction cone."""


def min_weight_margin(p_CoMC: FloatArray, nhat: FloatArray, friction: float) -> float:
    """Returns the normalised min-weight margin of point contacts with friction, in [0, 1].

    The forces along the edges of all friction pyramids, m wrenches in all, are to balance with
    weights a >= 0 that add up to one; the margin is m times the largest possible least weight. It
    is above zero if and only if the grasp has force closure (given wrenches of full rank), which
    Q_MSV, Q_GII and Q_VEW don't see. Torques are divided by the longest lever arm.

    Args:
        p_CoMC: Lever arms from the centre of mass to the contacts, shape (n, 3), in metres.
        nhat: Outward unit normals there, in the same frame, shape (n, 3).
        friction: Coulomb's coefficient.
    """
    if len(p_CoMC) == 0:
        return 0.0
    wrenches = _pyramid_wrenches(p_CoMC, nhat, friction)
    if np.linalg.matrix_rank(wrenches) < 6:
        return 0.0
    m = wrenches.shape[1]
    # Unknowns: the weights a, then their least, l: max l with W a = 0, sum a = 1, a >= l >= 0.
    solution = linprog(
        c=np.append(np.zeros(m), -1.0),
        A_eq=np.block([[wrenches, np.zeros((6, 1))], [np.ones((1, m)), np.zeros((1, 1))]]),
        b_eq=np.append(np.zeros(6), 1.0),
        A_ub=np.hstack([-np.eye(m), np.ones((m, 1))]),
        b_ub=np.zeros(m),
        bounds=(0, None),
    )
    return float(m * solution.x[-1]) if solution.success else 0.0


def _pyramid_wrenches(p_CoMC: FloatArray, nhat: FloatArray, friction: float) -> FloatArray:
    """Returns the wrenches of unit normal force along the pyramids' edges, shape (6, 8n)."""
    helper = np.eye(3)[np.argmin(np.abs(nhat), axis=1)]
    t1 = np.cross(nhat, helper)
    t1 /= np.linalg.norm(t1, axis=1, keepdims=True)
    t2 = np.cross(nhat, t1)
    angles = 2 * np.pi * np.arange(CONE_EDGES) / CONE_EDGES
    forces = (
        -nhat[:, None]
        + friction * np.cos(angles)[:, None] * t1[:, None]
        + friction * np.sin(angles)[:, None] * t2[:, None]
    )
    length = max(np.max(np.linalg.norm(p_CoMC, axis=1)), np.finfo(float).tiny)
    torques = np.cross(p_CoMC[:, None] / length, forces)
    return np.concatenate([forces, torques], axis=2).reshape(-1, 6).T
