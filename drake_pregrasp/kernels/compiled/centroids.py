"""The one pass over all blocks that sums up weighted centroids, for numba."""

import numpy as np

from drake_pregrasp.kernels.compiled.compiling import compiled
from drake_pregrasp.kernels.compiled.point_weights import prepare
from drake_pregrasp.kernels.compiled.singular_values import SCRATCH
from drake_pregrasp.kernels.compiled.stand_ins import (
    gaussian_error,
    interpolation_error,
    least_between,
)
from drake_pregrasp.kernels.compiled.sums import (
    AREA,
    ERROR,
    LEAST,
    REFERENCE,
    add,
    empty_sums,
    heed_least,
    mean_weight,
    refer,
    write_centroid,
)
from drake_pregrasp.kernels.compiled.weighing import POSITION, weigh
from drake_pregrasp.kernels.partition import MIXED
from drake_pregrasp.kernels.sorting import BLOCK

_PART_ERROR = 2e-10  # Of a stand-in's weights, as a share of the mean weight so far.
_TOTAL_ERROR = 2.4e-10  # As a share of the sum of all weights: above it candidates are weighed.


@compiled()
def centroids_of(  # type: ignore[no-untyped-def]
    kind, stretch, movers, r, sizes, covariance, packs, owners, labels, stand_ins
):
    """Returns the centroids of the regions of contacts that move, shape (k, 3), or NaN.

    Args:
        kind: Place in `KINDS`.
        stretch: As of `Weighting`.
        movers: Contacts that move, shape (k,).
        r: All contacts, shape (n, 3).
        sizes: As in `Partition`.
        covariance: As of `Weighting`.
        packs: Points and areas of each block, shape (B, 4, BLOCK).
        owners: As in `Partition`.
        labels: As in `Partition`.
        stand_ins: All arrays of `StandIns`, in their order.
    """
    hand = prepare(kind, r, sizes, covariance)
    moves = np.zeros(len(r), dtype=np.bool_)
    for k in range(len(movers)):
        moves[movers[k]] = True
    sums = empty_sums(kind, len(r))
    _sum_up(kind, stretch, moves, hand, packs, owners, labels, stand_ins, True, sums)
    again = False
    for contact in range(len(r)):
        row = sums[contact]
        error = _TOTAL_ERROR * mean_weight(kind, stretch, row) * row[AREA]
        moves[contact] &= row[ERROR] > error
        if moves[contact]:
            again = True
            row[:] = empty_sums(kind, 1)[0]
    if again:
        _sum_up(kind, stretch, moves, hand, packs, owners, labels, stand_ins, False, sums)
    centroids = np.empty((len(movers), 3))
    for k in range(len(movers)):
        write_centroid(kind, stretch, sums[movers[k]], centroids[k])
    return centroids


@compiled()
def _sum_up(  # type: ignore[no-untyped-def]
    kind, stretch, moves, hand, packs, owners, labels, stand_ins, may_stand_in, sums
):
    """Adds up the regions of contacts that move, first what no stand-in could be for."""
    whitener, numbers, t, B, n = hand
    firsts, ends, skips, grids = stand_ins
    rows = len(firsts) if may_stand_in else 0
    b, powers = np.empty(BLOCK), np.empty(BLOCK, dtype=np.int64)
    scratch = np.empty((SCRATCH, BLOCK))
    same = _ends_of_runs(owners) if rows else owners
    waiting, size = np.empty(rows, dtype=np.int64), 0
    pending, filled = np.empty((len(moves), 4, BLOCK)), np.zeros(len(moves), dtype=np.int64)
    row, block = 0, 0
    while block < len(owners):
        owner = owners[block]
        if row < rows and firsts[row] == block:
            if owner == MIXED or same[block] < ends[row]:
                row += 1
                continue
            if owner >= 0 and moves[owner]:
                waiting[size] = row
                size += 1
            block = ends[row]
            row = skips[row]
            continue
        if owner >= 0 and moves[owner]:
            q = packs[block]
            _add(kind, whitener, numbers, t, B, n, owner, q, scratch, b, powers, sums)
        elif owner == MIXED:
            for k in range(BLOCK):
                contact = labels[block, k]
                if contact < 0 or not moves[contact]:
                    continue
                place = filled[contact]
                for axis in range(4):
                    pending[contact, axis, place] = packs[block, axis, k]
                filled[contact] = place + 1
                if place == BLOCK - 1:
                    filled[contact] = 0
                    q = pending[contact]
                    _add(
                        kind,
                        whitener,
                        numbers,
                        t,
                        B,
                        n,
                        contact,
                        q,
                        scratch,
                        b,
                        powers,
                        sums,
                    )
        block += 1
    for contact in range(len(moves)):
        if filled[contact] > 0:
            q = pending[contact]
            _fill_up(q, filled[contact])
            _add(kind, whitener, numbers, t, B, n, contact, q, scratch, b, powers, sums)
    while size > 0:
        size -= 1
        row = waiting[size]
        owner = owners[firsts[row]]
        q = grids[row]
        if _add_stand_in(
            kind, stretch, whitener, numbers, t, B, n, owner, q, scratch, b, powers, sums
        ):
            continue
        part, block = row + 1, firsts[row]
        while block < ends[row]:
            if part < skips[row] and firsts[part] == block:
                waiting[size] = part
                size += 1
                block = ends[part]
                part = skips[part]
                continue
            q = packs[block]
            _add(kind, whitener, numbers, t, B, n, owner, q, scratch, b, powers, sums)
            block += 1


@compiled()
def _add(  # type: ignore[no-untyped-def]
    kind, whitener, numbers, t, B, n, contact, q, scratch, b, powers, sums
):
    """Adds a block of candidates to a contact's sums."""
    weigh(kind, whitener, numbers, t, B, n, contact, q, scratch, b)
    refer(kind, b, powers, sums, contact)
    if kind != POSITION:
        heed_least(b, sums, contact)
    add(b, q, sums, contact)


@compiled()
def _ends_of_runs(owners):  # type: ignore[no-untyped-def]
    """Returns the block after the run of blocks of one owner that each block is in."""
    ends = np.empty(len(owners), dtype=np.int64)
    end = len(owners)
    for block in range(len(owners) - 1, -1, -1):
        if block + 1 < len(owners) and owners[block] != owners[block + 1]:
            end = block + 1
        ends[block] = end
    return ends


@compiled()
def _fill_up(q, filled):  # type: ignore[no-untyped-def]
    """Fills a block up with copies of its first point, without area."""
    for k in range(filled, BLOCK):
        q[0, k], q[1, k], q[2, k], q[3, k] = q[0, 0], q[1, 0], q[2, 0], 0.0


@compiled()
def _add_stand_in(  # type: ignore[no-untyped-def]
    kind, stretch, whitener, numbers, t, B, n, contact, q, scratch, b, powers, sums
):
    """Adds a stand-in and returns True, if it is accurate, and can't hold the least weight."""
    allowed = _PART_ERROR * mean_weight(kind, stretch, sums[contact])
    error = 0.0
    if kind == POSITION:
        error = gaussian_error(whitener, q, sums[contact, REFERENCE])
        if not error <= allowed:
            return False
    weigh(kind, whitener, numbers, t, B, n, contact, q, scratch, b)
    refer(kind, b, powers, sums, contact)
    if kind != POSITION:
        error = interpolation_error(b)
        if not error <= allowed:
            return False
        if stretch and least_between(b) - error < sums[contact, LEAST]:
            return False
    for k in range(BLOCK):
        sums[contact, ERROR] += error * q[3, k]
    add(b, q, sums, contact)
    return True
