"""Runs of a sweep that ended with an error."""

from collections.abc import Mapping
from pathlib import Path

from drake_pregrasp.errors import OutputError
from drake_pregrasp.studies.failed_file import read_failed, write_failed
from drake_pregrasp.studies.sweep.plan import SweepPlan


def read_failures(path: Path, plan: SweepPlan) -> dict[int, str]:
    """Returns why runs have failed, by their indices, as a file says.

    Raises:
        OutputError: If it can't be read, or says it of other runs.
    """
    failures = {}
    for cells, why in read_failed(path, plan.cell_names).items():
        index = int(cells[0]) if cells[0].isdecimal() else -1
        if not 0 <= index < len(plan):
            raise OutputError(f"{path}: there is no run {cells[0]!r}")
        failures[index] = why
    return failures


def write_failures(path: Path, plan: SweepPlan, failures: Mapping[int, str]) -> None:
    """Writes why runs have failed, sorted by their indices; if none has there is no file.

    Raises:
        OutputError: If that fails.
    """
    cells = {plan.run(index).cells: failures[index] for index in sorted(failures)}
    write_failed(path, plan.cell_names, cells)
