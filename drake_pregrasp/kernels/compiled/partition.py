"""The tree search of Eq. 1 for numba: one contact after another, depth first."""

import numpy as np

from drake_pregrasp.kernels.compiled.compiling import compiled
from drake_pregrasp.kernels.partition import MIXED, NOBODY
from drake_pregrasp.kernels.sorting import BLOCK

_EMPTY = -1  # Where the planes leave nothing.


@compiled()
def divide(  # type: ignore[no-untyped-def]
    r,
    h,
    z,
    radii,
    longest_arm,
    share,
    points,
    starts,
    ends,
    skips,
    depths,
    centers,
    halves,
    shared,
    owners,
    labels,
):
    """Divides the blocks into the regions of all contacts, and returns the regions' sizes.

    Args:
        r: As for `region_planes`, and so the next three.
        h: Weights of the contacts.
        z: Forbidden points.
        radii: Theirs.
        longest_arm: Of the candidates, in metres.
        share: Of its terms, by which a plane must clear a box to decide it.
        points: As in `Blocks`.
        starts: As in `SearchTree`, and so the next six.
        ends: Of the nodes' places.
        skips: The nodes after theirs.
        depths: Of the nodes.
        centers: Midpoints of boxes.
        halves: Their half edges.
        shared: Blocks of more than one leaf.
        owners: As in `Partition`, written to.
        labels: As in `Partition`, written to.
    """
    for block in range(len(owners)):
        owners[block] = NOBODY
    for block in shared:
        owners[block] = MIXED
        labels[block] = NOBODY
    room = len(r) + len(z)
    normals, bounds, slack = np.empty((3, room)), np.empty(room), np.empty(room)
    deepest = 0
    for depth in depths:
        deepest = max(deepest, depth)
    planes = np.empty((deepest + 2, room), dtype=np.int64)
    counts = np.empty(deepest + 2, dtype=np.int64)
    outside = np.empty(BLOCK, dtype=np.bool_)
    sizes = np.zeros(len(r), dtype=np.int64)
    for contact in range(len(r)):
        if h[contact] == -np.inf:
            continue
        counts[0] = _write_planes(contact, r, h, z, radii, normals, bounds)
        for j in range(counts[0]):
            planes[0, j] = j
            size = abs(normals[0, j]) + abs(normals[1, j]) + abs(normals[2, j])
            slack[j] = share * (abs(bounds[j]) + size * longest_arm)
        node = 0
        while node < len(starts):
            depth = depths[node]
            kept = _cutting_planes(
                planes[depth],
                counts[depth],
                normals,
                bounds,
                slack,
                centers[node],
                halves[node],
                planes[depth + 1],
            )
            if kept == _EMPTY:
                node = skips[node]
            elif kept == 0:
                _give(contact, starts[node], ends[node], owners, labels)
                sizes[contact] += ends[node] - starts[node]
                node = skips[node]
            elif skips[node] > node + 1:
                counts[depth + 1] = kept
                node += 1
            else:
                sizes[contact] += _give_some(
                    contact,
                    normals,
                    bounds,
                    planes[depth + 1],
                    kept,
                    starts[node],
                    ends[node],
                    points,
                    outside,
                    owners,
                    labels,
                )
                node += 1
    return sizes


@compiled()
def _write_planes(contact, r, h, z, radii, normals, bounds):  # type: ignore[no-untyped-def]
    """Writes what `region_planes` returns, and returns how many planes there are."""
    cx, cy, cz = r[contact, 0], r[contact, 1], r[contact, 2]
    power = cx * cx + cy * cy + cz * cz - h[contact]
    j = 0
    for k in range(len(r)):
        if k == contact or h[k] == -np.inf:
            continue
        x, y, z_ = r[k, 0], r[k, 1], r[k, 2]
        normals[0, j], normals[1, j], normals[2, j] = x - cx, y - cy, z_ - cz
        bound = (x * x + y * y + z_ * z_ - h[k] - power) / 2
        bounds[j] = np.nextafter(bound, -np.inf) if k < contact else bound
        j += 1
    for k in range(len(z)):
        x, y, z_ = z[k, 0] - cx, z[k, 1] - cy, z[k, 2] - cz
        normals[0, j + k], normals[1, j + k], normals[2, j + k] = x, y, z_
        d = np.sqrt(x * x + y * y + z_ * z_)
        bounds[j + k] = x * cx + y * cy + z_ * cz + d * (d - radii[k])
    return j + len(z)


@compiled()
def _cutting_planes(  # type: ignore[no-untyped-def]
    asked, count, normals, bounds, slack, center, half, kept
):
    """Writes which planes cut a box, and returns their number, or `_EMPTY` if it is outside one."""
    cx, cy, cz, hx, hy, hz = center[0], center[1], center[2], half[0], half[1], half[2]
    size = 0
    for p in range(count):
        j = asked[p]
        nx, ny, nz = normals[0, j], normals[1, j], normals[2, j]
        over = nx * cx + ny * cy + nz * cz - bounds[j]
        reach = abs(nx) * hx + abs(ny) * hy + abs(nz) * hz
        if over - reach > slack[j]:
            return _EMPTY
        kept[size] = j
        size += over + reach > -slack[j]
    return size


@compiled()
def _give(contact, start, end, owners, labels):  # type: ignore[no-untyped-def]
    """Gives a contact a run of places: whole blocks, but those that are shared."""
    place = start
    while place < end:
        block = place // BLOCK
        stop = min(end, (block + 1) * BLOCK)
        if owners[block] == MIXED:
            for k in range(place, stop):
                labels[block, k - block * BLOCK] = contact
        else:
            owners[block] = contact
        place = stop


@compiled()
def _give_some(  # type: ignore[no-untyped-def]
    contact,
    normals,
    bounds,
    planes,
    count,
    start,
    end,
    points,
    outside,
    owners,
    labels,
):
    """Gives a contact the points of a leaf that are inside planes, and returns how many are."""
    block = start // BLOCK
    first, size = start - block * BLOCK, end - start
    x, y, z = points[0, start:end], points[1, start:end], points[2, start:end]
    for k in range(size):
        outside[k] = False
    for p in range(count):
        j = planes[p]
        nx, ny, nz, b = normals[0, j], normals[1, j], normals[2, j], bounds[j]
        for k in range(size):
            outside[k] |= nx * x[k] + ny * y[k] + nz * z[k] > b
    inside = 0
    for k in range(size):
        inside += not outside[k]
    if inside == BLOCK:
        owners[block] = contact
    elif inside > 0:
        if owners[block] != MIXED:
            owners[block] = MIXED
            labels[block] = NOBODY
        for k in range(size):
            if not outside[k]:
                labels[block, first + k] = contact
    return inside
