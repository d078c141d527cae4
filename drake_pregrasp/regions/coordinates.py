"""Further coordinates of safe regions: what fingers offer and places demand (Sec. III.A)."""

from collections.abc import Callable, Mapping

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.geometry.surface import ObjectSurface


def height(surface: ObjectSurface) -> FloatArray:
    """Returns the heights of the candidates above the centre of mass, shape (N,), in metres."""
    above: FloatArray = surface.p_OQ[:, 2] - surface.p_OCoM[2]
    return above


def lever_arm(surface: ObjectSurface) -> FloatArray:
    """Returns the distances of the candidates from the line of gravity, shape (N,), in metres.

    It is the torque that the object's weight exerts about the candidate, in N m per newton.
    """
    arms: FloatArray = np.linalg.norm((surface.p_OQ - surface.p_OCoM)[:, :2], axis=1)
    return arms


def weight_share(surface: ObjectSurface) -> FloatArray:
    """Returns the share of the weight that a contact at each candidate bears, shape (N,).

    The law of the lever: of two supports on opposite sides of the line of gravity, at the lever
    arms r and r_m, the first bears r_m / (r + r_m) of the weight. The other support is at the mean
    lever arm r_m of the surface.
    """
    r = lever_arm(surface)
    mean = float(np.average(r, weights=surface.areas))
    return mean / (r + mean)


QUANTITIES: Mapping[str, Callable[[ObjectSurface], FloatArray]] = {
    "height": height,
    "lever_arm": lever_arm,
    "weight_share": weight_share,
}
"""Quantities of candidates that follow from the surface alone; z of O points up."""

GIVEN = "port"
"""Name of a quantity whose values for the candidates come from an input port."""
