"""The command `drake-pregrasp study faults`."""

import argparse

from drake_pregrasp.studies.faults.study import FILTER_SEEDS, PREFIX, SEEDS, study_faults
from drake_pregrasp.studies.many_runs import MOST_SEEDS, check_bounds, names_of
from drake_pregrasp.studies.step_bar import step_bar


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.set_defaults(command=_run)
    parser.add_argument(
        "--out", default="study_faults", metavar="FOLDER", help="where the report goes"
    )
    parser.add_argument(
        "--faults",
        type=names_of,
        metavar="a,b,...",
        help=f"which of the shipped {PREFIX}..., without the filter's consistency; all, and"
        " that too, if not set",
    )
    parser.add_argument(
        "--seeds", type=int, default=SEEDS, metavar="N", help="of each; %(default)s if not set"
    )
    parser.add_argument(
        "--processes",
        type=int,
        metavar="N",
        help="runs at a time; as many as there are processors if not set",
    )


def _run(options: argparse.Namespace) -> int:
    check_bounds(options, seeds=(1, MOST_SEEDS), processes=(1, None))
    with step_bar("run") as on_progress:
        report = study_faults(
            options.out,
            faults=options.faults,
            seeds=options.seeds,
            filter_seeds=0 if options.faults else FILTER_SEEDS,
            processes=options.processes,
            on_progress=on_progress,
        )
    print(f"report in {report}")
    return 0
