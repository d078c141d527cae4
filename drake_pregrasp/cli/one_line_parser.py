"""A parser of arguments that says in one line what is wrong."""

import argparse
import sys
from collections.abc import Callable
from typing import Any, NoReturn

BAD_INPUT = 2
"""Exit status of a command that can't use what it was given."""


class OneLineParser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage before it.

    Attributes:
        add_options: Adds the options of a command when it is given, and not before; none if not
            set.
    """

    add_options: "Callable[[OneLineParser], None] | None" = None

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parses arguments, after the options of the command have been added."""
        add_options, self.add_options = self.add_options, None
        if add_options is not None:
            add_options(self)
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Prints what is wrong, and ends the process."""
        print(f"{self.prog}: {message}", file=sys.stderr)
        sys.exit(BAD_INPUT)
