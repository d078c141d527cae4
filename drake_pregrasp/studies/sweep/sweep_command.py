"""The command `drake-pregrasp sweep`: makes the missing runs, and a report of all runs."""

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
"""File of the study's content with every key."""

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
        help="further folder with files that the study names; repeatable",
    )
    study_options.add_scheduler_option(parser)


def sweep(
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
    folder = Path(out) / study.name
    plan, measures = study.plan, tuple(study.config.measures)
    # All points get one seed before any point gets the next: half a study has all points.
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
        raise InvalidArgumentError("--processes: has no effect on a cluster; leave it out")
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
