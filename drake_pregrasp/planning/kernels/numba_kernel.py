"""The kernel in code that numba compiles, once: the extra `[fast]`."""

from collections.abc import Sequence

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray, IntArray
from drake_pregrasp.planning.kernels.blocks import BLOCK
from drake_pregrasp.planning.kernels.compiled_centroids import sum_up
from drake_pregrasp.planning.kernels.compiled_partition import divide
from drake_pregrasp.planning.kernels.compiled_projection import project
from drake_pregrasp.planning.kernels.compiled_triangles import nearest_on_triangles
from drake_pregrasp.planning.kernels.ground import Ground
from drake_pregrasp.planning.kernels.numpy_kernel import SLACK
from drake_pregrasp.planning.kernels.partition import NOBODY, Partition
from drake_pregrasp.planning.kernels.tick_kernel import TickKernel
from drake_pregrasp.planning.kernels.weighting import KINDS, HandSums, Weighting, volume_numbers


class NumbaKernel(TickKernel):
    """Searches the tree depth first, and sums up weights block by block without storing them."""

    def nearest_on_triangles(
        self, points: FloatArray, triangles: Sequence[IntArray], corners: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """As of `TickKernel`."""
        ends = np.cumsum([len(own) for own in triangles])
        nearest: FloatArray
        nearest, which = nearest_on_triangles(points, ends, np.concatenate(triangles), corners)
        return nearest, which

    def project(self, points: FloatArray, ground: Ground) -> tuple[FloatArray, IntArray]:
        """As of `TickKernel`."""
        count = self.blocks.count
        everything = Partition(
            owners=np.zeros(count, dtype=np.int64),
            labels=np.empty((count, BLOCK), dtype=np.int16),
            sizes=np.array([self.blocks.num_candidates]),
            blocks=self.blocks,
        )
        owner = np.zeros(len(points), dtype=np.int64)
        return self.project_onto_regions(points, everything, owner, ground)

    def project_onto_regions(
        self, points: FloatArray, partition: Partition, contacts: IntArray, ground: Ground
    ) -> tuple[FloatArray, IntArray]:
        """As of `TickKernel`."""
        blocks = self.blocks
        nearest: FloatArray
        nearest, which = project(
            points,
            contacts,
            self._p_OCoM,
            blocks.order,
            blocks.points,
            blocks.centers,
            blocks.halves,
            blocks.starts,
            partition.owners,
            partition.labels,
            ground.patches,
            ground.patch_starts,
            ground.reach,
            ground.longest_edge,
        )
        return nearest, which

    def _partition(
        self, r: FloatArray, h: FloatArray, z: FloatArray, radii: FloatArray
    ) -> Partition:
        blocks = self.blocks
        owners = np.full(blocks.count, NOBODY, dtype=np.int64)
        labels = np.empty((blocks.count, BLOCK), dtype=np.int16)
        sizes = divide(
            r,
            h,
            z,
            radii,
            self._longest_arm,
            SLACK,
            blocks.points,
            blocks.centers,
            blocks.halves,
            blocks.starts,
            blocks.num_candidates - (blocks.count - 1) * BLOCK,
            owners,
            labels,
        )
        return Partition(owners, labels, sizes, blocks)

    def _centroids(
        self, partition: Partition, r: FloatArray, movers: IntArray, weighting: Weighting
    ) -> FloatArray:
        blocks = self.blocks
        sums = HandSums.none(len(r))
        if weighting.is_of_the_hand:
            sums = HandSums.over(r, partition.sizes > 0)
        numbers = volume_numbers(sums) if weighting.kind == "vew" else np.empty((len(r), 0))
        moves = np.zeros(len(r), dtype=bool)
        moves[movers] = True
        centroids: FloatArray = sum_up(
            KINDS.index(weighting.kind),
            weighting.stretch,
            moves,
            weighting.whitener(),
            numbers,
            sums.t,
            sums.B,
            sums.n,
            self._newton_steps(r),
            blocks.points,
            blocks.areas,
            partition.owners,
            partition.labels,
        )
        return centroids[movers]
