"""A sweep: makes the runs that are missing, and a report of all that there are."""

import contextlib
from collections.abc import Callable
from pathlib import Path

from drake_pregrasp.errors import OutputError
from drake_pregrasp.simulation.output import write_text, writing
from drake_pregrasp.simulation.yaml_text import dump_yaml
from drake_pregrasp.studies import settings_file
from drake_pregrasp.studies.failed_file import FAILED, Cells, FailedFile
from drake_pregrasp.studies.many_runs import ManyRuns
from drake_pregrasp.studies.sweep.engines import Engine, Maker
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
        write_text(folder / STUDY, dump_yaml(study.resolved))
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
    with FailedFile(failed, plan.cell_names, _index) as file:
        for cells in list(file.failures):
            index = _index(cells)
            if not 0 <= index < len(plan) or plan.run(index).cells != cells:
                raise OutputError(f"{failed}: {', '.join(cells)} is no run of this study")
            if index in rows:
                file.discard(cells)
        on_progress(0, len(missing))
        ended = engine(make, [plan.run(index) for index in missing])
        with contextlib.closing(ended):
            for done, (run, found) in enumerate(ended, start=1):
                if isinstance(found, str):
                    file.add(run.cells, found)
                else:
                    rows.append(run.index, found)
                    file.discard(run.cells)
                on_progress(done, len(missing))
    return {_index(cells): why for cells, why in file.failures.items()}


def _index(cells: Cells) -> int:
    return int(cells[0])
