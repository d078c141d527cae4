"""Candidates in spatially compact blocks, and the tree of boxes around them."""

from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.kernels.sorting import BLOCK, sorted_places

FAN = 8
"""Blocks, or nodes, below a node of the tree."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """The N candidates of a surface, sorted and cut into B blocks of `BLOCK` points.

    Lengths are in metres, and places are relative to the centre of mass, in O. The last block is
    filled up with copies of the last point that have no area.

    Attributes:
        order: Candidate at each place, shape (N,).
        points: q of each place, coordinate by coordinate, shape (3, B * BLOCK).
        areas: Of each place, in m², shape (B * BLOCK,).
        centers: Midpoints of the boxes of all nodes, level after level from the root's children
            to the blocks, shape (K, 3).
        halves: Half the edge lengths of those boxes, shape (K, 3).
        starts: Place of each level's first node in them, and K, shape (L + 1,).
        groups: First place of each flat face, or other group of candidates, and N, shape (F + 1,).
    """

    order: IntArray
    points: FloatArray
    areas: FloatArray
    centers: FloatArray
    halves: FloatArray
    starts: IntArray
    groups: IntArray

    def __deepcopy__(self, memo: dict[int, object]) -> "Blocks":
        """Returns itself: nobody writes to it, and regions know it by its identity."""
        return self

    @property
    def count(self) -> int:
        """B, the number of blocks."""
        return int(self.starts[-1] - self.starts[-2])

    @property
    def num_candidates(self) -> int:
        """N, the number of candidates."""
        return len(self.order)


def make_blocks(p_CoMQ: FloatArray, nhat: FloatArray, areas: FloatArray) -> Blocks:
    """Sorts candidates by the face they are on, and compactly on each face.

    Args:
        p_CoMQ: Candidates relative to the centre of mass, shape (N, 3), N >= 1, in metres.
        nhat: Outward unit normals there, shape (N, 3).
        areas: Surface area each candidate stands for, shape (N,), in m².
    """
    order, groups = sorted_places(p_CoMQ, nhat)
    count = -(-len(order) // BLOCK)
    padding = count * BLOCK - len(order)
    places = np.pad(order, (0, padding), mode="edge")
    corners = p_CoMQ[places].reshape(count, BLOCK, 3)
    low, high = [np.min(corners, axis=1)], [np.max(corners, axis=1)]
    while len(low[0]) > FAN:
        firsts = np.arange(0, len(low[0]), FAN)
        low.insert(0, np.minimum.reduceat(low[0], firsts))
        high.insert(0, np.maximum.reduceat(high[0], firsts))
    all_low, all_high = np.concatenate(low), np.concatenate(high)
    return Blocks(
        order=order,
        points=np.ascontiguousarray(p_CoMQ[places].T),
        areas=np.pad(areas[order], (0, padding)),
        centers=(all_low + all_high) / 2,
        halves=(all_high - all_low) / 2,
        starts=np.cumsum([0, *(len(level) for level in low)]),
        groups=groups,
    )
