"""Gaussian and volumes of the points of one block, for numba."""

import math

import numpy as np

from drake_pregrasp.kernels.compiled.compiling import FAST, compiled
from drake_pregrasp.kernels.sorting import BLOCK

_LOWEST = -709.0  # Whose exponential is still a normal number.
_LOG2_E = 1.4426950408889634
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # ln 2 in two parts.


@compiled(fastmath=FAST)
def gaussian_exponents(whitener, q, out):  # type: ignore[no-untyped-def]
    """Writes -|W q|²/2 for a lower triangular W."""
    w00, w10, w11 = whitener[0, 0], whitener[1, 0], whitener[1, 1]
    w20, w21, w22 = whitener[2, 0], whitener[2, 1], whitener[2, 2]
    for k in range(BLOCK):
        u = w00 * q[0, k]
        v = w10 * q[0, k] + w11 * q[1, k]
        w = w20 * q[0, k] + w21 * q[1, k] + w22 * q[2, k]
        out[k] = -0.5 * (u * u + v * v + w * w)


@compiled(fastmath={"contract", "nsz"})
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


@compiled(fastmath=FAST)
def volumes(numbers, contact, n, q, out):  # type: ignore[no-untyped-def]
    """Writes Eq. 7, from the contact's row of `volume_numbers`."""
    m0, m1, m2, alpha, e_3, e_2 = (
        numbers[contact, 0],
        numbers[contact, 1],
        numbers[contact, 2],
        numbers[contact, 3],
        numbers[contact, 4],
        numbers[contact, 5],
    )
    k00, k01, k02, k11, k12, k22 = (
        numbers[contact, 6],
        2 * numbers[contact, 7],
        2 * numbers[contact, 8],
        numbers[contact, 9],
        2 * numbers[contact, 10],
        numbers[contact, 11],
    )
    a00, a01, a02, a11, a12, a22 = (
        numbers[contact, 12],
        2 * numbers[contact, 13],
        2 * numbers[contact, 14],
        numbers[contact, 15],
        2 * numbers[contact, 16],
        numbers[contact, 17],
    )
    cube = float(n) ** 3
    for k in range(BLOCK):
        u, v, w = q[0, k] - m0, q[1, k] - m1, q[2, k] - m2
        uu, uv, uw, vv, vw, ww = u * u, u * v, u * w, v * v, v * w, w * w
        dKd = k00 * uu + k01 * uv + k02 * uw + k11 * vv + k12 * vw + k22 * ww
        dAd = a00 * uu + a01 * uv + a02 * uw + a11 * vv + a12 * vw + a22 * ww
        a = alpha * (uu + vv + ww)
        out[k] = math.sqrt(cube * (e_3 + e_2 * a + alpha * (a * dKd - dAd)))
