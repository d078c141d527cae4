"""Runs the jobs of a study that have no rows yet, and stores all rows in the study's folder."""

import contextlib
import dataclasses
import functools
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from drake_pregrasp.errors import OutputError
from drake_pregrasp.simulation.output import (
    claimed,
    make_folder,
    own_file,
    reading_back,
    write_text,
    writing,
)
from drake_pregrasp.studies.package_digest import differing_names, package_digest
from drake_pregrasp.studies.workers import Failure, call_for_all

ROWS = "rows.csv"
"""File of the table of all rows, sorted by their jobs."""

FAILED = "failed.csv"
"""File of the table of failed jobs and their errors, if any job has failed."""

SETTINGS = "settings.json"
"""File of the settings and versions that the rows depend on besides their jobs."""

JOURNAL = "rows.jsonl"
"""File with a line for each finished job, written at once so that a study can be resumed."""

OnProgress = Callable[[int, int], None]
"""Callback with the number of finished jobs and the number of jobs to do."""

Job = Any
"""A mapping, a dataclass or a named tuple of plain values that identify the job."""

_ANOTHER = "choose another folder with --out"


class StudyRows(NamedTuple):
    """Rows and failures of a study.

    Attributes:
        rows: All rows in the folder, sorted by their jobs; columns of the job, then its results.
        failed: All failed jobs in the folder; columns of the job, then `error`.
        wanted: Number of requested jobs.
        made: Number of requested jobs that have rows.
    """

    rows: pd.DataFrame
    failed: pd.DataFrame
    wanted: int
    made: int


def run_jobs(
    function: Callable[[Any], Mapping[str, Any] | Sequence[Mapping[str, Any]]],
    jobs: Sequence[Job],
    *,
    folder: Path | None = None,
    settings: Mapping[str, Any] | None = None,
    modules: Sequence[str] = (),
    processes: int | None = None,
    scheduler: str | None = None,
    on_progress: OnProgress = lambda done, total: None,
) -> StudyRows:
    """Runs the jobs that have no rows in the folder, and returns all rows of the folder.

    The rows do not depend on the order in which jobs finish, on where they run, or on
    interruptions. A failed job does not stop the others, and runs again the next time.

    Args:
        function: Function that returns the row or the rows of a job as mappings of plain values.
            It runs in other processes, so it is a module's function, a `partial` of one, or a
            dataclass with `__call__`.
        jobs: Jobs to run, in their order.
        folder: Folder that stores the rows, made if it is not there; if not set, nothing is stored.
        settings: Further settings that the rows depend on, serializable as JSON.
        modules: Names of the modules in `studies` that the rows depend on besides the function's.
        processes: Number of local processes; the number of processors if not set.
        scheduler: Address of a Dask scheduler whose workers replace the local processes.
        on_progress: Called at the start and after each job.

    Raises:
        OutputError: If the folder cannot be used, or has rows of other settings or of another
            version of the package; or, without a folder, if a job fails.
        InvalidArgumentError: If the scheduler cannot be used.
        KeyboardInterrupt: If SIGINT or SIGTERM arrives; the rows so far are stored.
    """
    modules = [*modules, _module_of(function)]
    package = package_digest(*modules)
    with contextlib.ExitStack() as stack:
        if folder is not None:
            make_folder(folder)
            stack.enter_context(claimed(folder))
            _check_settings(folder / SETTINGS, {"study": settings or {}, "package": package})
        journal = stack.enter_context(_journal(folder, jobs))
        missing = [job for job in jobs if "rows" not in journal.get(_key(job), {})]
        done = 0
        on_progress(done, len(missing))

        def on_result(index: int, result: Any) -> None:
            nonlocal done
            if isinstance(result, Failure):
                if folder is None:
                    raise OutputError(f"{missing[index]}: {result.error}")
                journal.add(missing[index], error=result.error)
            else:
                rows = [result] if isinstance(result, Mapping) else list(result)
                journal.add(missing[index], rows=rows)
            done += 1
            on_progress(done, len(missing))

        call_for_all(
            function, missing, on_result, modules=modules, processes=processes, scheduler=scheduler
        )
        made = sum("rows" in journal.get(_key(job), {}) for job in jobs)
        return StudyRows(*journal.tables(), len(jobs), made)


