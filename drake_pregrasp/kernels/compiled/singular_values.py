"""Extreme singular values at the points of a block, as `extreme_singular_values`, for numba."""

import math

from drake_pregrasp.kernels.compiled.compiling import FAST, compiled
from drake_pregrasp.kernels.sorting import BLOCK
from drake_pregrasp.quality.singular_values import SETTLED, STEPS

_CERTAIN = 0.75  # As in `extreme_singular_values`, and so the next.
_GAP = 1e-3
_UNCERTAIN = -1.0  # No y is negative, and steps never leave it: its gap to b11 is below zero.
_PLAIN_STEPS = 2  # As a rule; where they don't settle the largest, it is found another way.
SCRATCH = 9
"""Rows of numbers a block that the singular values need."""


@compiled(fastmath=FAST)
def squared_smallest(t, B, contact, n, q, s, out):  # type: ignore[no-untyped-def]
    """Writes sigma_min², and into s, shape (SCRATCH, BLOCK), what the largest needs.

    Each loop is over the points of a block, without branches, so that it compiles to SIMD code. Its
    time goes into divisions and roots. So the last steps are plain Newton steps of
    f(x) = x² + x mu(x) - tau, which have no root of their own, and A = P - b bᵀ/g is taken times g.
    Two of them are enough as a rule; there are more until all points of the block are settled.
    """
    _blocks_across(t, B, contact, q, s, out)
    for k in range(BLOCK):
        g = out[k] + s[1, k]
        mu, slope = _eigenvalue(-1.0, g, s[2, k], s[3, k], s[4, k], s[5, k], s[6, k], s[7, k])
        p = mu - slope * out[k]
        below = p + math.sqrt(p * p + 4.0 * (1.0 + slope) * s[0, k])
        out[k] = 2.0 * s[0, k] / (below if below > 0.0 else 1.0)
    for step in range(STEPS):
        for k in range(BLOCK):
            g = out[k] + s[1, k]
            mu, slope = _eigenvalue(-1.0, g, s[2, k], s[3, k], s[4, k], s[5, k], s[6, k], s[7, k])
            rise = (2.0 + slope) * out[k] + mu
            above = (1.0 + slope) * out[k] * out[k] + s[0, k]
            better = above / (rise if rise > 0.0 else 1.0)
            s[8, k] = abs(better - out[k]) - SETTLED * better
            out[k] = better
        if step > 0:
            unsettled = 0.0
            for k in range(BLOCK):
                unsettled = max(unsettled, s[8, k])
            if unsettled <= 0.0:
                break
    for k in range(BLOCK):
        out[k] = n - out[k]


@compiled(fastmath=FAST)
def squared_largest(n, s):  # type: ignore[no-untyped-def]
    """Writes sigma_max² into s[8], or a number below zero where that is not certain, or settled."""
    for k in range(BLOCK):
        certain = s[0, k] > _CERTAIN * s[1, k] * s[1, k]
        y = math.sqrt(s[0, k]) + s[1, k]
        g = y - s[1, k]
        nu, slope = _eigenvalue(1.0, g, s[2, k], s[3, k], s[4, k], s[5, k], s[6, k], s[7, k])
        p = nu + slope * y
        root = math.sqrt(p * p + 4.0 * (1.0 + slope) * s[0, k])
        better = (p + root) / (2.0 * (1.0 + slope))
        s[8, k] = better if certain & (g > _GAP * y) else _UNCERTAIN
    for step in range(_PLAIN_STEPS):
        for k in range(BLOCK):
            g = s[8, k] - s[1, k]
            nu, slope = _eigenvalue(1.0, g, s[2, k], s[3, k], s[4, k], s[5, k], s[6, k], s[7, k])
            rise = (2.0 + slope) * s[8, k] - nu
            above = (1.0 + slope) * s[8, k] * s[8, k] + s[0, k]
            better = above / (rise if rise > 0.0 else 1.0)
            settles = (step < _PLAIN_STEPS - 1) | (abs(better - s[8, k]) <= SETTLED * better)
            certain = (g > _GAP * s[8, k]) & (rise > 0.0) & settles
            s[8, k] = better if certain else _UNCERTAIN
    for k in range(BLOCK):
        s[8, k] = n + s[8, k] if s[8, k] > 0.0 else _UNCERTAIN


