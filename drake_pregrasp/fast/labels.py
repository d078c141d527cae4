"""Labels of candidates in compact blocks, whose bounding boxes decide whole blocks at once."""

import math

import numpy as np

from drake_pregrasp.arrays import IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.fast.blocks import BLOCK, Blocks
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.fast.predicates import (
    SHARED,
    any_positive,
    limits_of_block,
    near_obstacles,
    no_limits,
    shared_arrays,
)
from drake_pregrasp.regions.constraints import NO_CAUSE, UNCONSTRAINED, Limit
from drake_pregrasp.regions.safe_regions import NO_REGION, RegionBounds

_SLACK = 1e-12  # Share of its terms by which a half-space must clear a box to decide it.
_NONE, _CROWDED, _WALL = int(Limit.NONE), int(Limit.CROWDED), int(Limit.WALL)
_NUM_LIMITS = len(Limit)


@compiled()
def contenders(c, half_power, box, extent, power, which):  # type: ignore[no-untyped-def]
    """Writes the contacts whose cells may have points in a box, and returns their number."""
    d, nearest, count = c.shape[1], 0, 0
    for i in range(len(c)):
        power[i] = half_power[i]
        for axis in range(d):
            power[i] -= c[i, axis] * box[axis]
        nearest = i if power[i] < power[nearest] else nearest
    for i in range(len(c)):
        least, size = power[i] - power[nearest], abs(half_power[i]) + abs(half_power[nearest])
        for axis in range(d):
            least -= abs(c[i, axis] - c[nearest, axis]) * box[d + axis]
        if half_power[i] < np.inf and not least > _SLACK * (size + d * extent * extent):
            which[count] = i
            count += 1
    return count


@compiled()
def own_cells(q, start, stop, c, half_power, same_side, places, owners, least, power, which):  # type: ignore[no-untyped-def]
    """Writes the contact whose cell each candidate of a block lies in, or `NO_REGION`."""
    x, y, z, size = q[0, start:stop], q[1, start:stop], q[2, start:stop], stop - start
    least[:size], owners[:size] = np.inf, NO_REGION
    if len(which) == 1 and not same_side.size:
        owners[:size] = which[0]
        return
    for i in which:
        cx, cy, cz, half = c[i, 0], c[i, 1], c[i, 2], half_power[i]
        for k in range(size):
            power[k] = half - (cx * x[k] + cy * y[k] + cz * z[k])
        for axis in range(3, len(q)):
            for k in range(size):
                power[k] -= c[i, axis] * q[axis, start + k]
        if same_side.size:
            for k in range(size):
                if not same_side[i, places[k]]:
                    power[k] = np.inf
        for k in range(size):
            is_less = power[k] < least[k]
            owners[k] = i if is_less else owners[k]
            least[k] = power[k] if is_less else least[k]


@compiled()
def cutting_half_spaces(normals, bounds, slack, c, box, over, reach, cutting, find_all):  # type: ignore[no-untyped-def]
    """Writes the indices of half-spaces that do not contain a whole box, and returns their number.

    Unless all are to be found, one that excludes the whole box is the only one.
    """
    d, nx, ny, nz = len(normals), normals[0], normals[1], normals[2]
    x, y, z = box[0] - c[0], box[1] - c[1], box[2] - c[2]
    hx, hy, hz = box[d], box[d + 1], box[d + 2]
    for j in range(len(bounds)):
        over[j] = nx[j] * x + ny[j] * y + nz[j] * z - bounds[j]
        reach[j] = abs(nx[j]) * hx + abs(ny[j]) * hy + abs(nz[j]) * hz
    for axis in range(3, d):
        for j in range(len(bounds)):
            over[j] += normals[axis, j] * (box[axis] - c[axis])
            reach[j] += abs(normals[axis, j]) * box[d + axis]
    count = 0
    for j in range(len(bounds)):
        if over[j] - reach[j] > slack[j] and not find_all:
            cutting[0] = j
            return 1
        cutting[count] = j
        count += over[j] + reach[j] > -slack[j]
    return count


@compiled()
def exclude(normals, bounds, j, c, q, start, stop, over, beyond):  # type: ignore[no-untyped-def]
    """Raises the largest excess of the points of a block over bounds to that over half-space j."""
    x, y, z = q[0, start:stop], q[1, start:stop], q[2, start:stop]
    a, b, d, bound = normals[0, j], normals[1, j], normals[2, j], bounds[j]
    cx, cy, cz = c[0], c[1], c[2]
    for k in range(stop - start):
        over[k] = a * (x[k] - cx) + b * (y[k] - cy) + d * (z[k] - cz)
    for axis in range(3, len(q)):
        for k in range(stop - start):
            over[k] += normals[axis, j] * (q[axis, start + k] - c[axis])
    for k in range(stop - start):
        beyond[k] = over[k] - bound if over[k] - bound > beyond[k] else beyond[k]


