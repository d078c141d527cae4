"""Pairs of contacts: at a fixed distance, or opposite each other like the jaws of a gripper."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.regions.constraints import OPPOSITE

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
    # along the mean of the outward normal at the second one and the inward normal at the first.
    distance: float = field(default=0.0, metadata={"at_least": 0, "at_most": 10})

    # Largest error of the place of the second contact, in metres.
    tolerance: float = field(default=0.0005, metadata={"at_least": 1e-5, "at_most": 1})

    def place(
        self, p_OA: FloatArray, nhat_OA: FloatArray, p_OB: FloatArray, nhat_OB: FloatArray
    ) -> FloatArray:
        """Returns the places nearest to B at which pairs of A and B are met, shape (..., 3).

        Args:
            p_OA: First contacts, shape (..., 3), in metres.
            nhat_OA: Outward unit normals there, shape (..., 3).
            p_OB: Second contacts, shape (..., 3), in metres.
            nhat_OB: Outward unit normals there, shape (..., 3).
        """
        p_AB = p_OB - p_OA
        along = p_AB if self.distance > 0 else nhat_OB - nhat_OA
        along = along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), _TINY)
        length = self.distance or np.sum(p_AB * along, axis=-1, keepdims=True)
        return np.asarray(p_OA + length * along)

    def error(self, p_OC: FloatArray, nhat_OC: FloatArray) -> float:
        """Returns the distance of the second contact from its place, in metres.

        It is infinite for contacts that should be opposite, but whose normals are not (`OPPOSITE`).

        Args:
            p_OC: All contacts, shape (n, 3), in metres.
            nhat_OC: Outward unit normals at the contacts, shape (n, 3).
        """
        a, b = self.first, self.second
        if self.distance > 0:
            return abs(float(np.linalg.norm(p_OC[b] - p_OC[a])) - self.distance)
        if nhat_OC[a] @ nhat_OC[b] > OPPOSITE:
            return np.inf
        place = self.place(p_OC[a], nhat_OC[a], p_OC[b], nhat_OC[b])
        return float(np.linalg.norm(p_OC[b] - place))


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
    """

    def __init__(self, p_OQ: FloatArray, nhat_OQ: FloatArray, tolerance: float) -> None:
        self._p, self._normals, self._tolerance = p_OQ, nhat_OQ, tolerance

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
        off = np.linalg.norm(p_B - pair.place(p_A, nhat_A, p_B, nhat_B), axis=-1)
        width = np.maximum(np.linalg.norm(p_B - p_A, axis=-1), self._tolerance)
        meets = (off <= self._tolerance) & (np.sum(nhat_A * nhat_B, axis=-1) < OPPOSITE)
        return np.where(meets, off, np.inf), width

    def least_width(self, pair: Pair, up: FloatArray) -> float:
        """Returns the least distance of opposite points with normals across an axis, in metres.

        Args:
            pair: The pair.
            up: Unit vector along the axis, shape (3,).
        """
        index = np.flatnonzero(np.abs(self._normals @ up) < -OPPOSITE)
        least = np.inf
        for i in index[:, None]:  # A row at a time: all pairs at once are too large for memory.
            off, width = self.errors(pair, i, index)
            least = float(np.min(width, where=off < np.inf, initial=least))
        return least
