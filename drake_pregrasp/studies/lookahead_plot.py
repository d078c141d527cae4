"""The plot of the look-ahead study."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from drake_pregrasp.arrays import FloatArray

# Colours of Okabe and Ito's colour-blind-safe set, with markers that differ as well.
_STYLES = (
    ("#000000", "o", "-"),
    ("#009E73", "s", "-"),
    ("#E69F00", "v", "--"),
    ("#0072B2", "^", "--"),
)

Curves = Mapping[str, Mapping[str, FloatArray]]
"""For each object and each look-ahead, by their names, rows of delay, median and 95th percentile,
in seconds and metres."""


def plot_lookahead(path: Path, curves: Curves) -> None:
    """Plots goal errors over the hand's delay, a panel for each object."""
    figure = Figure(figsize=(4.6 * len(curves), 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    panels = np.atleast_1d(figure.subplots(1, len(curves), sharey=True))
    for axis, (name, lines) in zip(panels, curves.items(), strict=True):
        for (label, rows), (color, marker, line) in zip(lines.items(), _STYLES, strict=True):
            delay, median, p95 = 1e3 * np.array(rows).T
            axis.plot(delay, median, color=color, marker=marker, linestyle=line, label=label)
            axis.fill_between(delay, median, p95, color=color, alpha=0.12, linewidth=0)
        axis.set_yscale("log")
        axis.set_title(name)
        axis.set_xlabel("delay of the hand [ms]")
        axis.grid(True, which="both", color="0.92", linewidth=0.6)
        axis.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("goal error at contact [mm]\nmedian, shaded up to 95 %")
    panels[0].legend(frameon=False, loc="upper left", fontsize=9)
    figure.savefig(path, dpi=140)
