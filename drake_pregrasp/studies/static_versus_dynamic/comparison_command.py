"""The command `drake-pregrasp study static-versus-dynamic`."""

import argparse
import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.simulation.scenario_file import scenario_data
from drake_pregrasp.studies import study_options
from drake_pregrasp.studies.runner import OnProgress, StudyRows, run_jobs
from drake_pregrasp.studies.static_versus_dynamic.comparison_report import write_comparison
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.grasp_outcome import TrialJob
from drake_pregrasp.studies.static_versus_dynamic.methods import METHODS
from drake_pregrasp.studies.static_versus_dynamic.trial import MODULES, run_trial
from drake_pregrasp.studies.static_versus_dynamic.trial_pictures import figures_of_one_seed

NAME = "static-versus-dynamic"  # Name of the study's folder.

SEEDS = 30  # Default number of seeds.

# Keys of methods in version 0.1, and their present keys.


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    study_options.add_out_option(parser, "studies", f"the folder {NAME} with the report")
    count, names = study_options.whole_number, study_options.names
    for flags, kind, default, metavar, text in (
        (["--seeds"], count(1, study_options.MOST_SEEDS), SEEDS, "N", "number of seeds"),
        (["--first_seed"], count(0), 0, "K", "first seed"),
        (["--conditions"], names, ",".join(CONDITIONS), "a,b,...", "keys of conditions"),
        # The second flag is that of version 0.1.
        (["--methods"], names, ",".join(METHODS), "a,b,...", "keys of methods"),
    ):
        text = f"{text}; %(default)s if not set"
        parser.add_argument(*flags, type=kind, default=default, metavar=metavar, help=text)
    study_options.add_processes_option(parser, "trials")
    parser.set_defaults(command=_run)


def _run(options: argparse.Namespace) -> int:
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    jobs = trial_jobs(options.conditions, options.methods, seeds)
    folder = Path(options.out) / NAME
    make = functools.partial(compare_methods, folder, jobs, processes=options.processes)
    return study_options.make_rows_and_report(make, folder=folder, noun="trial")


def trial_jobs(
    conditions: Sequence[str], methods: Sequence[str], seeds: Sequence[int]
) -> list[TrialJob]:
    """Returns the trials in order of their seeds, so that half a study compares all methods.

    Args:
        conditions: Keys of `CONDITIONS`.
        methods: Keys of `METHODS`.
        seeds: Seeds of the trials.

    Raises:
        InvalidArgumentError: If a condition or method is unknown.
    """
    for kind, wanted, known in ("condition", conditions, CONDITIONS), ("method", methods, METHODS):
        for name in wanted:
            if name not in known:
                raise InvalidArgumentError(f"{name}: no such {kind}; there are: {','.join(known)}")
    return [
        TrialJob(condition, method, seed)
        for seed in seeds
        for condition in CONDITIONS
        if condition in conditions
        for method in METHODS
        if method in methods
    ]


def compare_methods(
    folder: Path,
    jobs: Sequence[TrialJob],
    on_progress: OnProgress = lambda done, total: None,
    *,
    run: Callable[[TrialJob], Sequence[Mapping[str, Any]]] = run_trial,
    processes: int | None = None,
) -> tuple[StudyRows, Path]:
    """Runs the trials that have no rows yet, and writes the report of all rows.

    Args:
        folder: Folder of the study.
        jobs: Trials from `trial_jobs`.
        on_progress: Called with the number of finished trials and the number of trials to do;
            then again for the trials of each figure.
        run: Function that simulates a trial and returns its rows.
        processes: Number of local processes; the number of processors if not set.

    Returns:
        The rows, and the path of the report.

    Raises:
        OutputError: If the folder cannot be used, or has rows of other settings.
    """
    settings = {
        key: scenario_data(condition.scenario.scenario) for key, condition in CONDITIONS.items()
    }
    found = run_jobs(
        run,
        jobs,
        folder=folder,
        settings=settings,
        modules=MODULES,
        processes=processes,
        on_progress=on_progress,
    )
    # The report comes first: figures are slow, and an error in them must not lose it.
    report = write_comparison(folder, found.rows, found.failed, settings)
    if len(found.rows):
        figures = figures_of_one_seed(folder, found.rows, processes, on_progress)
        write_comparison(folder, found.rows, found.failed, settings, figures)
    return found, report
