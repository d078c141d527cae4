"""The figure of the study: shares of clean grasps, a panel for each condition."""

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.results import Results
from drake_pregrasp.studies.static_versus_dynamic.share_interval import share_interval

_COLUMNS = 4
_PADDING = 0.1  # Inches above and below each panel.
_WIDTH = 0.78  # Of the arms of one closing time, side by side; the next time's are 1 further on.


def plot_clean_shares(path: Path, results: Results) -> None:
    """Plots the share of clean grasps of each arm over closing times, with exact intervals."""
    conditions = results.conditions
    columns = min(_COLUMNS, len(conditions))
    rows = math.ceil(len(conditions) / columns)
    figure = Figure(figsize=(1.2 + 3.5 * columns, 0.9 + 2.9 * rows))
    figure.set_layout_engine("constrained", h_pad=_PADDING)
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False).ravel()
    arms = [arm for arm in ARMS if any(arm in results.arms(c) for c in conditions)]
    for panel, condition in zip(panels, conditions, strict=False):
        _plot_condition(panel, results, condition, arms)
    for panel in panels[len(conditions) :]:
        panel.set_visible(False)
    for first in panels[::columns]:
        first.set_ylabel("clean grasps [%]")
    for index, panel in enumerate(panels[: len(conditions)]):
        if index + columns >= len(conditions):  # Nothing is below it.
            panel.set_xlabel("the hand closes at [s]")
    figure.legend(
        handles=[_handle(arm) for arm in arms],
        loc="outside lower center",
        ncols=min(len(arms), 2 * columns),
        frameon=False,
    )
    figure.savefig(path, dpi=130)


def _plot_condition(panel: Axes, results: Results, condition: str, arms: list[str]) -> None:
    times = results.times(condition)
    offsets = dict(zip(arms, _WIDTH * (np.arange(len(arms)) + 0.5) / len(arms), strict=True))
    for arm in results.arms(condition):
        x, shares, lows, highs = [], [], [], []
        for place, time in enumerate(times):
            count, of = results.count(condition, arm, time), len(results.cell(condition, arm, time))
            if of == 0:
                continue
            interval = share_interval(count, of)
            x.append(place - _WIDTH / 2 + offsets[arm])
            shares.append(100 * count / of)
            lows.append(shares[-1] - 100 * interval.low)
            highs.append(100 * interval.high - shares[-1])
        panel.errorbar(
            x,
            shares,
            yerr=np.clip([lows, highs], 0, None),
            fmt=ARMS[arm].marker,
            color=ARMS[arm].color,
            markersize=5,
            elinewidth=1.3,
            zorder=3,
        )
    for place in range(0, len(times), 2):
        panel.axvspan(place - 0.5, place + 0.5, color="0.955", zorder=0, linewidth=0)
    panel.set_title(CONDITIONS[condition].label, fontsize=11)
    panel.set_xticks(range(len(times)), [f"{time:g}" for time in times])
    panel.set_xlim(-0.5, len(times) - 0.5)
    panel.set_ylim(-4, 104)
    panel.grid(visible=True, axis="y", color="0.88", linewidth=0.6)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)


def _handle(arm: str) -> Line2D:
    label, _, color, marker = ARMS[arm]
    return Line2D([], [], color=color, marker=marker, linestyle="", markersize=6, label=label)
