"""The figures of a sweep's report: measures against one axis, with another one as the colour."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.studies.sweep.measures import MEASURES
from drake_pregrasp.studies.sweep.results import Group, SweepResults

MOST_COLORS = 7
"""Axes of more values than that are not shown by colours."""

_COLUMNS = 3
# Okabe and Ito's colour-blind-safe set, without its yellow, which is pale on white.
_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_LOG_RATIO = 20.0
_LIGHTEST = 0.82  # Of viridis: what is lighter is pale on white.
_WIDTH = 0.6  # Of the colours of one value, side by side; the next value's are 1 further on.
_PLAIN = (-2, 4)  # Powers of ten between which an axis' numbers are written out.
_MOST_TICKS = 6
_LEAST_SPAN = 2e-3  # Of a panel, as a share of its largest value: less is no difference to show.
_UNITS = {
    "m": ("position_std", "position_spread", "size", "spacing", "radius", "clearance", "standoff"),
    "rad": ("orientation_std", "direction"),
    "s": ("period", "time_step", "static_duration", "simulation_duration", "lookahead"),
    "m/s": ("linear_velocity", "speed", "initial_velocity_std"),
    "rad/s": ("angular_velocity", "spin", "initial_angular_velocity_std"),
    "m/s²/√Hz": ("acceleration",),
    "rad/s²/√Hz": ("angular_acceleration",),
}


def axis_label(name: str) -> str:
    """Returns what figures call an axis, with the unit of its field where that is known."""
    field = name.rpartition(".")[2].partition("[")[0]
    unit = next((unit for unit, fields in _UNITS.items() if field in fields), "")
    # The names of several fields that change together bring their own.
    return f"{name} [{unit}]" if unit and " [" not in name else name


def plot_axis(
    path: Path, results: SweepResults, axis: str, measures: Sequence[str], color_axis: str | None
) -> None:
    """Plots measures against an axis, a panel each: medians and quartiles over other runs.

    Args:
        path: Of the PNG.
        results: All there are.
        axis: What is below.
        measures: The panels, by the names of measures.
        color_axis: What colours show, if anything.
    """
    columns = min(_COLUMNS, len(measures))
    rows = math.ceil(len(measures) / columns)
    figure = Figure(figsize=(4.4 * columns, 0.6 + 3.1 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    everything = np.arange(len(next(iter(results.values.values()))))
    parts = [Group("", "", everything)] if color_axis is None else results.groups(color_axis)
    colors = _colors(results, color_axis, len(parts))
    for panel, measure in zip(panels, measures, strict=False):
        for place, part in enumerate(parts):
            style: dict[str, Any] = {
                "color": colors[place],
                "marker": _MARKERS[place],
                "label": _plain(part.label),
            }
            if results.is_continuous(axis):
                x = results.numbers(axis)[part.places]
                y = results.values[measure][part.places]
                panel.plot(x, y, linestyle="", markersize=3.5, alpha=0.7, **style)
            else:
                offset = _WIDTH * ((place + 0.5) / len(parts) - 0.5)
                _plot_groups(panel, results, axis, measure, part.places, offset, style)
        _finish(panel, results, axis, measure)
    for panel in panels[len(measures) :]:
        panel.set_visible(False)
    if color_axis is not None:
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(
            handles,
            labels,
            title=_plain(axis_label(color_axis)),
            loc="outside lower center",
            ncols=len(parts),
            frameon=False,
        )
    figure.savefig(path, dpi=130)


def _plot_groups(
    panel: Axes,
    results: SweepResults,
    axis: str,
    measure: str,
    places: IntArray,
    offset: float,
    style: dict[str, Any],
) -> None:
    groups = results.groups(axis)
    spreads = [results.spread(measure, np.intersect1d(group.places, places)) for group in groups]
    medians = np.array([s.median for s in spreads])
    # The extremes of many runs say little of them, and would leave the panel to a few.
    low = np.array([s.first_quartile for s in spreads])
    high = np.array([s.third_quartile for s in spreads])
    if results.is_numeric(axis):
        x = np.array([float(group.value) for group in groups])
        panel.fill_between(x, low, high, color=style["color"], alpha=0.13, linewidth=0)
        panel.plot(x, medians, linewidth=1.4, markersize=4.5, **style)
        return
    panel.errorbar(
        np.arange(len(groups)) + offset,
        medians,
        yerr=[medians - low, high - medians],
        linestyle="",
        markersize=5,
        elinewidth=1.2,
        **style,
    )


def _finish(panel: Axes, results: SweepResults, axis: str, measure: str) -> None:
    panel.set_xlabel(_plain(axis_label(axis)))
    panel.set_ylabel(_plain(MEASURES[measure].label), fontsize=9)
    if results.is_numeric(axis):
        panel.ticklabel_format(axis="x", scilimits=_PLAIN)
        panel.locator_params(axis="x", nbins=_MOST_TICKS)
        _scale(panel, results.numbers(axis))
    else:
        groups = results.groups(axis)
        panel.set_xticks(range(len(groups)), [_plain(g.label) for g in groups], rotation=20)
    if _wide(results.values[measure]):
        panel.set_yscale("log")
        _write_out(panel.yaxis)
    else:
        panel.ticklabel_format(axis="y", useOffset=False)
        low, high = panel.get_ylim()
        lacking = _LEAST_SPAN * max(abs(low), abs(high)) - (high - low)
        if lacking > 0:  # What is nearly always the same looks so.
            panel.set_ylim(low - lacking / 2, high + lacking / 2)
    panel.grid(visible=True, color="0.9", linewidth=0.6)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)


def _scale(panel: Axes, numbers: FloatArray) -> None:
    """Makes an axis of magnitudes logarithmic, but for what is below the least that is not zero."""
    above = numbers[numbers > 0]
    if _wide(above) and not np.any(numbers < 0):
        if len(above) == len(numbers):
            panel.set_xscale("log")
        else:
            panel.set_xscale("symlog", linthresh=above.min())
        _write_out(panel.xaxis)


def _write_out(scale: Axis) -> None:
    """Writes a logarithmic axis' numbers without powers of ten."""
    scale.set_major_formatter(lambda value, place: f"{value:g}")
    scale.set_minor_formatter(LogFormatter(labelOnlyBase=False))


def _wide(values: FloatArray) -> bool:
    values = values[np.isfinite(values)]
    return bool(len(values) and values.min() > 0 and values.max() > _LOG_RATIO * values.min())


def _colors(results: SweepResults, axis: str | None, count: int) -> list[str]:
    if axis is None or not results.is_numeric(axis):
        return list(_COLORS[:count])
    scale = matplotlib.colormaps["viridis"]
    shades = np.linspace(0, _LIGHTEST, count)
    return [matplotlib.colors.to_hex(scale(shade)) for shade in shades]


def _plain(text: str) -> str:
    """Returns a text that matplotlib doesn't take for a formula."""
    return text.replace("$", r"\$")
