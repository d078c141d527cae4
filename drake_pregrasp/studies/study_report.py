"""Report of a study: counts, intervals, paired tests, causes of failure, and figures by axis."""

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter

from drake_pregrasp.studies.grasps.fitting_objects import FIT_IN_WORDS
from drake_pregrasp.studies.grasps.grasp_outcome import CLEAN_IN_WORDS, HELD_IN_WORDS
from drake_pregrasp.studies.measures import MEASURES, PLANNING
from drake_pregrasp.studies.paired_tests import (
    ALL,
    SIGNIFICANT,
    is_yes_or_no,
    least_pairs,
    paired_tests,
    share_interval,
)
from drake_pregrasp.studies.report_page import Details, Heading, Part, Picture, Table, write_report
from drake_pregrasp.studies.runner import StudyRows, to_csv
from drake_pregrasp.studies.study_axes import RANDOM_OBJECTS, Axis, GridAxis, RandomAxis
from drake_pregrasp.studies.study_file import Study

_DEFINITIONS = {"held": HELD_IN_WORDS, "clean": CLEAN_IN_WORDS}
_GROUPS = ("condition", "close_at", "method")
_HEADS = {"close_at": "closes at [s]"}
_CLASSES = {"ahead": "better", "behind": "worse"}
_MOST_COLORS = 7  # Largest number of values that colours distinguish.
_MOST_GROUPS = 8  # Random numbers with more values are grouped into quartiles.
_LOG_RATIO = 20.0  # Ratio of largest to least value from which a scale is logarithmic.


def write_study_report(folder: Path, study: Study, found: StudyRows, settings: Any) -> Path:
    """Writes `report.html` and `report.md`, and returns the path of the former.

    Args:
        folder: Folder of the study.
        study: Study of the report.
        found: Rows and failures of the study.
        settings: Settings that the rows depend on, shown at the end of the report.

    Raises:
        OutputError: If the report cannot be written.
    """
    config, rows = study.config, found.rows
    runs = rows.drop_duplicates([n for n in rows if n in study.job_columns])
    parts: list[Part] = [config.description] if config.description else []
    parts.append(f"{len(runs)} runs; {len(found.failed)} failed.")
    parts += [_DEFINITIONS[name] for name in config.measures if name in _DEFINITIONS]
    if any(axis.kind == RANDOM_OBJECTS for axis in study.axes if isinstance(axis, RandomAxis)):
        parts.append(f"{FIT_IN_WORDS} Other objects are left out.")
    if any(name in PLANNING.labels for name in config.measures):
        parts.append(
            "Means, extremes and shares of planning are over the time in which all contacts adapt."
        )
    parts += _results(study, rows) if len(rows) else ["There are no rows yet."]
    for key, entries in (("Conditions", study.conditions), ("Methods", study.methods)):
        texts = [{"name": e.label, "description": e.description} for e in entries.values()]
        if any(text["description"] for text in texts):
            parts += [Heading(key), Table(pd.DataFrame(texts))]
    if len(found.failed):
        parts.append(Details(f"Failed runs, {len(found.failed)}", to_csv(found.failed)))
    parts.append(Details("Settings", json.dumps(settings, indent=1)))
    return write_report(folder, f"Study: {study.name}", parts)


def _results(study: Study, rows: pd.DataFrame) -> list[Part]:
    """Returns the parts of a report that follow from its rows."""
    config, shown = study.config, labelled(study, rows)
    groups = [name for name in _GROUPS if name in rows and rows[name].nunique() > 1]
    shares = [name for name in config.measures if is_yes_or_no(rows[name])]
    numbers = [n for n in config.measures if n not in shares and rows[n].notna().any()]
    parts: list[Part] = [Heading("Results")]
    for name in shares:
        known = shown[shown[name].notna()]
        parts.append(Table(share_table(known, name), f"Runs in which: {MEASURES[name]}."))
        if len(groups) > 1:
            parts.append(Picture(plot_shares(known, name), "Shares with exact 95 % intervals."))
    if numbers:
        table = measure_table(shown, groups, numbers)
        parts.append(Table(table, "Medians, and the least and largest values."))
    if "cause" in rows:
        parts += _causes(shown)
    if config.tests:
        parts += _test_parts(study, rows)
    figures = config.figures or [*shares, *numbers]
    figures = [name for name in figures if name in (*shares, *numbers)]
    for axis in study.axes:
        parts += [
            Heading(axis.name),
            *_axis_parts(study, shown, axis, figures),
        ]
    return parts


