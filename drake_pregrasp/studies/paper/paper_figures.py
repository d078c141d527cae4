"""The paper's Figures 2c, 4, 5 and 6, made from runs."""

from collections.abc import Mapping

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.centroids import select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import make_strategy
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.regions.safe_regions import NO_REGION, compute_safe_regions
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.scenario_file import load_scenario
from drake_pregrasp.studies.gallery.pictures import ByteArray, render_goals
from drake_pregrasp.studies.paper.paper_cases import SCENARIOS, CaseLog

# Okabe and Ito's colour-blind-safe set. Dashes keep overlapping lines visible.
_BLUE, _ORANGE, _GREEN, _PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
_STRATEGY_LINES = {
    "gii": (_BLUE, "-"),
    "msv": (_PURPLE, (0, (4, 3))),
    "vew": (_GREEN, "-"),
    "position": ("#E69F00", (0, (4, 3))),
}
_STRATEGY_TITLES = {
    "position": "position tracking",
    "msv": "$b^{MSV}$",
    "gii": "$b^{GII}$",
    "vew": "$b^{VEW}$",
}


def figure_2c(resolved: ResolvedScenario, contact: int) -> Figure:
    """Returns Figure 2c: weight maps of the four strategies on one region, with their goals.

    The side faces are unrolled: the horizontal axis goes once around the object.

    Args:
        resolved: Object, surface and initial contacts.
        contact: Index of the contact whose region is shown.
    """
    surface, p_OC = resolved.sampled_surface(0.0025), resolved.start.p_OC
    regions = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(len(p_OC)), surface.forbidden)
    covariance = resolved.planner.position_spread**2 * np.eye(3)
    selection = SelectionInput(surface, p_OC, regions, covariance)
    q = regions.members(contact)
    strip = unrolled(surface, surface.p_OQ[q], surface.nhat_OQ[q])
    figure = Figure(figsize=(9, 6.2), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    for axis, (name, title) in zip(axes.flat, _STRATEGY_TITLES.items(), strict=True):
        strategy = make_strategy(name)
        b = np.exp(strategy(selection, contact))
        goal = select_contacts(selection, strategy).p_OC[[contact]]
        shades = axis.pcolormesh(*_as_grid(strip, b / b.max()), cmap="cividis", vmin=0)
        axis.set_facecolor("0.93")
        for p_OP, style in ((p_OC[[contact]], "wx"), (goal, "ko")):
            axis.plot(*unrolled(surface, *surface.project(p_OP)).T, style, markersize=8, mew=2)
        axis.set_title(title)
        axis.use_sticky_edges = False
        axis.margins(0.15)
        axis.set_aspect("equal")
        axis.set(xlabel="distance around the object [mm]", ylabel="height over the centre [mm]")
        axis.label_outer()
    figure.colorbar(shades, ax=axes, label="weight $b_n$, largest = 1", shrink=0.8)
    figure.suptitle("One safe region: its contact (cross), and where each strategy moves it (dot)")
    return figure


def _as_grid(strip: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns the coordinates of an unrolled grid's columns and rows, and the grid's values."""
    along, column = np.unique(np.round(strip[:, 0], 6), return_inverse=True)
    height, row = np.unique(np.round(strip[:, 1], 6), return_inverse=True)
    grid = np.full((len(height), len(along)), np.nan)
    grid[row, column] = values
    return along, height, grid


def unrolled(surface: ObjectSurface, p_OQ: FloatArray, nhat_OQ: FloatArray) -> FloatArray:
    """Returns (distance around, height) of points on a box's side faces, shape (k, 2), in mm.

    Args:
        surface: Surface of the box.
        p_OQ: Points on the side faces, in O, shape (k, 3), in metres.
        nhat_OQ: Outward unit normals at the points, in O, shape (k, 3).
    """
    x, y, _ = surface.mesh.extents
    # Counterclockwise from the middle of the face -x: face -y, +x, +y, and -x again.
    starts = {(0, -1): x / 2, (1, 0): x + y / 2, (0, 1): 3 * x / 2 + y, (-1, 0): 2 * x + 3 * y / 2}
    n = np.round(nhat_OQ).astype(int)
    start = np.array([starts[nx, ny] for nx, ny, _ in n.tolist()])
    around = start - n[:, 1] * p_OQ[:, 0] + n[:, 0] * p_OQ[:, 1]
    return 1e3 * np.stack([around, p_OQ[:, 2]], axis=1)


def figure_4(logs: Mapping[str, CaseLog]) -> Figure:
    """Returns Figure 4: measures over time, divided by those of contacts at the centre of mass.

    Args:
        logs: Log of one run of each case, by the case.
    """
    rows = -(-len(logs) // 2)
    figure = Figure(figsize=(10, 2.1 * rows + 0.8), layout="constrained")
    axes = figure.subplots(rows, 2, sharex=True, sharey=True, squeeze=False)
    for axis, (case, log) in zip(axes.flat, logs.items(), strict=False):
        n = log.table[[f"c{i}_active" for i in range(log.resolved.num_contacts)]].sum(axis=1)
        for name, label, color, scale in (
            ("q_msv", r"$Q_{MSV}/\sqrt{n}$", "black", n**0.5),
            ("q_gii", r"$Q_{GII}$", _BLUE, 1.0),
            ("q_vew", r"$Q_{VEW}/n^3$", _ORANGE, n**3.0),
        ):
            values = log.table[name] / scale
            axis.plot(log.table["time"], values, color=color, linewidth=1, label=label)
        for event in log.scenario.damage:
            axis.axvline(event.at, color=_PURPLE, linestyle=":", label="fingers lost")
        description = load_scenario(SCENARIOS[case]).description
        axis.set_title(f"{case}) {description}", fontsize=10, loc="left")
        _style(axis, log)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    for axis in axes[:, 0]:
        axis.set_ylabel("relative measure")
    for axis in axes.flat[len(logs) :]:
        axis.set_visible(False)
    _add_legend(figure)
    return figure


def figure_5(a: CaseLog, f: CaseLog, j: CaseLog) -> Figure:
    """Returns Figure 5: pictures of regions and goals from two sides.

    Args:
        a: Log of a run of case a, whose first and last ticks are shown.
        f: Log of a run of case f, whose last tick is shown.
        j: Log of a run of case j, whose last tick is shown.
    """
    figure = Figure(figsize=(12, 6.2), layout="constrained")
    columns = (
        ("i) static contacts", a, 0),
        ("ii) position tracking", a, -1),
        ("iii) after the damage", f, -1),
        ("iv) VEW", j, -1),
    )
    for pair, (title, log, tick) in zip(figure.subplots(2, 4).T, columns, strict=True):
        pair[0].set_title(title)
        for axis, yaw in zip(pair, (0.9, 0.9 + np.pi), strict=True):
            axis.imshow(_picture(log, tick, yaw))
            axis.set_axis_off()
    return figure


def _picture(log: CaseLog, tick: int, yaw: float) -> ByteArray:
    surface, p_OC, contacts = log.resolved.surface, log.p_OC(tick), log.active(tick)
    regions = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(len(p_OC)), surface.forbidden)
    # Labels of regions index the active contacts, those of the picture all contacts.
    labels = np.append(contacts, NO_REGION)[regions.labels]
    return render_goals(surface, labels, p_OC, contacts, yaw=yaw)


def figure_6(logs: Mapping[str, CaseLog]) -> Figure:
    """Returns Figure 6: displacement and energy of the goals over time.

    Args:
        logs: Log of one run of each strategy, by the strategy.
    """
    figure = Figure(figsize=(9, 6), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    columns = (
        ("displacement", 1e3, "displacement, sum [mm per tick]"),
        ("energy", 1, "energy, sum [J/kg]"),
    )
    for axis, (column, scale, label) in zip(axes, columns, strict=True):
        for name, log in logs.items():
            color, style = _STRATEGY_LINES[name]
            title = name if name == "position" else name.upper()
            moving = log.table[1:]
            values = scale * moving[column]
            axis.plot(moving["time"], values, color=color, linestyle=style, label=title)
        _style(axis, log)
        axis.set(yscale="log", ylabel=label)
    axes[1].set_xlabel("time [s]")
    _add_legend(figure)
    return figure


def _style(axis: Axes, log: CaseLog) -> None:
    axis.axvspan(0, log.scenario.planner.static_duration, color="0.9", label="static phase")
    axis.set_xlim(0, log.table["time"].iloc[-1])
    axis.grid(True, color="0.9", linewidth=0.5)
    axis.spines[["top", "right"]].set_visible(False)


def _add_legend(figure: Figure) -> None:
    entries: dict[str, Artist] = {}
    for axis in figure.axes:
        handles, labels = axis.get_legend_handles_labels()
        entries = dict(zip(labels, handles, strict=True)) | entries
    figure.legend(entries.values(), entries, loc="outside upper center", ncols=5)