@compiled(inline="always")
def _eigenvalue(sign, g, p11, p12, p22, b1b1, b1b2, b2b2):  # type: ignore[no-untyped-def]
    """Returns an eigenvalue of P + sign b bᵀ/g, the upper or lower one as sign, and (b·v)²/g²."""
    g = g if g > 0.0 else 1.0
    half = 0.5 * ((p11 - p22) * g + sign * (b1b1 - b2b2))
    c12 = p12 * g + sign * b1b2
    root = math.sqrt(half * half + c12 * c12)
    form = half * (b1b1 - b2b2) + 2.0 * c12 * b1b2
    safe = root if root > 0.0 else 1.0
    inverse = 1.0 / (g * safe)
    d = safe * inverse
    along = 0.5 * (b1b1 + b2b2 + sign * form * g * inverse)
    slope = (along if along > 0.0 else 0.0) * d * d
    return 0.5 * (p11 + p22) + sign * d * (0.5 * (b1b1 + b2b2) + root), slope


@compiled(fastmath=FAST)
def _blocks_across(t, B, contact, q, scratch, out):  # type: ignore[no-untyped-def]
    """Writes |t|², b11, P11, P12, P22, b1 b1, b1 b2, b2 b2 into scratch, and |t|, the first x."""
    t0, t1, t2 = t[contact, 0], t[contact, 1], t[contact, 2]
    m00, m11, m22 = B[contact, 0, 0], B[contact, 1, 1], B[contact, 2, 2]
    m01, m02, m12 = B[contact, 0, 1], B[contact, 0, 2], B[contact, 1, 2]
    trace = m00 + m11 + m22
    for k in range(BLOCK):
        qx, qy, qz = q[0, k], q[1, k], q[2, k]
        tx, ty, tz = t0 + qx, t1 + qy, t2 + qz
        tau = tx * tx + ty * ty + tz * tz
        length = math.sqrt(tau)
        safe = length if length > 0.0 else 1.0
        tz = tz if length > 0.0 else 1.0
        sign = 1.0 if tz >= 0.0 else -1.0
        above = sign * safe + tz
        inverse = 1.0 / (safe * above)
        scale, s = above * inverse, -safe * safe * inverse
        ax, ay, az = tx * scale, ty * scale, tz * scale
        xy = ax * ay * s
        e1x, e1y, e1z = 1.0 + sign * ax * ax * s, sign * xy, -sign * ax
        e2x, e2y, e2z = xy, sign + ay * ay * s, -ay
        square = qx * qx + qy * qy + qz * qz
        q0 = ax * qx + ay * qy + az * qz
        q1 = e1x * qx + e1y * qy + e1z * qz
        q2 = e2x * qx + e2y * qy + e2z * qz
        fx = m00 * ax + m01 * ay + m02 * az
        fy = m01 * ax + m11 * ay + m12 * az
        fz = m02 * ax + m12 * ay + m22 * az
        gx = m00 * e1x + m01 * e1y + m02 * e1z
        gy = m01 * e1x + m11 * e1y + m12 * e1z
        gz = m02 * e1x + m12 * e1y + m22 * e1z
        b11 = ax * fx + ay * fy + az * fz + square - q0 * q0
        b1 = e1x * fx + e1y * fy + e1z * fz - q1 * q0
        b2 = e2x * fx + e2y * fy + e2z * fz - q2 * q0
        p11 = e1x * gx + e1y * gy + e1z * gz + square - q1 * q1
        scratch[0, k] = tau
        out[k] = length
        scratch[1, k] = b11
        scratch[2, k] = p11
        scratch[3, k] = e2x * gx + e2y * gy + e2z * gz - q2 * q1
        scratch[4, k] = trace + 2.0 * square - b11 - p11
        scratch[5, k] = b1 * b1
        scratch[6, k] = b1 * b2
        scratch[7, k] = b2 * b2
