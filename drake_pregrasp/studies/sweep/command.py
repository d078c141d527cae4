"""The command `drake-pregrasp sweep`."""

import argparse
import sys
from pathlib import Path
from typing import Any

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.studies.interruptible import INTERRUPTED_STATUS, interruptible
from drake_pregrasp.studies.step_bar import step_bar
from drake_pregrasp.studies.sweep.dask_engine import dask_engine
from drake_pregrasp.studies.sweep.engines import Engine, local_engine
from drake_pregrasp.studies.sweep.failed_file import FAILED
from drake_pregrasp.studies.sweep.rows_file import ROWS
from drake_pregrasp.studies.sweep.study_file import load_study
from drake_pregrasp.studies.sweep.sweep import sweep

FAILED_STATUS = 1


def add_command(commands: "argparse._SubParsersAction[Any]") -> None:
    """Adds the command to those of `drake-pregrasp`."""
    parser = commands.add_parser("sweep", help="simulate a scenario with many values of its fields")
    parser.set_defaults(command=_run)
    parser.add_argument("study", metavar="STUDY", help="YAML file, or name of a shipped sweep")
    parser.add_argument(
        "--out",
        default="sweeps",
        metavar="FOLDER",
        help="its folder with the study's name gets the results; %(default)s if not set",
    )
    parser.add_argument(
        "--processes",
        type=int,
        metavar="N",
        help="runs at a time; as many as there are processors if not set",
    )
    parser.add_argument(
        "--allow",
        action="append",
        default=[],
        metavar="FOLDER",
        help="where files that the study names may be, beside its own folder; repeatable",
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="make the runs on the Dask cluster of this scheduler, as tcp://host:8786",
    )


def _run(options: argparse.Namespace) -> int:
    study = load_study(options.study, options.allow)
    folder = Path(options.out) / study.name
    try:
        with interruptible(), step_bar("run") as on_progress:
            result = sweep(study, options.out, _engine(options), on_progress=on_progress)
    except KeyboardInterrupt:
        print(
            f"drake-pregrasp: interrupted: the rows so far are in {folder / ROWS};"
            " the same command goes on from there",
            file=sys.stderr,
        )
        return INTERRUPTED_STATUS
    print(f"{result.made} of {result.wanted} runs are there")
    print(f"report in {result.report}: open it in a browser")
    if result.failed:
        print(
            f"drake-pregrasp: {result.failed} runs failed: {folder / FAILED} says why;"
            " the same command tries them again",
            file=sys.stderr,
        )
        return FAILED_STATUS
    return 0


def _engine(options: argparse.Namespace) -> Engine:
    if options.scheduler is None:
        if options.processes is not None and options.processes < 1:
            raise InvalidArgumentError(f"--processes: {options.processes} must be 1 or more")
        return local_engine(options.processes)
    if options.processes is not None:
        raise InvalidArgumentError("--processes: a cluster has its own; leave it out")
    return dask_engine(options.scheduler)
