"""The largest eigenvalue of G Gᵀ wherever the closed form is not certain, for numba."""

import math

from drake_pregrasp.kernels.compiled.compiling import compiled

_RAYLEIGH_STEPS = 12
_JACOBI_SWEEPS = 6
_SETTLED = 1e-7  # Of y, as the last change: its square is what is left.


@compiled()
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


@compiled()
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


@compiled()
def _rotation(p, q, m):  # type: ignore[no-untyped-def]
    """Returns cosine, sine and shift of the diagonal that take [[p, m], [m, q]] to a diagonal."""
    if m == 0.0:
        return 1.0, 0.0, 0.0
    theta = (q - p) / (2.0 * m)
    tangent = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1.0))
    c = 1.0 / math.sqrt(tangent * tangent + 1.0)
    return c, tangent * c, tangent * m
