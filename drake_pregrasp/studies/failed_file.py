"""What has failed in a study, in a file: what each was, and why."""

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from drake_pregrasp.errors import OutputError
from drake_pregrasp.simulation.output import reading_back, writing
from drake_pregrasp.studies.whole_files import replace_whole

FAILED = "failed.csv"
"""The file."""

Cells = tuple[str, ...]
"""What tells a run from the others, as the file has it."""


def read_failed(path: Path, columns: Sequence[str]) -> dict[Cells, str]:
    """Returns what the file says, nothing if there is none.

    Args:
        path: Of the file.
        columns: Names of the cells.

    Raises:
        OutputError: If it can't be read, or has other columns.
    """
    if not path.exists():
        return {}
    with reading_back(path):
        text = path.read_text(encoding="utf-8")
    try:
        header, *rows = csv.reader(io.StringIO(text, newline=""), strict=True)
        if any(len(row) != len(columns) + 1 for row in rows) or header != [*columns, "error"]:
            raise ValueError
    except (ValueError, csv.Error) as error:
        raise OutputError(f"{path}: is no list of what has failed in this study") from error
    return {tuple(cells): why for *cells, why in rows}


def write_failed(path: Path, columns: Sequence[str], failures: Mapping[Cells, str]) -> None:
    """Writes what has failed, in the order given; if nothing has there is no file.

    Args:
        path: Of the file.
        columns: Names of the cells.
        failures: Why, by the cells.

    Raises:
        OutputError: If that fails.
    """
    if not failures:
        with writing(path):
            path.unlink(missing_ok=True)
        return
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([[*columns, "error"], *([*cells, why] for cells, why in failures.items())])
    replace_whole(path, text.getvalue())
