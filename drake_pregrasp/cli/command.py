"""The command `drake-pregrasp`."""

import argparse
import contextlib
import logging
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from threadpoolctl import threadpool_limits

from drake_pregrasp.cli import grasp_commands, hand_command, run_command, study_commands
from drake_pregrasp.errors import OutputError, PregraspError, printable
from drake_pregrasp.geometry.mesh_repair import repair_mesh
from drake_pregrasp.simulation.output import INTERRUPTED_STATUS, check_new, write_named_text
from drake_pregrasp.simulation.scenario_file import shipped_scenarios
from drake_pregrasp.simulation.smooth_file import load_estimator, smooth_file
from drake_pregrasp.version import __version__

BAD_INPUT = 2
"""Exit status of a command with invalid input, or whose output cannot be written."""


class OneLineParser(argparse.ArgumentParser):
    """Parser that reports an error in one line, without the usage before it.

    Attributes:
        add_options: Function that adds the options of a command when the command is given; None for
            no further options.
    """

    add_options: "Callable[[OneLineParser], None] | None" = None

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parses arguments, after the options of the command have been added."""
        add_options, self.add_options = self.add_options, None
        if add_options is not None:
            add_options(self)
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Prints an error and ends the process."""
        _print_error(message, self.prog)
        sys.exit(BAD_INPUT)


BROKEN_PIPE = 141
"""Exit status of a command whose output is no longer read."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status: 2 for bad input, 130 if interrupted."""
    logging.getLogger("drake").setLevel(logging.WARNING)
    has_stdout = _open_standard_streams()
    options = _parser().parse_args(arguments)
    try:
        if not has_stdout and options.command is _list:
            raise OutputError("standard output: cannot be written: it is closed")
        _check_working_directory()
        with threadpool_limits(1, user_api="blas"):  # More threads wait for each other, mostly.
            status: int = options.command(options)
        sys.stdout.flush()
    except KeyboardInterrupt:
        _print_error("interrupted")
        return INTERRUPTED_STATUS
    except (PregraspError, SystemExit) as error:  # The latter is a failed demand of Drake's.
        _print_error(str(error))
        return BAD_INPUT
    except BrokenPipeError:  # The reader, such as `head`, has ended.
        _discard_output()
        return BROKEN_PIPE
    except OSError as error:  # Every other file has its `OutputError`.
        _discard_output()
        _print_error(f"standard output: cannot be written: {error.strerror}")
        return BAD_INPUT
    return status


def _open_standard_streams() -> bool:
    """Replaces closed standard streams by the null device, and returns whether stdout was open.

    Without this, the next file that is opened would get the number of a standard stream.
    """
    has_stdout = sys.stdout is not None
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(number)
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    return has_stdout


def _check_working_directory() -> None:
    try:
        Path.cwd()
    except OSError as error:
        raise OutputError(f"the working directory cannot be used: {error.strerror}") from error


def _discard_output() -> None:
    """Keeps Python from writing the rest of the output when it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _print_error(message: str, prog: str = "drake-pregrasp") -> None:
    with contextlib.suppress(OSError):
        print(f"{prog}: {printable(message)}", file=sys.stderr)


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
    hand_command.add_command(commands)
    grasp_commands.add_commands(commands)
    study_commands.add_commands(commands)

    meshes = commands.add_parser("mesh", help="repair a mesh that is refused (extra meshes)")
    meshes.set_defaults(command=_repair)
    meshes.add_argument("task", choices=["repair"], help="what to do")
    meshes.add_argument("file", metavar="FILE", help="OBJ, STL, PLY, OFF or glTF file")
    meshes.add_argument("-o", "--out", metavar="OUT.obj", help="default: FILE_repaired.obj")

    smoother = commands.add_parser("smooth", help="smooth recorded poses and add velocities")
    smoother.set_defaults(command=_smooth)
    smoother.add_argument(
        "input", metavar="IN", help="CSV (time,x,y,z,qw,qx,qy,qz), MCAP or rosbag2"
    )
    smoother.add_argument("output", metavar="OUT.csv", help="the same, and vx,vy,vz,wx,wy,wz")
    for name, what in (("topic", "topic of the poses"), ("frame", "frame of the object")):
        text = f"{what} in an MCAP file or a rosbag2, if there are several"
        smoother.add_argument(f"--{name}", default="", metavar="NAME", help=text)
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


def _repair(options: argparse.Namespace) -> int:
    source = Path(options.file)
    if options.out and not options.out.lower().endswith(".obj"):
        raise OutputError(f"{options.out}: must end with .obj")
    check_new(target := Path(options.out or source.with_name(f"{source.stem}_repaired.obj")))
    repair = repair_mesh(source)
    text = repair.mesh.export(file_type="obj", digits=9, include_normals=False)
    write_named_text(target, str(text))
    if repair.left_out:
        print(f"left out    {repair.left_out} surfaces that could not be closed")
    print(f"area        {repair.old_area:.4g}, now {repair.area:.4g}")
    print(f"volume      {repair.volume:.4g}, in units of the file")
    print(f"distance    of random points to the old surface: at most {repair.distance:.3g}")
    print(f"mesh in {target}")
    return 0


def _smooth(options: argparse.Namespace) -> int:
    config = load_estimator(options.estimator)
    source, target = Path(options.input), Path(options.output)
    rows = smooth_file(source, target, config, topic=options.topic, frame=options.frame)
    print(f"{rows} poses smoothed into {options.output}")
    return 0
