"""Prints the force-closure margin that each strategy settles at, from random contacts.

Run it as `python -m drake_pregrasp.studies.settled_margins`; it takes some five minutes.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.centroids import select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput, WeightFunction
from drake_pregrasp.contacts.strategies import make_blend, make_strategy
from drake_pregrasp.geometry.box_surface import box_surface
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.force_closure import FRICTION, min_weight_margin
from drake_pregrasp.regions.safe_regions import compute_safe_regions

CASES: Sequence[tuple[int, int, Sequence[float], float]] = (
    (5, 40, (0.1, 0.1, 0.1), 0.005),
    (4, 24, (0.1, 0.1, 0.1), 0.005),
    (3, 24, (0.1, 0.1, 0.1), 0.005),
    (3, 24, (0.05, 0.2, 0.1), 0.01),
)
"""Numbers of contacts and of starts, the box's size and the spacing of candidates, in metres."""

STRATEGIES: Mapping[str, tuple[WeightFunction, bool]] = {
    "position": (make_strategy("position"), False),
    "msv": (make_strategy("msv"), False),
    "msv, in turns": (make_strategy("msv"), True),
    "margin": (make_strategy("margin"), False),
    "margin, power 4": (make_strategy("margin", power=4.0), False),
    "margin, in turns": (make_strategy("margin"), True),
    "margin, in turns, power 4": (make_strategy("margin", power=4.0), True),
    "blend, in turns": (make_blend({"position": 1.0, "margin": 1.0}), True),
}
"""What is compared: weights, and whether contacts move in turns."""

SPREAD = 0.04
"""Standard deviation of Eq. 3, in metres, as `planner.position_spread`."""


def random_starts(surface: ObjectSurface, contacts: int, count: int) -> list[FloatArray]:
    """Returns contact sets drawn from the candidates, the same at every call."""
    generator = np.random.default_rng(0)
    indices = range(len(surface.p_OQ))
    return [surface.p_OQ[generator.choice(indices, contacts, replace=False)] for _ in range(count)]


def margin_of(surface: ObjectSurface, p_OC: FloatArray) -> float:
    """Returns the exact margin of hard fingers on the surface, shape (n, 3)."""
    return min_weight_margin(p_OC - surface.p_OCoM, surface.project(p_OC)[1], FRICTION)


def settled_margin(
    surface: ObjectSurface,
    p_OC: FloatArray,
    strategy: WeightFunction,
    *,
    in_turns: bool,
    ticks: int = 60,
    last: int = 8,
) -> float:
    """Returns the mean margin of the last ticks, of regions and selection without any noise.

    Args:
        surface: The object's surface.
        p_OC: Where the contacts start, shape (n, 3), in metres.
        strategy: Weights of the candidates.
        in_turns: As for `select_contacts`.
        ticks: How many in all.
        last: How many of them count.
    """
    no_weights, covariance = np.zeros(len(p_OC)), SPREAD**2 * np.eye(3)
    margins = []
    for tick in range(ticks):
        regions = compute_safe_regions(surface.p_OQ, p_OC, no_weights, surface.forbidden)
        selection = SelectionInput(surface, p_OC, regions, covariance)
        p_OC = select_contacts(selection, strategy, in_turns=in_turns).p_OC
        if tick >= ticks - last:
            margins.append(margin_of(surface, p_OC))
    return float(np.mean(margins))


def main() -> None:
    """Prints medians and least values over the starts."""
    for contacts, count, size, spacing in CASES:
        surface = box_surface(size, spacing=spacing)
        starts = random_starts(surface, contacts, count)
        open_starts = sum(margin_of(surface, p_OC) == 0 for p_OC in starts)
        print(f"{contacts} contacts, box {size} m, {count} starts, {open_starts} not closed")
        margins = {
            name: [settled_margin(surface, p, strategy, in_turns=in_turns) for p in starts]
            for name, (strategy, in_turns) in STRATEGIES.items()
        }
        print(pd.DataFrame(margins).agg(["median", "min"]).T.round(3).to_string())


if __name__ == "__main__":
    main()
