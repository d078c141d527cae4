"""Weights of the points of one block for numba; what they are is in `kernels` and its modules."""

import math

import numba
import numpy as np

from drake_pregrasp.planning.kernels.sorting import BLOCK

_FAST = {"reassoc", "contract", "nsz", "nnan"}
_CERTAIN = 0.75  # As in `extreme_singular_values`, and so the next.
_GAP = 1e-3
_UNCERTAIN = -1.0  # No y is negative, and steps never leave it: its gap to b11 is below zero.
SCRATCH = 9
"""Rows of numbers a block that the singular values need."""

_RAYLEIGH_STEPS = 12
_JACOBI_SWEEPS = 6
_SETTLED = 1e-7  # Of y, as the last change: its square is what is left.
_LOWEST = -709.0  # Whose exponential is still a normal number.
_LOG2_E = 1.4426950408889634
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # ln 2 in two parts.


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST)
def gaussian_exponents(whitener, x, y, z, out):  # type: ignore[no-untyped-def]
    """Writes -|W q|²/2 for a lower triangular W."""
    w00, w10, w11 = whitener[0, 0], whitener[1, 0], whitener[1, 1]
    w20, w21, w22 = whitener[2, 0], whitener[2, 1], whitener[2, 2]
    for k in range(BLOCK):
        u = w00 * x[k]
        v = w10 * x[k] + w11 * y[k]
        w = w20 * x[k] + w21 * y[k] + w22 * z[k]
        out[k] = -0.5 * (u * u + v * v + w * w)


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST)
def volumes(numbers, n, x, y, z, out):  # type: ignore[no-untyped-def]
    """Writes Eq. 7, from a row of `volume_numbers`."""
    m0, m1, m2, alpha, e_3, e_2 = (
        numbers[0],
        numbers[1],
        numbers[2],
        numbers[3],
        numbers[4],
        numbers[5],
    )
    k00, k01, k02, k11, k12, k22 = (
        numbers[6],
        2 * numbers[7],
        2 * numbers[8],
        numbers[9],
        2 * numbers[10],
        numbers[11],
    )
    a00, a01, a02, a11, a12, a22 = (
        numbers[12],
        2 * numbers[13],
        2 * numbers[14],
        numbers[15],
        2 * numbers[16],
        numbers[17],
    )
    cube = float(n) ** 3
    for k in range(BLOCK):
        u, v, w = x[k] - m0, y[k] - m1, z[k] - m2
        uu, uv, uw, vv, vw, ww = u * u, u * v, u * w, v * v, v * w, w * w
        dKd = k00 * uu + k01 * uv + k02 * uw + k11 * vv + k12 * vw + k22 * ww
        dAd = a00 * uu + a01 * uv + a02 * uw + a11 * vv + a12 * vw + a22 * ww
        a = alpha * (uu + vv + ww)
        out[k] = math.sqrt(cube * (e_3 + e_2 * a + alpha * (a * dKd - dAd)))


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST)
def smallest_singular_values(t, B, n, steps, x, y, z, scratch, out):  # type: ignore[no-untyped-def]
    """Writes sigma_min, and into scratch, shape (SCRATCH, BLOCK), what `divide_by_largest` needs.

    Each loop is over the points of a block, without branches, so that it compiles to SIMD code.
    """
    _blocks_across(t, B, x, y, z, scratch)
    tau, b11, p11, p12, p22 = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]
    b1b1, b1b2, b2b2 = scratch[5], scratch[6], scratch[7]
    for k in range(BLOCK):
        out[k] = math.sqrt(tau[k])
    for _ in range(steps):
        for k in range(BLOCK):
            d = out[k] + b11[k]
            d = 1.0 / (d if d > 0.0 else 1.0)
            c11, c12, c22 = p11[k] - d * b1b1[k], p12[k] - d * b1b2[k], p22[k] - d * b2b2[k]
            half = 0.5 * (c11 - c22)
            root = math.sqrt(half * half + c12 * c12)
            form = half * (b1b1[k] - b2b2[k]) + 2.0 * c12 * b1b2[k]
            along = 0.5 * (b1b1[k] + b2b2[k] - form / (root if root > 0.0 else 1.0))
            slope = (along if along > 0.0 else 0.0) * d * d
            p = 0.5 * (c11 + c22) - root - slope * out[k]
            below = p + math.sqrt(p * p + 4.0 * (1.0 + slope) * tau[k])
            out[k] = 2.0 * tau[k] / (below if below > 0.0 else 1.0)
    for k in range(BLOCK):
        out[k] = math.sqrt(n - out[k])


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST)
def divide_by_largest(n, steps, scratch, out):  # type: ignore[no-untyped-def]
    """Divides by sigma_max, but where that is not certain: there scratch[8] is `_UNCERTAIN`."""
    tau, b11, p11, p12, p22 = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]
    b1b1, b1b2, b2b2 = scratch[5], scratch[6], scratch[7]
    value = scratch[8]
    for k in range(BLOCK):
        certain = tau[k] > _CERTAIN * b11[k] * b11[k]
        value[k] = math.sqrt(tau[k]) + b11[k] if certain else _UNCERTAIN
    for _ in range(steps):
        for k in range(BLOCK):
            gap = value[k] - b11[k]
            certain = gap > _GAP * value[k]
            d = 1.0 / (gap if gap > 0.0 else 1.0)
            c11, c12, c22 = p11[k] + d * b1b1[k], p12[k] + d * b1b2[k], p22[k] + d * b2b2[k]
            half = 0.5 * (c11 - c22)
            root = math.sqrt(half * half + c12 * c12)
            form = half * (b1b1[k] - b2b2[k]) + 2.0 * c12 * b1b2[k]
            along = 0.5 * (b1b1[k] + b2b2[k] + form / (root if root > 0.0 else 1.0))
            slope = (along if along > 0.0 else 0.0) * d * d
            p = 0.5 * (c11 + c22) + root + slope * value[k]
            root = math.sqrt(p * p + 4.0 * (1.0 + slope) * tau[k])
            value[k] = (p + root) / (2.0 * (1.0 + slope)) if certain else _UNCERTAIN
    for k in range(BLOCK):
        out[k] /= math.sqrt(n + value[k]) if value[k] > 0.0 else 1.0


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST)
def _blocks_across(t, B, x, y, z, scratch):  # type: ignore[no-untyped-def]
    """Writes |t|², b11, P11, P12, P22 and the products b1 b1, b1 b2, b2 b2 into scratch."""
    t0, t1, t2 = t[0], t[1], t[2]
    m00, m01, m02, m11, m12, m22 = B[0, 0], B[0, 1], B[0, 2], B[1, 1], B[1, 2], B[2, 2]
    trace = m00 + m11 + m22
    tau_out, b11_out, p11_out, p12_out = scratch[0], scratch[1], scratch[2], scratch[3]
    p22_out, b1b1, b1b2, b2b2 = scratch[4], scratch[5], scratch[6], scratch[7]
    for k in range(BLOCK):
        qx, qy, qz = x[k], y[k], z[k]
        tx, ty, tz = t0 + qx, t1 + qy, t2 + qz
        tau = tx * tx + ty * ty + tz * tz
        length = math.sqrt(tau)
        scale = 1.0 / (length if length > 0.0 else 1.0)
        ax, ay, az = tx * scale, ty * scale, (tz * scale if length > 0.0 else 1.0)
        sign = 1.0 if az >= 0.0 else -1.0
        s = -1.0 / (sign + az)
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
        tau_out[k] = tau
        b11_out[k] = b11
        p11_out[k] = p11
        p12_out[k] = e2x * gx + e2y * gy + e2z * gz - q2 * q1
        p22_out[k] = trace + 2.0 * square - b11 - p11
        b1b1[k] = b1 * b1
        b1b2[k] = b1 * b2
        b2b2[k] = b2 * b2


