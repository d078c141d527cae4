"""The command `drake-pregrasp study`: makes the missing runs of a study, and its report."""

import argparse
import contextlib
import dataclasses
import importlib
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from drake_pregrasp.config.yaml_text import dump_yaml
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.estimation.recorded_poses import MAX_BYTES
from drake_pregrasp.geometry.meshes import companions
from drake_pregrasp.resources import make_paths_absolute
from drake_pregrasp.simulation.hand_file import read_hand
from drake_pregrasp.simulation.output import write_text
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.schema_check import load_checked
from drake_pregrasp.studies import field_path, measures, study_axes, study_file
from drake_pregrasp.studies.command_options import (
    add_out_option,
    add_processes_option,
    make_rows_and_report,
    names,
    whole_number,
)
from drake_pregrasp.studies.grasps import (
    baseline_goals,
    failure_cause,
    fitting_objects,
    goal_sources,
    grasp_outcome,
    grasp_trial,
)
from drake_pregrasp.studies.grasps.goal_sources import GOAL_SOURCES
from drake_pregrasp.studies.package_digest import digest_files
from drake_pregrasp.studies.runner import OnProgress, StudyRows, run_jobs
from drake_pregrasp.studies.study_file import Study, load_study, study_data
from drake_pregrasp.studies.study_report import write_study_report
from drake_pregrasp.studies.study_run import StudyRun

STUDY = "study.yaml"
"""File of the study's content with every key."""

_MODULES = (
    *(baseline_goals, failure_cause, field_path, fitting_objects, goal_sources, grasp_outcome),
    *(grasp_trial, measures, study_axes, study_file),
)
"""Modules on which rows depend, besides that of `StudyRun`."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.set_defaults(command=_command)
    parser.add_argument("study", metavar="STUDY", help="name of a shipped study, or a YAML file")
    add_out_option(parser, "studies", "a folder with the study's name")
    for option, what in (("conditions", "conditions"), ("methods", "methods")):
        text = f"keys of the {what} to run; all if not set"
        parser.add_argument(f"--{option}", type=names, default=(), metavar="a,b,...", help=text)
    for option, kind, metavar in (
        ("seeds", whole_number(1), "N"),
        ("first_seed", whole_number(0), "K"),
    ):
        text = f"replaces the key {option} of the study"
        parser.add_argument(f"--{option}", type=kind, metavar=metavar, help=text)
    parser.add_argument(
        "--study_text",
        default="{}",
        metavar="YAML",
        help="keys that override those of the study, such as '{overrides: {grasp: {close_at: 3}}}'",
    )
    parser.add_argument(
        "--allow",
        action="append",
        default=[],
        metavar="FOLDER",
        help="further folder with files that the study names; repeatable",
    )
    parser.add_argument(
        "--import",
        dest="modules",
        action="append",
        default=[],
        metavar="MODULE",
        help="Python module that registers sources of goals; repeatable",
    )
    add_processes_option(parser)
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="make the runs on the Dask cluster of this scheduler, such as tcp://host:8786",
    )


def run_study(
    study: Study,
    out: str | Path,
    *,
    processes: int | None = None,
    scheduler: str | None = None,
    on_progress: OnProgress = lambda done, total: None,
) -> tuple[StudyRows, Path]:
    """Makes the missing runs of a study, and returns all rows and the path of the report.

    Args:
        study: Study to run.
        out: Parent of the results' folder, which has the study's name.
        processes: Number of local processes; the number of processors if not set.
        scheduler: Address of a Dask scheduler whose workers replace the local processes.
        on_progress: Called with the number of finished runs and the number of runs to do.

    Raises:
        OutputError: If the folder cannot be used, or has rows of other settings.
        InvalidArgumentError: If the scheduler cannot be used.
    """
    folder, settings = Path(out) / study.name, study_settings(study)
    used = {m.goals: GOAL_SOURCES[m.goals] for m in study.methods.values() if m.goals}
    found = run_jobs(
        StudyRun(study, used),
        study.jobs(),
        folder=folder,
        settings=settings,
        modules=[m.__name__ for m in _MODULES] + [source.__module__ for source in used.values()],
        processes=processes,
        scheduler=scheduler,
        on_progress=on_progress,
    )
    write_text(folder / STUDY, dump_yaml(study_data(study.config)))
    return found, write_study_report(folder, study, found, settings)


def study_settings(study: Study) -> dict[str, Any]:
    """Returns what all rows of a study's folder depend on besides their first columns."""
    content = study_data(study.config)
    beside = {"description", "scenario", "file", "overrides", "seeds", "first_seed", "tests"}
    beside |= {"figures", "conditions", "methods"}
    kept = {key: value for key, value in content.items() if key not in beside}
    words = ("label", "description")
    entries = {"conditions": study.conditions, "methods": study.methods}
    for name, each in entries.items():
        kept[name] = {
            key: {n: v for n, v in vars(entry).items() if n not in words}
            for key, entry in each.items()
        }
    return kept | {"scenarios": study.bases, "files": named_files(study)}


