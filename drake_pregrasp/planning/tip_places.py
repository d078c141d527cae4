"""Where fingertips may be about an object, and where they wait without a contact."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_pregrasp.planning.arrays import BoolArray, FloatArray
from drake_pregrasp.planning.goal_shaping import TipRoom
from drake_pregrasp.planning.solids import Solid

MOVING_CLEARANCE = 0.008
"""Least gap between moving fingertips and the object, in metres."""

OTHER_CLEARANCE = 0.004
"""Least gap between fingertips and all else, also among themselves, in metres."""

_WITHDRAWN_CLEARANCE = 0.02  # Of fingers without a contact, over the object's top, in metres.


@dataclass(frozen=True, eq=False)
class TipPlaces:
    """The fingertips of a hand about an object O that is carried in the frame G.

    Attributes:
        tip_radii: Of the fingertips, shape (n,), in metres.
        ways_out: Level unit vectors to the fingers in the frame U of the palm, shape (n, 3).
        withdrawn_radii: How far from z of G each finger without a contact waits, shape (n,), in
            metres.
        object_top: How high the object reaches over O, in metres.
    """

    tip_radii: FloatArray
    ways_out: FloatArray
    withdrawn_radii: FloatArray
    object_top: float

    def first_contacts(self, p_GT: FloatArray, standoff: float) -> tuple[FloatArray, FloatArray]:
        """Returns contacts of tips that are to stay where they are, and normals, shape (n, 3).

        Args:
            p_GT: The tips' centres in G, shape (n, 3), in metres.
            standoff: The gap between tips and contacts, in metres.
        """
        outward = p_GT * [1.0, 1.0, 0.0]
        length = np.linalg.norm(outward, axis=1, keepdims=True)
        normals = np.where(length > 0, outward / np.where(length > 0, length, 1), self.ways_out)
        return p_GT - (self.tip_radii + standoff)[:, None] * normals, normals

    def withdrawn(self, p_GT: FloatArray, R_GU: FloatArray | None) -> FloatArray:
        """Returns where fingers without a contact wait over the object, in G, shape (n, 3).

        Args:
            p_GT: Where tips are, in G, shape (n, 3), in metres.
            R_GU: Orientation of the palm, shape (3, 3); without it tips wait at their azimuths.
        """
        level = p_GT * [1.0, 1.0, 0.0] if R_GU is None else self.ways_out @ R_GU.T
        least = self.tip_radii[:, None]
        length = np.maximum(np.linalg.norm(level, axis=1, keepdims=True), least)
        raised: FloatArray = level * self.withdrawn_radii[:, None] / length
        raised[:, 2] = self.object_top + self.tip_radii + _WITHDRAWN_CLEARANCE
        return raised

    def room(
        self,
        object_solid: Solid,
        gaps: FloatArray,
        *,
        fixed: Sequence[Solid],
        obstacles: Sequence[Solid],
        holding: BoolArray,
    ) -> TipRoom:
        """Returns where the tips' centres may be.

        Args:
            object_solid: The object in G, convex.
            gaps: That tips are to have from it, shape (n,), in metres; below zero they press.
            fixed: Solids in G that all tips stay off, as the table.
            obstacles: Solids in G that tips stay off unless they hold.
            holding: Which tips hold the object, shape (n,).
        """
        clearances = self.tip_radii + OTHER_CLEARANCE
        # A finger that were pushed along the object would lose the grasp.
        heeded = np.where(holding, -np.inf, clearances)
        return TipRoom(
            object=object_solid,
            p_GO=np.zeros(3),
            object_clearances=self.tip_radii + np.minimum(gaps, MOVING_CLEARANCE),
            others=(
                *((solid, clearances) for solid in fixed),
                *((solid, heeded) for solid in obstacles),
            ),
            spacing=self.tip_radii[:, None] + self.tip_radii + OTHER_CLEARANCE,
        )
