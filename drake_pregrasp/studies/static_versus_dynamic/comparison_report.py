"""Report of the study: counts, paired tests and figures, computed from its rows."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from drake_pregrasp.studies.report_page import Details, Heading, Part, Picture, Table, write_report
from drake_pregrasp.studies.static_versus_dynamic import paired_statistics
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.grasp_outcome import (
    CLEAN_IN_WORDS,
    TOUCHING_N,
    Outcome,
)
from drake_pregrasp.studies.static_versus_dynamic.methods import METHODS, TESTED

_MEASURES = [field.name for field in fields(Outcome) if field.type in (int, float)][1:]
_LABELS = {key: method.label for key, method in METHODS.items()}
_TESTED = _LABELS[TESTED]
_CLASSES = {"ahead": "better", "behind": "worse"}
_TITLE = "Static or dynamic contacts: which hand grasps better?"
_LIMITS = (
    "All grasps are simulated: rigid bodies, point contact of fingertips, one friction"
    " coefficient, one object, and one hand without gravity. The authors of the planner chose"
    " speeds, sizes and bounds."
    " Closing times of a trial share its tracking run, so their grasps are not independent."
)


def write_comparison(
    folder: Path,
    rows: pd.DataFrame,
    failed: pd.DataFrame,
    settings: Mapping[str, Any],
    figures: Sequence[Part] = (),
) -> Path:
    """Writes the report, and returns its path.

    Args:
        folder: Folder of the study.
        rows: Rows of the study.
        failed: Failed jobs, with their errors.
        settings: Settings of the study, shown at the end of the report.
        figures: Parts of the report with the figures of one seed.

    Raises:
        OutputError: If the report cannot be written.
    """
    parts: list[Part] = [CLEAN_IN_WORDS]
    if len(failed):
        parts.append(Table(failed, f"{len(failed)} trials failed and are left out."))
    if rows.empty:
        parts.append("There are no grasps yet.")
    else:
        tests = paired_statistics.paired_tests(rows)
        trials = len(rows[["condition", "method", "seed"]].drop_duplicates())
        parts += [
            f"{trials} trials, {len(rows)} grasps. With p corrected for all {len(tests)} tests"
            f" (Holm), the probability that {_TESTED} is found ahead or behind by chance is below"
            f" {paired_statistics.SIGNIFICANT:g}. Fewer than"
            f" {paired_statistics.least_pairs(len(tests))} common seeds cannot show a difference.",
            overview_table(tests),
            results_table(rows),
            Heading("Clean grasps"),
            Picture(plot_clean_shares(rows), "Shares with exact 95 % intervals."),
            *figures,
        ]
        for key in _present(rows["condition"], CONDITIONS):
            own = rows[rows["condition"] == key]
            parts += [
                Heading(f"Condition: {CONDITIONS[key].label}"),
                f"{CONDITIONS[key].scenario.scenario.description.capitalize()}.",
                outcome_table(own),
                reason_table(own),
                paired_test_table(tests[tests["condition"] == key]),
            ]
    methods = [{"method": method.label, "contacts": method.text} for method in METHODS.values()]
    parts += [Heading("Methods"), Table(pd.DataFrame(methods)), Heading("Limits"), _LIMITS]
    parts += [Details("Settings", json.dumps(settings, indent=1))]
    return write_report(folder, _TITLE, parts)


def overview_table(tests: pd.DataFrame) -> Table:
    """Returns a table of verdicts for each condition and baseline, with the closing times."""
    cells: dict[str, dict[str, str]] = {}
    for (condition, method), group in tests.groupby(["condition", "method"], sort=False):
        words = [
            f"{verdict} at {', '.join(f'{time:g}' for time in shown['close_at'])} s"
            for verdict, shown in group[group["verdict"] != ""].groupby("verdict")
        ]
        open_words = f"not shown (least p {_p(group['p_holm'].min())})"
        cells.setdefault(_LABELS[method], {})[condition] = "; ".join(words) or open_words
    table = pd.DataFrame(cells, index=_present(tests["condition"], CONDITIONS))
    table.index = [CONDITIONS[key].label for key in table.index]
    return _styled(
        table.reset_index(names=f"{_TESTED} against"),
        f"Closing times at which {_TESTED} is shown to be clean more often (ahead) or less often"
        " (behind) than another method, by exact McNemar tests with Holm's correction.",
    )


def results_table(rows: pd.DataFrame) -> Table:
    """Returns counts of clean grasps, with a row per closing time and a column per method."""
    times = ["condition", "close_at"]
    rows = rows.assign(lifted=rows["lifted"] & ~rows["clean"])
    cells = rows.groupby([*times, "method"])[["clean", "lifted"]].sum()
    counts = cells["clean"].astype(str) + cells["lifted"].map(lambda n: f" (+{n})" if n else "")
    table = counts.unstack("method")[_present(rows["method"], METHODS)].rename(columns=_LABELS)
    table.insert(0, "seeds", rows.groupby(times)["seed"].nunique())
    table = table.loc[_present(rows["condition"], CONDITIONS)].reset_index()
    table["condition"] = table["condition"].map(lambda key: CONDITIONS[key].label)
    return Table(
        table.rename(columns={"close_at": "closes at [s]"}),
        "Numbers of clean grasps; in brackets, objects that were lifted but not by a clean grasp.",
    )


def outcome_table(rows: pd.DataFrame) -> Table:
    """Returns counts and medians of a condition, with a row per method and closing time."""
    links = rows.filter(regex="^link_on_") >= TOUCHING_N
    rows = rows.assign(**{"links touched": links.any(axis="columns")})
    cells = rows.groupby(["method", "close_at"])
    seeds, table = cells.size(), pd.DataFrame(index=cells.size().index)
    for success in ("clean", "lifted", "links touched"):
        count = cells[success].sum()
        bounds = (100 * paired_statistics.share_interval(count, seeds)).round().astype(int)
        lines = zip(count, seeds, bounds["low"], bounds["high"], strict=True)
        table[success] = [f"{n} of {of} ({low}–{high} %)" for n, of, low, high in lines]
    medians = cells[_MEASURES].median().dropna(axis="columns", how="all")
    table = table.join(medians.map(lambda value: None if np.isnan(value) else f"{value:.3g}"))
    return Table(_labelled(table), "Counts of seeds with exact 95 % intervals, and medians.")


def reason_table(rows: pd.DataFrame) -> Table:
    """Returns counts of the reasons for giving up, without finger numbers and forces."""
    details = {r"^finger \d+": "a finger", r": [\d.]+ N are left": ""}
    why = rows["gave_up"].replace(details, regex=True)
    reasons = pd.DataFrame({"method": rows["method"], "reason": why})[why != ""]
    table = reasons.value_counts().rename("grasps").reset_index().set_index("method")
    return Table(_labelled(table), "Reasons for which hands gave up.")


def paired_test_table(tests: pd.DataFrame) -> Table:
    """Returns the paired tests of a condition, with a row per baseline and closing time."""
    table = tests.set_index(["method", "close_at"])
    columns = {
        "common seeds": table["pairs"],
        "only it clean": table["gained"],
        "only the other clean": table["lost"],
        "p": table["p"].map(_p),
        "p (Holm)": table["p_holm"].map(_p),
        # Rounded outward, so that the interval keeps its coverage probability.
        "difference, least": (np.floor(1000 * table["low"]) / 10).map("{:+.1f} %".format),
        "most": (np.ceil(1000 * table["high"]) / 10).map("{:+.1f} %".format),
        f"{_TESTED} is": table["verdict"],
    }
    return _styled(
        _labelled(pd.DataFrame(columns, index=table.index)),
        f"{_TESTED.capitalize()} against each other method by common seeds: exact McNemar tests,"
        " and conservative 95 % intervals of the difference of clean shares.",
    )


def plot_clean_shares(rows: pd.DataFrame) -> Figure:
    """Returns a figure of each method's share of clean grasps, with one panel per condition."""
    conditions, methods = _present(rows["condition"], CONDITIONS), _present(rows["method"], METHODS)
    columns = min(4, len(conditions))
    lines = -(-len(conditions) // columns)
    figure = Figure((1.2 + 3.5 * columns, 0.9 + 2.9 * lines), layout="constrained")
    panels = figure.subplots(lines, columns, sharey=True, squeeze=False).ravel()
    for panel in panels[len(conditions) :]:
        panel.set_visible(False)
    for panel, condition in zip(panels, conditions, strict=False):
        own = rows[rows["condition"] == condition]
        times = sorted(own["close_at"].unique())
        for place, key in enumerate(methods):
            cells = own[own["method"] == key].groupby("close_at")["clean"]
            share = 100 * cells.mean()
            bounds = 100 * paired_statistics.share_interval(cells.sum(), cells.size())
            ends = np.abs([share - bounds["low"], bounds["high"] - share])
            shift = 0.78 * ((place + 0.5) / len(methods) - 0.5)
            at = [times.index(time) + shift for time in share.index]
            style = {"fmt": METHODS[key].marker, "color": METHODS[key].color}
            panel.errorbar(at, share, yerr=ends, label=_LABELS[key], **style)
        panel.set(title=CONDITIONS[condition].label, ylim=(-4, 104), ylabel="clean grasps [%]")
        panel.set_xticks(range(len(times)), [f"{time:g} s" for time in times])
        panel.grid(axis="y", color="0.88")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(methods), frameon=False)
    return figure


def _present(values: pd.Series, known: Mapping[str, Any]) -> list[str]:
    return [key for key in known if key in set(values)]


def _labelled(table: pd.DataFrame) -> pd.DataFrame:
    """Returns a table in the order of `METHODS`, with labels of methods and closing times."""
    table = table.loc[_present(table.index.get_level_values("method"), METHODS)].reset_index()
    table["method"] = table["method"].map(_LABELS)
    if "close_at" in table:
        table["close_at"] = table["close_at"].map("{:g} s".format)
    return table.rename(columns={"close_at": "closes at"})


def _styled(table: pd.DataFrame, caption: str) -> Table:
    """Returns a table whose verdicts have the CSS classes of the report's style."""
    classes = table.map(lambda cell: _CLASSES.get(str(cell).partition(" at ")[0], ""))
    return Table(table.style.set_td_classes(classes), caption)


def _p(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"{p:.2g}"
