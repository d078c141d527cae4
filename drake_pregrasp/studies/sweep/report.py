"""A sweep's report: one HTML page with everything inside."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from drake_pregrasp.simulation.output import write_text, writing
from drake_pregrasp.studies import markup
from drake_pregrasp.studies.markup import NONE, Cell
from drake_pregrasp.studies.report_style import STYLE
from drake_pregrasp.studies.settings_file import digest
from drake_pregrasp.studies.sweep.axis_figure import MOST_COLORS, axis_label, plot_axis
from drake_pregrasp.studies.sweep.grid_axis import label_text
from drake_pregrasp.studies.sweep.measures import MEASURES
from drake_pregrasp.studies.sweep.results import SweepResults
from drake_pregrasp.studies.sweep.rows_file import SweepRow
from drake_pregrasp.studies.sweep.study_file import Study

REPORT = "report.html"
"""The page."""

SHOWN = (
    "q_msv_mean",
    "q_gii_mean",
    "q_vew_mean",
    "motion_on_object",
    "displacement",
    "position_error_mean",
)
"""The measures in figures, as far as a study has them; if it has none, its first ones."""


def write_report(
    path: Path,
    study: Study,
    rows: Sequence[SweepRow],
    *,
    failures: Mapping[int, str],
    settings: Mapping[str, Any],
) -> None:
    """Writes the page. All that it says is computed from the rows.

    Args:
        path: Of the page.
        study: What was swept.
        rows: Of the runs that there are.
        failures: Why runs have none, by their indices.
        settings: That they were made with.

    Raises:
        OutputError: If it can't be written.
    """
    title = f"Sweep: {study.name}"
    results = SweepResults(study.plan, study.config.measures, rows)
    parts = [markup.heading(title, 1), *_lead(study, len(rows), failures)]
    if rows:
        for axis in results.axes:
            parts += _axis(path, results, axis)
    else:
        parts.append(markup.paragraph("There are no rows yet."))
    said = json.dumps(settings, indent=1)
    parts.append(markup.details(f"Settings, {digest(settings)}", said))
    if failures:
        lines = [f"{_run_in_words(study, index)}: {failures[index]}" for index in sorted(failures)]
        parts.append(markup.details(f"Failed runs, {len(failures)}", "\n".join(lines)))
    write_text(path, markup.page(title, STYLE, parts))


def color_axis(results: SweepResults, axis: str) -> str | None:
    """Returns the axis that colours show in an axis's figure: the next that has few values."""
    place = results.axes.index(axis)
    for other in results.axes[place + 1 :] + results.axes[:place]:
        if not results.is_continuous(other) and 1 < len(results.groups(other)) <= MOST_COLORS:
            return other
    return None


def _lead(study: Study, made: int, failures: Mapping[int, str]) -> list[str]:
    plan, config = study.plan, study.config
    counts = [f"{len(axis.labels)} values of {axis.name}" for axis in plan.grid]
    if plan.random:
        drawn = ", ".join(axis.name for axis in plan.random)
        counts.append(f"{plan.samples} samples of {drawn}")
    text = (
        f"{made} of {len(plan)} runs of the scenario {config.scenario}: {' x '.join(counts)} x"
        f" {len(plan.seeds)} seeds. Means, extremes and shares are over the time in which all"
        " contacts adapt."
    )
    parts = [markup.paragraph(config.description)] if config.description else []
    parts.append(markup.paragraph(text, "lead"))
    if failures:
        failed = f"{len(failures)} runs ended with an error and are left out."
        parts.append(markup.paragraph(failed, "behind"))
    return parts


def _axis(path: Path, results: SweepResults, axis: str) -> list[str]:
    shown = [name for name in SHOWN if name in results.values] or [*results.values][: len(SHOWN)]
    color = color_axis(results, axis)
    pooled = [name for name in results.axes if name not in (axis, color)]
    over = " and ".join(["seeds", *pooled])
    if results.is_continuous(axis):
        caption = f"A point for each run, over {over}."
    else:
        caption = f"Median, and the middle half, over {over}."
    if color is not None:
        caption += f" Colours: {color}."
    with TemporaryDirectory() as folder, writing(path):
        picture = Path(folder) / "axis.png"
        plot_axis(picture, results, axis, shown, color)
        figure = markup.figure(picture, caption)
    return [markup.heading(axis, 2), figure, _table(results, axis)]


def _table(results: SweepResults, axis: str) -> str:
    head = [
        Cell(axis_label(axis)),
        Cell("runs"),
        *(Cell(MEASURES[m].label) for m in results.values),
    ]
    rows = []
    for group in results.groups(axis):
        cells = [Cell(group.label, kind="name"), Cell(str(len(group.places)))]
        for measure in results.values:
            spread = results.spread(measure, group.places)
            if math.isnan(spread.median):
                cells.append(Cell(NONE))
            else:
                ends = f"{spread.low:.4g} to {spread.high:.4g}"
                cells.append(Cell(f"{spread.median:.5g}", ends))
        rows.append(cells)
    return markup.table(head, rows, "Medians over all runs, and below them least and most.")


def _run_in_words(study: Study, index: int) -> str:
    run = study.plan.run(index)
    said = zip(study.plan.columns, run.labels, strict=True)
    values = ", ".join(f"{name} {label_text(label)}" for name, label in said)
    return f"run {index} ({values}, seed {run.seed})"
