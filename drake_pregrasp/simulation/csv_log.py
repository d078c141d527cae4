"""A table of numbers that is written row by row."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Self

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.simulation.output import reading_back, writing

_FLUSH_PERIOD = 1.0  # Seconds that an interrupted run may lose.


class CsvLog:
    """Writes rows as they come, so that an interrupted run keeps what it has.

    Numbers are written with all their digits: reading them gives the same floats.

    Args:
        path: The file to write; what was there is replaced.
        columns: Names of the columns.

    Attributes:
        columns: The names.
        num_rows: How many there are.

    Raises:
        OutputError: If the file can't be written.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        self.columns = list(columns)
        self.num_rows = 0
        self._flushed = time.monotonic()
        self._path = path
        with writing(path):
            self._file = path.open("w", encoding="utf-8", newline="\n")
            self._file.write(",".join(self.columns) + "\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self._file.close()

    def write(self, row: FloatArray) -> None:
        """Adds a row."""
        self.num_rows += 1
        now = time.monotonic()
        with writing(self._path):
            self._file.write(",".join(map(repr, row.tolist())) + "\n")
            if now - self._flushed > _FLUSH_PERIOD:
                self._file.flush()
                self._flushed = now

    def read(self, *names: str) -> list[FloatArray]:
        """Reads columns back from the file, once it is closed.

        Raises:
            OutputError: If the file can't be read.
        """
        if self.num_rows == 0:
            return [np.empty(0) for _ in names]
        indices = [self.columns.index(name) for name in names]
        with reading_back(self._path):
            table = np.loadtxt(self._path, delimiter=",", skiprows=1, usecols=indices, ndmin=2)
        return list(table.T)
