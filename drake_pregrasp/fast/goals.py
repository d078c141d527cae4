"""Goals of contacts: weighted centroids of safe regions, projected onto the regions' patches."""

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.fast.projection import CompiledSurface
from drake_pregrasp.fast.weights import KINDS, weighted_centroids
from drake_pregrasp.geometry.surface import ObjectSurface


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
        self._surface = CompiledSurface.of(surface)

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
        p_OC = centroids + self._p_OCoM
        return self._surface.project_into_regions(p_OC, contacts, labels)[0]