def labelled(study: Study, rows: pd.DataFrame) -> pd.DataFrame:
    """Returns rows with labels of conditions and methods, in the order of the study.

    Axes are numeric, or else categorical in their order.
    """
    rows = rows.copy()
    for name, entries in (("condition", study.conditions), ("method", study.methods)):
        if name in rows:
            labels = [entry.label for entry in entries.values()]
            column = rows[name].map({key: entry.label for key, entry in entries.items()})
            rows[name] = pd.Categorical(column, labels).remove_unused_categories()
    for axis in study.axes if len(rows) else ():
        column = rows[axis.name]
        known = column.dropna()
        if all(isinstance(v, int | float) and not isinstance(v, bool) for v in known):
            rows[axis.name] = column.astype(float)
        else:
            order = axis.changes if isinstance(axis, GridAxis) else known
            texts = list(dict.fromkeys(map(str, order)))
            rows[axis.name] = pd.Categorical(column.map(str), texts).remove_unused_categories()
    return rows


def share_table(rows: pd.DataFrame, measure: str) -> pd.DataFrame:
    """Returns counts of a yes-or-no measure with exact intervals, and a column for each method.

    Args:
        rows: Rows from `labelled` that have the measure.
        measure: Name of the measure.
    """
    table = rows.assign(all="all")
    keys = [name for name in _GROUPS if name in rows] or ["all"]
    cells = table.groupby(keys, observed=True)[measure]
    counts, sizes = cells.sum().astype(int), cells.size()
    ends = (100 * share_interval(counts, sizes)).round(1)
    lines = zip(counts, sizes, ends["low"], ends["high"], strict=True)
    texts = pd.Series(
        [f"{n} of {of} ({low:g}–{high:g} %)" for n, of, low, high in lines], counts.index
    )
    if "method" in keys and len(keys) > 1:
        texts = texts.unstack("method")
    return _flat(texts.to_frame("runs") if isinstance(texts, pd.Series) else texts)


def measure_table(rows: pd.DataFrame, keys: Sequence[Any], measures: Sequence[str]) -> pd.DataFrame:
    """Returns medians and ranges of numbers, and counts of yes-or-no measures, for each group.

    Args:
        rows: Rows from `labelled`.
        keys: Names of columns, or columns, that form the groups; none for a single group.
        measures: Names of the measures.
    """
    groups = rows.groupby(list(keys) or (lambda _: "all"), observed=True)
    table = pd.DataFrame({"runs": groups.size()})
    for measure in measures:
        if is_yes_or_no(rows[measure]):
            counts = groups[measure].agg(lambda known: f"{known.sum():.0f} of {known.count()}")
            table[MEASURES[measure]] = counts
            continue
        median, low, high = (getattr(groups[measure], n)() for n in ("median", "min", "max"))
        least, most = (part.map("{:.4g}".format) for part in (low, high))
        ends = (" (" + least + " to " + most + ")").where(low < high, "")
        table[MEASURES[measure]] = (median.map("{:.4g}".format) + ends).where(median.notna())
    return _flat(table if keys else table.reset_index(drop=True))


def _flat(table: pd.DataFrame) -> pd.DataFrame:
    """Returns a table whose index became columns."""
    named = [name for name in table.index.names if name not in (None, "all")]
    table = table.reset_index() if named else table.reset_index(drop=True)
    table.columns = [_HEADS.get(str(name), str(name)) for name in table.columns]
    return table.map(lambda v: f"{v:.6g}" if isinstance(v, float) else str(v))


def _causes(rows: pd.DataFrame) -> list[Part]:
    failed = rows[rows["cause"].fillna("") != ""]
    if not len(failed):
        return []
    keys = [name for name in ("condition", "cause") if name in rows]
    columns = failed["method"] if "method" in rows else pd.Series("runs", failed.index)
    counts = pd.crosstab([failed[key] for key in keys], columns)
    return [Table(_flat(counts), "Causes of failures; every failure has one.")]


