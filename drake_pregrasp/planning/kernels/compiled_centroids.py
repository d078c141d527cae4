"""The one pass over all blocks that sums up weighted centroids, for numba."""

import math

import numba
import numpy as np

from drake_pregrasp.planning.kernels.compiled_weights import (
    SCRATCH,
    divide_by_largest,
    exponentials,
    gaussian_exponents,
    largest_eigenvalue,
    smallest_singular_values,
    volumes,
)
from drake_pregrasp.planning.kernels.partition import MIXED
from drake_pregrasp.planning.kernels.sorting import BLOCK

POSITION, MSV, GII, VEW = range(4)
"""Kinds of weights, by their places in `KINDS`."""

_FAST = {"reassoc", "contract", "nsz", "nnan"}


@numba.njit(cache=True, error_model="numpy")
def sum_up(  # type: ignore[no-untyped-def]
    kind, stretch, moves, whitener, numbers, t, B, n, steps, points, areas, owners, labels
):
    """Returns the centroids of the regions of contacts that move, shape (n, 3), or NaN.

    Weights are summed as differences from one of their own, `reference`: sum (b - least) follows
    from sum (b - reference) and sum 1 when the least is known, at the end. Gaussians are summed as
    multiples of the largest so far.
    """
    count = len(moves)
    sums = np.zeros((count, 8))  # sum a b, sum a b q (3), sum a, sum a q (3).
    reference = np.full(count, np.nan if kind != POSITION else -np.inf)
    least = np.full(count, np.inf)
    b, own = np.empty(BLOCK), np.empty(BLOCK)
    scratch, powers = np.empty((SCRATCH, BLOCK)), np.empty(BLOCK, dtype=np.int64)
    present = np.zeros(count, dtype=np.bool_)
    for block in range(len(owners)):
        owner = owners[block]
        first, last = 0, 0
        if owner >= 0:
            first, last = owner, owner + 1
        elif owner == MIXED:
            last = count
            present[:] = False
            for k in range(BLOCK):
                if labels[block, k] >= 0:
                    present[labels[block, k]] = True
        here = slice(block * BLOCK, (block + 1) * BLOCK)
        x, y, z = points[0, here], points[1, here], points[2, here]
        for contact in range(first, last):
            if not moves[contact] or (owner == MIXED and not present[contact]):
                continue
            area = areas[here]
            if kind == POSITION:
                gaussian_exponents(whitener, x, y, z, b)
            elif kind == VEW:
                volumes(numbers[contact], n, x, y, z, b)
            else:
                smallest_singular_values(t[contact], B[contact], n, steps, x, y, z, scratch, b)
                if kind == GII:
                    divide_by_largest(n, steps, scratch, b)
                    for k in range(BLOCK):
                        if scratch[8, k] < 0.0 and (owner >= 0 or labels[block, k] == contact):
                            top = largest_eigenvalue(t[contact], B[contact], n, x[k], y[k], z[k])
                            b[k] /= math.sqrt(top)
            if owner == MIXED:
                pick = -1
                for k in range(BLOCK):
                    mine = labels[block, k] == contact
                    own[k] = area[k] if mine else 0.0
                    if mine:
                        pick = k
                for k in range(BLOCK):
                    if labels[block, k] != contact:
                        b[k] = b[pick]
                area = own
            if kind == POSITION:
                top = _largest(b)
                if top > reference[contact]:
                    shrink = math.exp(reference[contact] - top)
                    for k in range(4):
                        sums[contact, k] *= shrink
                    reference[contact] = top
                _subtract(b, reference[contact])
                exponentials(b, powers)
            else:
                if math.isnan(reference[contact]):
                    reference[contact] = b[0]
                _subtract(b, reference[contact])
                least[contact] = min(least[contact], _least(b))
            _add(b, area, x, y, z, sums[contact])
    return _centroids(kind, stretch, sums, reference, least)


@numba.njit(cache=True, error_model="numpy")
def _centroids(kind, stretch, sums, reference, least):  # type: ignore[no-untyped-def]
    centroids = np.empty((len(sums), 3))
    for contact in range(len(sums)):
        back = 0.0
        if kind != POSITION:
            back = -least[contact] if stretch else reference[contact]
        row = sums[contact]
        total = row[0] + back * row[4]
        for axis in range(3):
            moment = row[1 + axis] + back * row[5 + axis]
            plain = row[5 + axis] / row[4]
            centroids[contact, axis] = moment / total if total > 0 else plain
    return centroids


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST)
def _add(b, a, x, y, z, row):  # type: ignore[no-untyped-def]
    s, sx, sy, sz, p, px, py, pz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(BLOCK):
        w = a[k] * b[k]
        s += w
        sx += w * x[k]
        sy += w * y[k]
        sz += w * z[k]
        p += a[k]
        px += a[k] * x[k]
        py += a[k] * y[k]
        pz += a[k] * z[k]
    row[0] += s
    row[1] += sx
    row[2] += sy
    row[3] += sz
    row[4] += p
    row[5] += px
    row[6] += py
    row[7] += pz


@numba.njit(cache=True, fastmath=_FAST)
def _least(b):  # type: ignore[no-untyped-def]
    value = b[0]
    for k in range(BLOCK):
        value = min(value, b[k])
    return value


@numba.njit(cache=True, fastmath=_FAST)
def _largest(b):  # type: ignore[no-untyped-def]
    value = b[0]
    for k in range(BLOCK):
        value = max(value, b[k])
    return value


@numba.njit(cache=True, fastmath=_FAST)
def _subtract(b, value):  # type: ignore[no-untyped-def]
    for k in range(BLOCK):
        b[k] -= value
