"""Reach of a finger: the solid and the sector that contain its contacts."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.solids import EVERYWHERE, Solid, moved_rows, rounded_box_distances

ANY_ANGLE = -2.0
"""Least cosine of an angle that limits nothing."""

UNLIMITED = np.concatenate([EVERYWHERE, np.zeros(12), [ANY_ANGLE] * 3])
"""Row of the reach of a finger that reaches everything; see `reached`."""


def _z() -> FloatArray:
    return np.array([0.0, 0.0, 1.0])


@dataclass(eq=False)
class FingerReach:
    """Reach of a finger, expressed in a frame F: the contacts that pass every given test.

    Attributes:
        solid: Solid that has to contain the contact, or None.
        direction: Direction in which the finger points away from the hand's axis, shape (3,), not
            zero; None if none of the angles below is limited.
        half_angle: Largest angle between `direction` and the vector from the axis to the fingertip
            at its standoff, both projected across the axis, in radians.
        incidence: Largest angle between `direction` and the outward normal at the contact, in
            radians. Beyond it, a finger reaches around an edge and touches with a link.
        elevation: Largest angle between this normal and the plane across the axis, in radians.
            Beyond it, an object that comes along the axis does not pass between the fingertips, or
            fingers that touch it push it along the axis.
        origin: Point of the hand's axis, shape (3,), in metres.
        axis: Axis of the hand, a unit vector, shape (3,).
    """

    solid: Solid | None = None
    direction: FloatArray | None = None
    half_angle: float = np.pi
    incidence: float = np.pi
    elevation: float = np.pi / 2
    origin: FloatArray = field(default_factory=lambda: np.zeros(3))
    axis: FloatArray = field(default_factory=_z)

    def __post_init__(self) -> None:
        if self.direction is None:
            if min(self.half_angle, self.incidence, 2 * self.elevation) < np.pi:
                raise InvalidArgumentError("a reach with an angle needs a direction")
            return
        length = float(np.linalg.norm(self.direction))
        if not length > 0:
            raise InvalidArgumentError("a reach's direction must not be zero")
        self.direction = self.direction / length
        if self.half_angle < np.pi and not np.linalg.norm(self._level(self.direction)) > 0:
            raise InvalidArgumentError("a sector's direction must not be along the hand's axis")

    def permits(self, contacts: FloatArray, normals: FloatArray, tips: FloatArray) -> BoolArray:
        """Returns the mask of the contacts that the finger reaches, shape (k,).

        Args:
            contacts: Contacts in F, shape (k, 3), in metres.
            normals: Outward unit normals at the contacts, shape (k, 3).
            tips: Centres of the fingertip at its standoff from each contact, in F, shape (k, 3), in
                metres.
        """
        return reached(self.row, contacts, normals, tips)

    def place(self, contact: FloatArray) -> FloatArray:
        """Returns the place at which the finger reaches most easily, shape (3,), in metres.

        It is the centre of the solid, if there is one. Without, it is as high and as far from the
        axis as the contact, in the direction of the finger; without that, the contact itself.

        Args:
            contact: Contact of the finger in F, shape (3,), in metres.
        """
        if self.solid is not None:
            return self.solid.rounded_box()[:3]
        if self.direction is None:
            return contact
        level = self._level(contact - self.origin)
        place: FloatArray = contact - level + np.linalg.norm(level) * self.row[25:28]
        return place

    @cached_property
    def row(self) -> FloatArray:
        """The reach as plain numbers, shape (34,); see `reached`."""
        solid = EVERYWHERE if self.solid is None else self.solid.rounded_box()
        if self.direction is None:
            return np.concatenate([solid, UNLIMITED[19:]])
        middle = self._level(self.direction)
        middle /= max(float(np.linalg.norm(middle)), np.finfo(float).tiny)
        cosines = [
            np.cos(angle) if angle < np.pi else ANY_ANGLE
            for angle in (self.half_angle, self.incidence)
        ]
        cosines.append(-np.sin(self.elevation) if self.elevation < np.pi / 2 else ANY_ANGLE)
        return np.concatenate([solid, self.origin, self.axis, middle, self.direction, cosines])

    def moved(self, R_GF: FloatArray, p_GF: FloatArray) -> "FingerReach":
        """Returns the reach expressed in a frame G in which F has the given pose."""
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


def reached(
    row: FloatArray, contacts: FloatArray, normals: FloatArray, tips: FloatArray
) -> BoolArray:
    """Returns the mask of contacts in a reach, shape (k,).

    Args:
        row: Row of the solid (19; see `rounded_box_distances`); origin, axis, middle direction
            across the axis, and direction (12); the least cosines of the angles of tips and of
            normals, and the negative sine of the largest elevation of normals (3).
        contacts: As for `FingerReach.permits`, as the other arguments.
        normals: Outward unit normals at the contacts.
        tips: Centres of the fingertip at its standoff.
    """
    origin, axis, middle, direction = row[19:31].reshape(4, 3)
    outward = tips - origin
    outward -= (outward @ axis)[:, None] * axis
    permitted: BoolArray = rounded_box_distances(row[:19], contacts) <= 0
    permitted &= outward @ middle >= row[31] * np.linalg.norm(outward, axis=1)
    permitted &= normals @ direction >= row[32]
    permitted &= -np.abs(normals @ axis) >= row[33]
    return permitted


def moved_reaches(rows: FloatArray, R_GF: FloatArray, p_GF: FloatArray) -> FloatArray:
    """Returns rows for `reached` expressed in a frame G, shape (n, 34); see `FingerReach.moved`."""
    sectors = rows[:, 19:31].reshape(-1, 4, 3) @ R_GF.T
    sectors[:, 0] += p_GF
    parts = moved_rows(rows[:, :19], R_GF, p_GF), sectors.reshape(-1, 12), rows[:, 31:]
    return np.concatenate(parts, axis=1)
