"""Compilation with numba, at import, with the code kept on disk."""

import logging
from collections.abc import Callable
from typing import Any

import numba
from numba.core.event import Event, Listener, register, unregister

GROUP = 128
"""Largest number of places that are computed together, with memory for each."""


class _Announcement(Listener):  # type: ignore[misc]
    """Says once that numba compiles, since the first planner waits for it."""

    def on_start(self, event: Event) -> None:
        """See numba's `Listener`."""
        unregister("numba:compile", self)
        logging.getLogger(__name__).warning(
            "numba compiles the planner, for minutes on a busy machine; later starts load it from a"
            " cache, and DRAKE_PREGRASP_FAST=0 does without"
        )

    def on_end(self, event: Event) -> None:
        """See numba's `Listener`."""


register("numba:compile", _Announcement())


def compiled(signature: str | None = None) -> Callable[[Callable[..., Any]], Any]:
    """Returns a decorator that compiles a function with numba.

    With a signature, it is compiled or loaded when it is defined, so that no tick waits for it, and
    its code is kept on disk. Without, it is compiled into the functions that call it, and cannot be
    called from Python.

    Args:
        signature: Types of the result and the arguments, in numba's notation.
    """
    options = {"error_model": "numpy", "no_cfunc_wrapper": True}
    if signature is None:
        inner: Callable[..., Any] = numba.njit(no_cpython_wrapper=True, **options)
        return inner

    def compile_(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(signature, cache=True, **options)(function)
        except RuntimeError:  # Numba found no folder that it can write to.
            return numba.njit(signature, **options)(function)

    return compile_
