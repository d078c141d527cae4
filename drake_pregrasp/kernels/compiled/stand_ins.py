"""How far the polynomial through a stand-in's values may be from the weights, for numba."""

import math

import numpy as np
from numpy.polynomial import chebyshev

from drake_pregrasp.kernels.compiled.compiling import FAST, compiled
from drake_pregrasp.kernels.sorting import BLOCK
from drake_pregrasp.kernels.stand_ins import COEFFICIENTS, GRID, NODES

_LAST, _BUT_ONE = COEFFICIENTS[NODES - 1].copy(), COEFFICIENTS[NODES - 2].copy()
_SHARES = (1 + GRID) / 2  # How far each place is along its side.
_FINE = chebyshev.chebvander(np.linspace(-1, 1, 64 * NODES + 1), NODES - 1) @ COEFFICIENTS
_LEBESGUE = 1.01 * float(np.max(np.sum(np.abs(_FINE), axis=1)))  # Of one side; it is flat there.
_LEBESGUE_OF_BOTH = _LEBESGUE**2
_MOST = 700.0  # Whose exponential is still finite.
_OF_GAUSSIAN = 4.0 / (math.factorial(NODES) * 2 ** (NODES - 2))  # The 4 is for moments.


@compiled(fastmath=FAST)
def interpolation_error(b):  # type: ignore[no-untyped-def]
    """Returns an estimate of what the polynomial through values on the grid leaves out.

    Of functions whose coefficients fall, the last two along each line tell of the rest: where they
    are analytic all that are left out are smaller, and a kink shows in the last ones too. It is no
    bound: beside a kink as much as four times that was left out.
    """
    of_rows, of_columns = 0.0, 0.0
    for i in range(NODES):
        last_u, before_u, last_v, before_v = 0.0, 0.0, 0.0, 0.0
        for j in range(NODES):
            last_u += _LAST[j] * b[NODES * i + j]
            before_u += _BUT_ONE[j] * b[NODES * i + j]
            last_v += _LAST[j] * b[NODES * j + i]
            before_v += _BUT_ONE[j] * b[NODES * j + i]
        of_rows = max(of_rows, abs(last_u) + abs(before_u))
        of_columns = max(of_columns, abs(last_v) + abs(before_v))
    return _LEBESGUE * (of_rows + of_columns)


@compiled()
def gaussian_error(whitener, q, reference):  # type: ignore[no-untyped-def]
    """Returns a bound on what the polynomial leaves out of exp(-|W q|²/2 - reference).

    Between the 8 places of one side it is at most that of the 8th derivative, over 8! 2⁶. With half
    a side a long in whitened lengths, that is a⁸ He_8(x) times the Gaussian, with the polynomial of
    Hermite, and x the whitened place along the side.
    """
    corners = (
        _whitened(whitener, q, 0),
        _whitened(whitener, q, NODES - 1),
        _whitened(whitener, q, BLOCK - NODES),
        _whitened(whitener, q, BLOCK - 1),
    )
    along_u, of_u = _of_side(corners[0], corners[1], corners)
    along_v, of_v = _of_side(corners[0], corners[2], corners)
    nearest = np.inf
    for x, y, z in corners:
        nearest = min(nearest, x * x + y * y + z * z)
    # Each place is at most half of each side away from a corner.
    nearest = max(math.sqrt(nearest) - along_u - along_v, 0.0)
    largest = math.exp(min(-0.5 * nearest * nearest - reference, _MOST))
    return _OF_GAUSSIAN * largest * (of_u + _LEBESGUE * of_v)


@compiled()
def _of_side(first, last, corners):  # type: ignore[no-untyped-def]
    """Returns half the length a of a side, and a bound on a⁸ He_8(x)."""
    x, y, z = last[0] - first[0], last[1] - first[1], last[2] - first[2]
    length = math.sqrt(x * x + y * y + z * z)
    farthest = 0.0
    for corner in corners:
        place = x * corner[0] + y * corner[1] + z * corner[2]
        farthest = max(farthest, abs(place))
    farthest = farthest / length if length > 0.0 else 0.0
    s = farthest * farthest
    hermite = (((s + 28.0) * s + 210.0) * s + 420.0) * s + 105.0
    # exp(-x²/2) |He_8(x)| is 105 at most.
    return 0.5 * length, (0.5 * length) ** 8 * min(hermite, 105.0 * math.exp(0.5 * s))


@compiled()
def _whitened(whitener, q, k):  # type: ignore[no-untyped-def]
    x, y, z = q[0, k], q[1, k], q[2, k]
    return (
        whitener[0, 0] * x,
        whitener[1, 0] * x + whitener[1, 1] * y,
        whitener[2, 0] * x + whitener[2, 1] * y + whitener[2, 2] * z,
    )


@compiled(fastmath=FAST)
def least_between(b):  # type: ignore[no-untyped-def]
    """Returns what the polynomial through values on the grid is above everywhere between.

    It is the bilinear function through the corners, which is least at one of them, and a rest.
    """
    b00, b10, b01, b11 = b[0], b[NODES - 1], b[BLOCK - NODES], b[BLOCK - 1]
    rest = 0.0
    for j in range(NODES):
        low = b00 + _SHARES[j] * (b01 - b00)
        rise = b10 + _SHARES[j] * (b11 - b10) - low
        for i in range(NODES):
            rest = max(rest, abs(b[NODES * j + i] - low - _SHARES[i] * rise))
    return min(min(b00, b10), min(b01, b11)) - _LEBESGUE_OF_BOTH * rest