@numba.njit(cache=True, error_model="numpy")
def largest_eigenvalue(t, B, n, qx, qy, qz):  # type: ignore[no-untyped-def]
    """Returns the largest eigenvalue of G Gᵀ with one more contact at q, wherever that is.

    It is n + y with y the largest of y(v) = (v'Bv + sqrt((v'Bv)² + 4 |t x v|²))/2 over unit vectors
    v: stationary where y v = (B + (tau I - t tᵀ)/y) v. The steps take for v the top eigenvector of
    that matrix at the y before. They rise, and each squares the error.
    """
    tx, ty, tz = t[0] + qx, t[1] + qy, t[2] + qz
    tau = tx * tx + ty * ty + tz * tz
    square = qx * qx + qy * qy + qz * qz
    c00, c11 = B[0, 0] + square - qx * qx, B[1, 1] + square - qy * qy
    c22 = B[2, 2] + square - qz * qz
    c01, c02, c12 = B[0, 1] - qx * qy, B[0, 2] - qx * qz, B[1, 2] - qy * qz
    y = 0.5 * (c00 + c11 + c22) + math.sqrt(tau)
    if not y > 0.0:
        return float(n)
    for _ in range(_RAYLEIGH_STEPS):
        s = 1.0 / y
        vx, vy, vz = _top_eigenvector(
            c00 + s * (tau - tx * tx),
            c11 + s * (tau - ty * ty),
            c22 + s * (tau - tz * tz),
            c01 - s * tx * ty,
            c02 - s * tx * tz,
            c12 - s * ty * tz,
        )
        along = tx * vx + ty * vy + tz * vz
        across = max(tau - along * along, 0.0)
        form = c00 * vx * vx + c11 * vy * vy + c22 * vz * vz
        form += 2.0 * (c01 * vx * vy + c02 * vx * vz + c12 * vy * vz)
        better = 0.5 * (form + math.sqrt(form * form + 4.0 * across))
        change = abs(better - y)
        y = better
        if change <= _SETTLED * y:
            break
    return n + y


