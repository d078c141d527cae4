"""Strip charts: what each arm does over time in one trial, and when closing would be clean."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS

_CLEAN_COLOR, _OTHER_COLOR = "#009E73", "#D55E00"
_AREA_COLOR = "#F6DDCB"
_INCHES_A_STRIP = 2.1

FARTHEST_SHOWN_MM = 60.0
"""How far inside and outside the area charts reach: what is farther is off them."""


class Strip(NamedTuple):
    """One arm's tracking, and the closings that were tried from it.

    Attributes:
        arm: Key of `ARMS`.
        time: Of the ticks, in seconds, shape (k,).
        usable: How many fingers are usable, shape (k,).
        clearance_mm: Least distance of a goal to the no-touch area, negative inside, shape (k,);
            nan where there is no goal or no area.
        closings: Closing times, in seconds, each with whether the grasp was clean.
    """

    arm: str
    time: FloatArray
    usable: FloatArray
    clearance_mm: FloatArray
    closings: Sequence[tuple[float, bool]]


def plot_strips(path: Path, strips: Sequence[Strip], *, num_fingers: int) -> None:
    """Plots a strip for each arm, one below the other, over the same time.

    Args:
        path: Of the PNG.
        strips: In the order in which they are shown.
        num_fingers: Of the hand: how many can be usable.

    Raises:
        InvalidArgumentError: If there is no strip, or one's lists are not of one length.
    """
    if not strips:
        raise InvalidArgumentError("strips: there must be one at least")
    for strip in strips:
        if not len(strip.time) == len(strip.usable) == len(strip.clearance_mm) > 0:
            raise InvalidArgumentError(
                f"strip {strip.arm}: time, usable and clearance_mm must have one length above 0,"
                f" not {len(strip.time)}, {len(strip.usable)}, {len(strip.clearance_mm)}"
            )
    figure = Figure(figsize=(10, 0.5 + _INCHES_A_STRIP * len(strips)), layout="constrained")
    FigureCanvasAgg(figure)
    ends = [s.time[-1] for s in strips] + [time for s in strips for time, _ in s.closings]
    limits = (min(s.time[0] for s in strips), max(ends))
    margin = 0.02 * (limits[1] - limits[0])
    known = np.concatenate([s.clearance_mm[np.isfinite(s.clearance_mm)] for s in strips])
    clearances = (
        max(-FARTHEST_SHOWN_MM, known.min(initial=0.0)),
        min(FARTHEST_SHOWN_MM, known.max(initial=1.0)),
    )
    parts = figure.subfigures(len(strips), 1, squeeze=False).ravel()
    for index, (part, strip) in enumerate(zip(parts, strips, strict=True)):
        axes = part.subplots(3, 1, sharex=True, height_ratios=(1, 1.3, 0.45))
        part.suptitle(
            ARMS[strip.arm].label, x=0.01, ha="left", fontweight="bold", color="0.15", fontsize=11
        )
        _plot_usable(axes[0], strip, num_fingers)
        _plot_clearance(axes[1], strip, clearances)
        _plot_closings(axes[2], strip)
        for axis in axes:
            axis.set_xlim(limits[0] - margin, limits[1] + margin)
            axis.spines[["top", "right"]].set_visible(False)
        part.align_ylabels(axes)
        if index == len(strips) - 1:
            axes[2].set_xlabel("time, and time at which the hand closes [s]")
    figure.savefig(path, dpi=130)


def _plot_usable(axis: Axes, strip: Strip, num_fingers: int) -> None:
    color = ARMS[strip.arm].color
    axis.fill_between(strip.time, strip.usable, step="post", color=color, alpha=0.3, linewidth=0)
    axis.step(strip.time, strip.usable, where="post", color=color, linewidth=1.2)
    axis.set_ylim(0, num_fingers + 0.5)
    axis.set_yticks([0, num_fingers])
    axis.set_ylabel("usable\nfingers", fontsize=8)


def _plot_clearance(axis: Axes, strip: Strip, limits: tuple[float, float]) -> None:
    margin = 0.08 * (limits[1] - limits[0])
    axis.axhspan(limits[0] - margin, 0, color=_AREA_COLOR, linewidth=0)
    axis.plot(strip.time, strip.clearance_mm, color="0.15", linewidth=1.2)
    axis.set_ylim(limits[0] - margin, limits[1] + margin)
    axis.set_ylabel("goal to\narea [mm]", fontsize=8)
    if not np.any(np.isfinite(strip.clearance_mm)):
        axis.text(
            0.5, 0.5, "no goal, or no area", transform=axis.transAxes, ha="center", va="center"
        )


def _plot_closings(axis: Axes, strip: Strip) -> None:
    for wanted, marker, color, label in (
        (True, "o", _CLEAN_COLOR, "clean"),
        (False, "x", _OTHER_COLOR, "not clean"),
    ):
        times = [time for time, clean in strip.closings if clean == wanted]
        axis.scatter(times, np.zeros(len(times)), marker=marker, s=28, color=color, label=label)
    axis.set_ylim(-1, 1)
    axis.set_yticks([])
    axis.set_ylabel("closing", fontsize=8, rotation=0, ha="right", va="center")
    axis.spines["left"].set_visible(False)
    axis.legend(
        loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8, handletextpad=0.2
    )
