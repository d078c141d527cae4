"""Compiled distances from the grid of a mesh."""

import math
from dataclasses import replace

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.geometry.distance_grid import TIE, DistanceGrid
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.geometry.solids import SignedDistance


@compiled()
def write_distance(nodes, counts, low, cell, q, first, share, found):  # type: ignore[no-untyped-def]
    """Writes signed distance and unit gradient at a point, as `DistanceGrid.at`.

    Args:
        nodes: `DistanceGrid.nodes`, shape (N, 4).
        counts: `DistanceGrid.counts`, shape (3,).
        low: `DistanceGrid.low`, shape (3,), in metres.
        cell: `DistanceGrid.cell`, in metres.
        q: The point, shape (3,), in metres.
        first: Memory, shape (3,).
        share: Memory, shape (3,).
        found: Result, shape (4,).
    """
    off = 0.0
    for axis in range(3):
        place = (q[axis] - low[axis]) / cell
        within = min(max(place, 0.0), counts[axis] - 1.0)
        off = max(off, abs(within - place))
        first[axis] = min(int(within), counts[axis] - 2)
        share[axis] = within - first[axis]
    found[:] = 0.0
    if off <= TIE / cell:
        for i in range(2):
            for j in range(2):
                for k in range(2):
                    x = share[0] if i else 1 - share[0]
                    y = share[1] if j else 1 - share[1]
                    z = share[2] if k else 1 - share[2]
                    node = ((first[0] + i) * counts[1] + first[1] + j) * counts[2] + first[2] + k
                    for part in range(4):
                        found[part] += x * y * z * nodes[node, part]
        length = max(math.sqrt(found[1] ** 2 + found[2] ** 2 + found[3] ** 2), 1e-9)
        for part in range(1, 4):
            found[part] /= length
        return
    nearest = np.inf
    for i in range(2):
        for j in range(2):
            for k in range(2):
                node = ((first[0] + i) * counts[1] + first[1] + j) * counts[2] + first[2] + k
                d = nodes[node, 0]
                x = q[0] - (low[0] + cell * (first[0] + i) - d * nodes[node, 1])
                y = q[1] - (low[1] + cell * (first[1] + j) - d * nodes[node, 2])
                z = q[2] - (low[2] + cell * (first[2] + k) - d * nodes[node, 3])
                length = math.sqrt(x * x + y * y + z * z)
                if length < nearest:
                    nearest = length
                    found[0], found[1], found[2], found[3] = length, x, y, z
    for part in range(1, 4):
        found[part] /= nearest


@compiled("void(f8[:,::1], i8[::1], f8[::1], f8, f8[:,::1], f8[:,::1])")
def write_distances(nodes, counts, low, cell, points, found):  # type: ignore[no-untyped-def]
    """Writes signed distances and unit gradients at points, NaN where these are not finite.

    Args:
        nodes: As in `write_distance`, here and in the next three.
        counts: Numbers of nodes.
        low: First node.
        cell: Edge length of a cell.
        points: The points, shape (k, 3), in metres.
        found: Result, shape (k, 4).
    """
    first, share = np.empty(3, dtype=np.int64), np.empty(3)
    for k in range(len(points)):
        q = points[k]
        if math.isfinite(q[0]) and math.isfinite(q[1]) and math.isfinite(q[2]):
            write_distance(nodes, counts, low, cell, q, first, share, found[k])
        else:
            found[k] = np.nan


class CompiledGrid(DistanceGrid):
    """A distance grid whose `at` is compiled."""

    def at(self, p_MP: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `DistanceGrid.at`."""
        found = np.empty((len(p_MP), 4))
        points = np.ascontiguousarray(p_MP)
        write_distances(self.nodes, self.counts, self.low, self.cell, points, found)
        return found[:, 0], found[:, 1:]


def compiled_solid(solid: SignedDistance) -> SignedDistance:
    """Returns the same solid, whose distances are compiled if it is a mesh."""
    if not isinstance(solid, MeshSolid):
        return solid
    grid = solid.surface
    return replace(solid, surface=CompiledGrid(grid.low, grid.cell, grid.counts, grid.nodes))
