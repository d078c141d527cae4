"""How functions are compiled: once for all processes, if there is a place to keep them."""

from collections.abc import Callable
from typing import Any

import numba

from drake_pregrasp.kernels.compiled.fresh_cache import discard_if_stale

FAST = {"reassoc", "contract", "nsz", "nnan"}
"""Liberties that let sums and comparisons of a block become SIMD code; not for labels."""


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Returns a decorator that compiles a function when it is first called.

    The code is kept beside its source, or else in numba's folder for the user. Where neither can
    be written, each process compiles its own. Code of other source than there is now is thrown
    away first.

    Args:
        options: Of `numba.njit`. Division by zero gives infinity or NaN: a test for it would keep
            loops from becoming SIMD code.
    """

    def compile_(function: Callable[..., Any]) -> Any:
        try:
            dispatcher = numba.njit(function, cache=True, error_model="numpy", **options)
        except RuntimeError:  # Numba found no folder that it can write to.
            return numba.njit(function, error_model="numpy", **options)
        discard_if_stale(dispatcher.stats.cache_path)
        return dispatcher

    return compile_
