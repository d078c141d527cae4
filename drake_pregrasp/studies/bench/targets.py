"""The goals for the planner's speed, and what the measurements reach."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from drake_pregrasp.studies.bench.base_case import WITH_RECORDING, WITHOUT_RECORDING
from drake_pregrasp.studies.bench.global_times import GREEDY, MARGIN_WEIGHTED
from drake_pregrasp.studies.bench.outcome import Outcome, median_choices
from drake_pregrasp.studies.bench.scene import implementations
from drake_pregrasp.studies.bench.tick_goals import TICK_GOALS, tick_goal
from drake_pregrasp.studies.bench.tick_times import BY_SIZE, TickTimes
from drake_pregrasp.studies.bench.ways import IN_DRAKE

TAIL = 2.0
"""The 99th percentile is to be at most so many medians."""

TIMES_BLAS, TIMES_DIRECT = 10.0, 200.0
RATIO_SIZE, RATIO_STRATEGY = 99_856, "position"
"""How many times faster a tick is to be, on how many candidates, and with which strategy."""

PORTS = 60e-6
"""Seconds that Drake's ports may add to a tick."""

FASTER_THAN_GLOBAL, SHARE_OF_Q_MSV = 100.0, 0.997
"""How many times faster than global selection a tick is to be, and at what share of its Q_MSV."""

FACTOR_FAST, FACTOR, FACTOR_RECORDED = 1.0, 40.0, 20.0
"""Times real time: at 1,000 Hz with numba, and at 20 Hz with numpy, without and with recording."""

IMPORT, FIRST_TICK_EVER, FIRST_TICK = 1.5, 45.0, 0.5
"""Seconds."""

CONSTANT = 1.0
"""Bytes a tick below which memory in use counts as constant: 1 MB over a million ticks."""


class Target(NamedTuple):
    """A target.

    Attributes:
        what: Is measured.
        goal: What it is to be.
        reached: What it is; "not measured" without measurements.
        met: Whether that is enough.
    """

    what: str
    goal: str
    reached: str
    met: bool


def targets(outcome: Outcome) -> list[Target]:
    """Returns all targets, one after another."""
    return [
        *_tick_targets(outcome.series(BY_SIZE)),
        *_global_targets(outcome),
        *_run_targets(outcome),
        *_start_targets(outcome),
    ]


def _target(
    what: str, goal: str, values: Sequence[float], text: str, met: Callable[..., bool]
) -> Target:
    """Returns a target about some numbers, which the text shows."""
    if not values:
        return Target(what, goal, "not measured", False)
    return Target(what, goal, text.format(*values), bool(met(*values)))


def _tick_targets(ticks: Sequence[TickTimes]) -> list[Target]:
    fastest = implementations()[-1]
    rows = []
    for kernel in TICK_GOALS:
        goals = [(row.p50, goal) for row in ticks if row.way == kernel and (goal := tick_goal(row))]
        met = sum(p50 <= goal for p50, goal in goals)
        rows.append(
            _target(
                f"ticks with {kernel} that reach their goals in the table below",
                "all",
                [met, len(goals)] if goals else [],
                "{:.0f} of {:.0f}",
                lambda met, count: met == count,
            )
        )
    measured = [row for row in ticks if row.way == fastest and tick_goal(row)]
    for what, tails in (
        ("99th percentile over median", [row.p99 / row.p50 for row in measured]),
        ("the same of processor time", [row.own_p99 / row.own_p50 for row in measured]),
    ):
        rows.append(
            _target(
                f"{what}, {fastest}",
                f"at most {TAIL:g}",
                [float(np.median(tails)), max(tails)] if tails else [],
                "{:.1f} mostly, {:.1f} at worst",
                lambda middle, worst: worst <= TAIL,
            )
        )
    at = {
        row.way: row.p50
        for row in ticks
        if (row.size, row.strategy) == (RATIO_SIZE, RATIO_STRATEGY)
    }
    for way, ratio in (("BLAS", TIMES_BLAS), ("direct", TIMES_DIRECT)):
        rows.append(
            _target(
                f"times faster than {way}, {RATIO_STRATEGY}, {RATIO_SIZE:,} candidates",
                f"at least {ratio:g}",
                [at[way] / at[fastest]] if at else [],
                "{:.0f}",
                lambda times, ratio=ratio: times >= ratio,
            )
        )
    ports = [1e6 * row.ports for row in ticks if row.way == fastest + IN_DRAKE]
    rows.append(
        _target(
            f"what Drake's ports add to a tick, {fastest}",
            f"at most {1e6 * PORTS:g} µs",
            [float(np.median(ports))] if ports else [],
            "{:.0f} µs (median over sizes and strategies)",
            lambda added: added <= 1e6 * PORTS,
        )
    )
    return rows


