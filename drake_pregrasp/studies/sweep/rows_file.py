"""The rows of a sweep, in a file that is right whenever its study ends."""

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from drake_pregrasp.errors import OutputError
from drake_pregrasp.simulation.output import reading_back, writing
from drake_pregrasp.studies.sweep.plan import SweepPlan
from drake_pregrasp.studies.whole_files import append_safely, replace_whole, whole_lines

ROWS = "rows.csv"
"""The file of the rows."""


@dataclass(frozen=True)
class SweepRow:
    """What a run came to.

    Attributes:
        index: Of the run.
        values: Of the measures; nan where there was nothing to measure.
    """

    index: int
    values: tuple[float, ...]


class RowsFile:
    """Rows in a folder: each is on the disk when its run has ended.

    Entered, it drops what is left of a row that was cut off while it was written; left, it sorts
    its file, so that the same study leaves the same bytes in whatever order its runs have ended.

    Args:
        path: Of the file.
        plan: The runs that rows are of.
        measures: Names of the numbers in a row.

    Raises:
        OutputError: If the file can't be used, or holds something else.
    """

    def __init__(self, path: Path, plan: SweepPlan, measures: Sequence[str]) -> None:
        self._path = path
        self._plan = plan
        self._columns = [*plan.cell_names, *measures]
        self._num_values = len(measures)
        self._rows: dict[int, SweepRow] = {}

    def __enter__(self) -> Self:
        self._rows = self._read()
        self._write_all()
        with writing(self._path):
            self._file = self._path.open("a", encoding="utf-8", newline="\n")
        return self

    def __exit__(self, *raised: object) -> None:
        self._file.close()
        self._write_all()

    def __contains__(self, index: int) -> bool:
        return index in self._rows

    @property
    def rows(self) -> list[SweepRow]:
        """All there are, by their index."""
        return [self._rows[index] for index in sorted(self._rows)]

    def append(self, index: int, values: Sequence[float]) -> None:
        """Adds a row, and doesn't return before it is on the disk."""
        self._rows[index] = SweepRow(index, tuple(map(float, values)))
        append_safely(self._file, self._lines([index]), self._path)

    def _lines(self, indices: Iterable[int]) -> str:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        for index in indices:
            cells = self._plan.run(index).cells
            writer.writerow([*cells, *map(repr, self._rows[index].values)])
        return text.getvalue()

    def _read(self) -> dict[int, SweepRow]:
        if not self._path.exists():
            return {}
        with reading_back(self._path):
            text = whole_lines(self._path.read_text(encoding="utf-8"))
        if not text:
            return {}
        try:
            header, *lines = csv.reader(io.StringIO(text, newline=""), strict=True)
            if header != self._columns:
                raise ValueError
            found = [self._row(line) for line in lines]
        except (ValueError, csv.Error) as error:
            raise OutputError(f"{self._path}: holds no rows of this study") from error
        return {row.index: row for row in found}

    def _row(self, cells: Sequence[str]) -> SweepRow:
        index, values = int(cells[0]), cells[-self._num_values :]
        if len(cells) != len(self._columns) or not 0 <= index < len(self._plan):
            raise ValueError
        if tuple(cells[: -self._num_values]) != self._plan.run(index).cells:
            raise ValueError
        return SweepRow(index, tuple(map(float, values)))

    def _write_all(self) -> None:
        header = io.StringIO()
        csv.writer(header, lineterminator="\n").writerow(self._columns)
        replace_whole(self._path, header.getvalue() + self._lines(sorted(self._rows)))
