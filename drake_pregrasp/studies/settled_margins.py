"""Steady-state force-closure margins of strategies from random contacts, without noise.

`python -m drake_pregrasp.studies.settled_margins` prints them in about five minutes.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.planner_config import BlendConfig, PlannerConfig
from drake_pregrasp.geometry.box_surface import box_surface
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.force_closure import FRICTION, min_weight_margin
from drake_pregrasp.studies.bench.tick_times import implementations, make_tick

CASES: Sequence[tuple[int, int, Sequence[float], float]] = (
    (5, 40, (0.1, 0.1, 0.1), 0.005),
    (4, 24, (0.1, 0.1, 0.1), 0.005),
    (3, 24, (0.1, 0.1, 0.1), 0.005),
    (3, 24, (0.05, 0.2, 0.1), 0.01),
)
"""Number of contacts, number of starts, and the box's size and candidate spacing in metres."""

STRATEGIES: Mapping[str, PlannerConfig] = {
    "position": PlannerConfig(),
    "msv": PlannerConfig(strategy="msv"),
    "msv, in turns": PlannerConfig(strategy="msv", in_turns=True),
    "margin": PlannerConfig(strategy="margin"),
    "margin, power 4": PlannerConfig(strategy="margin", power=4.0),
    "margin, in turns": PlannerConfig(strategy="margin", in_turns=True),
    "margin, in turns, power 4": PlannerConfig(strategy="margin", in_turns=True, power=4.0),
    "blend, in turns": PlannerConfig(
        strategy="blend", blend=BlendConfig(position=1.0, margin=1.0), in_turns=True
    ),
}
"""Compared settings of the planner, by label."""


def random_starts(surface: ObjectSurface, contacts: int, count: int) -> list[FloatArray]:
    """Draws `count` sets of contacts from the candidates, with a fixed seed."""
    generator = np.random.default_rng(0)
    indices = range(len(surface.p_OQ))
    return [surface.p_OQ[generator.choice(indices, contacts, replace=False)] for _ in range(count)]


def margin_of(surface: ObjectSurface, p_OC: FloatArray) -> float:
    """Returns the exact min-weight margin of hard fingers at p_OC, shape (n, 3), in metres."""
    return min_weight_margin(p_OC - surface.p_OCoM, surface.project(p_OC)[1], FRICTION)


def settled_margin(
    surface: ObjectSurface, p_OC: FloatArray, config: PlannerConfig, *, ticks: int = 60
) -> float:
    """Returns the mean margin of the last 8 of `ticks` ticks from p_OC, shape (n, 3), in metres."""
    tick = make_tick(surface, implementations()[-1], p_OC, config)
    margins = []
    for _ in range(ticks):
        p_OC = tick(p_OC)
        margins.append(margin_of(surface, p_OC))
    return float(np.mean(margins[-8:]))


def main() -> None:
    """Prints medians and minima over the starts."""
    for contacts, count, size, spacing in CASES:
        surface = box_surface(size, spacing=spacing)
        starts = random_starts(surface, contacts, count)
        open_starts = sum(margin_of(surface, p_OC) == 0 for p_OC in starts)
        print(f"{contacts} contacts, box {size} m, {count} starts, {open_starts} not closed")
        margins = {
            name: [settled_margin(surface, p_OC, config) for p_OC in starts]
            for name, config in STRATEGIES.items()
        }
        print(pd.DataFrame(margins).agg(["median", "min"]).T.round(3).to_string())


if __name__ == "__main__":
    main()
