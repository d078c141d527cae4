"""Small flat marks on surfaces, as triangles: dots and rings."""

import numpy as np

from drake_pregrasp.arrays import FloatArray


def ring_triangles(
    p_FM: FloatArray, nhat_FM: FloatArray, *, radii: tuple[float, float], sides: int
) -> FloatArray:
    """Returns rings about points, flat on the planes of their normals, shape (m, 3, 3).

    A ring is the ground between two regular polygons, counter-clockwise seen from outside.

    Args:
        p_FM: The points, in a frame F, shape (k, 3), in metres.
        nhat_FM: Unit normals there, shape (k, 3).
        radii: Of the inner and the outer polygon, in metres; with 0 inside the ring is a dot.
        sides: How many each has.
    """
    inner, outer = radii
    steep = np.abs(nhat_FM[:, 2]) > np.sqrt(0.5)
    right = np.cross(nhat_FM, np.where(steep[:, None], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]))
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    up = np.cross(nhat_FM, right)
    angles = np.linspace(0, 2 * np.pi, sides + 1)[None, :, None]
    rim = np.cos(angles) * right[:, None] + np.sin(angles) * up[:, None]
    near, far = p_FM[:, None] + inner * rim, p_FM[:, None] + outer * rim
    triangles = [np.stack([near[:, :-1], far[:, :-1], far[:, 1:]], axis=2)]
    if inner > 0:
        triangles.append(np.stack([near[:, :-1], far[:, 1:], near[:, 1:]], axis=2))
    return np.concatenate(triangles).reshape(-1, 3, 3)
