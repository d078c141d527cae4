"""Stiffness of a grasp whose fingers yield as springs (Cutkosky & Kao, 1989)."""

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.rotations import skew

_CONTACT_COMPLIANCE = 1e-5  # Of a contact beside its finger, in m/N: much less than that of drives.
_SINGULAR = 1e-12  # Share of the largest stiffness below which contacts do not resist a motion.


def turn_by_force(
    p_CoMC: FloatArray,
    nhat: FloatArray,
    compliances: FloatArray,
    *,
    torsional_arms: FloatArray,
    force: float,
) -> float:
    """Returns the largest turn of a held object by a force on its centre of mass, in radians.

    Contact i is a spring with the compliance C_i of its finger and a small one of its own. By a
    force f the object turns by the rotation vector θ, and shifts by t, with K (θ, t) = (0, f) and

        K = Σ A_iᵀ C_i⁻¹ A_i,   A_i = [-[p_i]x, I].

    A soft finger also resists turns about its normal, with the stiffness of its contact times the
    square of its arm; its joints do not yield there. Turns that nothing resists, such as those
    about the line through two hard fingers, do not count. For large turns the springs would not be
    linear: of contacts that are almost on a line the result only tells that they turn far.

    Args:
        p_CoMC: Lever arms p_i from the centre of mass to the contacts, shape (n, 3), in metres.
        nhat: Unit normals there, in the same frame, shape (n, 3).
        compliances: Compliances of the fingers at their tips, shape (n, 3, 3), in m/N.
        torsional_arms: Arms of the moments of soft fingers about their normals, and 0 for hard
            ones, shape (n,), in metres.
        force: Size of the force, in newtons; its direction is the worst one.
    """
    A = np.concatenate([-skew(p_CoMC), np.tile(np.eye(3), (len(p_CoMC), 1, 1))], axis=2)
    springs = np.linalg.inv(compliances + _CONTACT_COMPLIANCE * np.eye(3))
    K = np.sum(A.swapaxes(1, 2) @ springs @ A, axis=0)
    K[:3, :3] += (nhat.T * torsional_arms**2) @ nhat / _CONTACT_COMPLIANCE
    turns = np.linalg.pinv(K, rcond=_SINGULAR, hermitian=True)[:3, 3:]
    return float(force * np.linalg.norm(turns, ord=2))
