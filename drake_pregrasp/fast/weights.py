"""Weighted centroids of safe regions, with closed forms in place of decompositions.

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

from drake_pregrasp.contacts.centroids import TIE
from drake_pregrasp.contacts.strategies import FLAT
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.fast.pose_steps import inverted

KINDS = (
    *((strategy, "hand") for strategy in ("position", "msv", "gii", "vew")),
    *((strategy, "contact") for strategy in ("msv", "gii", "vew")),
)
"""Strategies and their readings, in the order of their indices; `position` has no reading.

An index from `len(KINDS)` on is that of a strategy whose weights are given to `weighted_goals`.
"""

_POSITION, _MSV, _GII, _VEW, _OWN_MSV, _OWN_GII, _OWN_VEW, _GIVEN = range(8)
_GROUP = 64  # Largest number of places that are computed together.
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
def largest_singular_value(t, B, n, q):  # type: ignore[no-untyped-def]
    """Returns sigma_max of n contacts, the last one at q, by decomposition."""
    M = np.zeros((6, 6))
    square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2]
    for row in range(3):
        M[row, row] = M[3 + row, 3 + row] = n
        for column in range(3):
            own = (square if row == column else 0.0) - q[row] * q[column]
            M[3 + row, 3 + column] += B[row, column] + own
    x, y, z = t[0] + q[0], t[1] + q[1], t[2] + q[2]
    for row, column, value in ((0, 1, -z), (0, 2, y), (1, 2, -x)):
        M[3 + row, column] = M[column, 3 + row] = value
        M[3 + column, row] = M[row, 3 + column] = -value
    return math.sqrt(np.linalg.eigvalsh(M)[-1])


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
def write_volumes(t, B, n, q, b):  # type: ignore[no-untyped-def]
    """Writes sqrt(det(G Gᵀ)) of n contacts, the last one at each place, shape (3, k)."""
    for k in range(len(b)):
        p, r, s = q[0, k], q[1, k], q[2, k]
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
def write_singular_values(kind, t, B, n, q, b):  # type: ignore[no-untyped-def]
    """Writes sigma_min, or the isotropy, of n contacts, the last one at each place, shape (3, k).

    Loops run over groups of places without branches, so that they are vector instructions.
    """
    rows = np.empty((9, _GROUP))
    b11, b1, b2, p11, p12, p22 = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5]
    tau, roots, steps = rows[6], rows[7], rows[8]
    for start in range(0, len(b), _GROUP):
        size = min(_GROUP, len(b) - start)
        own, px, py, pz = b[start:], q[0, start:], q[1, start:], q[2, start:]
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
        for _ in range(_STEPS):
            unsettled = 0
            for k in range(size):
                root = roots[k]
                mu, slope = eigenvalue(-1.0, root + b11[k], p11[k], p12[k], p22[k], b1[k], b2[k])
                p = mu - slope * root
                below = p + math.sqrt(p * p + 4.0 * (1.0 + slope) * tau[k])
                roots[k] = 2.0 * tau[k] / (below if below > 0.0 else 1.0)
                steps[k] = abs(roots[k] - root) - _SETTLED * roots[k]
            for k in range(size):
                unsettled += steps[k] > 0.0
            if unsettled == 0:
                break
        for k in range(size):
            value = n - roots[k]
            own[k] = math.sqrt(value if value > 0.0 else 0.0)
        if kind == _MSV:
            continue
        for k in range(size):
            roots[k], steps[k] = math.sqrt(tau[k]) + b11[k], 1.0
        for _ in range(_STEPS):
            unsettled = 0
            for k in range(size):
                root, gap = roots[k], roots[k] - b11[k]
                nu, slope = eigenvalue(1.0, gap, p11[k], p12[k], p22[k], b1[k], b2[k])
                p = nu + slope * root
                found = (p + math.sqrt(p * p + 4.0 * (1.0 + slope) * tau[k])) / (1.0 + slope) / 2.0
                step = abs(found - root) - _SETTLED * found
                usable = tau[k] > 0.75 * b11[k] * b11[k] and gap > 1e-3 * root
                # Two of these places are not computed further: those that settled, and those
                # that need the decomposition.
                steps[k] = (step if usable else 1e300) if steps[k] < 1e300 else 1e300
                roots[k] = found if steps[k] < 1e300 else root
            for k in range(size):
                unsettled += steps[k] > 0.0 and steps[k] < 1e300
            if unsettled == 0:
                break
        for k in range(size):
            if steps[k] > 0.0:
                place = (px[k], py[k], pz[k])
                own[k] /= largest_singular_value(t, B, n, place)
            else:
                own[k] /= math.sqrt(n + roots[k])


@compiled()
def write_measures(kind, t, B, n, precision, q, b):  # type: ignore[no-untyped-def]
    """Writes b_n of one of `KINDS`, or log(b_n) of `position`, at places, shape (3, k)."""
    x, y, z = q[0], q[1], q[2]
    if kind == _POSITION:
        xx, yy, zz = precision[0, 0], precision[1, 1], precision[2, 2]
        xy, xz = precision[0, 1] + precision[1, 0], precision[0, 2] + precision[2, 0]
        yz = precision[1, 2] + precision[2, 1]
        for k in range(len(b)):
            square = xx * x[k] * x[k] + yy * y[k] * y[k] + zz * z[k] * z[k]
            mixed = xy * x[k] * y[k] + xz * x[k] * z[k] + yz * y[k] * z[k]
            b[k] = -0.5 * (square + mixed)
    elif kind == _VEW:
        write_volumes(t, B, n, q, b)
    elif kind < _VEW:
        write_singular_values(kind, t, B, n, q, b)
    else:
        for k in range(len(b)):
            rho = math.sqrt(x[k] * x[k] + y[k] * y[k] + z[k] * z[k])
            own = math.sqrt(1.0 + rho * rho / 4.0) - rho / 2.0
            b[k] = 1.0 if kind == _OWN_VEW else own if kind == _OWN_MSV else own * own


@compiled()
def add_weights(kind, share, stretch, power, areas, b, weights):  # type: ignore[no-untyped-def]
    """Adds a strategy's share of the weights, which are at most 1, over one region."""
    least, most, difference, whole = np.inf, -np.inf, 0.0, 0.0
    for k in range(len(b)):
        least, most = min(least, b[k]), max(most, b[k])
    if kind == _POSITION:
        for k in range(len(b)):
            weights[k] += share * math.exp(b[k] - most)
        return
    base = 0.0
    if stretch:
        base = least
        for k in range(len(b)):
            difference += (b[k] - least) * areas[k]
            whole += b[k] * areas[k]
        if not difference > FLAT * whole:
            return
    scale = most - base
    if not scale > 0.0:
        return
    scale = 1.0 / scale
    if power == 1.0:
        for k in range(len(b)):
            weight = (b[k] - base) * scale
            weights[k] += share * (weight if weight > 0.0 else 0.0)
    else:
        for k in range(len(b)):
            weights[k] += share * max((b[k] - base) * scale, 0.0) ** power


