"""The kernel in code that numba compiles, once: the extra `[fast]`."""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.kernels.compiled.centroids import centroids_of
from drake_pregrasp.kernels.compiled.partition import divide
from drake_pregrasp.kernels.compiled.point_weights import weights_of
from drake_pregrasp.kernels.compiled.projection import project
from drake_pregrasp.kernels.compiled.triangles import nearest_on_triangles
from drake_pregrasp.kernels.ground import Ground
from drake_pregrasp.kernels.numpy_kernel import SLACK
from drake_pregrasp.kernels.partition import Partition
from drake_pregrasp.kernels.search_tree import make_search_tree
from drake_pregrasp.kernels.sorting import BLOCK
from drake_pregrasp.kernels.stand_ins import make_stand_ins
from drake_pregrasp.kernels.tick_kernel import TickKernel
from drake_pregrasp.kernels.weighting import KINDS, Weighting


def plain(array: FloatArray) -> FloatArray:
    """Returns a copy of the one kind that functions are compiled for.

    To numba, arrays of another order, or that may not be written to, are of another type, and a
    tick that met the first of them would wait seconds for the compiler.
    """
    return np.array(array, dtype=float, order="C")


class NumbaKernel(TickKernel):
    """Searches the tree depth first, and sums up weights block by block without storing them."""

    def __init__(
        self, p_OQ: FloatArray, nhat_OQ: FloatArray, areas: FloatArray, p_OCoM: FloatArray
    ) -> None:
        super().__init__(p_OQ, nhat_OQ, areas, p_OCoM)
        self._tree = make_search_tree(self.blocks)
        s = make_stand_ins(self.blocks, self._tree)
        self._stand_ins = s.firsts, s.ends, s.skips, s.grids
        places = np.vstack([self.blocks.points, self.blocks.areas])
        self._packs = np.ascontiguousarray(places.reshape(4, -1, BLOCK).swapaxes(0, 1))

    @staticmethod
    def is_compiled() -> bool:
        """Returns whether compiled code is there already, on disk or in this process."""
        folder = divide.stats.cache_path
        kept = folder is not None and any(Path(folder).glob(f"*.{divide.__name__}-*.nbi"))
        return kept or bool(divide.signatures)

    def nearest_on_triangles(
        self, points: FloatArray, triangles: Sequence[IntArray], corners: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """As of `TickKernel`."""
        ends = np.cumsum([len(own) for own in triangles])
        nearest: FloatArray
        nearest, which = nearest_on_triangles(
            plain(points), ends, np.concatenate(triangles), corners
        )
        return nearest, which

    @cached_property
    def _everything(self) -> Partition:
        """The partition in which the first contact has all there is."""
        count = self.blocks.count
        return Partition(
            owners=np.zeros(count, dtype=np.int64),
            labels=np.empty((count, BLOCK), dtype=np.int16),
            sizes=np.array([self.blocks.num_candidates]),
            blocks=self.blocks,
        )

    def _project(self, points: FloatArray, ground: Ground) -> tuple[FloatArray, IntArray]:
        first = np.zeros(len(points), dtype=np.int64)
        return self._project_onto_regions(points, self._everything, first, ground)

    def _project_onto_regions(
        self, points: FloatArray, partition: Partition, contacts: IntArray, ground: Ground
    ) -> tuple[FloatArray, IntArray]:
        blocks = self.blocks
        nearest: FloatArray
        nearest, which = project(
            plain(points),
            np.array(contacts, dtype=np.int64),
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
        blocks, tree = self.blocks, self._tree
        owners = np.empty(blocks.count, dtype=np.int64)
        labels = np.empty((blocks.count, BLOCK), dtype=np.int16)
        sizes = divide(
            plain(r),
            plain(h),
            plain(z),
            plain(radii),
            self._longest_arm,
            SLACK,
            blocks.points,
            tree.starts,
            tree.ends,
            tree.skips,
            tree.depths,
            tree.centers,
            tree.halves,
            tree.shared,
            owners,
            labels,
        )
        return Partition(owners, labels, sizes, blocks)

    def _centroids(
        self, partition: Partition, r: FloatArray, movers: IntArray, weighting: Weighting
    ) -> FloatArray:
        centroids: FloatArray = centroids_of(
            KINDS.index(weighting.kind),
            weighting.stretch,
            np.array(movers, dtype=np.int64),
            plain(r),
            partition.sizes,
            plain(weighting.covariance),
            self._packs,
            partition.owners,
            partition.labels,
            self._stand_ins,
        )
        return centroids

    def _weights(
        self,
        partition: Partition,
        r: FloatArray,
        contact: int,
        weighting: Weighting,
        q: FloatArray,
    ) -> FloatArray:
        weights: FloatArray = weights_of(
            KINDS.index(weighting.kind),
            plain(r),
            partition.sizes,
            plain(weighting.covariance),
            contact,
            q,
        )
        return weights