def named_files(study: Study) -> dict[str, str]:
    """Returns digests of all files that rows depend on, by their absolute paths.

    These are the files named by the scenarios, the changed values, a hand's description and its
    model, and the buffers of a mesh. Shipped files are left out, as they are part of the package's
    digest, and so are files that cannot be read, as a run that needs one has no row.
    """
    allowed = [study.folder, *map(Path, study.folders)]
    found: set[Path] = set()
    for condition, base in study.bases.items():
        every: list[Mapping[str, Any]] = [{}]
        every += [change for axis in study.grid for change in axis.changes.values()]
        every += [method.overrides for method in study.methods.values()]
        for axis in study.random[condition]:
            every += [dict.fromkeys(axis.fields, value) for value in axis.arguments]
        for changes in every:
            # A run with invalid values or files fails with this error.
            with contextlib.suppress(ScenarioError, InvalidArgumentError):
                data = field_path.with_fields(base, changes, study.source)
                found |= _files_of(load_checked(study.source, "", data, Scenario()), study, allowed)
    for mesh in [path for path in found if path.suffix.lower() == ".gltf"]:
        with contextlib.suppress(InvalidArgumentError):
            found.update(companions(mesh))
    digests = {}
    for path in sorted(found):
        with contextlib.suppress(OSError):
            if path.is_file() and path.stat().st_size <= MAX_BYTES:  # No valid file is larger.
                digests[str(path)] = digest_files([path])
    return digests


def _files_of(scenario: Scenario, study: Study, allowed: list[Path]) -> set[Path]:
    make_paths_absolute(scenario, study.folder, allowed=allowed, source=study.source)
    found, hand = set(map(Path, _paths(scenario))), scenario.hand_file
    if _is_file(hand):
        read = read_hand(hand, allowed).model
        found.update(read.files if read else [])
    return found


def _paths(config: object) -> Iterator[str]:
    for f in dataclasses.fields(config) if dataclasses.is_dataclass(config) else ():
        value = getattr(config, f.name)
        if f.metadata.get("path"):
            yield from filter(_is_file, [value])
        else:
            for part in value if isinstance(value, list) else [value]:
                yield from _paths(part)


def _is_file(text: str) -> bool:
    return bool(text) and "://" not in text


def _command(options: argparse.Namespace) -> int:
    if options.scheduler is not None and options.processes is not None:
        raise InvalidArgumentError("--processes: has no effect on a cluster; leave it out")
    for name in options.modules:
        _import(name)
    study = load_study(
        options.study,
        options.allow,
        text=options.study_text,
        conditions=options.conditions,
        methods=options.methods,
        **{key: getattr(options, key) for key in ("seeds", "first_seed")},
    )
    return make_rows_and_report(
        lambda on_progress: run_study(
            study,
            options.out,
            processes=options.processes,
            scheduler=options.scheduler,
            on_progress=on_progress,
        ),
        folder=Path(options.out) / study.name,
    )


def _import(name: str) -> None:
    """Imports a module, also from the working directory, as `python -m` does."""
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.insert(0, here)
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        raise InvalidArgumentError(f"--import: {name}: {error}") from error