@numba.njit(cache=True, error_model="numpy")
def _top_eigenvector(m00, m11, m22, m01, m02, m12):  # type: ignore[no-untyped-def]
    """Returns the unit eigenvector to the largest eigenvalue of a 3 x 3 matrix (Jacobi)."""
    ax, ay, az = 1.0, 0.0, 0.0
    bx, by, bz = 0.0, 1.0, 0.0
    cx, cy, cz = 0.0, 0.0, 1.0
    for _ in range(_JACOBI_SWEEPS):
        if abs(m01) + abs(m02) + abs(m12) <= 1e-16 * (abs(m00) + abs(m11) + abs(m22)):
            break
        c, s, shift = _rotation(m00, m11, m01)
        m00, m11, m01 = m00 - shift, m11 + shift, 0.0
        m02, m12 = c * m02 - s * m12, s * m02 + c * m12
        ax, bx = c * ax - s * bx, s * ax + c * bx
        ay, by = c * ay - s * by, s * ay + c * by
        az, bz = c * az - s * bz, s * az + c * bz
        c, s, shift = _rotation(m00, m22, m02)
        m00, m22, m02 = m00 - shift, m22 + shift, 0.0
        m01, m12 = c * m01 - s * m12, s * m01 + c * m12
        ax, cx = c * ax - s * cx, s * ax + c * cx
        ay, cy = c * ay - s * cy, s * ay + c * cy
        az, cz = c * az - s * cz, s * az + c * cz
        c, s, shift = _rotation(m11, m22, m12)
        m11, m22, m12 = m11 - shift, m22 + shift, 0.0
        m01, m02 = c * m01 - s * m02, s * m01 + c * m02
        bx, cx = c * bx - s * cx, s * bx + c * cx
        by, cy = c * by - s * cy, s * by + c * cy
        bz, cz = c * bz - s * cz, s * bz + c * cz
    if m00 >= m11 and m00 >= m22:
        return ax, ay, az
    if m11 >= m22:
        return bx, by, bz
    return cx, cy, cz


@numba.njit(cache=True, error_model="numpy")
def _rotation(p, q, m):  # type: ignore[no-untyped-def]
    """Returns cosine, sine and shift of the diagonal that take [[p, m], [m, q]] to a diagonal."""
    if m == 0.0:
        return 1.0, 0.0, 0.0
    theta = (q - p) / (2.0 * m)
    tangent = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1.0))
    c = 1.0 / math.sqrt(tangent * tangent + 1.0)
    return c, tangent * c, tangent * m


@numba.njit(cache=True, error_model="numpy", fastmath={"contract", "nsz"})
def exponentials(out, powers):  # type: ignore[no-untyped-def]
    """Replaces numbers, at most zero, by their exponentials; powers is scratch of int64.

    exp(v) = 2^k exp(f), |f| <= ln(2)/2: a Taylor series of degree 13 is exact to rounding there,
    and 2^k has the bits of k in its exponent. Below -709 it is the exponential of that: nothing
    depends on such weights.
    """
    for k in range(BLOCK):
        v = max(out[k], _LOWEST)
        whole = np.floor(v * _LOG2_E + 0.5)
        f = v - whole * _LN2_HIGH - whole * _LN2_LOW
        p = 1.0 / 6227020800.0
        p = p * f + 1.0 / 479001600.0
        p = p * f + 1.0 / 39916800.0
        p = p * f + 1.0 / 3628800.0
        p = p * f + 1.0 / 362880.0
        p = p * f + 1.0 / 40320.0
        p = p * f + 1.0 / 5040.0
        p = p * f + 1.0 / 720.0
        p = p * f + 1.0 / 120.0
        p = p * f + 1.0 / 24.0
        p = p * f + 1.0 / 6.0
        p = p * f + 0.5
        p = p * f + 1.0
        p = p * f + 1.0
        out[k] = p
        powers[k] = (np.int64(whole) + 1023) << 52
    scale = powers.view(np.float64)
    for k in range(BLOCK):
        out[k] *= scale[k]
