"""Compilation with numba, at import, with the code kept on disk."""

import logging
from collections.abc import Callable
from typing import Any

import numba
from numba.core.event import Event, Listener, register, unregister


class _Announcement(Listener):  # type: ignore[misc]
    """Says once that numba compiles, since the first planner waits for it."""

    def on_start(self, event: Event) -> None:
        """See numba's `Listener`."""
        unregister("numba:compile", self)
        logging.getLogger(__name__).warning(
            "numba compiles the planner; later starts load it from a cache in less than a second"
        )

    def on_end(self, event: Event) -> None:
        """See numba's `Listener`."""


register("numba:compile", _Announcement())


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
