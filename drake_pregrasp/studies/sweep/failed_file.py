"""Runs of a sweep that ended with an error, in a file."""

import csv
import io
from collections.abc import Mapping
from pathlib import Path

from drake_pregrasp.simulation.output import writing
from drake_pregrasp.studies.sweep.grid_axis import label_text
from drake_pregrasp.studies.sweep.plan import SweepPlan
from drake_pregrasp.studies.whole_files import replace_whole

FAILED = "failed.csv"
"""The file."""


def write_failed(path: Path, plan: SweepPlan, failures: Mapping[int, str]) -> None:
    """Writes the runs that have failed, with why, sorted; if there are none there is no file.

    Args:
        path: Of the file.
        plan: All runs.
        failures: The words, by indices.

    Raises:
        OutputError: If that fails.
    """
    if not failures:
        with writing(path):
            path.unlink(missing_ok=True)
        return
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["index", *plan.columns, "seed", "error"])
    for index in sorted(failures):
        run = plan.run(index)
        said = [label_text(label) for label in run.labels]
        writer.writerow([index, *said, run.seed, failures[index]])
    replace_whole(path, text.getvalue())
