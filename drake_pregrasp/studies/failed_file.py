"""What has failed in a study, in a file: what each was, and why."""

import csv
import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self

from drake_pregrasp.errors import OutputError
from drake_pregrasp.simulation.output import reading_back, writing
from drake_pregrasp.studies.whole_files import append_safely, replace_whole, whole_lines

FAILED = "failed.csv"
"""The file."""

Cells = tuple[str, ...]
"""What tells a run from the others, as the file has it."""


class FailedFile:
    """Failures in a folder: each is on the disk when its run has ended.

    Entered, it reads what has failed before, which is known until it is made again; left, it sorts
    what is known and its file, or removes that if nothing has failed.

    Args:
        path: Of the file.
        columns: Names of the cells.
        order: Returns what runs are sorted by.

    Attributes:
        failures: Why runs have failed, by their cells.

    Raises:
        OutputError: If the file can't be used, or holds something else.
    """

    def __init__(
        self,
        path: Path,
        columns: Sequence[str],
        order: Callable[[Cells], Any],
    ) -> None:
        self._path = path
        self._header = [*columns, "error"]
        self._order = order
        self.failures: dict[Cells, str] = {}

    def __enter__(self) -> Self:
        self.failures = self._read()
        self._write_all()  # Else what is added would end a line that was cut off.
        return self

    def __exit__(self, *raised: object) -> None:
        self._write_all()

    def add(self, cells: Cells, why: str) -> None:
        """Says that a run has failed, and doesn't return before that is on the disk."""
        if self.failures.get(cells) == why:
            return
        self.failures[cells] = why
        if not self._path.exists():
            self._write_all()
            return
        with writing(self._path):
            file = self._path.open("a", encoding="utf-8", newline="\n")
        with file:
            append_safely(file, _lines([[*cells, why]]), self._path)

    def discard(self, cells: Cells) -> None:
        """Forgets that a run has failed."""
        self.failures.pop(cells, None)

    def _read(self) -> dict[Cells, str]:
        if not self._path.exists():
            return {}
        with reading_back(self._path):
            text = whole_lines(self._path.read_text(encoding="utf-8"))
        try:
            header, *rows = csv.reader(io.StringIO(text, newline=""), strict=True)
            if header != self._header or any(len(row) != len(header) for row in rows):
                raise ValueError
            failures = {tuple(cells): why for *cells, why in rows}
            sorted(failures, key=self._order)
        except (ValueError, csv.Error) as error:
            problem = "is no list of what has failed in this study"
            raise OutputError(f"{self._path}: {problem}") from error
        return failures

    def _write_all(self) -> None:
        self.failures = {c: self.failures[c] for c in sorted(self.failures, key=self._order)}
        if self.failures:
            rows = [[*cells, why] for cells, why in self.failures.items()]
            replace_whole(self._path, _lines([self._header, *rows]))
            return
        with writing(self._path):
            self._path.unlink(missing_ok=True)


def _lines(rows: Sequence[Sequence[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
