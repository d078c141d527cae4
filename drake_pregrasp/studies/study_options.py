"""Options that the commands of studies share, and how these commands end."""

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from drake_pregrasp.simulation.output import INTERRUPTED_STATUS, interruptible
from drake_pregrasp.studies.runner import FAILED, ROWS, OnProgress, StudyRows

MOST_SEEDS = 10_000
"""Largest number of seeds of a study."""

FAILED_STATUS = 1
"""Exit status if some runs have failed."""


def add_out_option(parser: argparse.ArgumentParser, default: str, what: str = "the report") -> None:
    """Adds `--out`."""
    text = f"where {what} goes; %(default)s if not set"
    parser.add_argument("--out", default=default, metavar="FOLDER", help=text)


def add_processes_option(parser: argparse.ArgumentParser, noun: str = "runs") -> None:
    """Adds `--processes`."""
    text = f"{noun} at a time; as many as there are processors if not set"
    parser.add_argument("--processes", type=whole_number(1), metavar="N", help=text)


def whole_number(least: int, most: int | None = None) -> Callable[[str], int]:
    """Returns the type of an option that is a whole number in a range."""

    def parse(text: str) -> int:
        value = int(text)
        if value < least:
            raise argparse.ArgumentTypeError(f"{value} must be {least} or more")
        if most is not None and value > most:
            raise argparse.ArgumentTypeError(f"{value} must be {most} or less")
        return value

    parse.__name__ = "whole number"  # What argparse calls it: "invalid whole number value: 'x'".
    return parse


def names(text: str) -> list[str]:
    """Returns the names in a list with commas; the type of such an option."""
    return [name.strip() for name in text.split(",")]


def add_report_command(
    parser: argparse.ArgumentParser, study: Callable[..., Path], out: str
) -> None:
    """Adds the options of a study that has none but `--out`.

    Args:
        parser: Parser of the command.
        study: Function that makes the report in a folder and returns its path; it accepts
            `on_progress`.
        out: Default folder.
    """

    def command(options: argparse.Namespace) -> int:
        with step_bar() as on_progress:
            report = study(options.out, on_progress=on_progress)
        print(f"report in {report}")
        return 0

    add_out_option(parser, out)
    parser.set_defaults(command=command)


def make_rows_and_report(
    make: Callable[[OnProgress], tuple[StudyRows, Path]], *, folder: Path, noun: str = "run"
) -> int:
    """Makes a study of many runs, prints its result, and returns the exit status.

    Args:
        make: Function that makes rows and report, and returns the rows and the report's path.
        folder: Folder of the rows.
        noun: Name of one run, for messages.
    """
    try:
        with interruptible(), step_bar(noun) as on_progress:
            found, report = make(on_progress)
    except KeyboardInterrupt:
        problem = f"interrupted: the {noun}s so far are in {folder / ROWS}"
        print(f"drake-pregrasp: {problem}; the same command goes on from there", file=sys.stderr)
        return INTERRUPTED_STATUS
    print(f"{found.made} of {found.wanted} {noun}s are there")
    print(f"report in {report}")
    if number := len(found.failed):
        print(
            f"drake-pregrasp: {number} {noun}{'s' * (number > 1)} failed:"
            f" {folder / FAILED} says why; the same command tries again",
            file=sys.stderr,
        )
        return FAILED_STATUS
    return 0


@contextlib.contextmanager
def step_bar(noun: str = "step") -> Iterator[OnProgress]:
    """Shows how many steps are done on a terminal, and nothing when the output goes elsewhere."""
    console = Console(stderr=True)
    columns = (
        TextColumn(f"{noun} {{task.completed}} of {{task.total}}"),
        BarColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