def _global_targets(outcome: Outcome) -> list[Target]:
    if not outcome.choices:
        return []
    medians = {
        (method, is_planner): [float(np.median(v)) for v in values]
        for method, is_planner, values in median_choices(outcome.choices)
    }
    others = {method: values for (method, planner), values in medians.items() if not planner}
    planners = {method: values for (method, planner), values in medians.items() if planner}
    rival = min(others, key=lambda method: others[method][0])
    shares = {name: values[1] / others[rival][1] for name, values in planners.items()}
    # The fastest strategy of those that come near enough, or else the one that comes nearest.
    near = [name for name, share in shares.items() if share >= SHARE_OF_Q_MSV]
    own = min(near or [max(shares, key=shares.__getitem__)], key=lambda name: planners[name][0])
    best = max(MARGIN_WEIGHTED, key=lambda name: planners[name][2])
    return [
        _target(
            f"times faster than the fastest global selection ({rival}), {own}",
            f"at least {FASTER_THAN_GLOBAL:g}",
            [others[rival][0] / planners[own][0]],
            "{:.0f}",
            lambda times: times >= FASTER_THAN_GLOBAL,
        ),
        _target(
            f"times faster than {GREEDY} by numpy's eigenvalues, {own}",
            f"at least {FASTER_THAN_GLOBAL:g}",
            [others[GREEDY][0] / planners[own][0]],
            "{:.0f}",
            lambda times: times >= FASTER_THAN_GLOBAL,
        ),
        _target(
            f"Q_MSV over that of the fastest global selection, {own}",
            f"at least {100 * SHARE_OF_Q_MSV:.1f} %",
            [100 * shares[own]],
            "{:.2f} %",
            lambda share: share >= 100 * SHARE_OF_Q_MSV,
        ),
        _target(
            f"settled margin, {best}",
            f"at least that of {GREEDY}: {others[GREEDY][2]:.3f}",
            [planners[best][2]],
            "{:.3f}",
            lambda margin: margin >= others[GREEDY][2],
        ),
    ]


def _run_targets(outcome: Outcome) -> list[Target]:
    rows = []
    for kernel, rate, part, factor in (
        ("numba", 1000, WITHOUT_RECORDING, FACTOR_FAST),
        ("numpy", 20, WITHOUT_RECORDING, FACTOR),
        ("numpy", 20, WITH_RECORDING, FACTOR_RECORDED),
    ):
        kind = "with" if part == WITH_RECORDING else "without"
        rows.append(
            _target(
                f"base case at {rate:,} Hz with {kernel}, {kind} recording",
                f"at least {factor:g} x real time",
                [
                    run.factor(part)
                    for run in outcome.runs
                    if run.implementation == kernel and round(run.rate) == rate
                ],
                "{:.2f} x real time",
                lambda reached, factor=factor: reached >= factor,
            )
        )
    return rows


def _start_targets(outcome: Outcome) -> list[Target]:
    fastest = implementations()[-1]
    imports = [start.imports for start in outcome.starts]
    rows = [
        _target(
            "import of the package",
            f"less than {IMPORT:g} s",
            [float(np.median(imports))] if imports else [],
            "{:.2f} s",
            lambda seconds: seconds < IMPORT,
        )
    ]
    for compiles, what, limit in (
        (True, "first kernel and tick after installing", FIRST_TICK_EVER),
        (False, "first kernel and tick of later processes", FIRST_TICK),
    ):
        rows.append(
            _target(
                f"{what}, {fastest}",
                f"less than {limit:g} s",
                [
                    start.makes + start.ticks
                    for start in outcome.starts
                    if start[:2] == (fastest, compiles)
                ],
                "{:.2f} s",
                lambda seconds, limit=limit: seconds < limit,
            )
        )
    rows.append(
        _target(
            "memory that ticks leave behind",
            f"less than {CONSTANT:g} byte a tick",
            [use.slope for use in outcome.memory][:1],
            "{:+.2f} bytes a tick",
            lambda slope: slope < CONSTANT,
        )
    )
    return rows
