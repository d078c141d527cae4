"""Options, progress bar and exit status that the commands of studies share."""

import argparse
import contextlib
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from drake_pregrasp.simulation.output import INTERRUPTED_STATUS, handling
from drake_pregrasp.studies.runner import FAILED, ROWS, OnProgress, StudyRows

FAILED_STATUS = 1
"""Exit status if some runs have failed."""


def add_out_option(parser: argparse.ArgumentParser, default: str, what: str = "the report") -> None:
    """Adds `--out`."""
    text = f"folder of {what}; %(default)s if not set"
    parser.add_argument("--out", default=default, metavar="FOLDER", help=text)


def add_processes_option(parser: argparse.ArgumentParser) -> None:
    """Adds `--processes`."""
    text = "number of parallel runs; the number of processors if not set"
    parser.add_argument("--processes", type=whole_number(1), metavar="N", help=text)


def whole_number(least: int) -> Callable[[str], int]:
    """Returns the type of an option that is a whole number, `least` or more."""

    def parse(text: str) -> int:
        value = int(text)
        if value < least:
            raise argparse.ArgumentTypeError(f"{value} must be {least} or more")
        return value

    parse.__name__ = "whole number"  # Argparse's message: "invalid whole number value: 'x'".
    return parse


def names(text: str) -> list[str]:
    """Splits a comma-separated list of names; serves as the type of an option."""
    return [name.strip() for name in text.split(",")]


def add_report_command(
    parser: argparse.ArgumentParser, study: Callable[..., Path], out: str, *names: str
) -> None:
    """Adds `--out` and the command of a study that writes one report.

    Args:
        parser: Parser of the command.
        study: Function that writes the report to a folder and returns its path; accepts
            `on_progress`.
        out: Default folder of the report.
        names: Names of further options, which the study accepts as keywords.
    """

    def command(options: argparse.Namespace) -> int:
        keywords = {name: getattr(options, name) for name in names}
        with step_bar() as on_progress:
            report = study(options.out, **keywords, on_progress=on_progress)
        print(f"report in {report}")
        return 0

    add_out_option(parser, out)
    parser.set_defaults(command=command)


def make_rows_and_report(
    make: Callable[[OnProgress], tuple[StudyRows, Path]], *, folder: Path
) -> int:
    """Makes a study of many runs, prints the outcome, and returns the exit status.

    Args:
        make: Function that makes the rows and the report, and returns the rows and the report's
            path.
        folder: Folder of the rows.
    """
    try:
        # SIGTERM interrupts, like SIGINT.
        with handling(signal.default_int_handler, signal.SIGTERM), step_bar("run") as on_progress:
            found, report = make(on_progress)
    except KeyboardInterrupt:
        problem = f"interrupted: the runs so far are in {folder / ROWS}"
        print(f"drake-pregrasp: {problem}; the same command resumes the study", file=sys.stderr)
        return INTERRUPTED_STATUS
    print(f"{found.made} of {found.wanted} runs are complete")
    print(f"report in {report}")
    if number := len(found.failed):
        print(
            f"drake-pregrasp: {number} run{'s' * (number > 1)} failed:"
            f" see {folder / FAILED}; the same command tries again",
            file=sys.stderr,
        )
        return FAILED_STATUS
    return 0


@contextlib.contextmanager
def step_bar(noun: str = "step") -> Iterator[OnProgress]:
    """Shows a progress bar on a terminal; shows nothing if the output is redirected."""
    console = Console(stderr=True)
    columns = (
        TextColumn(f"{noun} {{task.completed}} of {{task.total}}"),
        BarColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
