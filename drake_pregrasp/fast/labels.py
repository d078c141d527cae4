"""Labels of candidates in compact blocks, whose bounding boxes decide whole blocks at once."""

import numpy as np

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.fast.blocks import Blocks
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.fast.predicates import (
    SHARED,
    any_positive,
    limits_of_block,
    near_obstacles,
    no_limits,
    shared_arrays,
)
from drake_pregrasp.regions.constraints import NO_CAUSE, Limit
from drake_pregrasp.regions.safe_regions import (
    NO_REGION,
    Labelled,
    RegionBounds,
    limit_of_cell,
)

_SLACK = 1e-12  # Share of its terms by which a half-space must clear a box to decide it.
_NONE, _NUM_LIMITS = int(Limit.NONE), len(Limit)
_NO_WALLS = np.empty((0, 0), dtype=bool)


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
def count_of(labels, size, label):  # type: ignore[no-untyped-def]
    """Returns how many of the first labels are that one."""
    count = 0
    for k in range(size):
        count += labels[k] == label
    return count


@compiled()
def write_slack(c, h, by_axis, bounds, largest, half_power, slack):  # type: ignore[no-untyped-def]
    """Writes what rounding may change, and returns the extent of what is compared, in metres.

    Args:
        c: Contacts, shape (n, d), in metres.
        h: Weights h_i, shape (n,), in m².
        by_axis: Normals of the half-spaces, shape (n, d, m), in metres.
        bounds: Their bounds, shape (n, m), in m².
        largest: Largest coordinate of the candidates, in metres.
        half_power: Result, (|c_i|² - h_i)/2, shape (n,), in m².
        slack: Result, the rounding of each half-space's test, shape (n, m), in m².
    """
    (n, d, m), extent = by_axis.shape, 0.0
    for i in range(n):
        square = 0.0
        for axis in range(d):
            square += c[i, axis] * c[i, axis]
            extent = max(extent, abs(c[i, axis]))
        half_power[i] = (square - h[i]) / 2.0  # Infinite for lost fingers.
    extent = 2.0 * max(extent, largest)
    for i in range(n):
        for j in range(m):
            size = 0.0
            for axis in range(d):
                size += abs(by_axis[i, axis, j])
            slack[i, j] = _SLACK * (abs(bounds[i, j]) + extent * size)
    return extent


