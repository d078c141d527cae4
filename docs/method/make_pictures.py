"""Makes the pictures of docs/equations.md with the functions of the planner.

    .venv/bin/python docs/method/make_pictures.py

Needs the extra `studies`.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_rgba
from matplotlib.figure import Figure

from drake_pregrasp import ResolvedScenario, SelectionInput, compute_safe_regions, load_resolved
from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.contacts.centroids import position_tracking, select_contacts
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.regions.safe_regions import safe_region_labels
from drake_pregrasp.studies.paper.paper_figures import figure_2c, unrolled

COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9")  # Okabe and Ito's.
FORBIDDEN = "#D55E00"
SHADES = ListedColormap(["0.88", *[to_rgba(color, 0.45) for color in COLORS]])


@dataclass(frozen=True)
class Plane:
    """A flat piece of surface with contacts and forbidden points; lengths in metres."""

    c: FloatArray
    z: FloatArray
    R: FloatArray


PLANE = Plane(
    c=np.array([[-0.02, 0.012, 0], [0.024, 0.018, 0], [0.004, -0.024, 0]]),
    z=np.array([[0.0, 0.045, 0], [0.045, -0.012, 0], [-0.036, -0.024, 0]]),
    R=np.array([0.008, 0.005, 0.012]),
)


def regions_figure() -> Figure:
    """Returns the picture of Eq. 1-2 on a plane, for equal and for different weights h_i."""
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    panels = (
        (np.zeros(3), "equal weights, $h_i = 0$"),
        (np.array([0.0008, 0.0, 0.0]), "$h_1$ = 8 cm², a more capable finger"),
    )
    for axis, (h, title) in zip(figure.subplots(1, 2, sharey=True), panels, strict=True):
        draw_plane(axis, h)
        axis.set_title(title)
        axis.label_outer()
    return figure


def draw_plane(axis: Axes, h: FloatArray) -> None:
    """Draws the regions of the plane's contacts for these weights."""
    side = np.linspace(-0.055, 0.055, 441)
    grid = np.stack(np.meshgrid(side, side, [0.0], indexing="xy"), axis=-1).reshape(-1, 3)
    labels = safe_region_labels(grid, PLANE.c, h, PLANE.z, PLANE.R)
    mm = 1e3 * side
    square = labels.reshape(len(side), len(side))
    axis.pcolormesh(mm, mm, square, cmap=SHADES, vmin=-1, vmax=5, rasterized=True)
    for j, (z, R) in enumerate(zip(1e3 * PLANE.z, 1e3 * PLANE.R, strict=True), start=1):
        angle = np.linspace(0, 2 * np.pi, 100)
        axis.plot(z[0] + R * np.cos(angle), z[1] + R * np.sin(angle), color=FORBIDDEN)
        axis.plot(*z[:2], ".", color=FORBIDDEN)
        axis.annotate(f"$z_{j}$", z[:2], (-13, 2), textcoords="offset points", color=FORBIDDEN)
    for i, (c, color) in enumerate(zip(1e3 * PLANE.c, COLORS, strict=False), start=1):
        axis.plot(*c[:2], "o", color=color, markeredgecolor="black")
        axis.annotate(f"$c_{i}$", c[:2], (5, 5), textcoords="offset points")
    axis.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")


def ticks_figure(resolved: ResolvedScenario, ticks: tuple[int, ...] = (0, 1, 20)) -> Figure:
    """Returns the picture of regions and goals of some ticks, on the unrolled side faces."""
    surface, p_OC = resolved.sampled_surface(0.0025), resolved.start.p_OC
    covariance = resolved.planner.position_spread**2 * np.eye(3)
    strip = unrolled(surface, surface.p_OQ, surface.nhat_OQ)
    figure = Figure(figsize=(9, 6.4), layout="constrained")
    axes = dict(zip(ticks, figure.subplots(len(ticks), 1, sharex=True), strict=True))
    for tick in range(max(ticks) + 1):
        h = np.zeros(len(p_OC))
        regions = compute_safe_regions(surface.p_OQ, p_OC, h, surface.forbidden)
        selection = SelectionInput(surface, p_OC, regions, covariance)
        goals = select_contacts(selection, position_tracking).p_OC
        if tick in axes:
            draw_strip(axes[tick], strip, regions.labels)
            for points, style in ((p_OC, "kx"), (goals, "ko")):
                place = unrolled(surface, *surface.project(points))
                axes[tick].plot(*place.T, style, markersize=6, mew=1.5)
            q_gii = grasp_quality(goals - surface.p_OCoM).q_gii
            axes[tick].set_title(f"tick {tick}: $Q_{{GII}}$ of the goals = {q_gii:.4f}", loc="left")
        p_OC = goals
    figure.supxlabel("distance around the object [mm]")
    figure.supylabel("height over the centre [mm]")
    return figure


def draw_strip(axis: Axes, strip: FloatArray, labels: IntArray) -> None:
    """Draws the regions of the side faces, one patch a candidate."""
    axis.scatter(*strip.T, c=labels, cmap=SHADES, vmin=-1, vmax=4, marker="s", s=12, linewidths=0)
    axis.set_aspect("equal")


def main(folder: Path) -> None:
    """Writes the pictures into a folder."""
    resolved = load_resolved("a_base")
    figures = {
        "regions": regions_figure(),
        "ticks": ticks_figure(resolved),
        "weights": figure_2c(resolved, 1),
    }
    for name, figure in figures.items():
        figure.savefig(folder / f"{name}.png", dpi=100, bbox_inches="tight")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
