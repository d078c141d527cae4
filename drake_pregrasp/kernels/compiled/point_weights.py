"""The weights of any points, and what they all share, for numba."""

import numpy as np

from drake_pregrasp.kernels.compiled.compiling import compiled
from drake_pregrasp.kernels.compiled.hand import hand_sums, volume_numbers, whitener
from drake_pregrasp.kernels.compiled.singular_values import SCRATCH
from drake_pregrasp.kernels.compiled.weighing import POSITION, VEW, weigh
from drake_pregrasp.kernels.sorting import BLOCK


@compiled()
def weights_of(kind, r, sizes, covariance, contact, q):  # type: ignore[no-untyped-def]
    """Returns the weights of points, shape (3, k), for a contact, without stretching, shape (k,).

    Args:
        kind: As for `centroids_of`, and so the next four.
        r: All contacts.
        sizes: As in `Partition`.
        covariance: As of `Weighting`.
        contact: The one that moves.
        q: The points.
    """
    whitener, numbers, t, B, n = prepare(kind, r, sizes, covariance)
    count = q.shape[1]
    weights, b = np.empty(count), np.empty(BLOCK)
    scratch, pack = np.empty((SCRATCH, BLOCK)), np.empty((4, BLOCK))
    for first in range(0, count, BLOCK):
        for k in range(BLOCK):
            for axis in range(3):
                pack[axis, k] = q[axis, min(first + k, count - 1)]
        weigh(kind, whitener, numbers, t, B, n, contact, pack, scratch, b)
        for k in range(first, min(first + BLOCK, count)):
            weights[k] = np.exp(b[k - first]) if kind == POSITION else b[k - first]
    return weights


@compiled()
def prepare(kind, r, sizes, covariance):  # type: ignore[no-untyped-def]
    """Returns what `weigh` needs of all contacts: whitener, numbers, t, B and n."""
    count, n = len(r), 0
    t, B, numbers = np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros((count, 18))
    if kind == POSITION:
        return whitener(covariance), numbers, t, B, n
    n = hand_sums(r, sizes, t, B)
    if kind == VEW:
        for contact in range(count):
            volume_numbers(t[contact], B[contact], n, numbers[contact])
    return np.zeros((3, 3)), numbers, t, B, n
