"""Labels of candidates in compact blocks with bounding boxes, which decide whole blocks at once."""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.regions.half_spaces import HalfSpaces
from drake_pregrasp.regions.safe_regions import NO_REGION

BLOCK = 64
"""Largest number of candidates in a block."""

_SLACK = 1e-12  # Share of its terms by which a half-space must clear a box to decide it.


def compiled(signature: str | None = None) -> Callable[[Callable[..., Any]], Any]:
    """Returns a decorator that compiles a function with numba and keeps the code on disk.

    With a signature, it is compiled or loaded when it is defined, so that no tick waits for it.

    Args:
        signature: Types of the result and the arguments, in numba's notation.
    """

    def compile_(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(signature, cache=True, error_model="numpy")(function)
        except RuntimeError:  # Numba found no folder that it can write to.
            return numba.njit(signature, error_model="numpy")(function)

    return compile_


def compact_blocks(q: FloatArray) -> list[IntArray]:
    """Returns the indices of points in blocks, made by bisection of the longest side.

    Args:
        q: Points, shape (N, 3), in metres.
    """
    waiting, blocks = [np.arange(len(q))], []
    while waiting:
        own = waiting.pop()
        if len(own) <= BLOCK:
            blocks.append(own)
            continue
        axis = np.argmax(np.ptp(q[own], axis=0))
        middle = BLOCK * -(-len(own) // (2 * BLOCK))
        order = np.argpartition(q[own, axis], middle - 1)
        waiting += [own[order[:middle]], own[order[middle:]]]
    return blocks


@compiled()
def cutting_half_spaces(  # type: ignore[no-untyped-def]
    normals, bounds, slack, c, center, half, cutting
):
    """Writes the indices of half-spaces that do not contain a whole box, and returns their number.

    If a half-space excludes the whole box, it is the only one.
    """
    x, y, z = center[0] - c[0], center[1] - c[1], center[2] - c[2]
    count = 0
    for j in range(len(bounds)):
        nx, ny, nz = normals[j, 0], normals[j, 1], normals[j, 2]
        over = nx * x + ny * y + nz * z - bounds[j]
        reach = abs(nx) * half[0] + abs(ny) * half[1] + abs(nz) * half[2]
        if over - reach > slack[j]:
            cutting[0] = j
            return 1
        cutting[count] = j
        count += over + reach > -slack[j]
    return count


@compiled(
    "i8[::1](f8[:,::1], i8[::1], i8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1],"
    " f8[:,:,::1], f8[:,::1], b1[:,::1])"
)
def label_blocks(  # type: ignore[no-untyped-def]
    q, order, starts, centers, halves, c, half_power, normals, bounds, same_side
):
    """Returns the label of each candidate, in the order of the candidates, shape (N,).

    Args:
        q: Candidates in the order of the blocks, shape (N, 3), in metres.
        order: Index of the candidate at each place of that order, shape (N,).
        starts: First place of each block, and N, shape (B + 1,).
        centers: Midpoints of the bounding boxes of the blocks, shape (B, 3), in metres.
        halves: Half edge lengths of these boxes, shape (B, 3), in metres.
        c: Contacts, shape (n, 3), in metres.
        half_power: (|c_i|² - h_i)/2, shape (n,), in m²; infinite for lost fingers.
        normals: Normals of the half-spaces, shape (n, m, 3), in metres.
        bounds: Bounds of the half-spaces for points relative to the contact, shape (n, m), in m².
        same_side: Candidates that no wall hides from each contact, shape (n, N), or empty for all.
    """
    labels = np.empty(len(q), dtype=np.int64)
    owners = np.empty(BLOCK, dtype=np.int64)
    cutting = np.empty(bounds.shape[1], dtype=np.int64)
    owns = np.empty(len(c), dtype=np.bool_)
    extent = np.max(np.abs(centers) + halves) + np.max(np.abs(c))
    slack = _SLACK * (np.abs(bounds) + extent * np.sum(np.abs(normals), axis=2))
    for block in range(len(centers)):
        start, size = starts[block], starts[block + 1] - starts[block]
        owns[:] = False
        for k in range(size):
            x, y, z = q[start + k, 0], q[start + k, 1], q[start + k, 2]
            least, owners[k] = np.inf, NO_REGION
            for i in range(len(c)):
                power = half_power[i] - (c[i, 0] * x + c[i, 1] * y + c[i, 2] * z)
                if power < least and (same_side.size == 0 or same_side[i, order[start + k]]):
                    least, owners[k] = power, i
            if owners[k] != NO_REGION:
                owns[owners[k]] = True
        for i in range(len(c)):
            if not owns[i]:
                continue
            cx, cy, cz = c[i, 0], c[i, 1], c[i, 2]
            count = cutting_half_spaces(
                normals[i],
                bounds[i],
                slack[i],
                c[i],
                centers[block],
                halves[block],
                cutting,
            )
            for k in range(size):
                if owners[k] != i:
                    continue
                x, y, z = q[start + k, 0] - cx, q[start + k, 1] - cy, q[start + k, 2] - cz
                for p in range(count):
                    j = cutting[p]
                    over = normals[i, j, 0] * x + normals[i, j, 1] * y + normals[i, j, 2] * z
                    if over > bounds[i, j]:
                        owners[k] = NO_REGION
                        break
        for k in range(size):
            labels[order[start + k]] = owners[k]
    return labels


class CompactCandidates:
    """The candidates of a surface in spatially compact blocks.

    Args:
        q: Candidate points, shape (N, 3), in metres.
    """

    def __init__(self, q: FloatArray) -> None:
        blocks = compact_blocks(q)
        self._order: IntArray = np.concatenate(blocks)
        self._starts = np.cumsum([0, *map(len, blocks)])
        self._q = np.ascontiguousarray(q[self._order])
        low = np.minimum.reduceat(self._q, self._starts[:-1])
        high = np.maximum.reduceat(self._q, self._starts[:-1])
        self._centers, self._halves = (low + high) / 2, (high - low) / 2

    def label(
        self,
        q: FloatArray,
        c: FloatArray,
        h: FloatArray,
        half_spaces: HalfSpaces | None = None,
        same_side: BoolArray | None = None,
    ) -> IntArray:
        """Returns the region of each candidate, or `NO_REGION`, as `label_candidates` does.

        Args:
            q: The same candidates as in the constructor, shape (N, 3), in metres.
            c: Contact points; this and the other arguments are as for `label_candidates`.
            h: Weights of the contacts.
            half_spaces: Bounds of the regions inside the cells.
            same_side: Candidates that no wall hides from each contact.

        Raises:
            InvalidArgumentError: If the number of candidates differs from the constructor's.
        """
        if q.shape != self._q.shape:
            raise InvalidArgumentError(f"{len(self._q)} candidates were expected, not {q.shape}")
        seen = np.empty((0, 0), dtype=bool) if same_side is None else same_side
        labels: IntArray = label_blocks(
            self._q,
            self._order,
            self._starts,
            self._centers,
            self._halves,
            np.array(c, dtype=float, order="C"),
            (np.sum(c**2, axis=1) - h) / 2,
            np.empty((len(c), 0, 3)) if half_spaces is None else half_spaces.normals,
            np.empty((len(c), 0)) if half_spaces is None else half_spaces.bounds,
            np.array(seen, dtype=bool, order="C"),
        )
        return labels
