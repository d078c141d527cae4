"""The command `drake-pregrasp study static-versus-dynamic`."""

import argparse
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.studies.interruptible import INTERRUPTED_STATUS, interruptible
from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.experiment import Experiment
from drake_pregrasp.studies.static_versus_dynamic.failures import FAILED
from drake_pregrasp.studies.static_versus_dynamic.store import OUTCOMES
from drake_pregrasp.studies.static_versus_dynamic.study import (
    NAME,
    study_static_versus_dynamic,
    trial_jobs,
)
from drake_pregrasp.studies.step_bar import step_bar

SEEDS = 30
"""How many seeds each arm has, if nothing else is asked for."""

FAILED_STATUS = 1

_SIMULATED = "drake_pregrasp.studies.static_versus_dynamic.simulated"


def load_experiment() -> Experiment:
    """Returns the trials of the study, which most commands have no use for."""
    experiment: Experiment = importlib.import_module(_SIMULATED).EXPERIMENT
    return experiment


def add_command(
    studies: "argparse._SubParsersAction[Any]", load: Callable[[], Experiment] | None = None
) -> None:
    """Adds the command to those of `study`.

    Args:
        studies: What holds those commands.
        load: Returns what is run; `load_experiment` if not set.
    """
    parser = studies.add_parser(NAME, help="what planning anew gains, in simulated grasps")
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
    for name, least in (("seeds", 1), ("first_seed", 0), ("processes", 1)):
        value = getattr(options, name)
        if value is not None and value < least:
            raise InvalidArgumentError(f"--{name}: {value} must be {least} or more")
    jobs = trial_jobs(
        _names(options.conditions),
        _names(options.arms),
        range(options.first_seed, options.first_seed + options.seeds),
    )
    folder = Path(options.out) / NAME
    try:
        with interruptible(), step_bar("trial") as on_progress:
            result = study_static_versus_dynamic(
                options.out,
                load(),
                jobs,
                processes=options.processes,
                on_progress=on_progress,
            )
    except KeyboardInterrupt:
        print(
            f"drake-pregrasp: interrupted: the outcomes so far are in {folder / OUTCOMES};"
            " the same command goes on from there",
            file=sys.stderr,
        )
        return INTERRUPTED_STATUS
    print(f"{result.made} of {result.wanted} trials are there")
    print(f"report in {result.report}: open it in a browser")
    if result.failed:
        print(
            f"drake-pregrasp: {result.failed} trials failed: {folder / FAILED} says why;"
            " the same command tries them again",
            file=sys.stderr,
        )
        return FAILED_STATUS
    return 0


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]
