"""Eq. 5-7 of the hand with one contact moved to many points, coordinate by coordinate (numpy)."""

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.quality.singular_values import (
    largest_eigenvalues,
    largest_x,
    largest_y,
)


def volumes(numbers: FloatArray, n: int, q: FloatArray) -> FloatArray:
    """Returns Eq. 7 at points.

    Args:
        numbers: A row of `volume_numbers`.
        n: Number of active contacts.
        q: The points relative to the centre of mass, shape (3, k), in metres.
    """
    x, y, z = q - numbers[:3, None]
    alpha, e_3, e_2 = numbers[3:6]
    products = np.stack([x * x, x * y, x * z, y * y, y * z, z * z])
    twice = np.array([1.0, 2.0, 2.0, 1.0, 2.0, 1.0])
    dKd, dAd = (numbers[6:].reshape(2, 6) * twice) @ products
    a = alpha * (products[0] + products[3] + products[5])
    volume: FloatArray = np.sqrt(n**3 * (e_3 + e_2 * a + alpha * (a * dKd - dAd)))
    return volume


def extremes(
    t: FloatArray, B: FloatArray, n: int, q: FloatArray, *, largest: bool
) -> tuple[FloatArray, FloatArray]:
    """Returns the extreme singular values of the hand at points, shape (k,) each.

    Args:
        t: Sum of the other contacts' lever arms, shape (3, 1); or (3, k), one for each point.
        B: Their sum of |r|² I - r rᵀ, shape (3, 3, 1) or (3, 3, k).
        n: Number of active contacts.
        q: The points relative to the centre of mass, shape (3, k), in metres.
        largest: Whether the largest are asked for too; if not, ones stand in their place.
    """
    total = t + q
    tau = np.einsum("ik,ik->k", total, total)
    length = np.sqrt(tau)
    e_0 = total / np.where(length > 0, length, 1)
    e_0[2, length == 0] = 1
    e_1, e_2 = _across(e_0)
    square = np.einsum("ik,ik->k", q, q)
    q_0, q_1, q_2 = (np.einsum("ik,ik->k", e, q) for e in (e_0, e_1, e_2))
    Be_0, Be_1 = (np.sum(B * e, axis=1) for e in (e_0, e_1))
    b11 = np.einsum("ik,ik->k", e_0, Be_0) + square - q_0**2
    b = np.stack(
        [
            np.einsum("ik,ik->k", e_1, Be_0) - q_1 * q_0,
            np.einsum("ik,ik->k", e_2, Be_0) - q_2 * q_0,
        ]
    )
    P11 = np.einsum("ik,ik->k", e_1, Be_1) + square - q_1**2
    P12 = np.einsum("ik,ik->k", e_2, Be_1) - q_2 * q_1
    P = np.stack([P11, P12, np.trace(B) + 2 * square - b11 - P11])
    sigma_min = np.sqrt(n - largest_x(tau, b11, b, P))
    if not largest:
        return sigma_min, np.ones(len(tau))
    y, certain = largest_y(tau, b11, b, P)
    sigma_max = np.sqrt(n + y)
    rest = np.flatnonzero(~certain)
    if len(rest):
        p = q[:, rest].T
        moments = square[rest, None, None] * np.eye(3) - np.einsum("ki,kj->kij", p, p)
        held = np.broadcast_to(B, (3, 3, len(tau)))[:, :, rest].transpose(2, 0, 1)
        sigma_max[rest] = np.sqrt(largest_eigenvalues(total[:, rest].T, held + moments, n))
    return sigma_min, sigma_max


def _across(e: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns two axes that complete unit vectors, shape (3, k), to orthonormal bases.

    Without a branch, after Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 2017.
    """
    x, y, z = e
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    xy = x * y * a
    return (
        np.stack([1 + sign * x * x * a, sign * xy, -sign * x]),
        np.stack([xy, sign + y * y * a, -y]),
    )
