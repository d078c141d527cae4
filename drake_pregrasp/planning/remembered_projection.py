"""Points that are projected onto a surface again and again within a tick."""

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.surface import ObjectSurface


class RememberedProjection:
    """Projects points as `ObjectSurface.project` does, but the same point only once.

    Args:
        surface: Onto which.
    """

    def __init__(self, surface: ObjectSurface) -> None:
        self._surface = surface
        self._known: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def __call__(self, p_OP: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Returns the nearest allowed points and the outward normals there, each (k, 3)."""
        keys = [point.tobytes() for point in p_OP]
        new = [index for index, key in enumerate(keys) if key not in self._known]
        if new:
            found = zip(*self._surface.project(p_OP[new]), strict=True)
            self._known.update(zip((keys[index] for index in new), found, strict=True))
        if not keys:
            return np.empty((0, 3)), np.empty((0, 3))
        points, normals = zip(*(self._known[key] for key in keys), strict=True)
        return np.array(points), np.array(normals)
