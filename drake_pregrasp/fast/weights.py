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

from drake_pregrasp.contacts.centroids import TIE
from drake_pregrasp.contacts.strategies import FLAT
from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.fast.margins import write_margins

KINDS = (
    ("position", "hand"),
    ("msv", "hand"),
    ("gii", "hand"),
    ("vew", "hand"),
    ("margin", "hand"),
    ("msv", "contact"),
    ("gii", "contact"),
    ("vew", "contact"),
)
"""Strategies and their readings, in the order of their indices; two do not depend on a reading."""

_POSITION, _MSV, _GII, _VEW, _MARGIN, _OWN_MSV, _OWN_GII, _OWN_VEW = range(8)
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


@compiled()
def write_measures(kind, members, t, B, n, precision, q, b):  # type: ignore[no-untyped-def]
    """Writes b_n of a strategy, but of `margin`, at candidates; log(b_n) of `position`."""
    for k in members:
        if kind == _POSITION:
            b[k] = 0.0
            for row in range(3):
                for column in range(3):
                    b[k] -= 0.5 * q[k, row] * precision[row, column] * q[k, column]
        elif kind == _VEW:
            b[k] = volume(t, B, n, q[k])
        elif kind == _OWN_VEW:
            b[k] = 1.0
        elif kind >= _OWN_MSV:
            rho = math.sqrt(q[k, 0] * q[k, 0] + q[k, 1] * q[k, 1] + q[k, 2] * q[k, 2])
            b[k] = math.sqrt(1.0 + rho * rho / 4.0) - rho / 2.0
            if kind == _OWN_GII:
                b[k] *= b[k]
        else:
            b[k] = measure(kind, t, B, n, q[k])


@compiled()
def add_weights(kind, share, stretch, power, members, areas, b, weights):  # type: ignore[no-untyped-def]
    """Adds a strategy's share of the weights, which are at most 1, over one region."""
    least, most = np.inf, -np.inf
    for k in members:
        least, most = min(least, b[k]), max(most, b[k])
    if kind == _POSITION:
        for k in members:
            weights[k] += share * math.exp(b[k] - most)
        return
    base = 0.0
    if stretch:
        base, difference, whole = least, 0.0, 0.0
        for k in members:
            difference += (b[k] - least) * areas[k]
            whole += b[k] * areas[k]
        if not difference > FLAT * whole:
            return
    scale = most - base
    if not scale > 0.0:
        return
    for k in members:
        weight = max(b[k] - base, 0.0) / scale
        weights[k] += share * (weight if power == 1.0 else weight**power)


@compiled(
    "f8[:,::1](i8[::1], f8[::1], b1, f8, b1, i8[::1], i8[::1], b1[::1], f8[:,::1], f8[:,::1],"
    " f8[:,::1], f8[::1], f8[:,:,:,::1], f8[:,::1], f8)"
)
def weighted_goals(  # type: ignore[no-untyped-def]
    kinds,
    shares,
    stretch,
    power,
    best_point,
    contacts,
    labels,
    active,
    r,
    precision,
    q,
    areas,
    P_C,
    P_Q,
    friction,
):
    """Returns the centroids of contacts' regions or their best points, shape (k, 3).

    Both are relative to the centre of mass, in metres.

    Args:
        kinds: Indices of the strategies in `KINDS`.
        shares: Share of each of them in the weights.
        stretch: Whether to subtract a region's smallest weight.
        power: Exponent of the weights.
        best_point: Whether to return the candidates with the largest weights.
        contacts: Indices of the contacts that move, shape (k,).
        labels: Region of each candidate, shape (N,).
        active: Mask of the contacts that take part in the grasp, shape (n,).
        r: Lever arms of the contacts, shape (n, 3), in metres.
        precision: Inverse of the position's covariance, shape (3, 3), in 1/m².
        q: Lever arms of the candidates, shape (N, 3), in metres.
        areas: Surface area that each candidate represents, shape (N,), in m².
        P_C: P of the contacts, for the margin; see `write_margins`.
        P_Q: P of a contact at the candidates.
        friction: Coulomb's coefficient.
    """
    n, t, B = 0, np.empty(3), np.empty((3, 3))
    for i in range(len(active)):
        n += active[i]
    place, ends = np.full(len(r), -1), np.zeros(len(contacts) + 1, np.int64)
    for k in range(len(contacts)):
        place[contacts[k]] = k
    for label in labels:
        if label >= 0 and place[label] >= 0:
            ends[place[label] + 1] += 1
    for k in range(len(contacts)):
        ends[k + 1] += ends[k]
    members, filled = np.empty(ends[-1], np.int64), ends.copy()
    for j in range(len(labels)):
        if labels[j] >= 0 and place[labels[j]] >= 0:
            members[filled[place[labels[j]]]] = j
            filled[place[labels[j]]] += 1
    b, weights, goals = np.empty(len(q)), np.zeros(len(q)), np.empty((len(contacts), 3))
    for k in range(len(contacts)):
        i, own = contacts[k], members[ends[k] : ends[k + 1]]
        others_sums(r, active, i, t, B)
        for s in range(len(kinds)):
            if kinds[s] == _MARGIN:
                write_margins(i, active, P_C, P_Q, friction, own, b)
            else:
                write_measures(kinds[s], own, t, B, n, precision, q, b)
            add_weights(kinds[s], shares[s], stretch, power, own, areas, b, weights)
        if best_point:
            best = 0.0
            for j in own:
                best = max(best, weights[j])
            for j in own:
                if weights[j] >= best * (1.0 - TIE):
                    goals[k] = q[j]
                    break
            continue
        x, y, z, whole, flat = 0.0, 0.0, 0.0, 0.0, True
        for j in own:
            flat = flat and weights[j] == 0.0
        for j in own:
            weight = areas[j] if flat else weights[j] * areas[j]
            x, y, z = x + weight * q[j, 0], y + weight * q[j, 1], z + weight * q[j, 2]
            whole += weight
        goals[k, 0], goals[k, 1], goals[k, 2] = x / whole, y / whole, z / whole
    return goals
