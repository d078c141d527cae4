"""The interface of the kernels, and what both have in common."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.kernels.blocks import Blocks, make_blocks
from drake_pregrasp.kernels.ground import Ground
from drake_pregrasp.kernels.partition import Partition
from drake_pregrasp.kernels.triangles import nearest_on_triangles
from drake_pregrasp.kernels.weighting import Weighting


def check_finite(what: str, points: FloatArray) -> None:
    """Raises an InvalidArgumentError if points, shape (k, 3), aren't finite."""
    if not np.isfinite(points).all():
        row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise InvalidArgumentError(f"{what} must be finite, not {points[row]} as number {row} is")


class TickKernel(ABC):
    """Regions and centroids of one surface, tick after tick; made once.

    It can serve many planners. Between ticks it keeps the last partition, which it returns again
    if nothing has changed at all; results never depend on that.

    Args:
        p_OQ: Candidate points of Y, shape (N, 3), N >= 1, in metres.
        nhat_OQ: Outward unit normals there, shape (N, 3).
        areas: Surface area each candidate stands for, shape (N,), in m².
        p_OCoM: Centre of mass, shape (3,), in metres.
    """

    def __init__(
        self, p_OQ: FloatArray, nhat_OQ: FloatArray, areas: FloatArray, p_OCoM: FloatArray
    ) -> None:
        self._p_OCoM: FloatArray = np.array(p_OCoM, dtype=float)
        self.blocks: Blocks = make_blocks(p_OQ - p_OCoM, nhat_OQ, areas)
        self._last: tuple[tuple[bytes, ...], Partition] | None = None
        self._longest_arm = float(np.sqrt(np.max(np.sum(self.blocks.points**2, axis=0))))

    def partition(
        self, p_OC: FloatArray, h: FloatArray, p_OZ: FloatArray, radii: FloatArray
    ) -> Partition:
        """Divides the candidates into the contacts' safe regions (Eq. 1-2).

        What is returned may be returned again, and must not be written to.

        Args:
            p_OC: Contacts c_i, shape (n, 3), in metres.
            h: Their weights h_i, shape (n,), in m²; -inf for the lost.
            p_OZ: Forbidden points z_j, shape (m, 3), in metres.
            radii: R_j, shape (m,), in metres.

        Raises:
            InvalidArgumentError: If a contact isn't finite.
        """
        check_finite("contacts", p_OC)
        asked = (p_OC.tobytes(), h.tobytes(), p_OZ.tobytes(), radii.tobytes())
        last = self._last
        if last is not None and last[0] == asked:
            return last[1]
        partition = self._partition(p_OC - self._p_OCoM, h, p_OZ - self._p_OCoM, radii)
        self._last = asked, partition
        return partition

    def centroids(
        self, partition: Partition, p_OC: FloatArray, movers: IntArray, weighting: Weighting
    ) -> FloatArray:
        """Returns the centroids of Eq. 4 of some regions, shape (k, 3), in O, in metres.

        Each candidate counts with its weight and its area. Where all weights are zero it is the
        area alone.

        Args:
            partition: Of this kernel. Contacts with a region take part in the hand's measures.
            p_OC: Contacts, shape (n, 3), in metres.
            movers: Contacts whose centroids are asked for, shape (k,); none of an empty region.
            weighting: Of the candidates.

        Raises:
            InvalidArgumentError: If the partition is not of this kernel, or a region is empty.
        """
        if len(movers) == 0:
            return np.empty((0, 3))
        self._check_regions(partition, movers)
        r = p_OC - self._p_OCoM
        return self._centroids(partition, r, movers, weighting) + self._p_OCoM

    def project(self, points: FloatArray, ground: Ground) -> tuple[FloatArray, IntArray]:
        """Returns the nearest point of the ground to each of some points, and what it is on.

        Args:
            points: In O, shape (k, 3), in metres.
            ground: The candidates' patches.

        Returns:
            The nearest points, shape (k, 3), and the indices of the triangles they are on; of
            equals the first counts.

        Raises:
            InvalidArgumentError: If a point isn't finite.
        """
        check_finite("points", points)
        return self._project(points, ground)

    def _project(self, points: FloatArray, ground: Ground) -> tuple[FloatArray, IntArray]:
        return self.nearest_on_triangles(points, ground.near(points), ground.patches)

    def project_onto_regions(
        self, points: FloatArray, partition: Partition, contacts: IntArray, ground: Ground
    ) -> tuple[FloatArray, IntArray]:
        """Returns what `project` does, for each point on the ground of one region.

        Args:
            points: In O, shape (k, 3), in metres.
            partition: Of this kernel.
            contacts: For each point the contact whose region it is, shape (k,); none of an empty
                region.
            ground: The candidates' patches.

        Raises:
            InvalidArgumentError: If a point isn't finite, the partition is not of this kernel, or a
                region is empty.
        """
        check_finite("points", points)
        self._check_regions(partition, contacts)
        return self._project_onto_regions(points, partition, contacts, ground)

    def _project_onto_regions(
        self, points: FloatArray, partition: Partition, contacts: IntArray, ground: Ground
    ) -> tuple[FloatArray, IntArray]:
        labels = partition.labels_of_candidates()
        triangles = ground.near_in_regions(points, labels, contacts)
        return self.nearest_on_triangles(points, triangles, ground.patches)

    def weights(
        self,
        partition: Partition,
        p_OC: FloatArray,
        contact: int,
        weighting: Weighting,
        p_OP: FloatArray,
    ) -> FloatArray:
        """Returns the weights b of Eq. 3 or 5-7 at any points, not stretched, shape (k,).

        They are those that `centroids` sums up; those of the position are 1 at the centre of mass.

        Args:
            partition: Of this kernel. Contacts with a region take part in the hand's measures.
            p_OC: Contacts, shape (n, 3), in metres.
            contact: The one that moves to the points.
            weighting: Of the points.
            p_OP: Shape (k, 3), k >= 1, in O, in metres.
        """
        r, q = p_OC - self._p_OCoM, np.ascontiguousarray((p_OP - self._p_OCoM).T)
        return self._weights(partition, r, contact, weighting, q)

    def nearest_on_triangles(
        self, points: FloatArray, triangles: Sequence[IntArray], corners: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """Returns the nearest point to each of some points on its own triangles, and which it is.

        Args:
            points: In O, shape (k, 3), k >= 1, in metres.
            triangles: For each point the indices of one triangle or more; the first of equals
                counts.
            corners: Of all triangles, in O, shape (T, 3, 3), in metres.
        """
        return nearest_on_triangles(points, triangles, corners)

    def _check_regions(self, partition: Partition, contacts: IntArray) -> None:
        if partition.blocks is not self.blocks:
            raise InvalidArgumentError("the regions are of another surface, or of another kernel")
        if not (partition.sizes[contacts] > 0).all():
            empty = np.flatnonzero(partition.sizes == 0)
            raise InvalidArgumentError(f"the regions of contacts {empty} are empty")

    @abstractmethod
    def _partition(
        self, r: FloatArray, h: FloatArray, z: FloatArray, radii: FloatArray
    ) -> Partition: ...

    @abstractmethod
    def _centroids(
        self, partition: Partition, r: FloatArray, movers: IntArray, weighting: Weighting
    ) -> FloatArray: ...

    @abstractmethod
    def _weights(
        self,
        partition: Partition,
        r: FloatArray,
        contact: int,
        weighting: Weighting,
        q: FloatArray,
    ) -> FloatArray: ...
