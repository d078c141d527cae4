"""Runs the trials of a study that are not there yet."""

import contextlib
import functools
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from drake_pregrasp.errors import OutputError
from drake_pregrasp.studies.error_words import in_words
from drake_pregrasp.studies.failed_file import FAILED, Cells, FailedFile
from drake_pregrasp.studies.processes import as_they_end
from drake_pregrasp.studies.static_versus_dynamic.outcome import Outcome, TrialJob
from drake_pregrasp.studies.static_versus_dynamic.store import OutcomeStore


def run_missing(
    store: OutcomeStore,
    folder: Path,
    jobs: Sequence[TrialJob],
    run_trial: Callable[[TrialJob], list[Outcome]],
    *,
    processes: int | None = None,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[TrialJob, str]:
    """Runs the trials that the store doesn't have, and adds their outcomes as they end.

    A trial that raises doesn't stop the others: `failed.csv` says which it was, and why, and it
    is run again the next time.

    Args:
        store: Where outcomes go.
        folder: Of the study.
        jobs: The trials that are wanted.
        run_trial: Makes one.
        processes: How many at a time; as many as there are processors if not set.
        on_progress: Called with the number of trials done and of those that were missing.

    Returns:
        What went wrong in which of all trials ever wanted in this folder that are still missing.

    Raises:
        OutputError: If a file can't be written, or a process ended without a word.
    """
    missing = [job for job in jobs if job not in store]
    with failed_trials(folder) as file:
        for cells in list(file.failures):
            if _job(cells) in store:
                file.discard(cells)
        on_progress(0, len(missing))
        ended = as_they_end(functools.partial(_attempt, run_trial), missing, processes=processes)
        with contextlib.closing(ended):
            for done, (index, future) in enumerate(ended, start=1):
                job = missing[index]
                found = _result(job, future)
                if not isinstance(found, str) and not store.is_complete(job, found):
                    found = _mismatch(found)
                if isinstance(found, str):
                    file.add(_cells(job), found)
                else:
                    store.append(job, found)
                    file.discard(_cells(job))
                on_progress(done, len(missing))
    return {_job(cells): why for cells, why in file.failures.items()}


def failed_trials(folder: Path) -> FailedFile:
    """Returns the file of the trials that have failed in a study's folder."""
    return FailedFile(folder / FAILED, TrialJob._fields, _job)


def _job(cells: Cells) -> TrialJob:
    condition, arm, seed = cells
    return TrialJob(condition, arm, int(seed))


def _cells(job: TrialJob) -> Cells:
    return job.condition, job.arm, str(job.seed)


def _attempt(run_trial: Callable[[TrialJob], list[Outcome]], job: TrialJob) -> list[Outcome] | str:
    """Returns the outcomes or, because not all errors get from process to process, the words."""
    try:
        return list(run_trial(job))
    except Exception as error:
        return in_words(error)


def _result(job: TrialJob, future: "Future[list[Outcome] | str]") -> list[Outcome] | str:
    try:
        return future.result()
    except BrokenProcessPool as error:
        raise OutputError(
            f"{job}, or a trial beside it: its process ended without a word;"
            " the outcomes so far are kept"
        ) from error
    except Exception as error:
        return in_words(error)


def _mismatch(outcomes: Sequence[Outcome]) -> str:
    given = "; ".join(f"{o.job} at {o.close_at:g} s" for o in outcomes) or "none"
    return f"its outcomes are not one for each closing time: {given}"
