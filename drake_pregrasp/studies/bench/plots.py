"""The benchmark's plots, in colours of Okabe and Ito's colour-blind-safe set."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, FuncFormatter, NullFormatter

from drake_pregrasp.studies.bench.base_case import PARTS, RunTime
from drake_pregrasp.studies.bench.outcome import Outcome
from drake_pregrasp.studies.bench.tick_times import (
    BY_CONTACTS,
    BY_FORBIDDEN,
    BY_MESH_SIZE,
    TickTimes,
)
from drake_pregrasp.studies.bench.ways import AS_OBSTACLES, OF_THE_HAND

# Colour, marker and line of a way: any one of them tells it from the others.
_STYLES = {
    "direct": ("#000000", "x", ":"),
    "BLAS": ("#E69F00", "v", "--"),
    AS_OBSTACLES: ("#CC79A7", "D", "-."),
    "numpy": ("#0072B2", "s", "-"),
    "numba": ("#009E73", "o", "-"),
}

_PART_COLORS = ("#000000", "#E69F00", "#0072B2", "#009E73", "#F0E442", "#CC79A7")

_DPI = 140


def plot_ticks(path: Path, ticks: Sequence[TickTimes]) -> None:
    """Plots tick times over the number of candidates, a panel for each strategy of the hand."""
    strategies = [name for name in OF_THE_HAND if any(row.strategy == name for row in ticks)]
    figure, panels = _panels(max(1, len(strategies)))
    for axis, strategy in zip(panels, strategies, strict=False):
        _plot_ways(axis, [row for row in ticks if row.strategy == strategy], "size")
        axis.set_title(strategy)
        _label_sizes(axis)
    _finish(figure, panels, path)


def plot_growth(path: Path, outcome: Outcome) -> None:
    """Plots tick times on the mesh, over contacts and over forbidden points, for one strategy."""
    figure, panels = _panels(3)
    shown = "gii"
    for axis, series, name, title in (
        (panels[0], BY_MESH_SIZE, "size", "on a mesh"),
        (panels[1], BY_CONTACTS, "contacts", "N = {}"),
        (panels[2], BY_FORBIDDEN, "forbidden", "N = {}"),
    ):
        rows = outcome.series(series)
        own = [row for row in rows if row.strategy == shown]
        _plot_ways(axis, own, name)
        sizes = ", ".join(f"{size:,}" for size in sorted({row.size for row in own}))
        axis.set_title(f"{shown}, {title.format(sizes)}")
    _label_sizes(panels[0])
    panels[1].set_xscale("log", base=2)
    panels[1].xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panels[1].set_xlabel("contacts n")
    panels[2].set_xscale("symlog", linthresh=20)
    panels[2].set_xticks([0, 20, 200, 2000], ["0", "20", "200", "2,000"])
    panels[2].xaxis.set_minor_formatter(NullFormatter())
    panels[2].set_xlabel("forbidden points m")
    _finish(figure, panels, path)


def plot_base_case(path: Path, runs: Sequence[RunTime]) -> None:
    """Plots what parts of a simulation take, a bar for each rate and kernel, beside real time."""
    figure = Figure(figsize=(8.4, 0.8 + 0.5 * max(1, len(runs))), layout="constrained")
    FigureCanvasAgg(figure)
    axis = figure.subplots()
    labels = [f"{run.rate:,.0f} Hz, {run.implementation}" for run in runs]
    left = [0.0] * len(runs)
    for part, color in zip(PARTS, _PART_COLORS, strict=True):
        widths = [max(0.0, 100 * run.parts[part] / _whole(run)) for run in runs]
        axis.barh(labels, widths, left=left, color=color, label=part, edgecolor="white")
        left = [a + b for a, b in zip(left, widths, strict=True)]
    for place, run in enumerate(runs):
        axis.text(left[place] + 1, place, f"{1e3 * _whole(run):,.0f} ms", va="center", fontsize=9)
    axis.set_xlim(0, 115)
    axis.set_xticks(range(0, 101, 20))
    axis.invert_yaxis()
    axis.set_xlabel("share of the processor time of a simulated second [%]; its ms at the right")
    axis.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper center", ncols=3, frameon=False, fontsize=9)
    figure.savefig(path, dpi=_DPI)


def _whole(run: RunTime) -> float:
    return sum(max(0.0, run.parts[part]) for part in PARTS)


def _panels(count: int) -> tuple[Figure, Sequence[Axes]]:
    figure = Figure(figsize=(3.6 * count, 4.0), layout="constrained")
    FigureCanvasAgg(figure)
    panels: Sequence[Axes] = figure.subplots(1, count, sharey=True, squeeze=False)[0]
    for axis in panels:
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,g}"))
        axis.grid(True, which="major", color="0.9", linewidth=0.6)
        axis.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("planning tick [ms]\nmedian, shaded up to 99 %")
    return figure, panels


def _label_sizes(axis: Axes) -> None:
    axis.set_xlabel("candidates N")
    axis.set_xlim(8e2, None)
    axis.xaxis.set_major_formatter(EngFormatter(sep=""))
    axis.xaxis.set_minor_formatter(NullFormatter())


def _plot_ways(axis: Axes, rows: Sequence[TickTimes], name: str) -> None:
    for way, (color, marker, line) in _STYLES.items():
        own = [row for row in rows if row.way == way]
        if own:
            numbers = [getattr(row, name) for row in own]
            p50, p99 = ([1e3 * getattr(row, p) for row in own] for p in ("p50", "p99"))
            axis.plot(numbers, p50, color=color, marker=marker, linestyle=line, label=way)
            axis.fill_between(numbers, p50, p99, color=color, alpha=0.12, linewidth=0)


def _finish(figure: Figure, panels: Sequence[Axes], path: Path) -> None:
    """Adds a legend of everything in any panel, and writes the file."""
    handles: dict[str, Artist] = {}
    for axis in panels:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(
        list(handles.values()), list(handles), loc="outside upper center", ncols=5, frameon=False
    )
    figure.savefig(path, dpi=_DPI)
