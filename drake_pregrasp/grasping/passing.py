"""Gaps of fingertips between which an object passes on its way to the palm."""

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.solids import SignedDistance
from drake_pregrasp.grasping.fingertip_paths import MOVING_CLEARANCE

_PARTS = 16  # Number of parts of the way, at whose ends distances are measured.
_STEPS = 3  # Normals may lean, so that a fingertip does not gain as much distance as it moves.


def passing_gaps(
    p_OC: FloatArray,
    nhat: FloatArray,
    gaps: FloatArray,
    tip_radii: FloatArray,
    way: FloatArray,
    solid: SignedDistance,
) -> FloatArray:
    """Returns gaps that let the object pass, shape (n,), in metres: at least the given ones.

    A fingertip that waits beside its contact, on the normal, may be in the way of other parts of
    the object while this comes to the palm. It then waits farther out until they have passed.

    Args:
        p_OC: Contacts in O, shape (n, 3), in metres.
        nhat: Outward unit normals at the contacts, in O, shape (n, 3).
        gaps: Gaps between fingertips and contacts when the object is there, shape (n,), in metres.
        tip_radii: Radii of the fingertips, shape (n,), in metres.
        way: Displacement of the fingertips from where they will be at the object to where they are
            now, in O, shape (3,), in metres.
        solid: The object in O.
    """
    ahead = np.linspace(0.0, 1.0, _PARTS + 1)[:, None, None] * way
    needed, wider = tip_radii + np.minimum(gaps, MOVING_CLEARANCE), gaps
    for _ in range(_STEPS):
        points = p_OC + (tip_radii + wider)[:, None] * nhat + ahead
        distances = solid.distance(points.reshape(-1, 3)).reshape(len(ahead), -1)
        lacking = np.fmax(0.0, needed - np.min(distances, axis=0))  # 0 for unknown contacts.
        if not lacking.any():
            break
        wider = wider + lacking
    return wider
