"""`metrics.png`: a run at a glance."""

from pathlib import Path
from typing import Any

from drake_pregrasp.errors import printable
from drake_pregrasp.simulation.run_log import RunLog
from drake_pregrasp.simulation.scenario import Scenario

# Colours of Okabe and Ito's colour-blind-safe set.
_PANELS = (
    ("q_msv", "$Q_{MSV}$", "#0072B2"),
    ("q_gii", "$Q_{GII}$", "#D55E00"),
    ("q_vew", "$Q_{VEW}$", "#009E73"),
)


def plot_metrics(path: Path, name: str, scenario: Scenario, log: RunLog, summary: Any) -> None:
    """Plots the three measures and the contacts' displacement over time."""
    # Here, because it takes a fifth of a second: not everybody runs scenarios.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(4, 1, sharex=True)
    time, displacement, *measured = log.read("time", "displacement", *(p[0] for p in _PANELS))
    for axis, (measure, label, color), values in zip(axes, _PANELS, measured, strict=False):
        axis.plot(time, values, color=color, linewidth=1.2)
        static = summary["static"][measure]
        if static is not None:
            axis.axhline(static, color="0.35", linestyle="--", linewidth=1, label="static mean")
        axis.set_ylabel(label)
        axis.ticklabel_format(axis="y", useOffset=False)
    axes[3].plot(time, 1e3 * displacement, color="#56B4E9", linewidth=1.0)
    axes[3].set_ylabel("displacement\n[mm per tick]")
    axes[3].set_xlabel("time [s]")
    for axis in axes:
        if scenario.planner.static_duration > 0:
            axis.axvspan(0, scenario.planner.static_duration, color="0.92", label="static phase")
        for index, event in enumerate(scenario.damage):
            name_once = None if index else "fingers lost"
            axis.axvline(event.at, color="#CC79A7", linestyle=":", linewidth=1.5, label=name_once)
        axis.set_xlim(0, max(time[-1], scenario.planner.period))
        axis.grid(True, color="0.9", linewidth=0.6)
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    if axes[0].get_legend_handles_labels()[1]:
        axes[0].legend(loc="lower right", frameon=False)
    figure.align_ylabels(axes)
    title = f"{name}: {scenario.description}" if scenario.description else name
    figure.suptitle(printable(title), parse_math=False)
    figure.savefig(path, dpi=130)
