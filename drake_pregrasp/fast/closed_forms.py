"""Measures of the complete grasp matrix, with closed forms in place of decompositions.

With t = sum r_i and B = sum (|r_i|² I - r_i r_iᵀ) over n contacts, the matrix of
`contacts.strategies.singular_values` with the complete model is
G Gᵀ = [[n I, -[t]x], [[t]x, n I + B]], since [r]x [r]xᵀ = |r|² I - r rᵀ. `spectra` computes the
measures of the other contact models.

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

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import MEASURES
from drake_pregrasp.fast.compiling import GROUP, compiled
from drake_pregrasp.fast.members import Members
from drake_pregrasp.quality.grasp_quality import contact_blocks

_MSV, _GII, _VEW = range(len(MEASURES))
_STEPS = 12  # Largest number of steps. Three are enough on a cube; long objects need more.
_SETTLED = 1e-7  # Relative step after which a root has converged: the error is its square.


@compiled()
def others_sums(r, active, i, t, B):  # type: ignore[no-untyped-def]
    """Writes t, shape (3,), and B, shape (3, 3), over the active contacts but contact i."""
    t[:], B[:] = 0.0, 0.0
    for k in range(len(r)):
        if k == i or not active[k]:
            continue
        square = r[k, 0] * r[k, 0] + r[k, 1] * r[k, 1] + r[k, 2] * r[k, 2]
        for row in range(3):
            t[row] += r[k, row]
            for column in range(3):
                B[row, column] += (square if row == column else 0.0) - r[k, row] * r[k, column]


@compiled()
def eigenvalue(sign, gap, p11, p12, p22, b1, b2):  # type: ignore[no-untyped-def]
    """Returns the upper or lower (by sign) eigenvalue of P + sign b bᵀ/gap, and (b·v)²/gap²."""
    d = 1.0 / (gap if gap > 0.0 else 1.0)
    a11, a12, a22 = p11 + sign * d * b1 * b1, p12 + sign * d * b1 * b2, p22 + sign * d * b2 * b2
    half = (a11 - a22) / 2.0
    root = math.sqrt(half * half + a12 * a12)
    form = half * (b1 * b1 - b2 * b2) + 2.0 * a12 * b1 * b2
    along = (b1 * b1 + b2 * b2 + sign * form / (root if root > 0.0 else 1.0)) / 2.0
    return (a11 + a22) / 2.0 + sign * root, (along if along > 0.0 else 0.0) * d * d


@compiled()
def find_roots(sign, size, tau, b11, b1, b2, p11, p12, p22, roots, steps):  # type: ignore[no-untyped-def]
    """Improves y (sign 1) or x (sign -1) of `size` places by Newton steps.

    Where y needs the decomposition instead, its step is written as infinite.
    """
    for k in range(size):
        steps[k] = 1.0
    for _ in range(_STEPS):
        unsettled = 0
        for k in range(size):
            root, gap = roots[k], roots[k] - sign * b11[k]
            mu, slope = eigenvalue(sign, gap, p11[k], p12[k], p22[k], b1[k], b2[k])
            p = mu + sign * slope * root
            above = p + math.sqrt(p * p + 4.0 * (1.0 + slope) * tau[k])
            x = 2.0 * tau[k] / (above if above > 0.0 else 1.0)
            found = above / (1.0 + slope) / 2.0 if sign > 0.0 else x
            usable = (gap > 1e-3 * root) | (sign < 0.0)
            step = abs(found - root) - _SETTLED * found
            steps[k] = step if usable & (steps[k] < np.inf) else np.inf
            roots[k] = found if steps[k] < np.inf else root
        for k in range(size):
            unsettled += (steps[k] > 0.0) & (steps[k] < np.inf)
        if unsettled == 0:
            break


@compiled()
def write_volumes(t, B, n, qx, qy, qz, b):  # type: ignore[no-untyped-def]
    """Writes sqrt(det(G Gᵀ)) of n contacts, the last one at each place (qx, qy, qz)."""
    for k in range(len(b)):
        p, r, s = qx[k], qy[k], qz[k]
        x, y, z = t[0] + p, t[1] + r, t[2] + s
        tau, square = x * x + y * y + z * z, p * p + r * r + s * s
        m = n + square - tau / n
        m00 = B[0, 0] + m - p * p + x * x / n
        m11 = B[1, 1] + m - r * r + y * y / n
        m22 = B[2, 2] + m - s * s + z * z / n
        m01 = B[0, 1] - p * r + x * y / n
        m02 = B[0, 2] - p * s + x * z / n
        m12 = B[1, 2] - r * s + y * z / n
        determinant = m00 * (m11 * m22 - m12 * m12) - m01 * (m01 * m22 - m12 * m02)
        determinant += m02 * (m01 * m12 - m11 * m02)
        b[k] = math.sqrt(n**3 * (determinant if determinant > 0.0 else 0.0))


@compiled()
def write_singular_values(kind, t, B, n, qx, qy, qz, b):  # type: ignore[no-untyped-def]
    """Writes sigma_min, or the isotropy, of n contacts, the last one at (qx, qy, qz).

    Returns whether sigma_max is still missing somewhere; there, it writes -sigma_min. Loops run
    over groups of places without branches, so that they are vector instructions.
    """
    rows, is_partial = np.empty((9, GROUP)), False
    b11, b1, b2, p11, p12, p22 = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5]
    tau, roots, steps = rows[6], rows[7], rows[8]
    for start in range(0, len(b), GROUP):
        size = min(GROUP, len(b) - start)
        own, px, py, pz = b[start:], qx[start:], qy[start:], qz[start:]
        for k in range(size):
            p, r, s = px[k], py[k], pz[k]
            x, y, z = t[0] + p, t[1] + r, t[2] + s
            tau[k] = x * x + y * y + z * z
            length = math.sqrt(tau[k])
            scale = 1.0 / (length if length > 0.0 else 1.0)
            ax, ay, az = x * scale, y * scale, z * scale if length > 0.0 else 1.0
            # Two axes across t without a branch (Duff et al., JCGT 2017).
            sign = 1.0 if az >= 0.0 else -1.0
            f = -1.0 / (sign + az)
            ux, uy, uz = 1.0 + sign * ax * ax * f, sign * ax * ay * f, -sign * ax
            vx, vy, vz = ax * ay * f, sign + ay * ay * f, -ay
            q0 = ax * p + ay * r + az * s
            q1 = ux * p + uy * r + uz * s
            q2 = vx * p + vy * r + vz * s
            square = p * p + r * r + s * s
            ex = B[0, 0] * ax + B[0, 1] * ay + B[0, 2] * az
            ey = B[0, 1] * ax + B[1, 1] * ay + B[1, 2] * az
            ez = B[0, 2] * ax + B[1, 2] * ay + B[2, 2] * az
            fx = B[0, 0] * ux + B[0, 1] * uy + B[0, 2] * uz
            fy = B[0, 1] * ux + B[1, 1] * uy + B[1, 2] * uz
            fz = B[0, 2] * ux + B[1, 2] * uy + B[2, 2] * uz
            b11[k] = ax * ex + ay * ey + az * ez + square - q0 * q0
            b1[k] = ux * ex + uy * ey + uz * ez - q1 * q0
            b2[k] = vx * ex + vy * ey + vz * ez - q2 * q0
            p11[k] = ux * fx + uy * fy + uz * fz + square - q1 * q1
            p12[k] = vx * fx + vy * fy + vz * fz - q2 * q1
            p22[k] = B[0, 0] + B[1, 1] + B[2, 2] + 2.0 * square - b11[k] - p11[k]
            roots[k] = length
        find_roots(-1.0, size, tau, b11, b1, b2, p11, p12, p22, roots, steps)
        for k in range(size):
            value = n - roots[k]
            own[k] = math.sqrt(value if value > 0.0 else 0.0)
        if kind == _MSV:
            continue
        for k in range(size):
            roots[k] = math.sqrt(tau[k]) + b11[k]
        find_roots(1.0, size, tau, b11, b1, b2, p11, p12, p22, roots, steps)
        for k in range(size):
            is_partial |= steps[k] > 0.0
            own[k] /= -1.0 if steps[k] > 0.0 else math.sqrt(n + roots[k])
    return is_partial


@compiled("b1(i8, i8[::1], b1[::1], f8[:,::1], i8[::1], f8[:,::1], f8[::1])")
def write_measures(kind, contacts, active, r, ends, q, b):  # type: ignore[no-untyped-def]
    """Writes one of `MEASURES` of the whole hand at all places.

    Returns whether an isotropy is still to be divided by sigma_max; there, b is -sigma_min.

    Args:
        kind: Index of the measure.
        contacts: As the other arguments, part of `Members`.
        active: Mask of the active contacts.
        r: Lever arms of the contacts.
        ends: Ends of the regions.
        q: Lever arms of the candidates.
        b: Result, shape (M,).
    """
    n, t, B, is_partial = 0.0, np.empty(3), np.empty((3, 3)), False
    for is_active in active:
        n += is_active
    for k in range(len(contacts)):
        start, stop = ends[k], ends[k + 1]
        # One row each: numba knows that part of a row is contiguous, but not part of all rows.
        x, y, z, own_b = q[0, start:stop], q[1, start:stop], q[2, start:stop], b[start:stop]
        others_sums(r, active, contacts[k], t, B)
        if kind == _VEW:
            write_volumes(t, B, n, x, y, z, own_b)
        else:
            is_partial |= write_singular_values(kind, t, B, n, x, y, z, own_b)
    return is_partial


class CompleteMeasure:
    """Weights of a measure of the whole hand's complete grasp matrix: `WriteWeights`.

    Args:
        name: Name of the measure in `MEASURES`.
    """

    def __init__(self, name: str) -> None:
        self._kind = list(MEASURES).index(name)

    def __call__(self, selection: SelectionInput, members: Members, b: FloatArray) -> None:
        """See `WriteWeights`."""
        contacts, active, r, ends, q = (*members[:4], members.q)
        if write_measures(self._kind, contacts, active, r, ends, q, b):
            places = np.flatnonzero(b < 0)
            i = contacts[np.searchsorted(ends, places, side="right") - 1]
            known = np.where(active[:, None], r, 0.0)  # Others may be NaN.
            G_C, G_Q = (contact_blocks(p, None, "complete") for p in (known, q.T[places]))
            grams = active[:, None, None] * (G_C @ G_C.swapaxes(1, 2))
            others = np.sum(grams, axis=0) - grams[i]
            b[places] /= -np.sqrt(np.linalg.eigvalsh(others + G_Q @ G_Q.swapaxes(1, 2))[:, -1])
