"""The plot of the benchmark."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from drake_pregrasp.studies.bench_runs import TickTimes

# Colours of Okabe and Ito's colour-blind-safe set, with markers that differ as well.
_STYLES = {
    "direct": ("#000000", "x", ":"),
    "BLAS": ("#E69F00", "v", "--"),
    "numpy": ("#0072B2", "s", "-"),
    "numba": ("#009E73", "o", "-"),
}


def plot_bench(path: Path, ticks: Sequence[TickTimes]) -> None:
    """Plots tick times over the number of candidates, a panel for each strategy."""
    strategies = list(dict.fromkeys(row.strategy for row in ticks))
    figure = Figure(figsize=(3.4 * len(strategies), 3.9), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(strategies), sharey=True, squeeze=False)[0]
    for axis, strategy in zip(panels, strategies, strict=True):
        for way, (color, marker, line) in _STYLES.items():
            rows = [row for row in ticks if (row.strategy, row.way) == (strategy, way)]
            if rows:
                sizes = [row.size for row in rows]
                p50, p99 = ([1e3 * getattr(row, name) for row in rows] for name in ("p50", "p99"))
                axis.plot(sizes, p50, color=color, marker=marker, linestyle=line, label=way)
                axis.fill_between(sizes, p50, p99, color=color, alpha=0.12, linewidth=0)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_title(strategy)
        axis.set_xlabel("candidate points N")
        axis.grid(True, which="major", color="0.9", linewidth=0.6)
        axis.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("planning tick [ms]\nmedian, shaded up to 99 %")
    panels[0].legend(frameon=False, loc="upper left", fontsize=9)
    figure.savefig(path, dpi=140)
