"""Eq. 1-2, written down as they are printed, point by point: the oracle of the fast ones."""

import numpy as np


def breaks_eq_1(q, i, p_OC, h, z, R, slack=0.0):
    """Whether q, as a member of S_i, breaks a condition of Eq. 1 by more than slack (m²)."""
    c_i = p_OC[i]
    own = np.sum((c_i - q) ** 2)
    for z_j, R_j in zip(z, R, strict=True):
        d = np.linalg.norm(c_i - z_j)
        w_ij = 2 * R_j * d - d**2
        if own > np.sum((z_j - q) ** 2) - w_ij + slack:
            return True
    for k in range(len(p_OC)):
        if k != i and own - h[i] > np.sum((p_OC[k] - q) ** 2) - h[k] + slack:
            return True
    return False
