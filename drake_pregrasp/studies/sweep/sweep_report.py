"""Report of a sweep, with a figure and a table of the measures for each axis."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import pandas as pd
import seaborn as sns
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter

from drake_pregrasp.studies.report_page import Details, Heading, Part, Picture, Table, write_report
from drake_pregrasp.studies.runner import StudyRows, to_csv
from drake_pregrasp.studies.sweep.measures import LABELS, MEASURES
from drake_pregrasp.studies.sweep.study_file import Study
from drake_pregrasp.studies.sweep.sweep_plan import GridAxis, RandomAxis

_SHOWN = (
    "q_msv_mean",
    "q_gii_mean",
    "q_vew_mean",
    "motion_on_object",
    "displacement",
    "position_error_mean",
)
_MOST_COLORS = 7  # Largest number of values that colours distinguish.
_MOST_GROUPS = 8  # Random numbers with more values are grouped into quartiles.
_LOG_RATIO = 20.0  # Ratio of largest to least value from which a scale is logarithmic.


def write_sweep_report(folder: Path, study: Study, found: StudyRows) -> Path:
    """Writes `report.html` and returns its path.

    Args:
        folder: Folder of the study.
        study: Study of the report.
        found: Rows and failures of the study.

    Raises:
        OutputError: If the report cannot be written.
    """
    plan, config = study.plan, study.config
    counts = [f"{len(axis.labels)} values of {axis.name}" for axis in plan.grid]
    if plan.random:
        counts.append(f"{plan.samples} samples of {', '.join(axis.name for axis in plan.random)}")
    parts: list[Part] = [config.description] if config.description else []
    parts.append(
        f"{found.made} of {len(plan)} runs of the scenario {config.scenario}:"
        f" {' x '.join(counts)} x {len(plan.seeds)} seeds; {len(found.failed)} failed. Means,"
        " extremes and shares are over the time in which all contacts adapt."
    )
    rows = with_categories(found.rows, plan.axes)
    shown = [name for name in _SHOWN if name in config.measures] or config.measures[: len(_SHOWN)]
    shown = [name for name in shown if len(rows) and rows[name].notna().any()]
    for axis in plan.axes if len(rows) else ():
        parts.append(Heading(axis.name))
        if shown:
            color = color_axis(rows, plan.axes, axis)
            caption = (
                "A point for each run."
                if is_scattered(rows, axis)
                else "Medians, and the middle half of the runs."
            )
            parts.append(Picture(plot_axis(rows, axis, shown, color), caption))
        table = axis_table(rows, axis, config.measures)
        parts.append(Table(table, "Medians of all runs, and the least and largest values."))
    if not len(rows):
        parts.append("There are no rows yet.")
    if len(found.failed):
        parts.append(Details(f"Failed runs, {len(found.failed)}", to_csv(found.failed)))
    return write_report(folder, f"Sweep: {study.name}", parts, formats=("html",))


def with_categories(rows: pd.DataFrame, axes: Sequence[GridAxis | RandomAxis]) -> pd.DataFrame:
    """Returns rows whose axes are numeric, or else categorical in the order of the study."""
    rows = rows.copy()
    for axis in axes if len(rows) else ():
        column = rows[axis.name]
        if all(isinstance(v, int | float) and not isinstance(v, bool) for v in column):
            rows[axis.name] = column.astype(float)
        else:
            order = axis.labels if isinstance(axis, GridAxis) else column
            texts = list(dict.fromkeys(map(str, order)))
            rows[axis.name] = pd.Categorical(column.map(str), texts).remove_unused_categories()
    return rows


def is_scattered(rows: pd.DataFrame, axis: GridAxis | RandomAxis) -> bool:
    """Returns whether a figure shows single runs, as it does for random numbers."""
    return isinstance(axis, RandomAxis) and pd.api.types.is_numeric_dtype(rows[axis.name])


def color_axis(
    rows: pd.DataFrame, axes: Sequence[GridAxis | RandomAxis], axis: GridAxis | RandomAxis
) -> GridAxis | RandomAxis | None:
    """Returns the axis that colours show in an axis's figure: the next axis with few values."""
    place = axes.index(axis)
    for other in [*axes[place + 1 :], *axes[:place]]:
        if not is_scattered(rows, other) and 1 < rows[other.name].nunique() <= _MOST_COLORS:
            return other
    return None


