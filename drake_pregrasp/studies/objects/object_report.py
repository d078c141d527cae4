"""Report of the study: shares of held objects, causes of failures, paired tests and pictures."""

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from drake_pregrasp.studies.objects import object_trial
from drake_pregrasp.studies.objects.object_sets import hand_name
from drake_pregrasp.studies.report_page import Details, Heading, Part, Picture, Table, write_report
from drake_pregrasp.studies.runner import OnProgress, run_jobs
from drake_pregrasp.studies.static_versus_dynamic import paired_statistics
from drake_pregrasp.studies.static_versus_dynamic.grasp_outcome import LIFTED_ABOVE_MM
from drake_pregrasp.studies.static_versus_dynamic.methods import METHODS, TESTED
from drake_pregrasp.studies.static_versus_dynamic.trial_pictures import Grasp, picture_grid

PICTURES = "pictures.png"
"""File with pictures of grasps."""

HELD = "held"

_TITLE = "Objects: which ones are held, and why others are not"
_CELLS = ["hand", "speed", "method"]
_LABELS = {key: method.label for key, method in METHODS.items()}
_MAP = "Success map, with objects in order of their shares of success: "
_PICTURED = 3  # Number of pictured grasps for each hand, of held objects and of failures each.
_IN_WORDS = (
    f"An object is held if it was lifted by more than {LIFTED_ABOVE_MM:g} mm and is still there"
    " after a second. Refused objects were not simulated, and count as not held."
)


