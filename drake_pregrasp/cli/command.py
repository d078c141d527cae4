"""The command `drake-pregrasp`."""

import argparse
import logging
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from drake_pregrasp.cli import run_command, study_commands
from drake_pregrasp.errors import PregraspError, printable
from drake_pregrasp.simulation.scenario_file import shipped_scenarios
from drake_pregrasp.simulation.smooth_file import load_estimator, smooth_file
from drake_pregrasp.studies.interruptible import INTERRUPTED_STATUS
from drake_pregrasp.version import __version__

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


BROKEN_PIPE = 141
"""Exit status when nobody reads the output any more."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status: 2 for bad input, 130 if interrupted."""
    logging.getLogger("drake").setLevel(logging.WARNING)
    options = _parser().parse_args(arguments)
    try:
        status: int = options.command(options)
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("drake-pregrasp: interrupted", file=sys.stderr)
        return INTERRUPTED_STATUS
    except PregraspError as error:
        print(f"drake-pregrasp: {printable(str(error))}", file=sys.stderr)
        return BAD_INPUT
    except SystemExit as error:  # So a failed demand of Drake's reaches Python.
        print(f"drake-pregrasp: {printable(str(error))}", file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:  # Whoever reads the output, as `head`, has enough of it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    return status


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="drake-pregrasp",
        description="Dynamic pre-grasp planning for multi-finger hands that track a moving object.",
    )
    parser.add_argument("--version", action="version", version=f"drake-pregrasp {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    listing = commands.add_parser("list", help="list the shipped scenarios")
    listing.set_defaults(command=_list)

    run_command.add_command(commands)
    study_commands.add_commands(commands)

    smoother = commands.add_parser(
        "smooth", help="smooth a recorded pose stream, and add its velocities"
    )
    smoother.set_defaults(command=_smooth)
    smoother.add_argument("input", metavar="IN.csv", help="columns time,x,y,z,qw,qx,qy,qz")
    smoother.add_argument("output", metavar="OUT.csv", help="the same and vx,vy,vz,wx,wy,wz")
    smoother.add_argument(
        "--estimator",
        default="{}",
        metavar="YAML",
        help="keys of planner.estimator, for example '{position_std: 0.002, acceleration: 1.0}'",
    )
    return parser


def _list(options: argparse.Namespace) -> int:
    shipped = shipped_scenarios()
    width = max(len(name) for name in shipped)
    for name, (_, description) in shipped.items():
        print(f"{name:{width}}  {description}".rstrip())
    return 0


def _smooth(options: argparse.Namespace) -> int:
    config = load_estimator(options.estimator)
    rows = smooth_file(Path(options.input), Path(options.output), config)
    print(f"{rows} poses smoothed into {options.output}")
    return 0
