"""Drake's failed demands, as errors that can be caught like others.

Where Drake demands a condition of what it is given, a failure reaches Python as `SystemExit`: it
would end the process, whatever a file of unknown origin has made fail.
"""

import contextlib
from collections.abc import Iterator


@contextlib.contextmanager
def failures_as_errors() -> Iterator[None]:
    """Turns a failed demand of Drake's inside into a `RuntimeError` that says which."""
    try:
        yield
    except SystemExit as error:
        if not isinstance(error.code, str):
            raise
        raise RuntimeError(error.code) from error
