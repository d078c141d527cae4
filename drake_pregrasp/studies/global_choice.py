"""The planner against choosing all contacts anew each time: time, Q_MSV and force-closure margin.

Greedy selection puts one contact after another at the candidate with the best score; exchange then
moves each in turn to its best candidate, until no move gains.
"""

import itertools
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.contacts.strategies import hand_singular_values
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.studies.bench.tick_times import (
    Tick,
    cube,
    implementations,
    make_scene,
    make_tick,
)
from drake_pregrasp.studies.settled_margins import STRATEGIES, margin_of, settled_contacts

Score = Callable[[IntArray], FloatArray]
"""Maps candidates that are held, shape (k,), to the score with each candidate added, shape (N,)."""

PLANNERS = {
    **STRATEGIES,
    "gii": PlannerConfig(strategy="gii"),
    "vew": PlannerConfig(strategy="vew"),
}
"""Settings of the planner that take part."""

_GAIN = 1e-12  # Relative gain of a score that is more than rounding.
_JITTER = 1e-9  # Standard deviation in metres that makes each timed tick a new one.


def msv_score(p_CoMQ: FloatArray) -> Score:
    """Returns the score Q_MSV².

    Args:
        p_CoMQ: Candidates relative to the centre of mass, shape (N, 3), in metres.
    """

    def score(held: IntArray) -> FloatArray:
        return hand_singular_values(p_CoMQ[held], p_CoMQ)[:, 0] ** 2

    return score


def greedy(score: Score, first: int, contacts: int) -> IntArray:
    """Returns candidates, each at the best score beside those before it, shape (n,).

    Args:
        score: Score to maximise.
        first: Index of the first candidate.
        contacts: Number of contacts n.
    """
    chosen = np.array([first])
    while len(chosen) < contacts:
        chosen = np.append(chosen, np.argmax(score(chosen)))
    return chosen


def exchanged(score: Score, chosen: IntArray) -> IntArray:
    """Returns candidates none of which has a better place while the others stay, shape (n,).

    Args:
        score: Score to maximise.
        chosen: Candidates to start from, shape (n,).
    """
    chosen, at_their_best = chosen.copy(), 0
    for i in itertools.cycle(range(len(chosen))):
        if at_their_best == len(chosen):
            break
        values = score(np.delete(chosen, i))
        best = int(np.argmax(values))
        gains = values[best] - values[chosen[i]] > _GAIN * abs(values[best])
        chosen[i] = best if gains else chosen[i]
        at_their_best = 1 if gains else at_their_best + 1
    return chosen


def compare_choices(seed: int, *, per_edge: int = 24, ticks: int = 60) -> list[dict[str, Any]]:
    """Returns a row for each method and strategy on one cube with random forbidden points.

    Args:
        seed: Seed of the forbidden points and the random contacts.
        per_edge: Number of candidates along an edge.
        ticks: Number of ticks until the planner's contacts have settled, and of those timed.
    """
    surface, starts = make_scene(cube(per_edge, seed=seed))
    clear = surface.p_OQ[surface.is_clear_of_forbidden_points]
    score, first = msv_score(clear), int(np.random.default_rng(seed).integers(len(clear)))
    start = time.perf_counter()
    chosen = exchanged(score, greedy(score, first, starts.shape[1]))
    seconds = time.perf_counter() - start
    rows = [_row("greedy with exchange", surface, seconds, [clear[chosen]])]
    for strategy, config in PLANNERS.items():
        tick = make_tick(surface, implementations()[-1], starts[0], config)
        settled = settled_contacts(tick, starts[0], ticks=ticks)
        seconds = _seconds_a_tick(tick, settled[-1], ticks)
        rows.append(_row(f"planner: {strategy}", surface, seconds, settled))
    return rows


def _seconds_a_tick(tick: Tick, p_OC: FloatArray, ticks: int) -> float:
    """Returns the median of ticks from contacts that differ a little, so that none is cached."""
    generator, seconds = np.random.default_rng(0), []
    for _ in range(ticks):
        jittered = p_OC + generator.normal(0, _JITTER, p_OC.shape)
        start = time.perf_counter()
        tick(jittered)
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))


def _row(
    method: str, surface: ObjectSurface, seconds: float, sets: list[FloatArray]
) -> dict[str, Any]:
    return {
        "method": method,
        "time [ms]": 1e3 * seconds,
        "Q_MSV": float(np.mean([grasp_quality(p_OC - surface.p_OCoM).q_msv for p_OC in sets])),
        "margin": float(np.mean([margin_of(surface, p_OC) for p_OC in sets])),
    }
