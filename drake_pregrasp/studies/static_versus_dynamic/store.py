"""Where a study keeps its outcomes while it runs, and finds them again when it goes on."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from drake_pregrasp.simulation.output import reading_back, writing
from drake_pregrasp.studies import settings_file
from drake_pregrasp.studies.static_versus_dynamic import outcome_csv
from drake_pregrasp.studies.static_versus_dynamic.outcome import Outcome, TrialJob
from drake_pregrasp.studies.whole_files import append_safely, replace_whole

OUTCOMES = "outcomes.csv"
"""The file of the rows."""

SETTINGS = "study.json"
"""The file of the settings they were made with."""


class OutcomeStore:
    """Outcomes in a folder: each trial's are on the disk when it has ended.

    A run that is killed loses the trials under way, and nothing else. Entered, the store drops
    what is left of a trial that was cut off while it was written; left, it sorts its file, so that
    the same study leaves the same bytes in whatever order its trials have ended.

    Args:
        folder: Of the study; made if it isn't there.
        settings: All that outcomes depend on but for their keys, as JSON can say it.
        closing_times: For each condition, the times at which its trials have outcomes.

    Raises:
        OutputError: If the folder can't be used, or is of a study with other settings.
    """

    def __init__(
        self,
        folder: Path,
        settings: Mapping[str, Any],
        closing_times: Mapping[str, Sequence[float]],
    ) -> None:
        self._path = folder / OUTCOMES
        self._closing_times = closing_times
        self._rows: dict[TrialJob, list[Outcome]] = {}
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            self._claim = settings_file.claim(folder / SETTINGS, settings)

    def __enter__(self) -> Self:
        try:
            self._rows = self._read()
            self._write_all()
            with writing(self._path):
                self._file = self._path.open("a", encoding="utf-8", newline="\n")
        except BaseException:
            self._claim.close()
            raise
        return self

    def __exit__(self, *raised: object) -> None:
        try:
            self._file.close()
            self._write_all()
        finally:
            self._claim.close()

    def __contains__(self, job: TrialJob) -> bool:
        return job in self._rows

    @property
    def outcomes(self) -> list[Outcome]:
        """Returns all of them, sorted by their keys."""
        return sorted((row for rows in self._rows.values() for row in rows), key=lambda r: r.key)

    def append(self, job: TrialJob, outcomes: Sequence[Outcome]) -> None:
        """Adds the outcomes of a trial, and doesn't return before they are on the disk."""
        self._rows[job] = list(outcomes)
        append_safely(self._file, outcome_csv.to_lines(outcomes), self._path)

    def is_complete(self, job: TrialJob, outcomes: Iterable[Outcome]) -> bool:
        """Whether these are what the job's trial gives: one for each closing time, in any order."""
        expected = [(job, time) for time in self._closing_times.get(job.condition, ())]
        return sorted((o.job, o.close_at) for o in outcomes) == sorted(expected)

    def _read(self) -> dict[TrialJob, list[Outcome]]:
        if not self._path.exists():
            return {}
        with reading_back(self._path):
            text = self._path.read_text(encoding="utf-8")
        rows: dict[TrialJob, list[Outcome]] = {}
        for outcome in outcome_csv.from_text(text, self._path):
            rows.setdefault(outcome.job, []).append(outcome)
        return {job: of_job for job, of_job in rows.items() if self.is_complete(job, of_job)}

    def _write_all(self) -> None:
        replace_whole(self._path, outcome_csv.HEADER + outcome_csv.to_lines(self.outcomes))
