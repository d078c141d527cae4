"""Weighted centroids of safe regions, with closed forms in place of decompositions.

With t = sum r_i and B = sum (|r_i|² I - r_i r_iᵀ) over n contacts, the matrix of
`contacts.strategies.hand_singular_values` is G Gᵀ = [[n I, -[t]x], [[t]x, n I + B]].

**Volume.** By the Schur complement of n I, det(G Gᵀ) = n³ det(n I + B + [t]x²/n).

**Extreme singular values.** An eigenvector (u, w) to the eigenvalue n - x obeys x u = [t]x w and
(x² I + x B + [t]x²) w = 0. In a basis whose first axis is along t, [t]x² = diag(0, -tau, -tau) with
tau = |t|². Eliminating the first component of w leaves, for x other than 0 and -b11, a problem in
the plane across t:

    x² + x mu = tau,   mu an eigenvalue of P - b bᵀ / (x + b11),

where b11, b and P are the blocks of B in that basis. The smallest singular value comes from the
largest root, which belongs to the lower mu; the largest one, with x = -y, from y² - y nu = tau and
the upper eigenvalue nu of P + b bᵀ / (y - b11). Eigenvalues of 2 x 2 matrices have a closed form,
and a few Newton steps, with mu linearised and the quadratic solved exactly, find the roots, also
double ones, because the closed form contains their square root. Near y = b11 the elimination would
divide by nearly zero; the matrix is then decomposed.
"""

import math

import numpy as np

from drake_pregrasp.contacts.strategies import FLAT
from drake_pregrasp.fast.compiling import compiled

KINDS = ("position", "msv", "gii", "vew")
"""Strategies that are compiled, the measures in the reading `hand`."""

_POSITION, _MSV, _GII, _VEW = range(4)
_STEPS = 12  # Largest number of steps. Three are enough on a cube; long objects need more.
_SETTLED = 1e-7  # Relative step after which a root has converged: the error is its square.


@compiled()
def others_sums(r, active):  # type: ignore[no-untyped-def]
    """Returns t, shape (n, 3), and B, shape (n, 3, 3), over the active contacts but each one."""
    t, B = np.zeros((len(r), 3)), np.zeros((len(r), 3, 3))
    for i in range(len(r)):
        for k in range(len(r)):
            if k != i and active[k]:
                t[i] += r[k]
                B[i] += np.dot(r[k], r[k]) * np.eye(3) - np.outer(r[k], r[k])
    return t, B


@compiled()
def volume(t, B, n, q):  # type: ignore[no-untyped-def]
    """Returns sqrt(det(G Gᵀ)) of n contacts, the last one at q, given the sums over the others."""
    x, y, z = t[0] + q[0], t[1] + q[1], t[2] + q[2]
    tau, square = x * x + y * y + z * z, q[0] * q[0] + q[1] * q[1] + q[2] * q[2]
    m = n + square - tau / n
    m00 = B[0, 0] + m - q[0] * q[0] + x * x / n
    m11 = B[1, 1] + m - q[1] * q[1] + y * y / n
    m22 = B[2, 2] + m - q[2] * q[2] + z * z / n
    m01 = B[0, 1] - q[0] * q[1] + x * y / n
    m02 = B[0, 2] - q[0] * q[2] + x * z / n
    m12 = B[1, 2] - q[1] * q[2] + y * z / n
    determinant = m00 * (m11 * m22 - m12 * m12) - m01 * (m01 * m22 - m12 * m02)
    determinant += m02 * (m01 * m12 - m11 * m02)
    return math.sqrt(n**3 * max(determinant, 0.0))


@compiled()
def eigenvalue(sign, gap, p11, p12, p22, b1, b2):  # type: ignore[no-untyped-def]
    """Returns the upper or lower (by sign) eigenvalue of P + sign b bᵀ/gap, and (b·v)²/gap²."""
    d = 1.0 / (gap if gap > 0.0 else 1.0)
    a11, a12, a22 = p11 + sign * d * b1 * b1, p12 + sign * d * b1 * b2, p22 + sign * d * b2 * b2
    half = (a11 - a22) / 2.0
    root = math.sqrt(half * half + a12 * a12)
    form = half * (b1 * b1 - b2 * b2) + 2.0 * a12 * b1 * b2
    along = (b1 * b1 + b2 * b2 + sign * form / (root if root > 0.0 else 1.0)) / 2.0
    return (a11 + a22) / 2.0 + sign * root, max(along, 0.0) * d * d


@compiled()
def largest_singular_value(t, B, n, q):  # type: ignore[no-untyped-def]
    """Returns sigma_max of n contacts, the last one at q, by decomposition."""
    M = n * np.eye(6)
    M[3:, 3:] += B + np.dot(q, q) * np.eye(3) - np.outer(q, q)
    x, y, z = t + q
    for row, column, value in ((0, 1, -z), (0, 2, y), (1, 2, -x)):
        M[3 + row, column] = M[column, 3 + row] = value
        M[3 + column, row] = M[row, 3 + column] = -value
    return math.sqrt(np.linalg.eigvalsh(M)[-1])


