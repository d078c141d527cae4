"""What a kernel finds of Eq. 1: whose region each block, and each point of a mixed one, is in."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drake_pregrasp.arrays import IntArray
from drake_pregrasp.kernels.blocks import Blocks
from drake_pregrasp.kernels.sorting import BLOCK

NOBODY = -1
"""Owner of what lies in no region."""

MIXED = -2
"""Owner of a block whose points have to be asked one by one."""


@dataclass(frozen=True, eq=False)
class Partition:
    """The regions of n contacts over the blocks of a surface.

    Attributes:
        owners: Contact that has the whole of each block, `NOBODY` or `MIXED`, shape (B,).
        labels: Contact that has each point of a mixed block, or `NOBODY`; not set elsewhere;
            shape (B, BLOCK).
        sizes: Number of candidates in each region, shape (n,).
        blocks: Of the surface.
    """

    owners: IntArray
    labels: npt.NDArray[np.int16]
    sizes: IntArray
    blocks: Blocks

    def labels_of_candidates(self) -> IntArray:
        """Returns the label of each candidate, in their own order, shape (N,)."""
        sorted_labels = np.repeat(self.owners, BLOCK).reshape(-1, BLOCK)
        mixed = np.flatnonzero(self.owners == MIXED)
        sorted_labels[mixed] = self.labels[mixed]
        order = self.blocks.order
        labels = np.empty(len(order), dtype=np.int64)
        labels[order] = sorted_labels.ravel()[: len(order)]
        return labels
