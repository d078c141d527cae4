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
def own_cells(x, y, z, c, half_power, same_side, places, owners, least, power):  # type: ignore[no-untyped-def]
    """Writes the contact whose cell each candidate of a block lies in, or `NO_REGION`."""
    size = len(x)
    least[:size], owners[:size] = np.inf, NO_REGION
    for i in range(len(c)):
        cx, cy, cz, half = c[i, 0], c[i, 1], c[i, 2], half_power[i]
        for k in range(size):
            power[k] = half - (cx * x[k] + cy * y[k] + cz * z[k])
        if same_side.size:
            for k in range(size):
                if not same_side[i, places[k]]:
                    power[k] = np.inf
        for k in range(size):
            is_less = power[k] < least[k]
            owners[k] = i if is_less else owners[k]
            least[k] = power[k] if is_less else least[k]


@compiled()
def cutting_half_spaces(normals, bounds, slack, center, half, over, reach, cutting):  # type: ignore[no-untyped-def]
    """Writes the indices of half-spaces that do not contain a whole box, and returns their number.

    If a half-space excludes the whole box, it is the only one.
    """
    (nx, ny, nz), (x, y, z), (hx, hy, hz) = normals, center, half
    for j in range(len(bounds)):
        over[j] = nx[j] * x + ny[j] * y + nz[j] * z - bounds[j]
        reach[j] = abs(nx[j]) * hx + abs(ny[j]) * hy + abs(nz[j]) * hz
    count = 0
    for j in range(len(bounds)):
        if over[j] - reach[j] > slack[j]:
            cutting[0] = j
            return 1
        cutting[count] = j
        count += over[j] + reach[j] > -slack[j]
    return count


@compiled(
    "i8[::1](f8[:,::1], i8[::1], i8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1],"
    " f8[:,:,::1], f8[:,::1], b1[:,::1])"
)
def label_blocks(  # type: ignore[no-untyped-def]
    q, order, starts, centers, halves, c, half_power, normals, bounds, same_side
):
    """Returns the label of each candidate, in the order of the candidates, shape (N,).

    Loops run along one array at a time, so that the compiler makes vector instructions of them.

    Args:
        q: Candidates in the order of the blocks, shape (3, N), in metres.
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
    n, m = bounds.shape
    labels = np.empty(q.shape[1], dtype=np.int64)
    owners = np.empty(BLOCK, dtype=np.int64)
    least, power, excluded = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK, dtype=np.bool_)
    cutting, over, reach = np.empty(m, dtype=np.int64), np.empty(m), np.empty(m)
    owns = np.empty(n, dtype=np.bool_)
    extent = np.max(np.abs(centers) + halves) + np.max(np.abs(c))
    by_axis, slack = np.empty((n, 3, m)), np.empty((n, m))
    for i in range(n):
        for j in range(m):
            size = 0.0
            for axis in range(3):
                by_axis[i, axis, j] = normals[i, j, axis]
                size += abs(normals[i, j, axis])
            slack[i, j] = _SLACK * (abs(bounds[i, j]) + extent * size)
    for block in range(len(centers)):
        start, stop = starts[block], starts[block + 1]
        x, y, z = q[0, start:stop], q[1, start:stop], q[2, start:stop]
        places, size = order[start:stop], stop - start
        own_cells(x, y, z, c, half_power, same_side, places, owners, least, power)
        owns[:] = False
        for k in range(size):
            if owners[k] != NO_REGION:
                owns[owners[k]] = True
        for i in range(n):
            if not owns[i]:
                continue
            cx, cy, cz = c[i, 0], c[i, 1], c[i, 2]
            center = (centers[block, 0] - cx, centers[block, 1] - cy, centers[block, 2] - cz)
            half = (halves[block, 0], halves[block, 1], halves[block, 2])
            nx, ny, nz = by_axis[i, 0], by_axis[i, 1], by_axis[i, 2]
            count = cutting_half_spaces(
                (nx, ny, nz), bounds[i], slack[i], center, half, over, reach, cutting
            )
            excluded[:size] = False
            for j in cutting[:count]:
                a, b, d, bound = nx[j], ny[j], nz[j], bounds[i, j]
                for k in range(size):
                    excluded[k] |= a * (x[k] - cx) + b * (y[k] - cy) + d * (z[k] - cz) > bound
            for k in range(size):
                if excluded[k] and owners[k] == i:
                    owners[k] = NO_REGION
        for k in range(size):
            labels[places[k]] = owners[k]
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
        ordered = q[self._order]
        self._q = np.ascontiguousarray(ordered.T)
        low = np.minimum.reduceat(ordered, self._starts[:-1])
        high = np.maximum.reduceat(ordered, self._starts[:-1])
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
        if q.shape != self._q.T.shape:
            raise InvalidArgumentError(
                f"{len(self._order)} candidates were expected, not {q.shape}"
            )
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
