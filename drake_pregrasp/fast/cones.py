"""The min-weight margin of one grasp, by an interior-point method for a few small cones.

The reference passes the same program to a library, which takes more time to set it up than to solve
it.
"""

import math

import numpy as np

from drake_pregrasp.fast.compiling import compiled
from drake_pregrasp.quality.force_closure import LEAST_SPREAD

_CENTRING = 0.15  # Share of the gap at which a step aims.
_NEAREST = 0.02  # Least share of the distance to a cone's boundary that a step leaves.
_SHORTER = 0.85  # Factor of steps that come closer.
_GAP = 1e-11  # Gap at which the solution is accepted, for each contact.
_LARGEST_GAP = 1e-9  # The same, if rounding permits no further step.
_MOST_STEPS = 100  # Random grasps need a third of them at most.


@compiled()
def factor_and_solve(M, x):  # type: ignore[no-untyped-def]
    """Replaces x by the solution of M x = x with a symmetric M, shape (6, 6); M by its L D Lᵀ."""
    for j in range(6):
        for i in range(j + 1, 6):
            share = M[i, j] / M[j, j]
            for k in range(j + 1, i + 1):
                M[i, k] -= share * M[k, j]
            x[i] -= share * x[j]
    for j in range(5, -1, -1):
        for i in range(j + 1, 6):
            x[j] -= M[i, j] * x[i]
        x[j] /= M[j, j]


@compiled()
def distance(x):  # type: ignore[no-untyped-def]
    """Returns x_0 - |x_t| of a vector x."""
    square = 0.0
    for a in range(1, len(x)):
        square += x[a] * x[a]
    return x[0] - math.sqrt(square)


@compiled()
def is_inside(x, dx, step):  # type: ignore[no-untyped-def]
    """Returns whether all vectors x + step dx, shape (n, k), stay in the interior of their cone."""
    for i in range(len(x)):
        first, square = x[i, 0] + step * dx[i, 0], 0.0
        for a in range(1, x.shape[1]):
            square += (x[i, a] + step * dx[i, a]) ** 2
        if not first - math.sqrt(square) > _NEAREST * distance(x[i]):
            return False
    return True


@compiled()
def root(x):  # type: ignore[no-untyped-def]
    """Returns the root of the determinant x_0² - |x_t|² of a vector x inside its cone."""
    return math.sqrt(distance(x) * (2.0 * x[0] - distance(x)))


@compiled()
def write_normal_equations(A, s, g, c, aim, M, dy, ds, dg, u, w):  # type: ignore[no-untyped-def]
    """Writes the matrix of a step's linear equations in dy, and their right side; see below.

    Args:
        A: Matrices A_i, shape (n, k, 6).
        s: Vectors s_i, shape (n, k).
        g: Multipliers g_i, shape (n, k).
        c: Gradient of the dual, shape (6,).
        aim: Aim m of the step.
        M: Result, the sum of A_iᵀ H_i A_i, shape (6, 6), below and on its diagonal.
        dy: Result, the right side, shape (6,).
        ds: Result for `write_direction`, the scaling of each cone, shape (n, k).
        dg: Result for `write_direction`, m s_i⁻¹, shape (n, k).
        u: Memory, shape (6,).
        w: Memory, shape (k,).
    """
    n, k, _ = A.shape
    M[:] = 0.0
    for j in range(6):
        dy[j] = -c[j]
    for i in range(n):
        # Of s and g over the roots of their determinants, w is half-way.
        root_s, root_g = root(s[i]), root(g[i])
        scale, product = root_g / root_s, 0.0
        for a in range(k):
            product += s[i, a] * g[i, a] / (root_s * root_g)
        for a in range(k):
            sign = 1.0 if a == 0 else -1.0
            half = math.sqrt(2.0 * (1.0 + product))
            w[a] = (g[i, a] / root_g + sign * s[i, a] / root_s) / half
            # H = scale (2 w wᵀ - J), of which ds and dg keep what the second pass needs.
            ds[i, a] = w[a]
            dg[i, a] = aim * sign * s[i, a] / (root_s * root_s)
        for j in range(6):
            u[j] = 0.0
            for a in range(k):
                u[j] += w[a] * A[i, a, j]
                dy[j] -= dg[i, a] * A[i, a, j]
        for j in range(6):
            for m in range(j + 1):
                across = 2.0 * u[j] * u[m] - A[i, 0, j] * A[i, 0, m]
                for a in range(1, k):
                    across += A[i, a, j] * A[i, a, m]
                M[j, m] += scale * across