def write_object_report(
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
        figures: Parts of the report with pictures of grasps.

    Raises:
        OutputError: If the report cannot be written.
    """
    parts: list[Part] = [_IN_WORDS, str(settings.get("fit", ""))]
    if len(failed):
        parts.append(Table(failed, f"{len(failed)} trials failed and are left out."))
    if len(rows):
        parts += [
            share_table(rows),
            Heading("Causes"),
            cause_table(rows),
            *(Picture(plot_map(own), _MAP + hand_name(hand)) for hand, own in rows.groupby("hand")),
            Heading("Paired tests"),
            paired_table(rows),
            *figures,
        ]
    methods = [{"method": METHODS[key].label, "contacts": METHODS[key].text} for key in METHODS]
    parts += [Heading("Methods"), Table(pd.DataFrame(methods))]
    parts += [Details("Settings", json.dumps(settings, indent=1))]
    return write_report(folder, _TITLE, parts)


def share_table(rows: pd.DataFrame) -> Table:
    """Returns counts of held objects with Wilson's intervals, and measures of their grasps."""
    cells = rows.groupby(_CELLS, sort=False)
    held, tried = cells["held"].sum(), cells.size()
    bounds = (100 * paired_statistics.share_interval(held, tried, method="wilson")).round(1)
    lines = zip(held, tried, bounds["low"], bounds["high"], strict=True)
    table = pd.DataFrame(index=held.index)
    table["held"] = [
        f"{n} of {of} = {100 * n / of:.1f} % ({low:g}–{high:g} %)" for n, of, low, high in lines
    ]
    good = rows[rows["held"]].groupby(_CELLS)
    table["slip [mm], median"] = good["slip_mm"].median()
    table["tilt [°], median"] = good["tilt_deg"].median()
    moved = rows.dropna(subset=["pushed_before_squeeze_mm"]).groupby(_CELLS)
    table["moved before the squeeze [mm], p95"] = moved["pushed_before_squeeze_mm"].quantile(0.95)
    return Table(
        _labelled(table).map(lambda v: f"{v:.2f}" if isinstance(v, float) and v == v else v),
        "Held objects with Wilson's 95 % intervals.",
    )


def cause_table(rows: pd.DataFrame) -> Table:
    """Returns counts of the causes of failures, with a row per cause."""
    why = rows.assign(cause=rows["cause"].where(~rows["held"], HELD))
    counts = why.groupby(["hand", "speed", "cause", "method"]).size().unstack("method")
    counts = counts[[key for key in METHODS if key in counts]].rename(columns=_LABELS)
    counts = counts.fillna(0).astype(int).reset_index()
    counts["hand"] = counts["hand"].map(hand_name)
    return Table(counts, "Numbers of trials by their outcome; every failure has one cause.")


def paired_table(rows: pd.DataFrame) -> Table:
    """Returns the paired tests of the tested method against each other method."""
    tests = paired_statistics.paired_tests(
        rows, keys=("hand", "speed"), pair=("object", "seed"), success="held"
    )
    table = tests.set_index(_CELLS)
    columns = {
        "pairs": table["pairs"],
        "only it holds": table["gained"],
        "only the other holds": table["lost"],
        "p (Holm)": table["p_holm"].map("{:.2g}".format),
        "difference": [
            f"{100 * low:+.1f} to {100 * high:+.1f} %"
            for low, high in zip(table["low"], table["high"], strict=True)
        ],
        f"{_LABELS[TESTED]} is": table["verdict"],
    }
    return Table(
        _labelled(pd.DataFrame(columns, index=table.index)),
        f"{_LABELS[TESTED].capitalize()} against each other method, by the same objects and start"
        " yaws: exact McNemar tests, with conservative 95 % intervals.",
    )


def plot_map(rows: pd.DataFrame) -> Figure:
    """Returns the success map of a hand: an object per column, a trial per row, coloured by cause.

    Args:
        rows: Rows of one hand.
    """
    outcome = rows["cause"].where(~rows["held"], HELD)
    causes = [HELD, *sorted(set(outcome) - {HELD})]
    codes = rows.assign(code=outcome.map(causes.index))
    grid = codes.pivot_table(index=["speed", "method", "seed"], columns="object", values="code")
    order = rows.groupby("object")["held"].mean().sort_values(ascending=False, kind="stable").index
    grid = grid[order]
    lines = [f"{speed:g} mm/s, {_LABELS[m]}, seed {seed}" for speed, m, seed in grid.index]
    not_green = np.delete(matplotlib.colormaps["tab20"](np.arange(20)), (4, 5), axis=0)
    colors = ["#009E73", *not_green[: len(causes) - 1]]
    figure = Figure((4 + 0.09 * max(40, len(order)), 1.6 + 0.22 * len(lines)), layout="constrained")
    axes = figure.subplots()
    norm = BoundaryNorm(np.arange(len(causes) + 1) - 0.5, len(causes))
    axes.imshow(grid, aspect="auto", cmap=ListedColormap(colors), norm=norm, interpolation="none")
    axes.set_yticks(range(len(lines)), lines, fontsize=7)
    if len(order) <= 60:
        axes.set_xticks(range(len(order)), order, fontsize=6, rotation=90)
    axes.set_xlabel("object")
    patches = [Patch(color=c, label=cause) for c, cause in zip(colors, causes, strict=True)]
    figure.legend(handles=patches, loc="outside lower center", ncols=5, frameon=False, fontsize=7)
    return figure


def pictures_of_grasps(
    folder: Path, rows: pd.DataFrame, processes: int | None, on_progress: OnProgress
) -> list[Part]:
    """Makes pictures of grasps with the tested method, and returns them as parts of the report.

    Of each hand, the first held objects are shown, and the first failure of each frequent cause.

    Args:
        folder: Folder of the study.
        rows: Rows of the study.
        processes: Number of local processes; the number of processors if not set.
        on_progress: Called with the number of finished pictures and the number of all.
    """
    shown: list[Grasp] = []
    if len(rows):
        rows = rows[rows["method"] == TESTED]
        rows = rows[~rows["cause"].fillna("").str.startswith(object_trial.REFUSED)]
    for _, own in rows.groupby("hand", sort=False) if len(rows) else ():
        failures = own[~own["held"]]
        usual = failures["cause"].value_counts().index[:_PICTURED]
        first = failures.drop_duplicates("cause").set_index("cause").loc[usual].reset_index()
        for row in pd.concat([own[own["held"]][:_PICTURED], first]).to_dict("records"):
            job = object_trial.ObjectJob(*(row[name] for name in object_trial.ObjectJob._fields))
            text = HELD if row["held"] else f"{row['cause']}: {row['gave_up']}"
            shown.append(Grasp(job, f"{job.object}, {hand_name(job.hand)}", text))
    if not shown:
        return []
    moments = (1.0, object_trial.base_scenario(shown[0].job.text).grasp.close_at)
    simulate = partial(run_jobs, processes=processes, on_progress=on_progress)
    picture_grid(folder / PICTURES, shown, moments, object_trial.make_trial, simulate)
    caption = (
        f"Grasps with {_LABELS[TESTED]}: for each hand the first {_PICTURED} held objects, and the"
        f" first failure of each of the {_PICTURED} most frequent causes after the start."
    )
    return [Heading("Pictures"), Picture(folder / PICTURES, caption)]


def _labelled(table: pd.DataFrame) -> pd.DataFrame:
    """Returns a table with labels of its hands and methods."""
    table = table.reset_index()
    table["hand"] = table["hand"].map(hand_name)
    table["method"] = table["method"].map(_LABELS)
    return table.rename(columns={"speed": "speed [mm/s]"})
