"""Goals of contacts: weighted centroids of safe regions, projected onto the regions' patches."""

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.fast.labels import compiled
from drake_pregrasp.fast.weights import KINDS, weighted_centroids
from drake_pregrasp.geometry.surface import FLAT_CORNER, ObjectSurface


@compiled()
def closest_point(p, corners, best, scratch):  # type: ignore[no-untyped-def]
    """Writes a triangle's point nearest to p, as `closest_points`; returns its squared distance.

    Args:
        p: Point, shape (3,), in metres.
        corners: Corners of the triangle, shape (3, 3), in metres.
        best: Nearest point, shape (3,), which is written.
        scratch: Memory, shape (5, 3); allocating it for each triangle would dominate the time.
    """
    least, edges, squares, along = np.inf, scratch[:3], scratch[3], scratch[4]
    for k in range(3):
        squares[k] = along[k] = 0.0
        for axis in range(3):
            edges[k, axis] = corners[(k + 1) % 3, axis] - corners[k, axis]
            squares[k] += edges[k, axis] * edges[k, axis]
            along[k] += (p[axis] - corners[k, axis]) * edges[k, axis]
        share = min(max(along[k] / squares[k], 0.0), 1.0) if squares[k] > 0.0 else 0.0
        distance = 0.0
        for axis in range(3):
            distance += (share * edges[k, axis] - (p[axis] - corners[k, axis])) ** 2
        if distance < least:
            least = distance
            for axis in range(3):
                best[axis] = corners[k, axis] + share * edges[k, axis]
    # The foot of the perpendicular is a + (v ab + w ac)/whole.
    c_a, bc = 0.0, 0.0
    for axis in range(3):
        c_a -= (p[axis] - corners[0, axis]) * edges[2, axis]
        bc -= edges[0, axis] * edges[2, axis]
    bb, cc, b_a = squares[0], squares[2], along[0]
    whole = bb * cc - bc * bc
    v, w = b_a * cc - c_a * bc, c_a * bb - b_a * bc
    if v > 0.0 and w > 0.0 and v + w < whole and whole > FLAT_CORNER * bb * cc:
        least = 0.0
        for axis in range(3):
            best[axis] = corners[0, axis] + (v * edges[0, axis] - w * edges[2, axis]) / whole
            least += (best[axis] - p[axis]) ** 2
    return least


@compiled("f8[:,::1](f8[:,::1], i8[::1], i8[::1], f8[:,::1], f8[:,:,::1], i8[::1], f8)")
def projected(points, contacts, labels, q, patches, patch_starts, reach):  # type: ignore[no-untyped-def]
    """Returns the nearest points on the patches of the contacts' regions, shape (k, 3).

    Args:
        points: Point of each contact, shape (k, 3), in metres.
        contacts: Indices of the contacts, shape (k,).
        labels: Region of each candidate, shape (N,).
        q: Candidates, each on its patch, shape (N, 3), in metres.
        patches: Triangles of the patches, shape (T, 3, 3), in metres.
        patch_starts: Index of each candidate's first triangle, and T, shape (N + 1,).
        reach: Largest distance of a patch's points from its candidate, in metres.
    """
    place = np.full(max(contacts.max(), labels.max()) + 1, -1)
    place[contacts] = np.arange(len(contacts))
    nearest, away = np.empty((len(points), 3)), np.empty(len(q))
    bounds, least = np.full(len(points), np.inf), np.full(len(points), np.inf)
    point, scratch = np.empty(3), np.empty((5, 3))
    for j in range(len(q)):
        if labels[j] >= 0 and place[labels[j]] >= 0:
            k = place[labels[j]]
            x, y, z = q[j, 0] - points[k, 0], q[j, 1] - points[k, 1], q[j, 2] - points[k, 2]
            away[j] = x * x + y * y + z * z
            bounds[k] = min(bounds[k], away[j])
    bounds = (np.sqrt(bounds) + reach) ** 2
    for j in range(len(q)):
        if labels[j] < 0 or place[labels[j]] < 0:
            continue
        k = place[labels[j]]
        if away[j] <= bounds[k]:
            for triangle in range(patch_starts[j], patch_starts[j + 1]):
                distance = closest_point(points[k], patches[triangle], point, scratch)
                if distance < least[k]:
                    least[k] = distance
                    nearest[k] = point
    return nearest


class CompiledGoals:
    """Goals of contacts on one surface: a `GoalFunction`.

    Args:
        surface: The object's surface.
        strategy: One of `KINDS`.
        stretch: Whether to subtract a region's smallest weight; `position` ignores it.
    """

    def __init__(self, surface: ObjectSurface, strategy: str, *, stretch: bool) -> None:
        self._kind = KINDS.index(strategy)
        self._stretch = stretch and strategy != "position"
        self._p_OCoM = surface.p_OCoM
        self._q = np.array(surface.p_OQ - surface.p_OCoM, dtype=float, order="C")
        self._areas = np.array(surface.areas, dtype=float)
        self._patches = np.array(surface.patches - surface.p_OCoM, dtype=float, order="C")
        self._patch_starts = np.array(surface.patch_starts, dtype=np.int64)
        self._reach = surface.patch_reach

    def __call__(self, selection: SelectionInput, contacts: IntArray) -> FloatArray:
        """Returns the goals, shape (k, 3), in O, in metres, as `region_goals` does.

        Args:
            selection: Surface, contacts, regions and estimate of this tick.
            contacts: Indices of k contacts whose regions are not empty, shape (k,).
        """
        contacts = np.array(contacts, dtype=np.int64)
        labels = np.array(selection.regions.labels, dtype=np.int64)
        centroids = weighted_centroids(
            self._kind,
            self._stretch,
            contacts,
            labels,
            np.array(selection.active, dtype=bool),
            np.array(selection.p_OC - self._p_OCoM, dtype=float, order="C"),
            np.linalg.inv(selection.covariance_O),
            self._q,
            self._areas,
        )
        goals: FloatArray = projected(
            centroids, contacts, labels, self._q, self._patches, self._patch_starts, self._reach
        )
        return goals + self._p_OCoM
