"""What the weights of all candidates share, as in `weighting`, for numba."""

import math

import numpy as np

from drake_pregrasp.kernels.compiled.compiling import compiled


@compiled()
def hand_sums(r, sizes, t, B):  # type: ignore[no-untyped-def]
    """Writes what `HandSums.over` returns for contacts of regions that aren't empty.

    Args:
        r: Contacts, shape (n, 3).
        sizes: Of their regions, shape (n,).
        t: Sums of the others' lever arms, shape (n, 3), written to.
        B: Sums of |r|² I - r rᵀ, shape (n, 3, 3), written to.

    Returns:
        The number of those contacts.
    """
    count = 0
    t[:], B[:] = 0.0, 0.0
    for k in range(len(r)):
        if sizes[k] == 0:
            continue
        count += 1
        square = r[k, 0] * r[k, 0] + r[k, 1] * r[k, 1] + r[k, 2] * r[k, 2]
        for i in range(len(r)):
            if i == k:
                continue
            for a in range(3):
                t[i, a] += r[k, a]
                B[i, a, a] += square
                for b in range(3):
                    B[i, a, b] -= r[k, a] * r[k, b]
    return count


@compiled()
def volume_numbers(t, B, n, row):  # type: ignore[no-untyped-def]
    """Writes one row of what `weighting.volume_numbers` returns.

    Args:
        t: Sum of the others' lever arms, shape (3,).
        B: Their sum of |r|² I - r rᵀ, shape (3, 3).
        n: Number of contacts.
        row: Shape (18,), written to.
    """
    rest = max(n - 1, 1)
    x, y, z = t[0] / rest, t[1] / rest, t[2] / rest
    square = x * x + y * y + z * z
    k00 = n + B[0, 0] - rest * (square - x * x)
    k11 = n + B[1, 1] - rest * (square - y * y)
    k22 = n + B[2, 2] - rest * (square - z * z)
    k01, k02, k12 = B[0, 1] + rest * x * y, B[0, 2] + rest * x * z, B[1, 2] + rest * y * z
    a00, a11, a22 = k11 * k22 - k12 * k12, k00 * k22 - k02 * k02, k00 * k11 - k01 * k01
    a01, a02, a12 = k12 * k02 - k01 * k22, k01 * k12 - k11 * k02, k02 * k01 - k00 * k12
    row[0], row[1], row[2], row[3] = x, y, z, (n - 1) / max(n, 1)
    row[4], row[5] = k00 * a00 + k01 * a01 + k02 * a02, a00 + a11 + a22
    row[6], row[7], row[8], row[9], row[10], row[11] = k00, k01, k02, k11, k12, k22
    row[12], row[13], row[14], row[15], row[16], row[17] = a00, a01, a02, a11, a12, a22


@compiled()
def whitener(covariance):  # type: ignore[no-untyped-def]
    """Returns what `Weighting.whitener` does for the position, shape (3, 3)."""
    l00 = math.sqrt(covariance[0, 0])
    l10, l20 = covariance[1, 0] / l00, covariance[2, 0] / l00
    l11 = math.sqrt(covariance[1, 1] - l10 * l10)
    l21 = (covariance[2, 1] - l20 * l10) / l11
    l22 = math.sqrt(covariance[2, 2] - l20 * l20 - l21 * l21)
    if not l00 * l11 * l22 > 0.0:
        raise np.linalg.LinAlgError("Matrix is not positive definite.")
    inverse = np.zeros((3, 3))
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = 1.0 / l00, 1.0 / l11, 1.0 / l22
    inverse[1, 0] = -l10 / (l00 * l11)
    inverse[2, 1] = -l21 / (l11 * l22)
    inverse[2, 0] = (l10 * l21 - l20 * l11) / (l00 * l11 * l22)
    return inverse
