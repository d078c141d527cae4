"""The order of candidates in which neighbours are in the same block: face by face, compactly."""

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray

BLOCK = 64
"""Points in a block."""

FACE = 2 * BLOCK
"""Candidates that a flat face has at least; smaller ones count as curved."""

_SAME = 1e-9  # Of normals, and of offsets relative to the object's size.
_TILT = 1e-3  # Of cuts against the axes: grid points that would tie are told apart by it.

_MIX = np.sqrt([2.0, 3.0, 5.0, 7.0])


def sorted_places(points: FloatArray, nhat: FloatArray) -> tuple[IntArray, IntArray]:
    """Returns the candidate at each place, shape (N,), and each group's first place, and N.

    A group is a flat face, or all that faces one of six directions otherwise. In a group, blocks
    are the leaves of a tree of cuts across the longest side, at `cut` each.

    Args:
        points: Candidates, shape (N, 3), N >= 1, in metres.
        nhat: Outward unit normals there, shape (N, 3).
    """
    groups = _groups(points, nhat)
    order = np.argsort(groups, kind="stable")
    starts = np.flatnonzero(np.diff(groups[order], prepend=-1))
    starts = np.append(starts, len(order))
    axes = np.ascontiguousarray(points.T)
    for first, end in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True):
        waiting = [(first, end)]
        while waiting:
            low, high = waiting.pop()
            middle = cut(low, high)
            if middle is None:
                continue
            own = order[low:high]
            order[low:high] = own[_halved(axes[:, own], middle - low)]
            waiting += [(low, middle), (middle, high)]
    return order, starts


def cut(first: int, end: int) -> int | None:
    """Returns the border of blocks in the middle of a run of places, or None inside one block."""
    lowest, highest = first // BLOCK + 1, (end - 1) // BLOCK
    return BLOCK * ((lowest + highest + 1) // 2) if lowest <= highest else None


def _groups(points: FloatArray, nhat: FloatArray) -> IntArray:
    """Returns the number of each candidate's group, shape (N,), in no order that matters."""
    size = max(float(np.max(np.abs(points))), np.finfo(float).tiny)
    offsets = np.einsum("ij,ij->i", points, nhat) / size
    # One number a plane, because rows are slow to compare. If two planes shared theirs, the group
    # would count as curved.
    planes = sum(w * np.round(x / _SAME) for w, x in zip(_MIX, [*nhat.T, offsets], strict=True))
    _, faces, counts = np.unique(planes, return_inverse=True, return_counts=True)
    axis = np.argmax(np.abs(nhat), axis=1)
    along = np.take_along_axis(nhat, axis[:, None], axis=1)[:, 0]
    directions = len(counts) + 2 * axis + (along > 0)
    faces = faces.reshape(-1)
    groups: IntArray = np.where(counts[faces] >= FACE, faces, directions).astype(np.int64)
    return groups


def _halved(axes: FloatArray, count: int) -> IntArray:
    """Returns an order of points, shape (3, k), whose first `count` are on one side of a cut."""
    extents = np.ptp(axes, axis=1)
    weights = np.where(np.arange(3) == np.argmax(extents), 1.0, _TILT)
    halved: IntArray = np.argpartition(weights @ axes, count)
    return halved
