"""The paper's Figures 2c, 4 and 6, from runs."""

import textwrap
from collections.abc import Mapping

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.centroids import select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import make_strategy
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.regions.safe_regions import compute_safe_regions
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.studies.case_runs import CaseLog

# Okabe and Ito's colour-blind-safe set.
_BLUE, _ORANGE, _GREEN, _PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
_STRATEGY_COLORS = {"gii": _BLUE, "msv": _PURPLE, "vew": _GREEN, "position": "#E69F00"}
# Dashes show lines that run on top of each other.
_STRATEGY_LINES = {"gii": "-", "msv": (0, (4, 3)), "vew": "-", "position": (0, (4, 3))}
_STRATEGY_TITLES = {
    "position": "position tracking (Eq. 3)",
    "msv": "$b^{MSV}$ (Eq. 5)",
    "gii": "$b^{GII}$ (Eq. 6)",
    "vew": "$b^{VEW}$ (Eq. 7)",
}


def figure_2c(scenario: Scenario, contact: int) -> Figure:
    """Weight maps of the four strategies on one safe region, with the goals they lead to.

    The side faces are unrolled: along the horizontal axis one walks once around the object.

    Args:
        scenario: Object, surface and initial contacts.
        contact: Whose region is shown.
    """
    surface = scenario.make_surface(0.0025)
    p_OC = scenario.initial_p_OC(surface)
    regions = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(len(p_OC)), surface.forbidden)
    covariance = scenario.planner.position_spread**2 * np.eye(3)
    selection = SelectionInput(surface, p_OC, regions, covariance)
    q = regions.members(contact)
    strip = unrolled(surface, surface.p_OQ, surface.nhat_OQ)
    figure = Figure(figsize=(9, 6.2), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    for axis, (name, title) in zip(axes.flat, _STRATEGY_TITLES.items(), strict=True):
        strategy = make_strategy(name)
        b = np.exp(strategy(selection)[q])
        goal, normal = surface.project(select_contacts(selection, strategy).p_OC[[contact]])
        weight = np.full(len(strip), np.nan)
        weight[q] = b / b.max()
        shades = axis.pcolormesh(*_as_grid(strip, weight), cmap="cividis", vmin=0)
        axis.set_facecolor("0.93")
        here = surface.project(p_OC[[contact]])
        axis.plot(*unrolled(surface, *here).T, "wx", markersize=9, markeredgewidth=2)
        axis.plot(*unrolled(surface, goal, normal).T, "o", color="black", markersize=8)
        axis.set_title(title)
        low, high = strip[q].min(axis=0), strip[q].max(axis=0)
        axis.set_xlim(low[0] - 12, high[0] + 12)
        axis.set_aspect("equal")
    for axis in axes[1]:
        axis.set_xlabel("way around the object [mm]")
    for axis in axes[:, 0]:
        axis.set_ylabel("height over the centre [mm]")
    figure.colorbar(shades, ax=axes, label="weight $b_n$, largest = 1", shrink=0.8)
    figure.suptitle("One safe region: its contact (cross), and where each strategy moves it (dot)")
    return figure


def _as_grid(strip: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns the coordinates of an unrolled grid's columns and rows, and the values on it."""
    way, column = np.unique(np.round(strip[:, 0], 6), return_inverse=True)
    height, row = np.unique(np.round(strip[:, 1], 6), return_inverse=True)
    grid = np.full((len(height), len(way)), np.nan)
    grid[row, column] = values
    return way, height, grid


def unrolled(surface: ObjectSurface, p_OQ: FloatArray, nhat_OQ: FloatArray) -> FloatArray:
    """Returns points on a box's side faces as (way around, height) in mm, shape (k, 2)."""
    x, y, _ = surface.mesh.extents
    # Counterclockwise from the middle of the face -x: face -y, +x, +y, and -x again.
    starts = {(0, -1): x / 2, (1, 0): x + y / 2, (0, 1): 3 * x / 2 + y, (-1, 0): 2 * x + 3 * y / 2}
    way = np.empty(len(p_OQ))
    for k, (p, n) in enumerate(zip(p_OQ, np.round(nhat_OQ).astype(int), strict=True)):
        way[k] = starts[(n[0], n[1])] + (-n[1] * p[0] + n[0] * p[1])
    return 1e3 * np.stack([way, p_OQ[:, 2]], axis=1)


def figure_4(logs: Mapping[str, CaseLog]) -> Figure:
    """The measures of each case over time, as shares of their values for contacts at the centre."""
    rows = -(-len(logs) // 2)
    figure = Figure(figsize=(10, 2.1 * rows + 0.8), layout="constrained")
    axes = figure.subplots(rows, 2, sharex=True, sharey=True, squeeze=False)
    for axis, (case, log) in zip(axes.flat, logs.items(), strict=False):
        count = sum(log.columns[f"c{i}_active"] for i in range(log.scenario.num_contacts))
        for name, label, color, scale in (
            ("q_msv", r"$Q_{MSV}/\sqrt{n}$", "black", np.sqrt(count)),
            ("q_gii", r"$Q_{GII}$", _BLUE, 1.0),
            ("q_vew", r"$Q_{VEW}/n^3$", _ORANGE, count**3.0),
        ):
            axis.plot(log.time, log.columns[name] / scale, color=color, linewidth=1, label=label)
        held = log.scenario.planner.static_duration
        axis.axvspan(0, held, color="0.9", label="static phase")
        for event in log.scenario.damage:
            axis.axvline(event.at, color=_PURPLE, linestyle=":", label="fingers lost")
        title = textwrap.shorten(f"{case}) {log.scenario.description}", 62, placeholder=" ...")
        axis.set_title(title, fontsize=10, loc="left")
        axis.grid(True, color="0.9", linewidth=0.5)
        axis.set_xlim(0, log.time[-1])
        axis.spines[["top", "right"]].set_visible(False)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    for axis in axes.flat[len(logs) :]:
        axis.set_visible(False)
    entries: dict[str, Artist] = {}
    for axis in axes.flat:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    figure.legend(list(entries.values()), list(entries), loc="outside upper center", ncols=5)
    return figure


def figure_6(logs: Mapping[str, CaseLog]) -> Figure:
    """Displacement and energy of the goals over time.

    Args:
        logs: For each strategy, one run.
    """
    figure = Figure(figsize=(9, 6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for name, log in logs.items():
        moving = slice(1, None)
        for axis, values in (
            (upper, 1e3 * log.columns["displacement"]),
            (lower, log.columns["energy"]),
        ):
            axis.plot(
                log.time[moving],
                values[moving],
                color=_STRATEGY_COLORS[name],
                linestyle=_STRATEGY_LINES[name],
                linewidth=1.2,
                label=name if name == "position" else name.upper(),
            )
        held = log.scenario.planner.static_duration
    for axis in (upper, lower):
        axis.axvspan(0, held, color="0.92", label="static phase")
        axis.set_yscale("log")
        axis.set_xlim(0, log.time[-1])
        axis.grid(True, color="0.9", linewidth=0.5)
        axis.spines[["top", "right"]].set_visible(False)
    upper.set_ylabel("displacement [mm per tick]")
    lower.set_ylabel("energy [J/kg]")
    lower.set_xlabel("time [s]")
    figure.legend(*upper.get_legend_handles_labels(), loc="outside upper center", ncols=5)
    return figure
