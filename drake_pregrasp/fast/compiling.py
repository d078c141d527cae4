"""Compilation with numba, at import, with the code kept on disk."""

from collections.abc import Callable
from typing import Any

import numba


def compiled(signature: str | None = None) -> Callable[[Callable[..., Any]], Any]:
    """Returns a decorator that compiles a function with numba and keeps the code on disk.

    With a signature, it is compiled or loaded when it is defined, so that no tick waits for it.

    Args:
        signature: Types of the result and the arguments, in numba's notation.
    """

    def compile_(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(signature, cache=True, error_model="numpy")(function)
        except RuntimeError:  # Numba found no folder that it can write to.
            return numba.njit(signature, error_model="numpy")(function)

    return compile_
