"""Sums of weights and moments of one region, block by block, for numba."""

import math

import numpy as np

from drake_pregrasp.kernels.compiled.compiling import FAST, compiled
from drake_pregrasp.kernels.compiled.weighing import POSITION
from drake_pregrasp.kernels.compiled.weights import exponentials
from drake_pregrasp.kernels.sorting import BLOCK
from drake_pregrasp.kernels.weighting import FLAT

AREA, REFERENCE, LEAST, ERROR = 4, 8, 9, 10
"""Columns of sums: before `AREA` sum a b and sum a b q, from there sum a and sum a q."""

_COLUMNS = 11


@compiled()
def empty_sums(kind, count):  # type: ignore[no-untyped-def]
    """Returns the sums of nothing for that many contacts.

    Weights are summed as differences from one of their own, the reference: sum (b - least) follows
    from sum (b - reference) and sum 1 when the least is known, at the end. Gaussians are summed as
    multiples of the largest so far, whose logarithm is the reference.
    """
    sums = np.zeros((count, _COLUMNS))
    sums[:, REFERENCE] = -np.inf if kind == POSITION else np.nan
    sums[:, LEAST] = np.inf
    return sums


@compiled()
def refer(kind, b, powers, sums, contact):  # type: ignore[no-untyped-def]
    """Turns what `weigh` wrote into what is summed: relative to the reference."""
    if kind != POSITION:
        if math.isnan(sums[contact, REFERENCE]):
            sums[contact, REFERENCE] = b[0]
        _subtract(b, sums[contact, REFERENCE])
        return
    top = _largest(b)
    if top > sums[contact, REFERENCE]:
        shrink = math.exp(sums[contact, REFERENCE] - top)
        for k in range(AREA):
            sums[contact, k] *= shrink
        sums[contact, ERROR] *= shrink
        sums[contact, REFERENCE] = top
    _subtract(b, sums[contact, REFERENCE])
    exponentials(b, powers)


@compiled()
def heed_least(b, sums, contact):  # type: ignore[no-untyped-def]
    """Keeps the least weight so far of candidates, relative to the reference."""
    sums[contact, LEAST] = min(sums[contact, LEAST], _least(b))


@compiled(fastmath=FAST)
def add(b, q, sums, contact):  # type: ignore[no-untyped-def]
    """Adds points with areas, shape (4, BLOCK), and their weights to the sums."""
    s, sx, sy, sz, p, px, py, pz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(BLOCK):
        w = q[3, k] * b[k]
        s += w
        sx += w * q[0, k]
        sy += w * q[1, k]
        sz += w * q[2, k]
        p += q[3, k]
        px += q[3, k] * q[0, k]
        py += q[3, k] * q[1, k]
        pz += q[3, k] * q[2, k]
    sums[contact, 0] += s
    sums[contact, 1] += sx
    sums[contact, 2] += sy
    sums[contact, 3] += sz
    sums[contact, 4] += p
    sums[contact, 5] += px
    sums[contact, 6] += py
    sums[contact, 7] += pz


@compiled()
def mean_weight(kind, stretch, row):  # type: ignore[no-untyped-def]
    """Returns the mean weight of all that is summed up, or NaN of nothing."""
    return row[0] / row[AREA] + _back(kind, stretch, row)


@compiled()
def write_centroid(kind, stretch, row, out):  # type: ignore[no-untyped-def]
    """Writes the centroid: that of the area alone where weights are zero, or but rounding."""
    back = _back(kind, stretch, row)
    total = row[0] + back * row[AREA]
    rounding = 0.0
    if kind != POSITION and stretch:
        rounding = FLAT * (row[0] + row[REFERENCE] * row[AREA])
    for axis in range(3):
        moment = row[1 + axis] + back * row[AREA + 1 + axis]
        plain = row[AREA + 1 + axis] / row[AREA]
        out[axis] = moment / total if total > rounding else plain


@compiled()
def _back(kind, stretch, row):  # type: ignore[no-untyped-def]
    """Returns what must be added to each weight that is summed."""
    if kind == POSITION:
        return 0.0
    return -row[LEAST] if stretch else row[REFERENCE]


@compiled(fastmath=FAST)
def _least(b):  # type: ignore[no-untyped-def]
    value = b[0]
    for k in range(BLOCK):
        value = min(value, b[k])
    return value


@compiled(fastmath=FAST)
def _largest(b):  # type: ignore[no-untyped-def]
    value = b[0]
    for k in range(BLOCK):
        value = max(value, b[k])
    return value


@compiled(fastmath=FAST)
def _subtract(b, value):  # type: ignore[no-untyped-def]
    for k in range(BLOCK):
        b[k] -= value
