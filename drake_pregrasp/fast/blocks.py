"""Spatially compact blocks of candidates, with boxes around their positions and normals."""

import math

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray

_SMALLEST = 64  # Largest number of candidates in a block of a small surface.


def block_size(N: int) -> int:
    """Returns the largest number of candidates in a block of a surface with N candidates.

    More blocks take more time for their boxes, fewer blocks for the candidates of those that lie
    across a boundary of regions.
    """
    return max(_SMALLEST, math.isqrt(4 * N))


def compact_blocks(q: FloatArray, size: int) -> list[IntArray]:
    """Returns the indices of points in blocks, made by bisection of the longest side.

    Args:
        q: Points, shape (N, 3), in metres.
        size: Number of points in all blocks but the first one, which may have fewer.
    """
    waiting, blocks = [np.arange(len(q))], []
    while waiting:
        own = waiting.pop()
        if len(own) <= size:
            blocks.append(own)
            continue
        axis = np.argmax(np.ptp(q[own], axis=0))
        middle = size * -(-len(own) // (2 * size))
        order = np.argpartition(q[own, axis], middle - 1)
        waiting += [own[order[:middle]], own[order[middle:]]]
    return blocks


class Blocks:
    """The candidates of a surface in spatially compact blocks.

    Args:
        q: Candidate points, shape (N, d), in metres; the first three coordinates are positions.
        nhat: Outward unit normals at the candidates, shape (N, 3).

    Attributes:
        points: The candidate points as given.
        q: Candidates in the order of the blocks, shape (d, N), in metres.
        nhat: Their outward unit normals, shape (3, N).
        order: Index of the candidate at each place of the blocks, shape (N,).
        starts: First place of each block, and N, shape (B + 1,).
        largest: Largest size of a coordinate, in metres.
        boxes: Midpoints and half edge lengths of the blocks' boxes, mean normals, and the radii of
            balls around both, shape (B, 2d + 5).
    """

    def __init__(self, q: FloatArray, nhat: FloatArray) -> None:
        blocks = compact_blocks(q, block_size(len(q)))
        self.points = q
        self.order: IntArray = np.concatenate(blocks)
        self.starts = np.cumsum([0, *map(len, blocks)])
        q, nhat = q[self.order], nhat[self.order]
        self.largest = float(np.max(np.abs(q)))
        self.q, self.nhat = np.ascontiguousarray(q.T), np.ascontiguousarray(nhat.T)
        low, high, turned_low, turned_high = (
            bound.reduceat(values, self.starts[:-1])
            for values in (q, nhat)
            for bound in (np.minimum, np.maximum)
        )
        half, turn = (high - low) / 2, (turned_high - turned_low) / 2
        radii = [np.linalg.norm(half[:, :3], axis=1), np.linalg.norm(turn, axis=1)]
        self.boxes = np.ascontiguousarray(
            np.column_stack([(low + high) / 2, half, (turned_low + turned_high) / 2, *radii])
        )