@compiled(
    "Tuple((i8[::1], i8[::1], i8[::1], i8[:,:,::1]))"
    "(Tuple((f8[:,::1], f8[:,::1], i8[::1], i8[::1], f8[:,::1], f8)), f8[:,::1], f8[::1],"
    f" Tuple((f8[:,:,::1], f8[:,::1], i8[::1])), b1[:,::1], f8[:,::1], {SHARED}, b1[::1], i8)"
)
def label_blocks(  # type: ignore[no-untyped-def]
    blocks, c, h, half_spaces, same_side, contacts, shared, is_asked, num_keys
):
    """Returns labels and cells of the candidates, the sizes of regions, and counts for reasons.

    Loops run along one array at a time, so that the compiler makes vector instructions of them.

    Args:
        blocks: Attributes of `Blocks`: q, nhat, order, starts, boxes and largest.
        c: Contacts, shape (n, d), in metres.
        h: Weights h_i, shape (n,), in m²; -inf for lost fingers.
        half_spaces: Normals of the half-spaces, shape (n, d, m), in metres; their bounds for points
            relative to the contact, shape (n, m), in m²; key of each, shape (m,), which
            only counting uses. Half-spaces of one key are adjacent.
        same_side: Candidates that no wall hides from each contact, shape (n, N), or empty for all.
        contacts: Rows of the contacts, as in `Predicates`.
        shared: What the contacts share; see `shared_arrays`.
        is_asked: Mask of the contacts whose regions are asked for.
        num_keys: Number of keys; 0 to compute the regions. Otherwise it is counted how many
            candidates of the cell half-spaces and predicates exclude, by their keys.

    Returns:
        Labels; cells, which only counting writes, shape (N,) each; sizes, shape (n,); counts, shape
            (n, 2, `num_keys`).
    """
    (q, nhat, order, starts, boxes, largest), (solids, points, _, _, hand) = blocks, shared
    by_axis, bounds, keys = half_spaces
    n, d, m = by_axis.shape
    width, is_counting = num_keys // _NUM_LIMITS, num_keys > 0
    labels, cells = np.empty_like(order), np.empty_like(order)
    most = starts[-1] - starts[-2]  # Only the first block may have fewer candidates.
    owners, out = np.empty(most, np.int64), (np.empty(most, np.int64), np.empty(most, np.int64))
    sizes, counts = np.zeros(n, np.int64), np.zeros((n, 2, num_keys), np.int64)
    least, power, beyond = np.empty(most), np.empty(most), np.empty(most)
    over, reach, cutting = np.empty(max(m, len(points))), np.empty(m), np.empty(m + 1, np.int64)
    near_lists = np.empty(len(solids), np.int64), np.empty(len(points), np.int64)
    powers, which, everybody = np.empty(n), np.empty(n, np.int64), np.arange(n)
    half_power, slack = np.empty(n), np.empty((n, m))
    extent = write_slack(c, h, by_axis, bounds, largest, half_power, slack)
    for block in range(len(boxes)):
        start, stop, box = starts[block], starts[block + 1], boxes[block]
        places, size = order[start:stop], stop - start
        rivals = everybody
        if not same_side.size:  # A wall may hide the contact that is nearest to the box.
            rivals = which[: contenders(c, half_power, box, extent, powers, which)]
        own_cells(q, start, stop, c, half_power, same_side, places, owners, least, power, rivals)
        if is_counting:
            for k in range(size):
                cells[places[k]] = owners[k]
        for i in rivals:
            own = count_of(owners, size, i)
            if not is_asked[i] or own == 0:
                continue
            normals, contact = by_axis[i], contacts[i]
            count = cutting_half_spaces(
                normals, bounds[i], slack[i], c[i], box, over, reach, cutting, is_counting
            )
            is_limited = any_positive(hand[4]) or not no_limits(contact)
            if count == 0 and not (is_limited or len(solids) + len(points) > 0):
                sizes[i] += own
                continue
            beyond[:] = 0.0
            for number in range(count):
                j = cutting[number]
                exclude(normals, bounds[i], j, c[i], q, start, stop, power, beyond)
                is_last = number + 1 == count or keys[cutting[number + 1]] != keys[j]
                if is_counting and is_last:
                    for k in range(size):
                        counts[i, 0, keys[j]] += (owners[k] == i) & (beyond[k] > 0.0)
                        beyond[k] = 0.0
            for k in range(size):
                owners[k] = NO_REGION if (owners[k] == i) & (beyond[k] > 0.0) else owners[k]
            if is_limited or len(solids) + len(points) > 0:
                near = near_obstacles(contact, box, d, shared, near_lists, over)
                if is_limited or len(near[0]) + len(near[1]) > 0:
                    own_places = q, nhat, start, stop, owners
                    limits_of_block(i, contact, *own_places, shared, near, out, power)
                    if is_counting:
                        for k in range(size):
                            key = out[0][k] * width + out[1][k] + 1
                            counts[i, 1, key] += (owners[k] == i) & (out[0][k] != _NONE)
                    for k in range(size):
                        is_barred = (owners[k] == i) & (out[0][k] != _NONE)
                        owners[k] = NO_REGION if is_barred else owners[k]
            sizes[i] += count_of(owners, size, i)
        for k in range(size):
            labels[places[k]] = owners[k]
    return labels, cells, sizes, counts


class CompactCandidates(Blocks):
    """The candidates of a surface in compact blocks, and their labels; see `Blocks`."""

    def label(self, bounds: RegionBounds) -> Labelled:
        """Labels these candidates as `label_candidates` does.

        Raises:
            InvalidArgumentError: If the bounds are for another number of candidates or coordinates.
        """
        c, planes, predicates = bounds.c, bounds.half_spaces, bounds.predicates
        n = len(c)
        if (bounds.num_candidates, c.shape[1]) != self.q.shape[::-1]:
            raise InvalidArgumentError(
                f"{len(self.order)} candidates were expected, not {bounds.num_candidates}"
            )
        by_axis = np.ascontiguousarray(planes.normals.swapaxes(1, 2))
        seen = _NO_WALLS if bounds.same_side is None else np.array(bounds.same_side, dtype=bool)
        h = np.array(bounds.h, dtype=float, order="C")
        tests = seen, predicates.contacts, shared_arrays(predicates)
        blocks = self.q, self.nhat, self.order, self.starts, self.boxes, self.largest
        arguments = blocks, np.array(c, dtype=float, order="C"), h
        numbers, is_there = (by_axis, np.ascontiguousarray(planes.bounds)), h > -np.inf
        regions = label_blocks(*arguments, (*numbers, planes.causes), *tests, is_there, 0)
        labels, _, sizes, _ = regions
        limits, causes = np.full(n, int(Limit.NONE)), np.full(n, NO_CAUSE)
        is_tiny = is_there & (sizes < bounds.few)
        if is_tiny.any():
            width = 2 + n + len(predicates.solids) + len(predicates.points)  # Causes from -1 on.
            keys, num_keys = planes.limits * width + planes.causes + 1, len(Limit) * width
            regions = label_blocks(*arguments, (*numbers, keys), *tests, is_tiny, num_keys)
            cells, counts = regions[1], regions[3].max(axis=1)
            for i in np.flatnonzero(is_tiny).tolist():
                key = int(np.argmax(counts[i]))
                if counts[i, key] == 0 or np.count_nonzero(cells == i) < bounds.few:
                    limits[i], causes[i] = limit_of_cell(i, self.points, cells, bounds)
                else:
                    limits[i], causes[i] = key // width, key % width - 1
        return labels, limits, causes
