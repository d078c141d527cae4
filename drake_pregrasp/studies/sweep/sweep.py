"""A sweep: makes the runs that are missing, and a report of all that there are."""

import contextlib
from collections.abc import Callable
from pathlib import Path

from pydrake.common.yaml import yaml_dump

from drake_pregrasp.simulation.output import write_text, writing
from drake_pregrasp.studies import settings_file
from drake_pregrasp.studies.failed_file import FAILED
from drake_pregrasp.studies.many_runs import ManyRuns
from drake_pregrasp.studies.sweep.engines import Engine, Maker
from drake_pregrasp.studies.sweep.failed_runs import read_failures, write_failures
from drake_pregrasp.studies.sweep.named_files import named_files
from drake_pregrasp.studies.sweep.package_digest import package_digest
from drake_pregrasp.studies.sweep.plan import SweepPlan
from drake_pregrasp.studies.sweep.report import REPORT, write_report
from drake_pregrasp.studies.sweep.rows_file import ROWS, RowsFile
from drake_pregrasp.studies.sweep.run_maker import RunMaker
from drake_pregrasp.studies.sweep.study_file import Study

SETTINGS = "settings.json"
"""The file of all that rows depend on."""

STUDY = "study.yaml"
"""The file of the study with every key."""


def sweep(
    study: Study,
    out: str | Path,
    engine: Engine,
    *,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> ManyRuns:
    """Makes the runs of a study that are not there yet, and its report.

    Args:
        study: What to sweep.
        out: Its folder with the study's name gets the results.
        engine: Makes the runs.
        on_progress: Called with the number of runs made and of those that were missing.

    Raises:
        OutputError: If the folder can't be used, or is of a study with other settings.
    """
    folder = Path(out) / study.name
    package = package_digest()
    measures = tuple(study.config.measures)
    make = RunMaker(study.scenario, study.source, study.folder, measures, package, study.folders)
    settings = {"study": study.settings, "files": named_files(study), "package": package}
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        claim = settings_file.claim(folder / SETTINGS, settings)
    with claim, RowsFile(folder / ROWS, study.plan, measures) as rows:
        write_text(folder / STUDY, yaml_dump(study.resolved))
        failures = make_missing(
            rows, folder / FAILED, study.plan, make, engine, on_progress=on_progress
        )
        found = rows.rows
    report = folder / REPORT
    write_report(report, study, found, failures=failures, settings=settings)
    return ManyRuns(report, len(study.plan), len(found), len(failures))


def make_missing(
    rows: RowsFile,
    failed: Path,
    plan: SweepPlan,
    make: Maker,
    engine: Engine,
    *,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[int, str]:
    """Makes the runs that have no row, and adds their rows as they end.

    A run that fails stops no other; it is made again the next time.

    Args:
        rows: Where rows go.
        failed: File of the runs that have failed.
        plan: All runs.
        make: Makes one.
        engine: Where.
        on_progress: Called with the number of runs made and of those that were missing.

    Returns:
        Why runs have failed, by their indices.

    Raises:
        OutputError: If a file can't be written.
    """
    # All points get one seed before any gets the next: half a study shows them all.
    missing = sorted(
        (index for index in range(len(plan)) if index not in rows),
        key=lambda index: (index % len(plan.seeds), index),
    )
    # What has failed is known until it is made again, whenever that ends.
    failures = {i: why for i, why in read_failures(failed, plan).items() if i not in rows}
    write_failures(failed, plan, failures)
    on_progress(0, len(missing))
    with contextlib.closing(engine(make, [plan.run(index) for index in missing])) as ended:
        for done, (run, found) in enumerate(ended, start=1):
            if isinstance(found, str):
                failures[run.index] = found
                write_failures(failed, plan, failures)
            else:
                rows.append(run.index, found)
                if failures.pop(run.index, None) is not None:
                    write_failures(failed, plan, failures)
            on_progress(done, len(missing))
    return failures
