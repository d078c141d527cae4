"""Where a finger's tip can be, and which ground it can touch with its tip first."""

from dataclasses import dataclass, field, replace

import numpy as np

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import BoolArray, FloatArray
from drake_pregrasp.planning.solids import Solid


def _z() -> FloatArray:
    return np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class FingerReach:
    """What a finger can reach, expressed in a frame F: all that passes each test that is asked for.

    Attributes:
        solid: In which the contact has to be, or None.
        direction: The way in which the finger stands off the hand's axis, shape (3,), of any length
            but zero; None if neither angle below is asked for.
        half_angle: Between `direction` and the way from the axis to the tip at its standoff, both
            level, at most; in radians.
        incidence: Between `direction` and the outward normal at the contact, at most; in radians. A
            finger that stands far off a normal reaches round an edge, and touches with a link.
        origin: A point of the hand's axis, shape (3,), in metres.
        axis: Of the hand, a unit vector, shape (3,).
    """

    solid: Solid | None = None
    direction: FloatArray | None = None
    half_angle: float = np.pi
    incidence: float = np.pi
    origin: FloatArray = field(default_factory=lambda: np.zeros(3))
    axis: FloatArray = field(default_factory=_z)

    def __post_init__(self) -> None:
        if self.direction is None:
            if min(self.half_angle, self.incidence) < np.pi:
                raise InvalidArgumentError("a reach with an angle needs a direction")
            return
        length = float(np.linalg.norm(self.direction))
        if not length > 0:
            raise InvalidArgumentError("a reach's direction must not be zero")
        object.__setattr__(self, "direction", self.direction / length)
        if self.half_angle < np.pi and not np.linalg.norm(self._level(self.direction)) > 0:
            raise InvalidArgumentError("a sector's direction must not be along the hand's axis")

    def permits(self, contacts: FloatArray, normals: FloatArray, tips: FloatArray) -> BoolArray:
        """Returns which contacts the finger reaches, shape (k,).

        Args:
            contacts: In F, shape (k, 3), in metres.
            normals: Outward unit normals there, shape (k, 3).
            tips: Centres of a fingertip at its standoff from each, shape (k, 3), in metres.
        """
        permitted = np.ones(len(contacts), dtype=bool)
        if self.solid is not None:
            permitted &= self.solid.distance(contacts) <= 0
        if self.direction is None:
            return permitted
        if self.half_angle < np.pi:
            ways, middle = self._level(tips - self.origin), self._level(self.direction)
            lengths = np.linalg.norm(ways, axis=1) * np.linalg.norm(middle)
            permitted &= ways @ middle >= np.cos(self.half_angle) * lengths
        if self.incidence < np.pi:
            permitted &= normals @ self.direction >= np.cos(self.incidence)
        return permitted

    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "FingerReach":
        """Returns the same reach expressed in a frame G, in which F has that pose."""
        return replace(
            self,
            solid=None if self.solid is None else self.solid.moved(R_GF, p_GF),
            direction=None if self.direction is None else R_GF @ self.direction,
            origin=R_GF @ self.origin + p_GF,
            axis=R_GF @ self.axis,
        )

    def _level(self, vectors: FloatArray) -> FloatArray:
        """Returns the parts of vectors across the axis, shape (..., 3)."""
        level: FloatArray = vectors - (vectors @ self.axis)[..., None] * self.axis
        return level
