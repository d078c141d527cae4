"""The command `drake-pregrasp study objects`."""

import argparse
import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.simulation.scenario_file import scenario_data
from drake_pregrasp.studies import study_options
from drake_pregrasp.studies.objects import object_sets
from drake_pregrasp.studies.objects.object_report import pictures_of_grasps, write_object_report
from drake_pregrasp.studies.objects.object_trial import MODULES, ObjectJob, base_scenario, run_trial
from drake_pregrasp.studies.package_digest import digest_files
from drake_pregrasp.studies.runner import OnProgress, StudyRows, run_jobs
from drake_pregrasp.studies.static_versus_dynamic.methods import METHODS, TESTED

NAME = "objects"
"""Name of the study's folder."""

_METHODS = f"{TESTED},fixed_plan,stationary,reactive"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    study_options.add_out_option(parser, "studies", f"the folder {NAME} with the report")
    count, names = study_options.whole_number, study_options.names
    parser.add_argument(
        "--set", choices=object_sets.SETS, default="household", help="%(default)s if not set"
    )
    for flag, kind, default, metavar, text in (
        ("--objects", count(1), 200, "N", "largest number of objects for each hand"),
        ("--pool", _pool, "0-999", "A-B", "indices of the set's objects to draw from"),
        ("--hands", names, "five_finger_hand", "a,b,...", "shipped hands, or files of hands"),
        ("--speeds", _speeds, "20", "a,b,...", "speeds in mm/s; 20 mm/s turn by 10 deg/s"),
        ("--methods", names, _METHODS, "a,b,...", "keys of methods"),
        ("--seeds", count(1, study_options.MOST_SEEDS), 1, "N", "number of seeds for each object"),
        ("--first_seed", count(0), 0, "K", "first seed, which also draws the objects"),
        ("--scenario_text", str, "{}", "YAML", "keys that override those of the trials' scenario"),
    ):
        text = f"{text}; %(default)s if not set"
        parser.add_argument(flag, type=kind, default=default, metavar=metavar, help=text)
    study_options.add_processes_option(parser, "trials")
    study_options.add_scheduler_option(parser, "trials")
    parser.set_defaults(command=_run)


def _pool(text: str) -> range:
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def _speeds(text: str) -> list[float]:
    return [float(speed) for speed in text.split(",")]


_pool.__name__, _speeds.__name__ = "range of indices", "list of speeds"


def _run(options: argparse.Namespace) -> int:
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    objects = {
        hand: object_sets.drawn_objects(options.set, hand, options.objects, seeds[0], options.pool)
        for hand in options.hands
    }
    text = options.scenario_text
    jobs = object_jobs(options.set, objects, options.speeds, options.methods, seeds, text)
    folder = Path(options.out) / NAME
    make = functools.partial(
        study_objects, folder, jobs, processes=options.processes, scheduler=options.scheduler
    )
    return study_options.make_rows_and_report(make, folder=folder, noun="trial")


def object_jobs(
    set_name: str,
    objects: Mapping[str, Sequence[str]],
    speeds: Sequence[float],
    methods: Sequence[str],
    seeds: Sequence[int],
    text: str = "{}",
) -> list[ObjectJob]:
    """Returns the trials in order of their objects, so that half a study compares all methods.

    Args:
        set_name: Key of the objects' set.
        objects: Names of the objects of each hand.
        speeds: Speeds of the conveyor, in mm/s.
        methods: Keys of `METHODS`.
        seeds: Seeds of the trials.
        text: YAML that overrides keys of the trials' scenario.

    Raises:
        InvalidArgumentError: If a method or a hand is unknown.
    """
    for method in methods:
        if method not in METHODS:
            raise InvalidArgumentError(f"{method}: no such method; there are: {','.join(METHODS)}")
    for hand in objects:
        object_sets.hand_file(hand)
    return [
        ObjectJob(set_name, names[place], hand, speed, method, seed, text)
        for place in range(max(map(len, objects.values()), default=0))
        for seed in seeds
        for hand, names in objects.items()
        if place < len(names)
        for speed in speeds
        for method in METHODS
        if method in methods
    ]


def study_objects(
    folder: Path,
    jobs: Sequence[ObjectJob],
    on_progress: OnProgress = lambda done, total: None,
    *,
    run: Callable[[ObjectJob], Mapping[str, Any]] = run_trial,
    processes: int | None = None,
    scheduler: str | None = None,
) -> tuple[StudyRows, Path]:
    """Runs the trials that have no rows yet, and writes the report of all rows.

    Args:
        folder: Folder of the study.
        jobs: Trials from `object_jobs`.
        on_progress: Called with the number of finished trials and the number of trials to do;
            then again for the pictures.
        run: Function that simulates a trial and returns its row.
        processes: Number of local processes; the number of processors if not set.
        scheduler: Address of a Dask scheduler whose workers replace the local processes.

    Returns:
        The rows, and the path of the report.

    Raises:
        OutputError: If the folder cannot be used, or has rows of other settings.
    """
    settings = {
        "scenario": scenario_data(base_scenario(jobs[0].text if jobs else "{}")),
        "fit": object_sets.FIT_IN_WORDS,
        "sets": digest_files([object_sets.SETS_FILE]),
    }
    found = run_jobs(
        run,
        jobs,
        folder=folder,
        settings=settings,
        modules=MODULES,
        processes=processes,
        scheduler=scheduler,
        on_progress=on_progress,
    )
    # The report comes first: pictures are slow, and an error in them must not lose it.
    report = write_object_report(folder, found.rows, found.failed, settings)
    pictures = pictures_of_grasps(folder, found.rows, processes, on_progress)
    if pictures:
        write_object_report(folder, found.rows, found.failed, settings, pictures)
    return found, report
