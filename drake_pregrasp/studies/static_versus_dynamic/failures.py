"""Trials that ended with an error, in a file."""

import csv
import io
from collections.abc import Mapping
from pathlib import Path

from drake_pregrasp.errors import OutputError
from drake_pregrasp.simulation.output import reading_back, writing
from drake_pregrasp.studies.static_versus_dynamic.outcome import TrialJob
from drake_pregrasp.studies.whole_files import replace_whole

FAILED = "failed.csv"
"""The file."""

_HEADER = [*TrialJob._fields, "error"]


def read_failures(path: Path) -> dict[TrialJob, str]:
    """Returns what the file says, nothing if there is none.

    Raises:
        OutputError: If it can't be read.
    """
    if not path.exists():
        return {}
    with reading_back(path):
        lines = path.read_text(encoding="utf-8").splitlines()
    try:
        header, *rows = csv.reader(lines, strict=True)
        if header != _HEADER:
            raise ValueError
        return {TrialJob(condition, arm, int(seed)): e for condition, arm, seed, e in rows}
    except (ValueError, csv.Error) as error:
        raise OutputError(f"{path}: is no list of failed trials") from error


def write_failures(path: Path, failures: Mapping[TrialJob, str]) -> None:
    """Writes them, sorted; if there are none there is no file.

    Raises:
        OutputError: If that fails.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([_HEADER, *([*job, failures[job]] for job in sorted(failures))])
    if failures:
        replace_whole(path, text.getvalue())
        return
    with writing(path):
        path.unlink(missing_ok=True)
