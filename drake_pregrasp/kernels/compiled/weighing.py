"""The weights of the points of one block, whichever they are, for numba."""

import math

from drake_pregrasp.kernels.compiled.compiling import FAST, compiled
from drake_pregrasp.kernels.compiled.largest_eigenvalue import largest_eigenvalue
from drake_pregrasp.kernels.compiled.singular_values import (
    squared_largest,
    squared_smallest,
)
from drake_pregrasp.kernels.compiled.weights import gaussian_exponents, volumes
from drake_pregrasp.kernels.sorting import BLOCK

POSITION, MSV, GII, VEW = range(4)
"""Kinds of weights, by their places in `KINDS`."""


@compiled()
def weigh(  # type: ignore[no-untyped-def]
    kind, whitener, numbers, t, B, n, contact, q, scratch, b
):
    """Writes the weights of a block's points, or the logarithms of those of the position.

    Args:
        kind: Place in `KINDS`.
        whitener: As of `Weighting`.
        numbers: Of all contacts, from `volume_numbers`, shape (n_all, 18).
        t: Sums of the others' lever arms, shape (n_all, 3).
        B: Their sums of |r|² I - r rᵀ, shape (n_all, 3, 3).
        n: Number of active contacts.
        contact: The one that moves.
        q: Points, the first three rows count, shape (4, BLOCK).
        scratch: Shape (SCRATCH, BLOCK).
        b: Written to, shape (BLOCK,).
    """
    if kind == POSITION:
        gaussian_exponents(whitener, q, b)
    elif kind == VEW:
        volumes(numbers, contact, n, q, b)
    else:
        squared_smallest(t, B, contact, n, q, scratch, b)
        if kind == GII:
            squared_largest(n, scratch)
            for k in range(BLOCK):
                if scratch[8, k] < 0.0:
                    scratch[8, k] = largest_eigenvalue(
                        t[contact], B[contact], n, q[0, k], q[1, k], q[2, k]
                    )
            _divide(b, scratch)
        _take_roots(b)


@compiled(fastmath=FAST)
def _divide(b, scratch):  # type: ignore[no-untyped-def]
    for k in range(BLOCK):
        b[k] /= scratch[8, k]


@compiled(fastmath=FAST)
def _take_roots(b):  # type: ignore[no-untyped-def]
    for k in range(BLOCK):
        b[k] = math.sqrt(b[k])