class _Journal(dict[str, dict[str, Any]]):
    """Results of jobs by their keys, and the file that stores them."""

    def __init__(self, folder: Path | None, jobs: Sequence[Job]) -> None:
        super().__init__()
        self._path = None if folder is None else folder / JOURNAL
        self._columns = list(_plain(jobs[0])) if jobs else []

    def read(self) -> None:
        """Reads the complete lines of the file; a kill may have truncated the last line."""
        if self._path is None or not self._path.is_file():
            return
        with reading_back(self._path):
            text = self._path.read_text(encoding="utf-8")
        try:
            for line in text[: text.rfind("\n") + 1].splitlines():
                record = json.loads(line)
                if not (record["job"] and ("rows" in record or "error" in record)):
                    raise ValueError
                self[_key(record["job"])] = record
        except (ValueError, KeyError, TypeError) as error:
            raise OutputError(f"{self._path}: has no rows of a study; {_ANOTHER}") from error

    def add(self, job: Job, **result: Any) -> None:
        """Stores the result of a job, and returns when it is on the disk."""
        record = {"job": _plain(job), **result}
        line = _line(record)
        self[_key(job)] = json.loads(line)
        if self._path is not None:
            with (
                writing(self._path),
                open(self._path, "a", encoding="utf-8", opener=own_file) as file,
            ):
                file.write(line)
                file.flush()
                os.fsync(file.fileno())

    def tables(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Returns the rows and the failures, sorted by their jobs."""
        rows: list[dict[str, Any]] = []
        failed: list[dict[str, Any]] = []
        for record in self._sorted():
            rows += [record["job"] | row for row in record.get("rows", ())]
            if "error" in record:
                failed.append(record["job"] | {"error": record["error"]})
        return (
            pd.DataFrame(rows, columns=None if rows else self._columns),
            pd.DataFrame(failed, columns=[*self._columns, "error"]),
        )

    def write(self) -> None:
        """Writes all files from the results so far, each file atomically."""
        if self._path is None:
            return
        write_text(self._path, "".join(map(_line, self._sorted())))
        rows, failed = self.tables()
        write_text(self._path.with_name(ROWS), to_csv(rows))
        if len(failed):
            write_text(self._path.with_name(FAILED), to_csv(failed))
        else:
            with writing(self._path):
                self._path.with_name(FAILED).unlink(missing_ok=True)

    def _sorted(self) -> list[dict[str, Any]]:
        """Returns the records in the order of their jobs; a column may have numbers and texts."""
        place = {name: index for index, name in enumerate(self._columns)}

        def order(record: dict[str, Any]) -> list[tuple[bool, Any]]:
            job = record["job"]
            names = sorted(job, key=lambda name: place.get(name, len(place)))
            return [(isinstance(job[name], str), job[name]) for name in names]

        return sorted(self.values(), key=order)


@contextlib.contextmanager
def _journal(folder: Path | None, jobs: Sequence[Job]) -> Iterator[_Journal]:
    journal = _Journal(folder, jobs)
    journal.read()
    journal.write()  # Drops a truncated last line before lines are added.
    try:
        yield journal
    finally:
        journal.write()


def to_csv(table: pd.DataFrame) -> str:
    """Returns a table as CSV with all digits of floats."""
    return str(table.to_csv(index=False, na_rep="nan", lineterminator="\n"))


def _check_settings(path: Path, settings: Mapping[str, Any]) -> None:
    """Writes the settings of a study, or compares them with those of an existing file."""
    ours = json.loads(json.dumps(settings))
    if not path.exists():
        write_text(path, json.dumps(ours, indent=1, sort_keys=True) + "\n")
        return
    with reading_back(path):
        text = path.read_text(encoding="utf-8")
    try:
        both = dict(json.loads(text)), ours
        by_path = (pd.json_normalize(settings).iloc[0].to_dict() for settings in both)
        names = ", ".join(differing_names(*by_path))
    except (ValueError, TypeError) as error:
        raise OutputError(f"{path}: has no settings of a study; {_ANOTHER}") from error
    if names:
        raise OutputError(f"{path}: has rows of other settings ({names}); {_ANOTHER}")


def _module_of(function: Any) -> str:
    while isinstance(function, functools.partial):
        function = function.func
    return str(function.__module__)


def _plain(job: Job) -> dict[str, Any]:
    if dataclasses.is_dataclass(job) and not isinstance(job, type):
        return dataclasses.asdict(job)
    return dict(job) if isinstance(job, Mapping) else dict(job._asdict())


def _key(job: Job) -> str:
    """Returns a text that is equal for jobs with equal values, in any order: 1 equals 1.0."""
    plain = json.loads(json.dumps(_plain(job)), parse_float=_number)
    return json.dumps(plain, sort_keys=True)


def _number(text: str) -> float:
    return int(value) if (value := float(text)).is_integer() else value


def _line(record: Mapping[str, Any]) -> str:
    # Numpy's scalars are not serializable: item() converts them.
    return json.dumps(record, default=lambda value: value.item()) + "\n"
