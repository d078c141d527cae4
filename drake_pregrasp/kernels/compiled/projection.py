"""The projection onto regions for numba: nearest boxes first."""

import numpy as np

from drake_pregrasp.kernels.blocks import FAN
from drake_pregrasp.kernels.compiled.compiling import compiled
from drake_pregrasp.kernels.compiled.triangles import closest
from drake_pregrasp.kernels.partition import MIXED
from drake_pregrasp.kernels.sorting import BLOCK


@compiled()
def project(  # type: ignore[no-untyped-def]
    points,
    contacts,
    p_OCoM,
    order,
    block_points,
    centers,
    halves,
    starts,
    owners,
    labels,
    patches,
    patch_starts,
    reach,
    longest_edge,
):
    """Returns what `TickKernel.project_onto_regions` does.

    A box is left out if its ground is farther away than the nearest point so far, and a candidate's
    triangles likewise: they reach no farther from it than the ground's reach. Candidates are on the
    ground themselves, and so are a first bound.

    Args:
        points: In O, shape (k, 3), in metres.
        contacts: Whose region each is projected onto, shape (k,).
        p_OCoM: Centre of mass in O, shape (3,), in metres.
        order: As in `Blocks`, and so the next four.
        block_points: Its points.
        centers: Midpoints of boxes.
        halves: Their half edges.
        starts: Of the tree's levels.
        owners: As in `Partition`.
        labels: As in `Partition`.
        patches: As in `Ground`, and so the next three.
        patch_starts: Where the candidates' begin.
        reach: Of patches.
        longest_edge: Of triangles.
    """
    depth_of_blocks = len(starts) - 2
    nearest, chosen = np.full((len(points), 3), np.nan), np.full(len(points), -1)
    stack = np.empty((FAN * (depth_of_blocks + 1) + starts[1], 2), dtype=np.int64)
    least_of, distances = np.empty(len(stack)), np.empty(BLOCK)
    for k in range(len(points)):
        p = points[k]
        x, y, z = p[0] - p_OCoM[0], p[1] - p_OCoM[1], p[2] - p_OCoM[2]
        least = bound = np.inf  # Of triangles, and of whatever is known to be on the ground.
        top = _push(0, 0, starts[1], x, y, z, 0, centers, halves, stack, least_of)
        while top > 0:
            top -= 1
            if least_of[top] > bound + reach:
                continue
            depth, a = stack[top]
            if depth < depth_of_blocks:
                first, last = a * FAN, min((a + 1) * FAN, starts[depth + 2] - starts[depth + 1])
                top = _push(
                    depth + 1,
                    first,
                    last,
                    x,
                    y,
                    z,
                    top,
                    centers[starts[depth + 1] :],
                    halves[starts[depth + 1] :],
                    stack,
                    least_of,
                )
                continue
            if owners[a] != contacts[k] and owners[a] != MIXED:
                continue
            first, last = a * BLOCK, min((a + 1) * BLOCK, len(order))
            for place in range(first, last):
                dx = block_points[0, place] - x
                dy = block_points[1, place] - y
                dz = block_points[2, place] - z
                away = np.sqrt(dx * dx + dy * dy + dz * dz)
                if owners[a] == MIXED and labels[a, place - first] != contacts[k]:
                    away = np.inf
                distances[place - first] = away
                bound = min(bound, away)
            for place in range(first, last):
                away = distances[place - first]
                if away == np.inf or away > bound + reach:
                    continue
                q = order[place]
                for j in range(patch_starts[q], patch_starts[q + 1]):
                    if _distance(p, patches[j, 0]) > bound + longest_edge:
                        continue
                    u, v, w = closest(p, patches[j])
                    away = _distance(p, (u, v, w))
                    bound = min(bound, away)
                    if away < least or (away == least and j < chosen[k]):
                        least, chosen[k] = away, j
                        nearest[k, 0], nearest[k, 1], nearest[k, 2] = u, v, w
    return nearest, chosen


@compiled()
def _distance(p, q):  # type: ignore[no-untyped-def]
    return np.sqrt((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2)


@compiled()
def _push(  # type: ignore[no-untyped-def]
    depth, first, last, x, y, z, top, centers, halves, stack, least_of
):
    """Puts some nodes of a level on the stack, the nearest uppermost, and returns its height."""
    bottom = top
    for a in range(first, last):
        dx = max(0.0, abs(x - centers[a, 0]) - halves[a, 0])
        dy = max(0.0, abs(y - centers[a, 1]) - halves[a, 1])
        dz = max(0.0, abs(z - centers[a, 2]) - halves[a, 2])
        least = np.sqrt(dx * dx + dy * dy + dz * dz)
        place = top
        while place > bottom and least_of[place - 1] < least:
            least_of[place] = least_of[place - 1]
            stack[place, 0], stack[place, 1] = stack[place - 1, 0], stack[place - 1, 1]
            place -= 1
        least_of[place] = least
        stack[place, 0], stack[place, 1] = depth, a
        top += 1
    return top
