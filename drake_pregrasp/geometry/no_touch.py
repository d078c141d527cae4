"""No-touch areas of an object: ground that no contact may be on."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.sampling import Triangles
from drake_pregrasp.geometry.solids import Solid


@dataclass(frozen=True, eq=False)
class FacingArea:
    """All ground whose outward normal is near a direction.

    Attributes:
        direction: In O, shape (3,); of any length but zero.
        angle: Largest angle between normal and direction, in radians.
    """

    direction: FloatArray
    angle: float

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(self.direction))
        if not length > 0:
            raise InvalidArgumentError("a facing area's direction must not be zero")
        object.__setattr__(self, "direction", self.direction / length)


@dataclass(frozen=True)
class AxisArea:
    """All ground whose outward normal is nearer to one axis of O than to the others.

    Attributes:
        face: Name of the axis and its sign, as `+z`.
    """

    face: str

    def holds(self, normals: FloatArray) -> BoolArray:
        """Returns which outward unit normals, shape (k, 3), are those of its ground, shape (k,)."""
        axis, sign = "xyz".index(self.face[1]), -1.0 if self.face[0] == "-" else 1.0
        nearest = np.argmax(np.abs(normals), axis=1)
        on_it: BoolArray = (nearest == axis) & (sign * normals[:, axis] > 0)
        return on_it


@dataclass(frozen=True)
class PartArea:
    """A whole part of the mesh.

    Attributes:
        part: Its index in the shape.
    """

    part: int


NoTouchArea = FacingArea | AxisArea | PartArea | Solid
"""A solid, in O, forbids all ground inside of it."""


def is_forbidden(
    triangles: Triangles, face_parts: IntArray, areas: Sequence[NoTouchArea]
) -> BoolArray:
    """Returns which triangles are forbidden, shape (T,).

    A triangle that reaches into a solid is forbidden as a whole: what is allowed lies outside.

    Args:
        triangles: Pieces of the mesh's faces.
        face_parts: Index of each face's part, shape (F,).
        areas: The no-touch areas.
    """
    forbidden = np.zeros(len(triangles.faces), dtype=bool)
    for area in areas:
        if isinstance(area, FacingArea):
            forbidden |= triangles.normals @ area.direction >= np.cos(area.angle) - 1e-9
        elif isinstance(area, AxisArea):
            forbidden |= area.holds(triangles.normals)
        elif isinstance(area, PartArea):
            forbidden |= face_parts[triangles.faces] == area.part
        else:
            forbidden |= area.distance(triangles.centroids) < triangles.radii
    return forbidden
