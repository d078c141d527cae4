"""Projection onto the patches of a surface, or of some of its candidates, with compact blocks."""

import dataclasses
import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.fast.blocks import Blocks
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.geometry.sampling import unit_normals
from drake_pregrasp.geometry.surface import FLAT_CORNER, NO_DISTANCE, TIE, ObjectSurface

_ABOVE = 1 + 1e-9  # Bounds must not exclude the nearest point by rounding.
_FAR = 1e300  # Squared distance before the first triangle, in m².


@compiled()
def closest_point(p, corners, best, scratch):  # type: ignore[no-untyped-def]
    """Writes a triangle's point nearest to p, as `closest_points`; returns its squared distance.

    Args:
        p: Point, shape (3,), in metres.
        corners: Corners of the triangle, shape (3, 3), in metres.
        best: Nearest point, shape (3,), which is written.
        scratch: Memory, shape (6, 3); allocating it for each triangle would dominate the time.
    """
    least, edges, squares, along, offset = np.inf, scratch[:3], scratch[3], scratch[4], scratch[5]
    for k in range(3):
        squares[k] = along[k] = 0.0
        for axis in range(3):
            edges[k, axis] = corners[(k + 1) % 3, axis] - corners[k, axis]
            squares[k] += edges[k, axis] * edges[k, axis]
            along[k] += (p[axis] - corners[k, axis]) * edges[k, axis]
        share = min(max(along[k] / squares[k], 0.0), 1.0) if squares[k] > 0.0 else 0.0
        distance = 0.0
        for axis in range(3):
            offset[axis] = share * edges[k, axis] - (p[axis] - corners[k, axis])
            distance += offset[axis] * offset[axis]
        if distance < least:
            least = distance
            for axis in range(3):
                best[axis] = p[axis] + offset[axis]
    # The foot of the perpendicular is a + (v ab + w ac)/whole.
    c_a, bc = 0.0, 0.0
    for axis in range(3):
        c_a -= (p[axis] - corners[0, axis]) * edges[2, axis]
        bc -= edges[0, axis] * edges[2, axis]
    bb, cc, b_a = squares[0], squares[2], along[0]
    whole = bb * cc - bc * bc
    v, w = b_a * cc - c_a * bc, c_a * bb - b_a * bc
    if v > 0.0 and w > 0.0 and v + w < whole and whole > FLAT_CORNER * bb * cc:
        for axis in range(3):
            best[axis] = corners[0, axis] + (v * edges[0, axis] - w * edges[2, axis]) / whole
    least = 0.0
    for axis in range(3):
        least += (best[axis] - p[axis]) ** 2
    return least