@compiled()
def measure(kind, t, B, n, q):  # type: ignore[no-untyped-def]
    """Returns sigma_min, or the isotropy, of n contacts, the last one at q."""
    x, y, z = t[0] + q[0], t[1] + q[1], t[2] + q[2]
    tau = x * x + y * y + z * z
    length = math.sqrt(tau)
    ax, ay, az = (x / length, y / length, z / length) if length > 0 else (0.0, 0.0, 1.0)
    # Two axes across t without a branch (Duff et al., JCGT 2017).
    sign = math.copysign(1.0, az)
    s = -1.0 / (sign + az)
    ux, uy, uz = 1.0 + sign * ax * ax * s, sign * ax * ay * s, -sign * ax
    vx, vy, vz = ax * ay * s, sign + ay * ay * s, -ay
    q0 = ax * q[0] + ay * q[1] + az * q[2]
    q1 = ux * q[0] + uy * q[1] + uz * q[2]
    q2 = vx * q[0] + vy * q[1] + vz * q[2]
    square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2]
    ex = B[0, 0] * ax + B[0, 1] * ay + B[0, 2] * az
    ey = B[0, 1] * ax + B[1, 1] * ay + B[1, 2] * az
    ez = B[0, 2] * ax + B[1, 2] * ay + B[2, 2] * az
    fx = B[0, 0] * ux + B[0, 1] * uy + B[0, 2] * uz
    fy = B[0, 1] * ux + B[1, 1] * uy + B[1, 2] * uz
    fz = B[0, 2] * ux + B[1, 2] * uy + B[2, 2] * uz
    b11 = ax * ex + ay * ey + az * ez + square - q0 * q0
    b1 = ux * ex + uy * ey + uz * ez - q1 * q0
    b2 = vx * ex + vy * ey + vz * ez - q2 * q0
    p11 = ux * fx + uy * fy + uz * fz + square - q1 * q1
    p12 = vx * fx + vy * fy + vz * fz - q2 * q1
    p22 = B[0, 0] + B[1, 1] + B[2, 2] + 2.0 * square - b11 - p11
    root = length
    for _ in range(_STEPS):
        mu, slope = eigenvalue(-1.0, root + b11, p11, p12, p22, b1, b2)
        p = mu - slope * root
        below = p + math.sqrt(p * p + 4.0 * (1.0 + slope) * tau)
        before, root = root, 2.0 * tau / (below if below > 0.0 else 1.0)
        if abs(root - before) <= _SETTLED * root:
            break
    sigma_min = math.sqrt(max(n - root, 0.0))
    if kind == _MSV:
        return sigma_min
    root = length + b11
    settled = False
    while tau > 0.75 * b11 * b11 and root - b11 > 1e-3 * root and not settled:
        nu, slope = eigenvalue(1.0, root - b11, p11, p12, p22, b1, b2)
        p = nu + slope * root
        before = root
        root = (p + math.sqrt(p * p + 4.0 * (1.0 + slope) * tau)) / (2.0 * (1.0 + slope))
        settled = abs(root - before) <= _SETTLED * root
    return sigma_min / (math.sqrt(n + root) if settled else largest_singular_value(t, B, n, q))


@compiled("f8[:,::1](i8, b1, i8[::1], i8[::1], b1[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1])")
def weighted_centroids(  # type: ignore[no-untyped-def]
    kind, stretch, contacts, labels, active, r, precision, q, areas
):
    """Returns the centroids of some contacts' regions, relative to the centre of mass, (k, 3).

    Args:
        kind: Index of the strategy in `KINDS`.
        stretch: Whether to subtract a region's smallest weight.
        contacts: Indices of the contacts that move, shape (k,).
        labels: Region of each candidate, shape (N,).
        active: Mask of the contacts that take part in the grasp, shape (n,).
        r: Lever arms of the contacts, shape (n, 3), in metres.
        precision: Inverse of the position's covariance, shape (3, 3), in 1/m².
        q: Lever arms of the candidates, shape (N, 3), in metres.
        areas: Surface area that each candidate represents, shape (N,), in m².
    """
    n = np.count_nonzero(active)
    t, B = others_sums(r, active)
    moves = np.zeros(len(r), dtype=np.bool_)
    moves[contacts] = True
    b = np.zeros(len(q))
    least, most = np.full(len(r), np.inf), np.full(len(r), -np.inf)
    for k in range(len(q)):
        i = labels[k]
        if i < 0 or not moves[i]:
            continue
        if kind == _POSITION:
            for row in range(3):
                for column in range(3):
                    b[k] -= 0.5 * q[k, row] * precision[row, column] * q[k, column]
        elif kind == _VEW:
            b[k] = volume(t[i], B[i], n, q[k])
        else:
            b[k] = measure(kind, t[i], B[i], n, q[k])
        least[i], most[i] = min(least[i], b[k]), max(most[i], b[k])
    sums, plain = np.zeros((len(r), 4)), np.zeros((len(r), 4))
    for k in range(len(q)):
        i = labels[k]
        if i < 0 or not moves[i]:
            continue
        weight = b[k]
        if kind == _POSITION:
            weight = math.exp(b[k] - most[i])
        elif stretch:
            weight -= least[i]
        for axis in range(3):
            sums[i, axis] += weight * areas[k] * q[k, axis]
            plain[i, axis] += areas[k] * q[k, axis]
        sums[i, 3] += weight * areas[k]
        plain[i, 3] += areas[k]
    centroids = np.empty((len(contacts), 3))
    for k in range(len(contacts)):
        i = contacts[k]
        total = sums[i, 3] + (least[i] * plain[i, 3] if stretch else 0.0)
        chosen = sums[i] if sums[i, 3] > FLAT * total else plain[i]
        centroids[k] = chosen[:3] / chosen[3]
    return centroids
