"""The command `drake-pregrasp study static-versus-dynamic`."""

import argparse
import importlib
from collections.abc import Callable
from pathlib import Path

from drake_pregrasp.studies.many_runs import MOST_SEEDS, carry_out, check_bounds, names_of
from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.experiment import Experiment
from drake_pregrasp.studies.static_versus_dynamic.store import OUTCOMES
from drake_pregrasp.studies.static_versus_dynamic.study import (
    NAME,
    study_static_versus_dynamic,
    trial_jobs,
)

SEEDS = 30
"""How many seeds each arm has, if nothing else is asked for."""

_SIMULATED = "drake_pregrasp.studies.static_versus_dynamic.simulated"


def load_experiment() -> Experiment:
    """Returns the trials of the study, which most commands have no use for."""
    experiment: Experiment = importlib.import_module(_SIMULATED).EXPERIMENT
    return experiment


def add_options(
    parser: argparse.ArgumentParser, load: Callable[[], Experiment] | None = None
) -> None:
    """Adds the options of `drake-pregrasp study static-versus-dynamic`.

    Args:
        parser: Of the command.
        load: Returns what is run; `load_experiment` if not set.
    """
    parser.set_defaults(command=lambda options: _run(options, load or load_experiment))
    parser.add_argument(
        "--out", default="studies", metavar="FOLDER", help=f"its folder {NAME} gets the report"
    )
    for flag, default, metavar, text in (
        ("--seeds", SEEDS, "N", "how many seeds"),
        ("--first_seed", 0, "K", "the first of them"),
    ):
        parser.add_argument(
            flag,
            type=int,
            default=default,
            metavar=metavar,
            help=f"{text}; %(default)s if not set",
        )
    for name, known in (("conditions", CONDITIONS), ("arms", ARMS)):
        parser.add_argument(
            f"--{name}",
            default=",".join(known),
            metavar="a,b,...",
            help="which; %(default)s if not set",
        )
    parser.add_argument(
        "--processes",
        type=int,
        metavar="N",
        help="trials at a time, for figures too; as many as there are processors if not set",
    )


def _run(options: argparse.Namespace, load: Callable[[], Experiment]) -> int:
    check_bounds(options, seeds=(1, MOST_SEEDS), first_seed=(0, None), processes=(1, None))
    jobs = trial_jobs(
        names_of(options.conditions),
        names_of(options.arms),
        range(options.first_seed, options.first_seed + options.seeds),
    )
    return carry_out(
        lambda on_progress: study_static_versus_dynamic(
            options.out, load(), jobs, processes=options.processes, on_progress=on_progress
        ),
        noun="trial",
        results=Path(options.out) / NAME / OUTCOMES,
    )
