"""A parser of arguments that says in one line what is wrong."""

import argparse
import sys
from typing import NoReturn

BAD_INPUT = 2
"""Exit status of a command that can't use what it was given."""


class OneLineParser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage before it."""

    def error(self, message: str) -> NoReturn:
        """Prints what is wrong, and ends the process."""
        print(f"{self.prog}: {message}", file=sys.stderr)
        sys.exit(BAD_INPUT)
