"""The table of a condition: what became of its grasps."""

import math
import re
import statistics
from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

from drake_pregrasp.studies.markup import NONE, Cell, table
from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.outcome import Outcome
from drake_pregrasp.studies.static_versus_dynamic.results import Results
from drake_pregrasp.studies.static_versus_dynamic.share_interval import share_interval


class _Column(NamedTuple):
    """A measure of which the tables show medians."""

    name: str
    unit: str
    shown: str
    value: Callable[[Outcome], float]


_COLUMNS = (
    _Column("slip", "mm", "{:.2f}", lambda o: o.slip_mm),
    _Column("tilt", "°", "{:.1f}", lambda o: o.tilt_deg),
    _Column("residual", "N", "{:.3f}", lambda o: o.residual_n),
    _Column("pushed before", "mm", "{:.2f}", lambda o: o.pushed_before_mm),
    _Column("turned before", "°", "{:.2f}", lambda o: o.turned_before_deg),
    _Column("pushed closing", "mm", "{:.2f}", lambda o: o.pushed_closing_mm),
    _Column("fingers", "number", "{:.1f}", lambda o: o.fingers),
    _Column("waited", "s", "{:.2f}", lambda o: o.waited_s),
    _Column("withdrawn", "number", "{:.1f}", lambda o: o.withdrawn),
    _Column("goal in area", "% of ticks", "{:.1f}", lambda o: 100 * o.goal_in_area),
    _Column("tip in area", "% of ticks", "{:.1f}", lambda o: 100 * o.tip_in_area),
)


def outcome_table(results: Results, condition: str) -> str:
    """Returns counts and medians of a condition, a line for each arm and closing time."""
    outcomes = [o for o in results.outcomes if o.condition == condition]
    columns = [c for c in _COLUMNS if not all(math.isnan(c.value(o)) for o in outcomes)]
    head = [
        Cell("arm"),
        Cell("closes at", "s"),
        Cell("clean", "95 % interval"),
        Cell("lifted", "95 % interval"),
        *(Cell(column.name, column.unit) for column in columns),
        Cell("gave up", "number"),
    ]
    rows = []
    for arm in results.arms(condition):
        times = [t for t in results.times(condition) if results.cell(condition, arm, t)]
        for place, time in enumerate(times):
            cell = results.cell(condition, arm, time)
            label = [Cell(ARMS[arm].label, swatch=ARMS[arm].color, kind="arm", rows=len(times))]
            rows.append(
                [
                    *(label if place == 0 else []),
                    Cell(f"{time:g}"),
                    _share(results.count(condition, arm, time), len(cell)),
                    _share(results.count(condition, arm, time, "lifted"), len(cell)),
                    *(_median(cell, column) for column in columns),
                    Cell(str(sum(bool(o.gave_up) for o in cell))),
                ]
            )
    return table(
        head,
        rows,
        f"{CONDITIONS[condition].label}: counts of seeds, and medians over those that have a"
        f" value ({NONE} if none has).",
    )


def surrenders(results: Results, condition: str) -> list[str]:
    """Returns why hands gave up, for each arm of which one did, the most frequent reason first."""
    sentences = []
    for arm in results.arms(condition):
        reasons = Counter(
            _kind(outcome.gave_up)
            for time in results.times(condition)
            for outcome in results.cell(condition, arm, time)
            if outcome.gave_up
        )
        if reasons:
            listed = "; ".join(f"{why} ({count})" for why, count in reasons.most_common())
            sentences.append(f"{ARMS[arm].label}: {listed}")
    return sentences


def _kind(why: str) -> str:
    """Returns a reason without what differs from grasp to grasp: which finger, how many newtons."""
    return re.sub(r": [\d.]+ N are left$", "", re.sub(r"^finger \d+", "a finger", why))


def _share(count: int, of: int) -> Cell:
    low, high = share_interval(count, of)
    interval = f"{100 * low:.0f}–{100 * high:.0f} %"
    return Cell(f"{count} of {of}", interval, "beside", share=count / of)


def _median(cell: Sequence[Outcome], column: _Column) -> Cell:
    values = [value for value in map(column.value, cell) if not math.isnan(value)]
    return Cell(column.shown.format(statistics.median(values)) if values else NONE)