@compiled(
    "f8[:,::1](Tuple((i8[::1], f8[::1], b1, f8, b1)), i8[::1], i8[::1], b1[::1], f8[:,::1],"
    " f8[:,::1], f8[:,::1], f8, f8[::1], f8[:,::1])"
)
def weighted_goals(settings, contacts, labels, active, r, covariance, q, unit, areas, given):  # type: ignore[no-untyped-def]
    """Returns the centroids of contacts' regions or their best points, shape (k, 3).

    Both are relative to the centre of mass, in metres.

    Args:
        settings: Indices of the strategies (see `KINDS`); share of each of them in the weights;
            whether to subtract a region's smallest weight; exponent of the weights; and whether to
            return the candidates with the largest weights.
        contacts: Indices of the contacts that move, shape (k,).
        labels: Region of each candidate, shape (N,).
        active: Mask of the contacts that take part in the grasp, shape (n,).
        r: Lever arms of the contacts, shape (n, 3), in units.
        covariance: Covariance of the position, shape (3, 3), in units².
        q: Lever arms of the candidates, shape (N, 3), in metres.
        unit: Length by which the matrix divides lever arms, in metres.
        areas: Surface area that each candidate represents, shape (N,), in m².
        given: Weights of the given strategies at the candidates, shape (g, N).
    """
    kinds, shares, stretch, power, best_point = settings
    n, t, B, precision = 0.0, np.empty(3), np.empty((3, 3)), inverted(covariance)
    for is_active in active:
        n += is_active
    place, ends = np.full(len(r), -1), np.zeros(len(contacts) + 1, np.int64)
    for k in range(len(contacts)):
        place[contacts[k]] = k
    for label in labels:
        if label >= 0 and place[label] >= 0:
            ends[place[label] + 1] += 1
    for k in range(len(contacts)):
        ends[k + 1] += ends[k]
    # The candidates of each contact, one contact after another.
    members, filled, own_q = np.empty(ends[-1], np.int64), ends.copy(), np.empty((3, ends[-1]))
    own_areas = np.empty(ends[-1])
    for j in range(len(labels)):
        if labels[j] >= 0 and place[labels[j]] >= 0:
            to = filled[place[labels[j]]]
            members[to], own_areas[to] = j, areas[j]
            own_q[0, to], own_q[1, to] = q[j, 0] / unit, q[j, 1] / unit
            own_q[2, to] = q[j, 2] / unit
            filled[place[labels[j]]] += 1
    b, weights, goals = np.empty(ends[-1]), np.zeros(ends[-1]), np.empty((len(contacts), 3))
    for k in range(len(contacts)):
        i, start, stop = contacts[k], ends[k], ends[k + 1]
        here, own_b, own_weights = own_q[:, start:stop], b[start:stop], weights[start:stop]
        x, y, z, own = here[0], here[1], here[2], own_areas[start:stop]
        others_sums(r, active, i, t, B)
        for s in range(len(kinds)):
            if kinds[s] >= _GIVEN:
                for j in range(stop - start):
                    own_b[j] = given[kinds[s] - _GIVEN, members[start + j]]
            else:
                write_measures(kinds[s], t, B, n, precision, here, own_b)
            add_weights(kinds[s], shares[s], stretch, power, own, own_b, own_weights)
        most = 0.0
        for j in range(stop - start):
            most = max(most, own_weights[j])
        if best_point:
            for j in range(stop - start):
                if own_weights[j] >= most * (1.0 - TIE):
                    for axis in range(3):
                        goals[k, axis] = q[members[start + j], axis]
                    break
            continue
        gx, gy, gz, whole = 0.0, 0.0, 0.0, 0.0
        for j in range(stop - start):
            weight = own[j] * (own_weights[j] if most > 0.0 else 1.0)
            gx, gy, gz = gx + weight * x[j], gy + weight * y[j], gz + weight * z[j]
            whole += weight
        whole /= unit
        goals[k, 0], goals[k, 1], goals[k, 2] = gx / whole, gy / whole, gz / whole
    return goals