@compiled()
def limit_of_region(  # type: ignore[no-untyped-def]
    i, blocks, cells, c, same_side, few, half_spaces, contact, shared, scratch, lists, out
):
    """Returns the limit that leaves a contact a tiny region, and its cause, as the reference does.

    It counts the candidates of the cell that each limit excludes, in the blocks with such
    candidates only, by the half-spaces and obstacles that do not permit the whole block.
    The arguments are those of `label_blocks`, and its memory.
    """
    q, nhat, places, starts, boxes = blocks
    normals, bounds, slack, limits, causes = half_spaces
    solids, points, _, _, _ = shared
    width = 2 + len(c) + len(solids) + len(points)  # More than the largest cause.
    counts = np.zeros(_NUM_LIMITS * width, np.int64)  # By limit, then by cause, from -1 on.
    by_points, beyond = counts.copy(), np.empty(BLOCK)
    d, own, nearest, cell = len(q), 0, math.inf, NO_REGION
    nearest_place = -1
    for block in range(len(starts) - 1):
        start, stop = starts[block], starts[block + 1]
        here = 0
        for k in range(start, stop):
            here += cells[k] == i
        own += here
        if here < stop - start:
            for k in range(start, stop):
                if cells[k] != i:
                    square = 0.0
                    for axis in range(d):
                        square += (q[axis, k] - c[i, axis]) ** 2
                    if square < nearest or (square == nearest and places[k] < nearest_place):
                        nearest, cell, nearest_place = square, cells[k], places[k]
        if here == 0:
            continue
        cutting, near_lists = lists
        over, reach, power = scratch
        count = cutting_half_spaces(
            normals, bounds, slack, c[i], boxes[block], over, reach, cutting, True
        )
        before = -1
        for number in range(count + 1):
            key = -1
            if number < count:
                key = limits[cutting[number]] * width + causes[cutting[number]] + 1
            if key != before:
                if before >= 0:
                    for k in range(start, stop):
                        counts[before] += beyond[k - start] > 0.0 and cells[k] == i
                beyond[:] = 0.0
                before = key
            if number < count:
                j = cutting[number]
                exclude(normals, bounds, j, c[i], q, start, stop, power, beyond)
        box = box_of(boxes[block], d)
        near = near_obstacles(contact, box, shared, near_lists, over)
        limits_of_block(i, contact, q, nhat, start, stop, shared, near, out)
        for k in range(start, stop):
            if cells[k] == i:
                limit, cause = out[0][k - start], out[1][k - start]
                if limit != _NONE:
                    by_points[limit * width + cause + 1] += 1
    best, most = 0, 0
    for key in range(len(counts)):
        count = max(counts[key], by_points[key])
        if count > most:
            best, most = key, count
    if own < few or most == 0:
        hidden = same_side.size > 0 and nearest_place >= 0 and not same_side[i, nearest_place]
        return (_WALL, NO_CAUSE) if cell == NO_REGION or hidden else (_CROWDED, cell)
    return best // width, best % width - 1


@compiled()
def count_of(labels, size, label):  # type: ignore[no-untyped-def]
    """Returns how many of the first labels are that one."""
    count = 0
    for k in range(size):
        count += labels[k] == label
    return count


@compiled()
def box_of(row, d):  # type: ignore[no-untyped-def]
    """Returns midpoint, mean normal, and the radii of both, of a block's row of `boxes`."""
    return row[0], row[1], row[2], row[2 * d], row[2 * d + 1], row[2 * d + 2], row[-2], row[-1]


