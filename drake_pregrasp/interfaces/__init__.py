"""Interfaces to other programs: recorded poses, MCAP logs, and LCM (extra `interfaces`)."""

import importlib.util

from drake_pregrasp.errors import InvalidArgumentError

_NEEDED = ("mcap", "rosbags")


def check_installed(what: str) -> None:
    """Raises an error if a package of the extra `interfaces` is not installed.

    Args:
        what: What needs it, for the message.

    Raises:
        InvalidArgumentError: If a package is missing; the message says how to install it.
    """
    if missing := [name for name in _NEEDED if not importlib.util.find_spec(name)]:
        raise InvalidArgumentError(
            f"{what} needs {' and '.join(missing)};"
            " pip install 'drake_pregrasp[interfaces]' brings it"
        )
