"""The study: makes the trials that are missing, and a report of all that there are."""

from collections.abc import Callable, Sequence
from pathlib import Path

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.studies.many_runs import ManyRuns
from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.experiment import Experiment
from drake_pregrasp.studies.static_versus_dynamic.outcome import TrialJob
from drake_pregrasp.studies.static_versus_dynamic.report import REPORT, write_report
from drake_pregrasp.studies.static_versus_dynamic.store import OutcomeStore
from drake_pregrasp.studies.static_versus_dynamic.trials import run_missing

NAME = "static-versus-dynamic"
"""Of the study, of its command, and of its folder."""


def trial_jobs(
    conditions: Sequence[str], arms: Sequence[str], seeds: Sequence[int]
) -> list[TrialJob]:
    """Returns the trials, all arms with one seed before the next: half a study compares them too.

    Raises:
        InvalidArgumentError: If there is no such condition or arm.
    """
    for kind, names, known in (("condition", conditions, CONDITIONS), ("arm", arms, ARMS)):
        for name in names:
            if name not in known:
                raise InvalidArgumentError(f"{name}: no such {kind}; there are: {','.join(known)}")
    return [
        TrialJob(condition, arm, seed)
        for seed in dict.fromkeys(seeds)
        for condition in CONDITIONS
        if condition in conditions
        for arm in ARMS
        if arm in arms
    ]


def study_static_versus_dynamic(
    out: str | Path,
    experiment: Experiment,
    jobs: Sequence[TrialJob],
    *,
    processes: int | None = None,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> ManyRuns:
    """Runs what is missing and writes the report.

    Args:
        out: Its folder `static-versus-dynamic` is the study's.
        experiment: How trials are made.
        jobs: The trials that are wanted, from `trial_jobs`.
        processes: How many at a time; as many as there are processors if not set.
        on_progress: Called with the number of trials done and of those that were missing; then
            those that figures need are counted too.

    Raises:
        OutputError: If the folder can't be used, or is of a study with other settings.
    """
    folder = Path(out) / NAME
    closing_times = {key: condition.closing_times for key, condition in CONDITIONS.items()}
    settings = {**experiment.settings, "closing_times": closing_times}
    with OutcomeStore(folder, settings, closing_times) as store:
        missing = sum(job not in store for job in jobs)
        failures = run_missing(
            store, folder, jobs, experiment.run_trial, processes=processes, on_progress=on_progress
        )
        made = sum(job in store for job in jobs)
        outcomes = store.outcomes
    # Without figures first: they take long, and the report must not be lost with them.
    report = folder / REPORT
    write_report(report, outcomes, settings, failures=failures)
    figures = experiment.make_figures(
        folder,
        outcomes,
        processes=processes,
        on_progress=lambda done, total: on_progress(missing + done, missing + total),
    )
    if figures:
        write_report(report, outcomes, settings, failures=failures, figures=figures)
    return ManyRuns(report, len(jobs), made, sum(job in failures for job in jobs))
