"""Pairs of contacts: at a fixed distance, or opposite each other like the jaws of a gripper."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray, norms
from drake_pregrasp.regions.constraints import OPPOSITE

NO_AXIS = np.zeros(3)
"""Axis of a hand whose fingers may move along any line."""

_TINY = 1e-12  # Length below which a vector has no direction, in metres.


@dataclass
class Pair:
    """Two contacts at a fixed distance, or opposite each other.

    Examples are a fingertip and the joint before it, and the jaws of a parallel gripper.
    """

    # Index of the contact that moves freely.
    first: int = field(default=0, metadata={"required": True, "at_least": 0})

    # Index of the contact that follows it.
    second: int = field(default=0, metadata={"required": True, "at_least": 0})

    # Distance between the two contacts, in metres. 0: they are opposite each other, at any distance
    # along the mean of the outward normal at the second one and the inward normal at the first. For
    # fingers whose reach has a direction, only the part of this mean across z of H counts.
    distance: float = field(default=0.0, metadata={"at_least": 0, "at_most": 10})

    # Largest error of the place of the second contact, in metres.
    tolerance: float = field(default=0.0005, metadata={"at_least": 1e-5, "at_most": 1})

    def line(
        self, nhat_OA: FloatArray, nhat_OB: FloatArray, axis: FloatArray = NO_AXIS
    ) -> FloatArray:
        """Returns unit vectors from A to B along which A and B are opposite, shape (..., 3).

        They are zero for normals that are equal across the axis.

        Args:
            nhat_OA: Outward unit normals at the first contacts, shape (..., 3).
            nhat_OB: Outward unit normals at the second contacts, shape (..., 3).
            axis: Axis of the hand in O, across which its jaws move, a unit vector, shape (3,);
                `NO_AXIS` if they may move along any line.
        """
        along = nhat_OB - nhat_OA
        along = along - (along @ axis)[..., None] * axis
        return np.asarray(along / _lengths(along))

    def place(
        self,
        p_OA: FloatArray,
        nhat_OA: FloatArray,
        p_OB: FloatArray,
        nhat_OB: FloatArray,
        axis: FloatArray = NO_AXIS,
    ) -> FloatArray:
        """Returns the places nearest to B at which pairs of A and B are met, shape (..., 3).

        Args:
            p_OA: First contacts, shape (..., 3), in metres.
            nhat_OA: Outward unit normals there, shape (..., 3).
            p_OB: Second contacts, shape (..., 3), in metres.
            nhat_OB: Outward unit normals there, shape (..., 3).
            axis: As for `line`; for opposite contacts.
        """
        p_AB = p_OB - p_OA
        if self.distance > 0:
            return np.asarray(p_OA + self.distance * p_AB / _lengths(p_AB))
        along = self.line(nhat_OA, nhat_OB, axis)
        return np.asarray(p_OA + np.sum(p_AB * along, axis=-1, keepdims=True) * along)

    def error(self, p_OC: FloatArray, nhat_OC: FloatArray, axis: FloatArray = NO_AXIS) -> float:
        """Returns the distance of the second contact from its place, in metres.

        It is infinite for contacts that should be opposite, but whose normals are not (`OPPOSITE`).

        Args:
            p_OC: All contacts, shape (n, 3), in metres.
            nhat_OC: Outward unit normals at the contacts, shape (n, 3).
            axis: As for `line`.
        """
        a, b = self.first, self.second
        if self.distance > 0:
            return abs(float(np.linalg.norm(p_OC[b] - p_OC[a])) - self.distance)
        if nhat_OC[a] @ nhat_OC[b] > OPPOSITE:
            return np.inf
        place = self.place(p_OC[a], nhat_OC[a], p_OC[b], nhat_OC[b], axis)
        return float(np.linalg.norm(p_OC[b] - place))


def _lengths(vectors: FloatArray) -> FloatArray:
    """Returns lengths by which vectors are divided, shape (..., 1)."""
    return np.maximum(norms(vectors), _TINY)[..., None]


def groups_of(pairs: Sequence[Pair], num_contacts: int) -> list[list[int]]:
    """Returns the contacts that move together: the pairs, then each other contact alone."""
    together = [[pair.first, pair.second] for pair in pairs]
    paired = {contact for pair in together for contact in pair}
    return together + [[contact] for contact in range(num_contacts) if contact not in paired]


class OppositePoints:
    """Points of a surface of which pairs of opposite ones are sought.

    Args:
        p_OQ: The points, shape (K, 3), in metres.
        nhat_OQ: Outward unit normals there, shape (K, 3).
        tolerance: Largest distance of a point from its place opposite another one, in metres.
        axis: Axis of the hand, across which points are opposite; see `Pair.line`.
    """

    def __init__(
        self, p_OQ: FloatArray, nhat_OQ: FloatArray, tolerance: float, axis: FloatArray
    ) -> None:
        self._p, self._normals, self._tolerance, self._axis = p_OQ, nhat_OQ, tolerance, axis

    def errors(self, pair: Pair, a: IntArray, b: IntArray) -> tuple[FloatArray, FloatArray]:
        """Returns how far points b are off their places opposite a, and their distances from a.

        Args:
            pair: The pair.
            a: Indices of first points, of any shape that fits that of `b`.
            b: Indices of second points.

        Returns:
            Both in metres, in the common shape. Errors are infinite beyond the tolerance, and where
            normals are not opposite (`OPPOSITE`).
        """
        (p_A, nhat_A), (p_B, nhat_B) = ((self._p[i], self._normals[i]) for i in (a, b))
        off = np.linalg.norm(p_B - pair.place(p_A, nhat_A, p_B, nhat_B, self._axis), axis=-1)
        width = np.maximum(np.linalg.norm(p_B - p_A, axis=-1), self._tolerance)
        meets = (off <= self._tolerance) & (np.sum(nhat_A * nhat_B, axis=-1) < OPPOSITE)
        return np.where(meets, off, np.inf), width

    def least_width(self, pair: Pair) -> float:
        """Returns the least distance of opposite points with normals across the axis, in metres."""
        index = np.flatnonzero(np.abs(self._normals @ self._axis) < -OPPOSITE)
        least = np.inf
        for i in index[:, None]:  # A row at a time: all pairs at once are too large for memory.
            off, width = self.errors(pair, i, index)
            least = float(np.min(width, where=off < np.inf, initial=least))
        return least
