"""Tipping of an object that stands on a table, by a finger that presses alone."""

import numpy as np
from scipy.spatial import ConvexHull

from drake_pregrasp.arrays import FloatArray

_STANDING = (
    1e-3  # Height over the lowest vertex up to which vertices stand on the table, in metres.
)
_LEAST = 1e-3  # Least distance of an edge from the point under the centre of mass, in metres.
_SQUARE = 1e-6 * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])  # Corners, in metres.


def tipping_shares(
    p_OQ: FloatArray,
    nhat_OQ: FloatArray,
    *,
    p_OV: FloatArray,
    p_OCoM: FloatArray,
    weight: FloatArray,
    force: float,
) -> FloatArray:
    """Returns the share of the tipping moment of a finger that presses alone, shape (K,).

    A finger that touches first presses with the force f, along the inward normal, at the height z
    over the table. The table's reaction then acts beside the point under the centre of mass, by the
    distance f_h z/(m g) in the direction of the horizontal part f_h of the force. The object tips
    if this is more than the distance b from that point to the edge of the support polygon in this
    direction. The share is

        s = f_h z/(m g b)

    so the object tips for s > 1. The vertical part of the force is small beside the weight, and
    left out. The support polygon is the convex hull of the lowest vertices, in the horizontal
    plane.

    Args:
        p_OQ: Contacts in O, shape (K, 3), in metres.
        nhat_OQ: Outward unit normals there, shape (K, 3).
        p_OV: Vertices of the object, shape (V, 3), in metres.
        p_OCoM: Centre of mass, shape (3,), in metres.
        weight: Weight m g of the object as a force in O, shape (3,), in newtons.
        force: Force f, in newtons.
    """
    mg = float(np.linalg.norm(weight))
    across = np.linalg.svd(weight[None])[2][1:]  # Two axes of the horizontal plane.
    up = -weight / mg
    heights = p_OV @ up
    lowest = np.min(heights)
    corners = (p_OV[heights <= lowest + _STANDING] - p_OCoM) @ across.T
    # With a tiny square about each vertex, the hull of an edge or a point is a polygon as well.
    edges = ConvexHull((corners[:, None] + _SQUARE).reshape(-1, 2)).equations
    f_T = -force * nhat_OQ @ across.T
    moments = (f_T @ edges[:, :2].T) * (p_OQ @ up - lowest)[:, None]
    shares: FloatArray = np.max(moments / np.maximum(-edges[:, 2], _LEAST), axis=1) / mg
    return shares
