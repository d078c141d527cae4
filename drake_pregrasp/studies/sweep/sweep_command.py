"""The command `drake-pregrasp sweep`: makes the runs that are missing, and a report of all."""

import argparse
from pathlib import Path

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.simulation.output import write_text
from drake_pregrasp.simulation.yaml_text import dump_yaml
from drake_pregrasp.studies import study_options
from drake_pregrasp.studies.runner import OnProgress, StudyRows, run_jobs
from drake_pregrasp.studies.sweep.measures import SweepRun
from drake_pregrasp.studies.sweep.study_file import Study, load_study, named_files
from drake_pregrasp.studies.sweep.sweep_report import write_sweep_report

STUDY = "study.yaml"
"""The file of the study with every key."""

_MODULES = tuple(f"{__package__}.{name}" for name in ("field_path", "sweep_plan"))


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.set_defaults(command=_command)
    parser.add_argument("study", metavar="STUDY", help="YAML file, or name of a shipped sweep")
    study_options.add_out_option(parser, "sweeps", "a folder with the study's name")
    study_options.add_processes_option(parser)
    parser.add_argument(
        "--allow",
        action="append",
        default=[],
        metavar="FOLDER",
        help="where files that the study names may be, besides its own folder; repeatable",
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="make the runs on the Dask cluster of this scheduler, as tcp://host:8786",
    )


def sweep(
    study: Study,
    out: str | Path,
    *,
    processes: int | None = None,
    scheduler: str | None = None,
    on_progress: OnProgress = lambda done, total: None,
) -> tuple[StudyRows, Path]:
    """Makes the runs of a study that are not there yet, and returns all rows and the report's path.

    Args:
        study: Study to sweep.
        out: Folder in which the folder of the study is made.
        processes: Number of local processes; by default the number of processors.
        scheduler: Address of a Dask scheduler whose workers are used instead.
        on_progress: Called with the number of runs made and of those that were missing.

    Raises:
        OutputError: If the folder cannot be used, or is of a study with other settings.
        InvalidArgumentError: If the scheduler cannot be used.
    """
    folder = Path(out) / study.name
    plan, measures = study.plan, tuple(study.config.measures)
    # All points get one seed before any gets the next: half a study shows them all.
    order = sorted(range(len(plan)), key=lambda index: (index % len(plan.seeds), index))
    found = run_jobs(
        SweepRun(plan, study.scenario, study.source, study.folder, study.folders, measures),
        [plan.job(index) for index in order],
        folder=folder,
        settings={**study.settings, "files": named_files(study)},
        modules=_MODULES,
        processes=processes,
        scheduler=scheduler,
        on_progress=on_progress,
    )
    write_text(folder / STUDY, dump_yaml(study.resolved))
    return found, write_sweep_report(folder, study, found)


def _command(options: argparse.Namespace) -> int:
    if options.scheduler is not None and options.processes is not None:
        raise InvalidArgumentError("--processes: a cluster has its own; leave it out")
    study = load_study(options.study, options.allow)
    return study_options.make_rows_and_report(
        lambda on_progress: sweep(
            study,
            options.out,
            processes=options.processes,
            scheduler=options.scheduler,
            on_progress=on_progress,
        ),
        folder=Path(options.out) / study.name,
    )
