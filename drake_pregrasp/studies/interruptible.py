"""An end in order for commands that take long."""

import contextlib
import signal
from collections.abc import Iterator

INTERRUPTED_STATUS = 130
"""Exit status of an interrupted command."""


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Makes SIGTERM an interruption as SIGINT is: what is done is put in order before the end."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
