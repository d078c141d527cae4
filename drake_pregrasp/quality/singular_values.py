"""Extreme singular values of many complete grasp matrices at once, without decomposing them.

With t = sum r_i, T = [t]x and B = sum (|r_i|² I - r_i r_iᵀ) the matrix of n contacts has

    G Gᵀ = [[n I, -T], [T, n I + B]].

An eigenvector (u, w) to the eigenvalue n - x obeys x u = T w and (x² I + x B + T²) w = 0. In a
basis whose first axis is along t, T² = diag(0, -tau, -tau) with tau = |t|². Eliminating the first
component of w leaves, for x other than 0 and -b11, a problem in the plane across t:

    x² + x mu = tau,   mu an eigenvalue of P - b bᵀ / (x + b11),

where b11, b and P are the blocks of B in that basis. The smallest singular value comes from the
largest root, which belongs to the lower mu; the largest one, with x = -y, from y² - y nu = tau and
the upper eigenvalue nu of P + b bᵀ / (y - b11). Eigenvalues of 2 x 2 matrices have a closed form,
and a few Newton steps, with mu linearised and the quadratic solved exactly, find the roots: double
ones too, because the square root inside the closed form takes them up.
"""

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray

STEPS = 12
"""Newton steps at most: three reach rounding where a hand holds a cube, long or flat objects want
some more."""

SETTLED = 1e-7
"""Share of itself by which a root may still move in the last step: what is left is its square."""


def extreme_singular_values(t: FloatArray, B: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
    """Returns the smallest and largest singular values of k complete grasp matrices.

    Args:
        t: Sums of the lever arms, shape (k, 3).
        B: Sums of |r|² I - r rᵀ, shape (k, 3, 3).
        n: Number of contacts, at least 1.
    """
    tau = np.einsum("ki,ki->k", t, t)
    b11, b, P = _blocks_across(t, tau, B)
    sigma_min = np.sqrt(n - largest_x(tau, b11, b, P))
    y, certain = largest_y(tau, b11, b, P)
    sigma_max = np.sqrt(n + y)
    uncertain = np.flatnonzero(~certain)
    if len(uncertain):
        sigma_max[uncertain] = np.sqrt(largest_eigenvalues(t[uncertain], B[uncertain], n))
    return sigma_min, sigma_max


def _blocks_across(
    t: FloatArray, tau: FloatArray, B: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns b11 (k), b (2, k) and (P11, P12, P22) (3, k) of B in a basis that starts along t."""
    length = np.sqrt(tau)
    axis = np.where(length[:, None] > 0, t / np.where(length > 0, length, 1)[:, None], [0, 0, 1.0])
    helper = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
    e1 = np.cross(axis, helper)
    e1 /= np.linalg.norm(e1, axis=1)[:, None]
    e2 = np.cross(axis, e1)
    Ba, B1 = np.einsum("kij,kj->ki", B, axis), np.einsum("kij,kj->ki", B, e1)
    dot = "ki,ki->k"
    b11 = np.einsum(dot, axis, Ba)
    b = np.stack([np.einsum(dot, e1, Ba), np.einsum(dot, e2, Ba)])
    P22 = np.einsum("ki,kij,kj->k", e2, B, e2)
    return b11, b, np.stack([np.einsum(dot, e1, B1), np.einsum(dot, e2, B1), P22])


def largest_x(tau: FloatArray, b11: FloatArray, b: FloatArray, P: FloatArray) -> FloatArray:
    """Returns x of the smallest singular values sqrt(n - x), shape (k,).

    Args:
        tau: |t|², shape (k,).
        b11: Block of B along t, shape (k,).
        b: Block between, shape (2, k).
        P: Block across t, (P11, P12, P22), shape (3, k).
    """
    x = np.sqrt(tau)
    for _ in range(STEPS):
        d = 1 / np.where(x + b11 > 0, x + b11, 1)
        mu, bv = _eigenvalue(P - d * np.stack([b[0] ** 2, b[0] * b[1], b[1] ** 2]), b, upper=False)
        slope = (bv * d) ** 2
        p = mu - slope * x
        denominator = p + np.sqrt(p**2 + 4 * (1 + slope) * tau)
        before, x = x, 2 * tau / np.where(denominator > 0, denominator, 1)
        if np.all(np.abs(x - before) <= SETTLED * x):
            break
    return x


def largest_y(
    tau: FloatArray, b11: FloatArray, b: FloatArray, P: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Returns y of the largest singular values sqrt(n + y), and where it is certain, shape (k,).

    Args:
        tau: As for `largest_x`, and so the others.
        b11: Block of B along t.
        b: Block between.
        P: Block across t.
    """
    # Near y = b11 the elimination divides by nearly nothing; far from it, it is sound.
    certain = tau > 0.75 * b11**2
    y = np.sqrt(tau) + b11
    for _ in range(STEPS):
        gap = y - b11
        certain &= gap > 1e-3 * y
        d = 1 / np.where(certain, gap, 1)
        nu, bv = _eigenvalue(P + d * np.stack([b[0] ** 2, b[0] * b[1], b[1] ** 2]), b, upper=True)
        slope = (bv * d) ** 2
        p = nu + slope * y
        before, y = y, (p + np.sqrt(p**2 + 4 * (1 + slope) * tau)) / (2 * (1 + slope))
        settled = np.abs(y - before) <= SETTLED * y
        if np.all(settled | ~certain):
            break
    return y, certain & settled


def _eigenvalue(A: FloatArray, b: FloatArray, *, upper: bool) -> tuple[FloatArray, FloatArray]:
    """Returns an eigenvalue of symmetric matrices (A11, A12, A22), and b along its eigenvector."""
    half = (A[0] - A[2]) / 2
    root = np.hypot(half, A[1])
    sign = 1.0 if upper else -1.0
    # The projector on the eigenvector is (I + sign (A - mean I) / root) / 2.
    safe = np.where(root > 0, root, 1)
    quadratic = half * (b[0] ** 2 - b[1] ** 2) + 2 * A[1] * b[0] * b[1]
    along_squared = (b[0] ** 2 + b[1] ** 2 + sign * quadratic / safe) / 2
    return (A[0] + A[2]) / 2 + sign * root, np.sqrt(np.maximum(along_squared, 0))


def largest_eigenvalues(t: FloatArray, B: FloatArray, n: int) -> FloatArray:
    """Returns the largest eigenvalues of G Gᵀ, decomposed, shape (k,).

    Args:
        t: As for `extreme_singular_values`, and so the others.
        B: Sums of |r|² I - r rᵀ.
        n: Number of contacts.
    """
    M = np.zeros((len(t), 6, 6))
    M[:, range(6), range(6)] = n
    M[:, 3:, 3:] += B
    x, y, z = t.T
    for row, column, value in ((0, 1, -z), (0, 2, y), (1, 2, -x)):
        M[:, 3 + row, column] = value
        M[:, 3 + column, row] = -value
        M[:, column, 3 + row] = value
        M[:, row, 3 + column] = -value
    return np.linalg.eigvalsh(M)[:, -1].astype(float)
