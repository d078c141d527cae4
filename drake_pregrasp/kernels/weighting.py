"""What weighs the points of a region, as numbers that don't depend on the point."""

from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray

KINDS = ("position", "msv", "gii", "vew")
"""Weights that kernels know: the Gaussian of Eq. 3, and the hand's measures of Eq. 5-7."""

FLAT = 1e-13
"""Share of their mean up to which what is left of weights by a stretch is rounding: areas count."""


@dataclass(frozen=True, eq=False)
class Weighting:
    """Which weight, and its parameters.

    Attributes:
        kind: One of `KINDS`.
        stretch: Whether the least weight of a region is subtracted; not for `position`.
        covariance: Sigma of Eq. 3, symmetric and positive definite, shape (3, 3), in m²; for
            `position` only.
    """

    kind: str
    stretch: bool
    covariance: FloatArray

    @property
    def is_of_the_hand(self) -> bool:
        """Whether the weights depend on the other contacts."""
        return self.kind != "position"

    def whitener(self) -> FloatArray:
        """Returns W, lower triangular, with Wᵀ W the inverse of Sigma, shape (3, 3)."""
        if self.is_of_the_hand:
            return np.eye(3)
        inverse: FloatArray = np.linalg.inv(np.linalg.cholesky(self.covariance))
        return inverse


@dataclass(frozen=True, eq=False)
class HandSums:
    """Sums over the active contacts other than each contact, the one that moves.

    Attributes:
        n: Number of active contacts.
        t: Sums of their lever arms, shape (n_all, 3).
        B: Sums of |r|² I - r rᵀ, shape (n_all, 3, 3).
    """

    n: int
    t: FloatArray
    B: FloatArray

    @staticmethod
    def none(count: int) -> "HandSums":
        """Returns zeros for that many contacts, where nothing depends on them."""
        return HandSums(0, np.zeros((count, 3)), np.zeros((count, 3, 3)))

    @staticmethod
    def over(r: FloatArray, active: BoolArray) -> "HandSums":
        """Returns the sums for contacts at lever arms r, shape (n_all, 3)."""
        held = np.where(active[:, None], r, 0)
        squares = np.einsum("ki,ki->k", held, held)
        moments = squares[:, None, None] * np.eye(3) - np.einsum("ki,kj->kij", held, held)
        # Summed over the others one by one: a difference of sums would round.
        others = ~np.eye(len(r), dtype=bool)
        return HandSums(int(np.sum(active)), others @ held, np.tensordot(others, moments, 1))


def volume_numbers(sums: HandSums) -> FloatArray:
    """Returns, for each contact, the numbers of the closed form of Eq. 7, shape (n_all, 18).

    In this order: mean of the others (3), alpha, e_3, e_2, then the upper triangles, row by row, of
    K and adj(K) (6 each).
    """
    n = sums.n
    rest = max(n - 1, 1)
    mean = sums.t / rest
    # K = (n + tr S) I - S with the others' scatter S about their mean; sum |r|² I - r rᵀ is B.
    away = np.einsum("ki,ki->k", mean, mean)[:, None, None] * np.eye(3)
    K = n * np.eye(3) + sums.B - rest * (away - np.einsum("ki,kj->kij", mean, mean))
    adjugate = np.stack(
        [
            np.cross(K[:, 1], K[:, 2]),
            np.cross(K[:, 2], K[:, 0]),
            np.cross(K[:, 0], K[:, 1]),
        ],
        axis=1,
    )
    e_3 = np.einsum("ki,ki->k", K[:, 0], adjugate[:, 0])
    e_2 = np.trace(adjugate, axis1=1, axis2=2)
    alpha = np.full(len(K), (n - 1) / max(n, 1))
    rows, columns = np.triu_indices(3)
    parts = [mean, alpha[:, None], e_3[:, None], e_2[:, None]]
    numbers: FloatArray = np.concatenate(
        [*parts, K[:, rows, columns], adjugate[:, rows, columns]], axis=1
    )
    return numbers
