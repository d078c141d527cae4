"""The tree that compiled kernels search: boxes around compact runs of places."""

from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.kernels.blocks import Blocks
from drake_pregrasp.kernels.sorting import BLOCK, cut

_FLAT = 1e-13  # Thickness of a face, as a share of the longest lever arm: rounding is below it.


@dataclass(frozen=True, eq=False)
class SearchTree:
    """K nodes, each before those below it; a leaf is a block, or that part of it in one group.

    Attributes:
        starts: First place of each node, shape (K,).
        ends: Place after its last one, shape (K,).
        skips: The next node that isn't below it, shape (K,).
        depths: Number of nodes above it, shape (K,).
        centers: Midpoints of the boxes around their points, shape (K, 3), in metres.
        halves: Half the edge lengths of those boxes, shape (K, 3).
        groups: Group of `Blocks` that each node is part of, shape (K,).
        frames: Of G groups: two axes along each and its normal, shape (G, 3, 3).
        is_flat: Whether each group is flat, shape (G,).
        shared: Blocks that hold more than one leaf, or padding, shape (s,).
    """

    starts: IntArray
    ends: IntArray
    skips: IntArray
    depths: IntArray
    centers: FloatArray
    halves: FloatArray
    groups: IntArray
    frames: FloatArray
    is_flat: BoolArray
    shared: IntArray


def make_search_tree(blocks: Blocks) -> SearchTree:
    """Makes the tree of a surface: the groups are its roots, and a node has four below it."""
    runs: list[tuple[int, int, int]] = []
    for first, end in zip(blocks.groups[:-1].tolist(), blocks.groups[1:].tolist(), strict=True):
        _grow(first, end, 0, runs)
    starts, ends, depths = np.ascontiguousarray(np.array(runs, dtype=np.int64).T)
    centers, halves = np.empty((len(runs), 3)), np.empty((len(runs), 3))
    for depth in range(int(np.max(depths)) + 1):
        own = np.flatnonzero(depths == depth)
        low, high = _boxes(blocks.points, starts[own], ends[own])
        centers[own], halves[own] = (low + high) / 2, (high - low) / 2
    skips = _next_outside(depths)
    frames, is_flat = _frames(blocks)
    leaves = starts // BLOCK == (ends - 1) // BLOCK
    parts = leaves & (ends - starts < BLOCK)
    return SearchTree(
        starts,
        ends,
        skips,
        depths,
        centers,
        halves,
        np.cumsum(depths == 0) - 1,
        frames,
        is_flat,
        np.unique(starts[parts] // BLOCK),
    )


def _grow(first: int, end: int, depth: int, runs: list[tuple[int, int, int]]) -> None:
    runs.append((first, end, depth))
    middle = cut(first, end)
    if middle is None:
        return
    for low, high in ((first, middle), (middle, end)):
        quarter = cut(low, high)
        for a, b in ((low, high),) if quarter is None else ((low, quarter), (quarter, high)):
            _grow(a, b, depth + 1, runs)


def _boxes(points: FloatArray, starts: IntArray, ends: IntArray) -> tuple[FloatArray, FloatArray]:
    """Returns the corners of boxes around runs of places that are apart and in order."""
    borders = np.stack([starts, ends], axis=1).ravel()
    borders = borders[:-1] if borders[-1] == points.shape[1] else borders
    low = np.minimum.reduceat(points, borders, axis=1)[:, ::2].T
    high = np.maximum.reduceat(points, borders, axis=1)[:, ::2].T
    return low, high


def _next_outside(depths: IntArray) -> IntArray:
    skips = np.empty(len(depths), dtype=np.int64)
    at_depth = np.full(int(np.max(depths)) + 2, len(depths))
    for node in range(len(depths) - 1, -1, -1):
        depth = depths[node]
        skips[node] = np.min(at_depth[: depth + 1])
        at_depth[depth] = node
    return skips


def _frames(blocks: Blocks) -> tuple[FloatArray, BoolArray]:
    """Returns the axes of each group, shape (G, 3, 3), and whether it is flat, shape (G,)."""
    arm = np.sqrt(np.max(np.sum(blocks.points**2, axis=0)))
    frames, is_flat = [], []
    for first, end in zip(blocks.groups[:-1].tolist(), blocks.groups[1:].tolist(), strict=True):
        points = blocks.points[:, first:end]
        frames.append(_frame(points))
        is_flat.append(bool(np.ptp(frames[-1][2] @ points) <= 2 * _FLAT * arm))
    return np.stack(frames), np.array(is_flat)


def _frame(points: FloatArray) -> FloatArray:
    """Returns axes u, v and w of points, shape (3, k): w is across them, u and v as O's are."""
    away = points - np.mean(points, axis=1, keepdims=True)
    _, axes = np.linalg.eigh(away @ away.T)
    w = axes[:, 0]
    u = np.eye(3)[np.argmin(np.abs(w))]
    u = u - (u @ w) * w
    u /= np.linalg.norm(u)
    return np.stack([u, np.cross(w, u), w])