def _test_parts(study: Study, rows: pd.DataFrame) -> list[Part]:
    cell = [name for name in ("condition", "close_at") if name in rows]
    pair = [axis.name for axis in study.grid] + ["seed"]
    tests = paired_tests(rows, study.config.tests, cell=cell, pair=pair)
    caption = (
        f"Paired tests on the same runs, corrected for all {len(tests)} tests (Holm). The"
        f" probability that any verdict is there by chance is below {SIGNIFICANT:g}. Fewer than"
        f" {least_pairs(len(tests))} common runs cannot show a difference. Intervals (95 %) of the"
        " difference of shares are conservative."
    )
    return [Heading("Paired tests"), Table(test_table(study, tests), caption)]


def test_table(study: Study, tests: pd.DataFrame) -> Any:
    """Returns the table of the tests of `paired_tests`, with colours of the verdicts."""
    table = tests.copy()
    if "condition" in table:
        labels = {key: condition.label for key, condition in study.conditions.items()} | {ALL: ALL}
        table["condition"] = pd.Categorical(table["condition"].map(labels), labels.values())
        table = table.sort_values("condition", kind="stable")
    labels = {key: method.label for key, method in study.methods.items()}
    table[["tested", "against"]] = table[["tested", "against"]].map(labels.get)
    # Rounded outward, so that the interval keeps its coverage probability.
    ends = [np.floor(1000 * table.pop("low")) / 10, np.ceil(1000 * table.pop("high")) / 10]
    p, p_holm, verdict = (table.pop(name) for name in ("p", "p_holm", "verdict"))
    table["p"], table["p (Holm)"] = p.map(_p), p_holm.map(_p)
    low, high = (part.map("{:+.1f}".format) for part in ends)
    table["difference"] = (low + " to " + high + " %").where(ends[0].notna())
    table["tested is"] = verdict
    same = table["pairs"] - table["gained"] - table["lost"]
    table.insert(table.columns.get_loc("pairs") + 1, "both the same", same)
    names = {"gained": "only it, or larger", "lost": "only the other, or smaller"}
    table = _flat(table.rename(columns=names))
    classes = table.map(lambda cell: _CLASSES.get(str(cell), ""))
    return table.style.set_td_classes(classes)


