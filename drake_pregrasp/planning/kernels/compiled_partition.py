"""The tree search of Eq. 1 for numba: one contact after another, depth first."""

import numba
import numpy as np

from drake_pregrasp.planning.kernels.blocks import BLOCK, FAN
from drake_pregrasp.planning.kernels.partition import MIXED, NOBODY


@numba.njit(cache=True, error_model="numpy")
def divide(  # type: ignore[no-untyped-def]
    r, h, z, radii, longest_arm, share, points, centers, halves, starts, filled, owners, labels
):
    """Divides the blocks into the regions of all contacts, and returns the regions' sizes.

    Args:
        r: As for `region_planes`, and so the next three.
        h: Weights of the contacts.
        z: Forbidden points.
        radii: Theirs.
        longest_arm: Of the candidates, in metres.
        share: Of its terms, by which a plane must clear a box to decide it.
        points: As in `Blocks`, and so the next three.
        centers: Midpoints of boxes.
        halves: Their half edges.
        starts: Of the tree's levels.
        filled: Points in the last block that are no padding.
        owners: As in `Partition`, written to; `NOBODY` at first.
        labels: As in `Partition`, written to.
    """
    normals = np.empty((len(r) - 1 + len(z), 3))
    bounds, slack = np.empty(len(normals)), np.empty(len(normals))
    for contact in range(len(r)):
        if h[contact] == -np.inf:
            continue
        k = _write_planes(contact, r, h, z, radii, normals, bounds)
        for j in range(k):
            size = abs(normals[j, 0]) + abs(normals[j, 1]) + abs(normals[j, 2])
            slack[j] = share * (abs(bounds[j]) + size * longest_arm)
        search_tree(
            contact,
            normals[:k],
            bounds[:k],
            slack,
            points,
            centers,
            halves,
            starts,
            owners,
            labels,
        )
    sizes = np.zeros(len(r), dtype=np.int64)
    settle(filled, owners, labels, sizes)
    return sizes


@numba.njit(cache=True, error_model="numpy")
def _write_planes(contact, r, h, z, radii, normals, bounds):  # type: ignore[no-untyped-def]
    """Writes what `region_planes` returns, and returns how many planes there are."""
    cx, cy, cz = r[contact, 0], r[contact, 1], r[contact, 2]
    power = cx * cx + cy * cy + cz * cz - h[contact]
    j = 0
    for k in range(len(r)):
        if k == contact or h[k] == -np.inf:
            continue
        x, y, z_ = r[k, 0], r[k, 1], r[k, 2]
        normals[j, 0], normals[j, 1], normals[j, 2] = x - cx, y - cy, z_ - cz
        bound = (x * x + y * y + z_ * z_ - h[k] - power) / 2
        bounds[j] = np.nextafter(bound, -np.inf) if k < contact else bound
        j += 1
    for k in range(len(z)):
        x, y, z_ = z[k, 0] - cx, z[k, 1] - cy, z[k, 2] - cz
        normals[j, 0], normals[j, 1], normals[j, 2] = x, y, z_
        d = np.sqrt(x * x + y * y + z_ * z_)
        bounds[j] = x * cx + y * cy + z_ * cz + d * (d - radii[k])
        j += 1
    return j


@numba.njit(cache=True, error_model="numpy")
def search_tree(  # type: ignore[no-untyped-def]
    contact, normals, bounds, slack, points, centers, halves, starts, owners, labels
):
    """Gives a contact the blocks and points inside all its planes.

    On the way down a node keeps the planes that cut its box, and hands on only those.

    Args:
        contact: Its index.
        normals: Of its planes n·q <= b, shape (k, 3).
        bounds: b, shape (k,).
        slack: By which a box must be clear of each plane to be decided, shape (k,).
        points: As in `Blocks`, and so the next three.
        centers: Midpoints of boxes.
        halves: Their half edges.
        starts: Of the tree's levels.
        owners: As in `Partition`, written to.
        labels: As in `Partition`, written to.
    """
    depth_of_blocks = len(starts) - 2
    planes = np.empty((depth_of_blocks + 2, len(bounds)), dtype=np.int64)
    counts = np.empty(depth_of_blocks + 2, dtype=np.int64)
    node = np.zeros(depth_of_blocks + 1, dtype=np.int64)
    end = np.zeros(depth_of_blocks + 1, dtype=np.int64)
    outside = np.empty(BLOCK, dtype=np.bool_)
    for j in range(len(bounds)):
        planes[0, j] = j
    counts[0] = len(bounds)
    end[0] = starts[1]
    depth = 0
    while depth >= 0:
        a = node[depth]
        if a == end[depth]:
            depth -= 1
            continue
        node[depth] += 1
        k = starts[depth] + a
        kept = 0
        misses = False
        for p in range(counts[depth]):
            j = planes[depth, p]
            nx, ny, nz = normals[j, 0], normals[j, 1], normals[j, 2]
            over = nx * centers[k, 0] + ny * centers[k, 1] + nz * centers[k, 2] - bounds[j]
            reach = abs(nx) * halves[k, 0] + abs(ny) * halves[k, 1] + abs(nz) * halves[k, 2]
            if over - reach > slack[j]:
                misses = True
                break
            if over + reach > -slack[j]:
                planes[depth + 1, kept] = j
                kept += 1
        if misses:
            continue
        if kept == 0:
            width = FAN ** (depth_of_blocks - depth)
            for block in range(a * width, min((a + 1) * width, len(owners))):
                owners[block] = contact
        elif depth < depth_of_blocks:
            counts[depth + 1] = kept
            depth += 1
            node[depth] = a * FAN
            end[depth] = min((a + 1) * FAN, starts[depth + 1] - starts[depth])
        else:
            _ask_points(normals, bounds, planes[depth + 1, :kept], points, a, outside)
            if owners[a] != MIXED:
                owners[a] = MIXED
                for place in range(BLOCK):
                    labels[a, place] = NOBODY
            for place in range(BLOCK):
                if not outside[place]:
                    labels[a, place] = contact


@numba.njit(cache=True, error_model="numpy")
def _ask_points(normals, bounds, planes, points, block, outside):  # type: ignore[no-untyped-def]
    x = points[0, block * BLOCK : (block + 1) * BLOCK]
    y = points[1, block * BLOCK : (block + 1) * BLOCK]
    z = points[2, block * BLOCK : (block + 1) * BLOCK]
    outside[:] = False
    for j in planes:
        nx, ny, nz, b = normals[j, 0], normals[j, 1], normals[j, 2], bounds[j]
        for place in range(BLOCK):
            outside[place] |= nx * x[place] + ny * y[place] + nz * z[place] > b


@numba.njit(cache=True)
def settle(filled, owners, labels, sizes):  # type: ignore[no-untyped-def]
    """Takes the padding out of the last block, and counts the regions' candidates.

    Args:
        filled: Points in the last block that are no padding.
        owners: As in `Partition`, written to.
        labels: As in `Partition`, written to.
        sizes: As in `Partition`, zeros that are added to.
    """
    last = len(owners) - 1
    if filled < BLOCK:
        if owners[last] != MIXED:
            for place in range(filled):
                labels[last, place] = owners[last]
            owners[last] = MIXED
        for place in range(filled, BLOCK):
            labels[last, place] = NOBODY
    for block in range(len(owners)):
        owner = owners[block]
        if owner >= 0:
            sizes[owner] += BLOCK
        elif owner == MIXED:
            for place in range(BLOCK):
                label = labels[block, place]
                if label >= 0:
                    sizes[label] += 1
