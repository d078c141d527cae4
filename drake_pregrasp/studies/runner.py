"""Runs the jobs of a study that have no rows yet, and keeps all rows in the study's folder."""

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
from drake_pregrasp.simulation.output import claimed, make_folder, reading_back, write_text, writing
from drake_pregrasp.studies.package_digest import package_digest
from drake_pregrasp.studies.workers import Failure, call_for_all

ROWS = "rows.csv"
"""The table of all rows, sorted by their jobs."""

FAILED = "failed.csv"
"""The table of the jobs that have failed, and why; only there if some have."""

SETTINGS = "settings.json"
"""All that rows depend on besides their jobs."""

JOURNAL = "rows.jsonl"
"""A line for each job that has ended, written at that moment: an interrupted study goes on here."""

OnProgress = Callable[[int, int], None]
"""Called with the number of jobs that have ended, and of those that were missing."""

Job = Any
"""A mapping, a dataclass or a named tuple of plain values, which tell it from all other jobs."""

_ANOTHER = "choose another folder with --out"


class StudyRows(NamedTuple):
    """The rows that a study has.

    Attributes:
        rows: All rows in the folder, sorted by their jobs; columns of the job, then its results.
        failed: All jobs in the folder that have failed; columns of the job, then `error`.
        wanted: Number of jobs that were asked for.
        made: Number of those that have rows.
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

    Rows depend neither on the order in which jobs end, nor on the place where they run, nor on
    interruptions. A job that fails stops no other, and runs again the next time.

    Args:
        function: Function that returns the row of a job, or its rows, as mappings of plain values.
            It runs in other processes, so it must be a module's function, a `partial` of one, or a
            dataclass with `__call__`.
        jobs: Jobs in the order in which they are run.
        folder: Folder in which rows are kept, created if it does not exist; None to keep nothing.
        settings: All that rows depend on besides their jobs and the source, as JSON values.
        modules: Names of modules in `studies` that rows depend on, besides the function's own.
        processes: Number of local processes; by default the number of processors.
        scheduler: Address of a Dask scheduler whose workers are used instead.
        on_progress: Function that is called after each job.

    Raises:
        OutputError: If the folder cannot be used, or is of a study with other settings or another
            version of the package; or, without a folder, if a job fails.
        InvalidArgumentError: If the scheduler cannot be used.
        KeyboardInterrupt: If SIGINT or SIGTERM has come; the rows so far are kept.
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
        """Reads what is there but for the end of a line that was cut off by a kill."""
        if self._path is None or not self._path.exists():
            return
        with reading_back(self._path):
            text = self._path.read_text(encoding="utf-8")
        try:
            for line in text[: text.rfind("\n") + 1].splitlines():
                record = json.loads(line)
                if not (record["job"] and ("rows" in record or "error" in record)):
                    raise ValueError
                self[json.dumps(record["job"])] = record
        except (ValueError, KeyError, TypeError) as error:
            raise OutputError(f"{self._path}: holds no rows of a study; {_ANOTHER}") from error

    def add(self, job: Job, **result: Any) -> None:
        """Notes what a job has come to, and returns when that is on the disk."""
        record = {"job": _plain(job), **result}
        line = _line(record)
        self[_key(job)] = json.loads(line)
        if self._path is not None:
            with writing(self._path), self._path.open("a", encoding="utf-8") as file:
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
        """Writes all files of what is known, each in one step."""
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
        return sorted(self.values(), key=lambda record: tuple(record["job"].values()))


@contextlib.contextmanager
def _journal(folder: Path | None, jobs: Sequence[Job]) -> Iterator[_Journal]:
    journal = _Journal(folder, jobs)
    journal.read()
    journal.write()  # Else what is added would end a line that was cut off.
    try:
        yield journal
    finally:
        journal.write()


def to_csv(table: pd.DataFrame) -> str:
    """Returns a table as CSV, floats with all their digits."""
    return str(table.to_csv(index=False, na_rep="nan", lineterminator="\n"))


def _check_settings(path: Path, settings: Mapping[str, Any]) -> None:
    """Writes the file of a study's settings, or compares them with those that are there."""
    ours = json.loads(json.dumps(settings))
    if not path.exists():
        write_text(path, json.dumps(ours, indent=1, sort_keys=True) + "\n")
        return
    with reading_back(path):
        text = path.read_text(encoding="utf-8")
    try:
        different = ", ".join(_differences(dict(json.loads(text)), ours))
    except (ValueError, TypeError) as error:
        raise OutputError(f"{path}: holds no settings of a study; {_ANOTHER}") from error
    if different:
        raise OutputError(f"{path}: is of a study with other settings ({different}); {_ANOTHER}")


def _differences(theirs: dict[str, Any], ours: dict[str, Any]) -> list[str]:
    """Returns the dotted paths of the settings that differ."""
    flat = [pd.json_normalize(settings).iloc[0].to_dict() for settings in (theirs, ours)]
    return [name for name in sorted({*flat[0], *flat[1]}) if flat[0].get(name) != flat[1].get(name)]


def _module_of(function: Any) -> str:
    while isinstance(function, functools.partial):
        function = function.func
    return str(function.__module__)


def _plain(job: Job) -> dict[str, Any]:
    if dataclasses.is_dataclass(job) and not isinstance(job, type):
        return dataclasses.asdict(job)
    return dict(job) if isinstance(job, Mapping) else dict(job._asdict())


def _key(job: Job) -> str:
    return json.dumps(_plain(job))


def _line(record: Mapping[str, Any]) -> str:
    # What numpy computes is no number of Python's own.
    return json.dumps(record, default=lambda value: value.item()) + "\n"