@compiled()
def write_direction(A, s, g, dy, ds, dg, w):  # type: ignore[no-untyped-def]
    """Writes the steps of s and g, after those of y; the arguments are as before."""
    n, k, _ = A.shape
    for i in range(n):
        for a in range(k):
            w[a] = ds[i, a]
        root_s, root_g = root(s[i]), root(g[i])
        product = 0.0
        for a in range(k):
            ds[i, a] = 0.0
            for j in range(6):
                ds[i, a] -= A[i, a, j] * dy[j]
            product += w[a] * ds[i, a]
        for a in range(k):
            sign = 1.0 if a == 0 else -1.0
            turned = root_g / root_s * (2.0 * w[a] * product - sign * ds[i, a])
            dg[i, a] -= g[i, a] + turned


@compiled("f8(f8[:,:,::1])")
def compiled_largest_minimum(B):  # type: ignore[no-untyped-def]
    """Returns `largest_minimum` by a primal-dual method with the scaling of Nesterov and Todd.

    The dual is min 1 + c y over s_i = e_0 - A_i y in the cones; g_i are its multipliers. A step
    solves A dy + ds = 0, A_iᵀ dg_i = -(c + A_iᵀ g_i) and dg_i + H_i ds_i = m s_i⁻¹ - g_i for the
    aim m, where H_i = W_i⁻² maps s_i to g_i (Nesterov & Todd, Mathematics of Operations Research
    22, 1997). y = 0 is inside, so that 1 + c y is an upper bound at any time.
    """
    n, _, k = B.shape
    if n == 0:
        return 0.0
    c, A = np.zeros(6), np.empty((n, k, 6))
    for i in range(n):
        for j in range(6):
            c[j] += B[i, j, 0] / n
    for i in range(n):
        for a in range(k):
            for j in range(6):
                A[i, a, j] = B[i, j, a] - (c[j] if a == 0 else 0.0)
    y, dy, M, u, w = np.zeros(6), np.empty(6), np.empty((6, 6)), np.empty(6), np.empty(k)
    s, g, ds, dg = np.zeros((n, k)), np.zeros((n, k)), np.empty((n, k)), np.empty((n, k))
    for i in range(n):
        s[i, 0] = g[i, 0] = 1.0
    value = gap = 1.0
    for iteration in range(_MOST_STEPS):
        value, gap, residual = 1.0, 0.0, 0.0
        for j in range(6):
            value += c[j] * y[j]
            left = c[j]
            for i in range(n):
                for a in range(k):
                    left += A[i, a, j] * g[i, a]
            residual = max(residual, abs(left))
        for i in range(n):
            for a in range(k):
                gap += s[i, a] * g[i, a] / n
        if value <= 0.0 or (gap < _GAP and residual < _GAP):
            return max(0.0, value)
        aim = _CENTRING * gap
        write_normal_equations(A, s, g, c, aim, M, dy, ds, dg, u, w)
        if iteration == 0:  # H is the identity.
            trace = 0.0
            for j in range(6):
                trace += M[j, j]
            if not np.linalg.eigvalsh(M)[0] > LEAST_SPREAD * trace:
                return 0.0
        factor_and_solve(M, dy)
        write_direction(A, s, g, dy, ds, dg, w)
        step = 1.0
        while step > _GAP and not (is_inside(s, ds, step) and is_inside(g, dg, step)):
            step *= _SHORTER
        if not step > _GAP:
            break
        for j in range(6):
            y[j] += step * dy[j]
        for i in range(n):
            for a in range(k):
                s[i, a] += step * ds[i, a]
                g[i, a] += step * dg[i, a]
    return max(0.0, value) if gap < _LARGEST_GAP else 0.0