@compiled(
    "Tuple((i8[::1], i8[::1], i8[::1]))"
    "(Tuple((f8[:,::1], f8[:,::1], i8[::1], i8[::1], f8[:,::1])), f8[:,::1], f8[::1], f8,"
    " Tuple((f8[:,:,::1], f8[:,::1], i8[::1], i8[::1])), b1[:,::1], f8[:,::1],"
    f" {SHARED})"
)
def label_blocks(blocks, c, h, few, half_spaces, same_side, contacts, shared):  # type: ignore[no-untyped-def]
    """Returns labels in the order of the candidates, limits and causes, as `label_candidates`.

    Loops run along one array at a time, so that the compiler makes vector instructions of them.

    Args:
        blocks: Attributes of `Blocks`: q, nhat, order, starts and boxes.
        c: Contacts, shape (n, d), in metres.
        h: Weights h_i, shape (n,), in m²; -inf for lost fingers.
        few: Number of candidates below which a region is tiny.
        half_spaces: Normals of the half-spaces, shape (n, d, m), in metres; their bounds for points
            relative to the contact, shape (n, m), in m²; `Limit` and cause of each, shape (m,).
            Those of one limit and cause are adjacent.
        same_side: Candidates that no wall hides from each contact, shape (n, N), or empty for all.
        contacts: Rows of the contacts, as in `Predicates`.
        shared: What the contacts share; see `shared_arrays`.
    """
    (q, nhat, order, starts, boxes), (solids, points, _, _, hand) = blocks, shared
    by_axis, bounds, by_limit, by_cause = half_spaces
    n, d, m = by_axis.shape
    labels, cells = np.empty(q.shape[1], dtype=np.int64), np.empty(q.shape[1], dtype=np.int64)
    owners, sizes = np.empty(BLOCK, dtype=np.int64), np.zeros(n, dtype=np.int64)
    least, power, beyond = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    most = max(m, len(points))
    over, reach, cutting = np.empty(most), np.empty(most), np.empty(most + 1, dtype=np.int64)
    near_lists = np.empty(len(solids), np.int64), np.empty(len(points), np.int64)
    powers, which, everybody = np.empty(n), np.empty(n, dtype=np.int64), np.arange(n)
    out = np.empty(BLOCK, dtype=np.int64), np.empty(BLOCK, dtype=np.int64), power
    half_power, is_limited = np.empty(n), np.empty(n, dtype=np.bool_)
    extent, slack = 0.0, np.empty((n, m))
    for i in range(n):
        square = 0.0
        for axis in range(d):
            square += c[i, axis] * c[i, axis]
            extent = max(extent, abs(c[i, axis]))
        half_power[i] = (square - h[i]) / 2.0  # Infinite for lost fingers.
    for block in range(len(boxes)):
        for axis in range(d):
            extent = max(extent, abs(boxes[block, axis]) + boxes[block, d + axis])
    extent *= 2.0
    for i in range(n):
        is_limited[i] = any_positive(hand[4]) or not no_limits(contacts[i])
        for j in range(m):
            size = 0.0
            for axis in range(d):
                size += abs(by_axis[i, axis, j])
            slack[i, j] = _SLACK * (abs(bounds[i, j]) + extent * size)
    for block in range(len(boxes)):
        start, stop = starts[block], starts[block + 1]
        places, size = order[start:stop], stop - start
        rivals = everybody
        if not same_side.size:  # A wall may hide the contact that is nearest to the box.
            rivals = which[: contenders(c, half_power, boxes[block], extent, powers, which)]
        own_cells(q, start, stop, c, half_power, same_side, places, owners, least, power, rivals)
        for k in range(size):  # An assignment of a slice takes two seconds to compile.
            cells[start + k] = owners[k]
        for i in rivals:
            if count_of(owners, size, i) == 0:
                continue
            count = cutting_half_spaces(
                by_axis[i], bounds[i], slack[i], c[i], boxes[block], over, reach, cutting, False
            )
            beyond[:size] = 0.0
            for j in cutting[:count]:
                exclude(by_axis[i], bounds[i], j, c[i], q, start, stop, power, beyond)
            for k in range(size):
                owners[k] = NO_REGION if (owners[k] == i) & (beyond[k] > 0.0) else owners[k]
            left = count_of(owners, size, i)
            if left == 0 or not (is_limited[i] or len(solids) + len(points)):
                sizes[i] += left
                continue
            near = near_obstacles(contacts[i], box_of(boxes[block], d), shared, near_lists, over)
            if is_limited[i] or len(near[0]) + len(near[1]) > 0:
                limits_of_block(i, contacts[i], q, nhat, start, stop, shared, near, out)
                for k in range(size):
                    owners[k] = NO_REGION if (owners[k] == i) & (out[0][k] != _NONE) else owners[k]
            sizes[i] += count_of(owners, size, i)
        for k in range(size):
            labels[places[k]] = owners[k]
    limits, causes = np.full(n, _NONE), np.full(n, NO_CAUSE)
    for i in range(n):
        if sizes[i] < few and half_power[i] < np.inf:
            own = by_axis[i], bounds[i], slack[i], by_limit, by_cause
            scratch, lists = (over, reach, power), (cutting, near_lists)
            limits[i], causes[i] = limit_of_region(
                i, blocks, cells, c, same_side, few, own, contacts[i], shared, scratch, lists, out
            )
    return labels, limits, causes


class CompactCandidates(Blocks):
    """The candidates of a surface in compact blocks, and their labels; see `Blocks`."""

    def label(self, bounds: RegionBounds) -> tuple[IntArray, IntArray, IntArray]:
        """Returns labels, limits and causes, as `label_candidates` does for these candidates.

        Raises:
            InvalidArgumentError: If the bounds are for another number of candidates or coordinates.
        """
        c, planes, predicates = bounds.c, bounds.half_spaces, bounds.predicates
        if predicates is None:
            predicates = UNCONSTRAINED.predicates(len(c))
        by_axis = np.ascontiguousarray(planes.normals.swapaxes(1, 2))
        seen = np.empty((0, 0), dtype=bool) if bounds.same_side is None else bounds.same_side
        if (bounds.num_candidates, c.shape[1]) != self.q.shape[::-1]:
            raise InvalidArgumentError(
                f"{len(self.order)} candidates were expected, not {bounds.num_candidates}"
            )
        result: tuple[IntArray, IntArray, IntArray] = label_blocks(
            (self.q, self.nhat, self.order, self.starts, self.boxes),
            np.array(c, dtype=float, order="C"),
            np.array(bounds.h, dtype=float, order="C"),
            bounds.few,
            (by_axis, np.ascontiguousarray(planes.bounds), planes.limits, planes.causes),
            np.array(seen, dtype=bool, order="C"),
            predicates.contacts,
            shared_arrays(predicates),
        )
        return result