@compiled(
    "Tuple((f8[:,::1], i8[::1]))"
    "(f8[:,::1], i8[::1], Array(i8, 1, 'C', readonly=True), f8[:,::1], i8[::1], i8[::1], f8[:,::1],"
    " f8[:,:,::1], i8[::1], f8[:,::1], f8)"
)
def projected(  # type: ignore[no-untyped-def]
    points, which, labels, q, order, starts, boxes, patches, patch_starts, balls, reach
):
    """Returns the nearest points on patches, shape (k, 3), and their triangles, shape (k,).

    Of triangles at the same distance but for rounding, the first one counts. A candidate is on its
    patch, so the nearest one bounds the distance; blocks, patches and triangles beyond it are left
    out.

    Args:
        points: Points, shape (k, 3), in metres.
        which: Label of the candidates that each point is projected onto, shape (k,).
        labels: Label of each candidate, shape (N,); empty if all points are for all of them.
        q: Candidates, each on its patch, shape (N, 3), in metres.
        order: Index of the candidate at each place of the blocks, shape (N,).
        starts: First place of each block, and N, shape (B + 1,).
        boxes: Midpoints and half edge lengths of the blocks, and more, shape (B, 11), in metres.
        patches: Triangles of the patches, shape (T, 3, 3), in metres.
        patch_starts: Index of each candidate's first triangle, and T, shape (N + 1,).
        balls: Centroids of the triangles and their corners' largest distances, shape (T, 4).
        reach: Largest distance of a patch's points from its candidate, in metres.
    """
    nearest, triangles = np.empty((len(points), 3)), np.full(len(points), -1)
    distances, point, scratch = np.empty(len(boxes)), np.empty(3), np.empty((6, 3))
    for k in range(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        first, bound, least = 0, np.inf, _FAR
        for block in range(len(boxes)):
            dx = max(abs(boxes[block, 0] - x) - boxes[block, 3], 0.0)
            dy = max(abs(boxes[block, 1] - y) - boxes[block, 4], 0.0)
            dz = max(abs(boxes[block, 2] - z) - boxes[block, 5], 0.0)
            distances[block] = dx * dx + dy * dy + dz * dz
            if distances[block] < distances[first]:
                first = block
        for turn in range(-1, len(boxes)):
            block = first if turn < 0 else turn
            if distances[block] < bound:
                for place in range(starts[block], starts[block + 1]):
                    j = order[place]
                    if labels.size == 0 or labels[j] == which[k]:
                        dx, dy, dz = q[j, 0] - x, q[j, 1] - y, q[j, 2] - z
                        bound = min(bound, dx * dx + dy * dy + dz * dz)
        bound = math.sqrt(bound) * _ABOVE
        beyond = (bound + reach) ** 2
        for block in range(len(boxes)):
            if distances[block] > beyond:
                continue
            for place in range(starts[block], starts[block + 1]):
                j = order[place]
                dx, dy, dz = q[j, 0] - x, q[j, 1] - y, q[j, 2] - z
                if dx * dx + dy * dy + dz * dz > beyond or (labels.size and labels[j] != which[k]):
                    continue
                for triangle in range(patch_starts[j], patch_starts[j + 1]):
                    dx, dy = balls[triangle, 0] - x, balls[triangle, 1] - y
                    dz, far = balls[triangle, 2] - z, bound + balls[triangle, 3]
                    if dx * dx + dy * dy + dz * dz > far * far:
                        continue
                    distance = closest_point(points[k], patches[triangle], point, scratch)
                    bound = min(bound, math.sqrt(distance) * _ABOVE + NO_DISTANCE)
                    slack = least * TIE + (2.0 * math.sqrt(least) + NO_DISTANCE) * NO_DISTANCE
                    is_first = distance <= least + slack and triangle < triangles[k]
                    if is_first or distance < least - slack:
                        triangles[k] = triangle
                        for axis in range(3):
                            nearest[k, axis] = point[axis]
                    least = min(least, distance)
    return nearest, triangles


class CompiledSurface(ObjectSurface):
    """An object's surface with a compiled projection."""

    @staticmethod
    def of(surface: ObjectSurface) -> "CompiledSurface":
        """Returns the same surface with a compiled projection."""
        if isinstance(surface, CompiledSurface):
            return surface
        fields = {f.name: getattr(surface, f.name) for f in dataclasses.fields(surface)}
        return CompiledSurface(**fields)

    @cached_property
    def blocks(self) -> Blocks:
        """The candidates in compact blocks."""
        return Blocks(self.p_OQ, self.nhat_OQ)

    @cached_property
    def _arrays(self) -> tuple[Any, ...]:
        centroids = np.mean(self.patches, axis=1)
        radii = np.max(np.linalg.norm(self.patches - centroids[:, None], axis=2), axis=1)
        return (
            np.array(self.p_OQ, dtype=float, order="C"),
            self.blocks.order,
            self.blocks.starts,
            self.blocks.boxes,
            np.array(self.patches, dtype=float, order="C"),
            np.array(self.patch_starts, dtype=np.int64),
            np.column_stack([centroids, _ABOVE * radii]),
            self.patch_reach,
        )

    @cached_property
    def _patch_normals(self) -> FloatArray:
        return unit_normals(self.patches)

    def project(self, p_OP: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `ObjectSurface`."""
        which = np.zeros(len(p_OP), dtype=np.int64)
        return self.project_into_regions(p_OP, which, np.empty(0, dtype=np.int64))

    def project_into(
        self, p_OP: FloatArray, candidates: Sequence[IntArray]
    ) -> tuple[FloatArray, FloatArray]:
        """See `ObjectSurface`."""
        if not all(map(len, candidates)):
            raise InvalidArgumentError("a point has no candidates to be projected onto")
        points, normals = np.empty((2, len(p_OP), 3))
        for k, own in enumerate(candidates):
            labels = np.zeros(len(self.p_OQ), dtype=np.int64)
            labels[own] = 1
            which, one = np.ones(1, dtype=np.int64), slice(k, k + 1)
            points[one], normals[one] = self.project_into_regions(p_OP[one], which, labels)
        return points, normals

    def project_into_regions(
        self, p_OP: FloatArray, which: IntArray, labels: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Projects each point onto the patches of the candidates with one label.

        Args:
            p_OP: Points in O, shape (k, 3), in metres.
            which: Label for each point, shape (k,).
            labels: Label of each candidate, shape (N,); or empty for all candidates.

        Returns:
            Points and normals; see `ObjectSurface.project`.

        Raises:
            InvalidArgumentError: If a point is not finite.
        """
        if not np.isfinite(p_OP).all():
            raise InvalidArgumentError(f"points must be finite, not {p_OP.tolist()}")
        points = np.array(p_OP, dtype=float, order="C")
        nearest, triangles = projected(points, which, labels, *self._arrays)
        return nearest, self._patch_normals[triangles]