def axis_table(
    rows: pd.DataFrame, axis: GridAxis | RandomAxis, measures: Sequence[str]
) -> pd.DataFrame:
    """Returns a table of the medians and ranges of measures for each value of an axis."""
    by = rows[axis.name]
    if is_scattered(rows, axis) and by.nunique() > _MOST_GROUPS:
        by = pd.qcut(by, 4, precision=4, duplicates="drop")
    groups = rows.groupby(by, observed=True)
    median, low, high = (getattr(groups[list(measures)], n)() for n in ("median", "min", "max"))
    table = pd.DataFrame({"runs": groups.size()})
    for measure in measures:
        least, most = (part[measure].map("{:.4g}".format) for part in (low, high))
        shown = median[measure].map("{:.5g}".format) + " (" + least + " to " + most + ")"
        table[MEASURES[measure]] = shown.where(median[measure].notna())
    table.index = [f"{v:.6g}" if isinstance(v, float) else str(v) for v in table.index]
    return table.rename_axis(axis_label(axis.name)).reset_index()


def axis_label(name: str) -> str:
    """Returns the label of an axis, with the unit of its field if the unit is known."""
    field = name.rpartition(".")[2].partition("[")[0]
    unit = next((unit for unit, fields in LABELS["units"].items() if field in fields), "")
    # Names of several fields that change together may have a unit.
    return f"{name} [{unit}]" if unit and " [" not in name else name


def plot_axis(
    rows: pd.DataFrame,
    axis: GridAxis | RandomAxis,
    measures: Sequence[str],
    color: GridAxis | RandomAxis | None,
) -> Figure:
    """Returns a figure of measures against an axis: medians and quartiles, or points.

    Args:
        rows: Rows from `with_categories`.
        axis: Axis of the sweep on the horizontal axis.
        measures: Names of the measures, one for each panel.
        color: Axis of the sweep that colours show, or None.
    """
    shown_by_color = axis.name if color is None else color.name
    data = rows[list(measures)].assign(x=rows[axis.name], color=rows[shown_by_color])
    data = data.melt(["x", "color"], var_name="measure")
    shared: dict[str, Any] = {"x": "x", "y": "value", "col": "measure", "height": 3.1}
    shared |= {"col_wrap": min(3, len(measures)), "aspect": 1.4}
    if color is not None:
        is_number = pd.api.types.is_numeric_dtype(data["color"])
        palette = "viridis" if is_number else "colorblind"
        shared |= {"hue": "color", "legend": "full"}
        shared["palette"] = sns.color_palette(palette, data["color"].nunique())
    middle = {"estimator": "median", "errorbar": ("pi", 50)}
    own_scales = {"sharex": False, "sharey": False}
    style = {"style": shared.get("hue"), "facet_kws": own_scales}
    # Names from users are not formulas.
    with matplotlib.rc_context({"text.parse_math": False}):
        if is_scattered(rows, axis):
            grid = sns.relplot(data, kind="scatter", **shared, **style)
        elif pd.api.types.is_numeric_dtype(data["x"]):
            grid = sns.relplot(
                data, kind="line", markers=True, dashes=False, **shared, **style, **middle
            )
        else:
            apart = {} if color is None else {"dodge": 0.4}
            grid = sns.catplot(
                data, kind="point", linestyle="none", **shared, **own_scales, **middle, **apart
            )
        grid.set_titles("").set_xlabels(axis_label(axis.name))
        if color is not None:
            place = {"loc": "lower center", "bbox_to_anchor": (0.5, 1), "ncol": _MOST_COLORS}
            sns.move_legend(grid, **place, title=axis_label(color.name))
        for panel, measure in zip(grid.axes.flat, measures, strict=True):
            panel.set_ylabel(MEASURES[measure])
            _scale(panel.yaxis, rows[measure])
            if pd.api.types.is_numeric_dtype(data["x"]):
                _scale(panel.xaxis, rows[axis.name])
        grid.tight_layout()
    figure: Figure = grid.figure
    plt.close(figure)
    return figure


def _scale(axis: Any, values: pd.Series) -> None:
    """Makes an axis with a wide range of magnitudes logarithmic, and linear around zero."""
    above = values[values > 0]
    if (values < 0).any() or not above.max() > _LOG_RATIO * above.min():
        axis.axes.ticklabel_format(axis=axis.axis_name, useOffset=False)
        return
    set_scale = getattr(axis.axes, f"set_{axis.axis_name}scale")
    if len(above) == len(values):
        set_scale("log")
    else:
        set_scale("symlog", linthresh=above.min())
    axis.set_major_formatter(lambda value, place: f"{value:g}")
    axis.set_minor_formatter(LogFormatter(labelOnlyBase=False))
