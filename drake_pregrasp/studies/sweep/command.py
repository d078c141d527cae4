"""The command `drake-pregrasp sweep`."""

import argparse
from pathlib import Path

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.studies.many_runs import carry_out, check_bounds
from drake_pregrasp.studies.sweep.dask_engine import dask_engine
from drake_pregrasp.studies.sweep.engines import Engine, local_engine
from drake_pregrasp.studies.sweep.rows_file import ROWS
from drake_pregrasp.studies.sweep.study_file import load_study
from drake_pregrasp.studies.sweep.sweep import sweep


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
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
    engine = _engine(options)
    return carry_out(
        lambda on_progress: sweep(study, options.out, engine, on_progress=on_progress),
        noun="run",
        results=Path(options.out) / study.name / ROWS,
    )


def _engine(options: argparse.Namespace) -> Engine:
    if options.scheduler is None:
        check_bounds(options, processes=(1, None))
        return local_engine(options.processes)
    if options.processes is not None:
        raise InvalidArgumentError("--processes: a cluster has its own; leave it out")
    return dask_engine(options.scheduler)