def _p(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"{p:.2g}"


def plot_shares(rows: pd.DataFrame, measure: str) -> Figure:
    """Returns a figure of a yes-or-no measure's shares, with one panel for each condition.

    Args:
        rows: Rows from `labelled` that have the measure.
        measure: Name of the measure.
    """
    data = rows.assign(condition=rows.get("condition", ""), method=rows.get("method", "runs"))
    data = data.assign(share=100 * data[measure].astype(float))
    data["close_at"] = data["close_at"].map("{:g}".format)
    conditions = list(dict.fromkeys(data["condition"]))
    with matplotlib.rc_context({"text.parse_math": False}):
        grid = sns.catplot(
            data,
            kind="point",
            x="close_at",
            y="share",
            hue="method",
            col="condition",
            col_order=conditions,
            col_wrap=min(4, len(conditions)),
            height=2.9,
            aspect=1.2,
            dodge=0.5,
            linestyle="none",
            palette="colorblind",
            sharex=False,
            legend="full",
            errorbar=_interval_ends,
        )
        grid.set_titles("{col_name}").set_axis_labels("closes at [s]", f"{MEASURES[measure]} [%]")
        grid.set(ylim=(-4, 104))
    figure: Figure = grid.figure
    plt.close(figure)
    return figure


def _interval_ends(shares: pd.Series) -> tuple[float, float]:
    held, tried = pd.Series([np.sum(shares) / 100]), pd.Series([len(shares)])
    ends = 100 * share_interval(held.round(), tried)
    return float(ends["low"][0]), float(ends["high"][0])


def _axis_parts(
    study: Study, rows: pd.DataFrame, axis: Axis, measures: Sequence[str]
) -> list[Part]:
    """Returns a figure and a table of the measures over an axis."""
    rows = rows[rows[axis.name].notna()]
    if isinstance(axis, RandomAxis) and axis.kind == RANDOM_OBJECTS:
        failed = rows[rows["held"].eq(False)]
        return [f"Not held: {', '.join(dict.fromkeys(map(str, failed[axis.name]))) or 'none'}."]
    caption = "Medians and the middle half of the runs, or shares with exact 95 % intervals."
    shown = list(measures)
    if is_scattered(rows, axis):
        caption = "A point for each run."
        shown = [name for name in measures if not is_yes_or_no(rows[name])]
    color = color_column(study, rows, axis)
    pictures = [Picture(plot_axis(rows, axis, shown, color), caption)] if shown else []
    by = rows[axis.name]
    if is_scattered(rows, axis) and by.nunique() > _MOST_GROUPS:
        by = pd.qcut(by, 4, precision=4, duplicates="drop")
    others = [n for n in ("condition", "method") if n in rows and rows[n].nunique() > 1]
    table = measure_table(rows, [*others[:1], by, *others[1:]], measures)
    return [*pictures, Table(table, "Medians, and the least and largest values.")]


def is_scattered(rows: pd.DataFrame, axis: Axis) -> bool:
    """Returns whether a figure shows single runs, as it does for random numbers."""
    return isinstance(axis, RandomAxis) and pd.api.types.is_numeric_dtype(rows[axis.name])


def color_column(study: Study, rows: pd.DataFrame, axis: Axis) -> str | None:
    """Returns the column that colours show in an axis's figure.

    It is the first column with few values of: methods, conditions, and the axes after this one.
    """
    place = study.axes.index(axis)
    axes = [*study.axes[place + 1 :], *study.axes[:place]]
    names = ["method", "condition", *(a.name for a in axes if not is_scattered(rows, a))]
    few = [n for n in names if n in rows and 1 < rows[n].nunique() <= _MOST_COLORS]
    return few[0] if few else None


def plot_axis(
    rows: pd.DataFrame,
    axis: Axis,
    measures: Sequence[str],
    color: str | None,
) -> Figure:
    """Returns a figure of measures against an axis: medians and quartiles, shares, or points.

    Args:
        rows: Rows from `labelled`.
        axis: Axis of the study on the horizontal axis.
        measures: Names of the measures, one for each panel.
        color: Name of the column that colours show, or None.
    """
    shown_by_color = axis.name if color is None else color
    shares = [name for name in measures if is_yes_or_no(rows[name])]
    data = rows[list(measures)].astype(float)
    data[shares] *= 100
    data = data.assign(x=rows[axis.name], color=rows[shown_by_color])
    data = data.melt(["x", "color"], var_name="measure")
    shared: dict[str, Any] = {"x": "x", "y": "value", "col": "measure", "height": 3.1}
    shared |= {"col_wrap": min(3, len(measures)), "aspect": 1.4}
    if color is not None:
        is_number = pd.api.types.is_numeric_dtype(data["color"])
        palette = "viridis" if is_number else "colorblind"
        shared |= {"hue": "color", "legend": "full"}
        shared["palette"] = sns.color_palette(palette, data["color"].nunique())
    is_share = data["measure"].isin(shares)
    middle = {"estimator": partial(_middle, is_share), "errorbar": partial(_spread, is_share)}
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
        grid.set_titles("").set_xlabels(axis.name)
        if color is not None:
            place = {"loc": "lower center", "bbox_to_anchor": (0.5, 1), "ncol": _MOST_COLORS}
            sns.move_legend(grid, **place, title=color)
        for panel, measure in zip(grid.axes.flat, measures, strict=True):
            panel.set_ylabel(MEASURES[measure] + (" [%]" if measure in shares else ""))
            _scale(panel.yaxis, data.loc[data["measure"] == measure, "value"])
            if pd.api.types.is_numeric_dtype(data["x"]):
                _scale(panel.xaxis, rows[axis.name])
            elif data["x"].nunique() > _MOST_COLORS:
                panel.tick_params(axis="x", rotation=60)
        grid.tight_layout()
    figure: Figure = grid.figure
    plt.close(figure)
    return figure


def _middle(is_share: pd.Series, values: pd.Series) -> float:
    """Returns a share, or the median of numbers.

    Args:
        is_share: Which rows of the figure are those of yes-or-no measures.
        values: Values of some rows of one measure, in percent for shares.
    """
    return float(np.mean(values) if is_share[values.index].all() else np.median(values))


def _spread(is_share: pd.Series, values: pd.Series) -> tuple[float, float]:
    """Returns the exact interval of a share, or the quartiles of numbers; see `_middle`."""
    if is_share[values.index].all():
        return _interval_ends(values)
    low, high = np.percentile(values, (25, 75))
    return float(low), float(high)


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
        axis.axes.autoscale_view()
        getattr(axis.axes, f"set_{axis.axis_name}lim")(0)
    axis.set_major_formatter(lambda value, place: f"{value:g}")
    axis.set_minor_formatter(LogFormatter(labelOnlyBase=False))
