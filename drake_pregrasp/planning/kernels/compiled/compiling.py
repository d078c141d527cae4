"""How functions are compiled: once for all processes, if there is a place to keep them."""

from collections.abc import Callable
from typing import Any

import numba

FAST = {"reassoc", "contract", "nsz", "nnan"}
"""Liberties that let sums and comparisons of a block become SIMD code; not for labels."""


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Returns a decorator that compiles a function when it is first called.

    The code is kept beside its source, or else in numba's folder for the user. Where neither can
    be written, each process compiles its own.

    Args:
        options: Of `numba.njit`. Division by zero gives infinity or NaN: a test for it would keep
            loops from becoming SIMD code.
    """

    def compile_(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(function, cache=True, error_model="numpy", **options)
        except RuntimeError:  # Numba found no folder that it can write to.
            return numba.njit(function, error_model="numpy", **options)

    return compile_
