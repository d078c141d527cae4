"""Few points with areas that stand in for the many candidates of a part of a flat face."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.kernels.blocks import Blocks
from drake_pregrasp.kernels.search_tree import SearchTree
from drake_pregrasp.kernels.sorting import BLOCK

NODES = 8
"""Points along each side of the grid: as many in all as in a block."""

LEAST = 4 * BLOCK
"""Candidates from which on they have a stand-in."""

GRID: FloatArray = -np.cos(np.pi * np.arange(NODES) / (NODES - 1)).astype(np.float64)
"""Their places along a side from -1 to 1: where Chebyshev polynomials are extreme."""

COEFFICIENTS: FloatArray = np.linalg.inv(chebyshev.chebvander(GRID, NODES - 1)).astype(float)
"""Takes values on the grid to the coefficients of Chebyshev polynomials, shape (8, 8)."""


@dataclass(frozen=True, eq=False)
class StandIns:
    """S stand-ins, each before those of its parts.

    Attributes:
        firsts: First block that each stands for, shape (S,).
        ends: Block after the last one, shape (S,).
        skips: The next one that isn't for a part of it, shape (S,).
        grids: Their points in metres, and areas, also below zero, in m², shape (S, 4, BLOCK).
    """

    firsts: IntArray
    ends: IntArray
    skips: IntArray
    grids: FloatArray


def make_stand_ins(blocks: Blocks, tree: SearchTree) -> StandIns:
    """Makes those of a surface: of all nodes that are flat, whole blocks, and large enough.

    Areas integrate each polynomial of degree 7 in u and in v as the candidates do. A part's
    stand-in does so too, and takes the place of its candidates here.
    """
    large = tree.ends - tree.starts >= LEAST
    whole = (tree.starts % BLOCK == 0) & (tree.ends % BLOCK == 0)
    nodes = np.flatnonzero(tree.is_flat[tree.groups] & large & whole)
    row_of = np.full(len(tree.starts) + 1, len(nodes))
    row_of[nodes] = np.arange(len(nodes))
    grids = np.empty((len(nodes), 4, BLOCK))
    for row in range(len(nodes) - 1, -1, -1):
        node = nodes[row]
        sources = []
        part = node + 1
        while part < tree.skips[node]:
            if row_of[part] < len(nodes):
                sources.append(grids[row_of[part]])
            else:
                own = slice(tree.starts[part], tree.ends[part])
                sources.append(np.vstack([blocks.points[:, own], blocks.areas[own]]))
            part = tree.skips[part]
        grids[row] = _stand_in(np.concatenate(sources, axis=1), tree.frames[tree.groups[node]])
    next_row = np.minimum.accumulate(row_of[::-1])[::-1]
    return StandIns(
        tree.starts[nodes] // BLOCK,
        tree.ends[nodes] // BLOCK,
        next_row[tree.skips[nodes]],
        grids,
    )


def _stand_in(points: FloatArray, frame: FloatArray) -> FloatArray:
    """Returns the grid on the rectangle of points with areas, shape (4, k); u runs fastest."""
    along = frame @ points[:3]
    low, high = np.min(along, axis=1), np.max(along, axis=1)
    middle, half = (low + high) / 2, (high - low) / 2
    scaled = (along - middle[:, None]) / np.where(half > 0, half, 1)[:, None]
    in_u, in_v = (chebyshev.chebvander(x, NODES - 1) @ COEFFICIENTS for x in scaled[:2])
    places = np.stack([np.tile(GRID, NODES), np.repeat(GRID, NODES), np.zeros(BLOCK)])
    grid = frame.T @ (middle[:, None] + half[:, None] * places)
    return np.vstack([grid, (in_v.T @ (points[3, :, None] * in_u)).ravel()])
