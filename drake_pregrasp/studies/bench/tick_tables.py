"""The benchmark's tables of planning ticks."""

from collections.abc import Iterable, Sequence
from typing import Any

from drake_pregrasp.studies.bench.markdown import milliseconds, table
from drake_pregrasp.studies.bench.tick_goals import TICK_GOAL_OF, TICK_GOALS, tick_goal
from drake_pregrasp.studies.bench.tick_times import TickTimes
from drake_pregrasp.studies.bench.ways import SLOW


def goals_table(ticks: Sequence[TickTimes]) -> list[str]:
    """Returns medians and what is asked of them, by size and kernel."""
    rows = []
    for kernel, sizes in TICK_GOALS.items():
        for size in sizes:
            found = {r.strategy: r for r in ticks if r.way == kernel and r.size == size}
            cells = [_with_goal(found.get(strategy)) for strategy in TICK_GOAL_OF]
            if found:
                rows.append([f"{size:,}", kernel, *cells])
    return table(["N", "kernel", *TICK_GOAL_OF], rows)


def _with_goal(row: TickTimes | None) -> str:
    goal = tick_goal(row) if row is not None else None
    if row is None or goal is None:
        return "—"
    mark = "**" if row.p50 <= goal else ""
    own = milliseconds(row.own_p50)
    return f"{mark}{milliseconds(row.p50)}{mark} of {milliseconds(goal)}; {own}"


def tick_sections(ticks: Sequence[TickTimes]) -> list[str]:
    """Returns a table for each strategy: all ways over the number of candidates."""
    lines: list[str] = []
    for strategy in _values(ticks, "strategy"):
        own = [row for row in ticks if row.strategy == strategy]
        lines += [f"### {strategy}", *ways_table(own, "size", "N")]
    return lines


def ways_table(rows: Sequence[TickTimes], name: str, head: str) -> list[str]:
    """Returns a table of all ways, over the numbers of that name."""
    ways = _values(rows, "way")
    slow = [way for way in SLOW if way in ways]
    lines = []
    for number in _values(rows, name):
        cells = {row.way: row for row in rows if getattr(row, name) == number}
        fastest = min(row.p50 for way, row in cells.items() if way not in SLOW)
        fewest = min(row.ticks for row in cells.values())
        most = max(row.ticks for row in cells.values())
        lines.append(
            [
                f"{number:,}",
                f"{most}" if fewest == most else f"{most}, {fewest}",
                *(_times(cells.get(way)) for way in ways),
                *(f"{cells[way].p50 / fastest:.0f}" if way in cells else "—" for way in slow),
            ]
        )
    return table([head, "ticks", *ways, *(f"times {way}" for way in slow)], lines)


def medians_table(rows: Sequence[TickTimes], name: str, head: str) -> list[str]:
    """Returns a table of medians, a column for each strategy and way, over those numbers."""
    columns = list(dict.fromkeys((row.strategy, row.way) for row in rows))
    lines = []
    for number in _values(rows, name):
        own = {(row.strategy, row.way): row for row in rows if getattr(row, name) == number}
        cells = (own.get(column) for column in columns)
        lines.append([f"{number:,}", *(milliseconds(c.p50) if c else "—" for c in cells)])
    return table([head, *(f"{strategy}, {way}" for strategy, way in columns)], lines)


def _values(rows: Iterable[TickTimes], name: str) -> list[Any]:
    return list(dict.fromkeys(getattr(row, name) for row in rows))


def _times(row: TickTimes | None) -> str:
    if row is None:
        return "—"
    mark = "*" if row.scaled > 1 else ""
    return f"{milliseconds(row.p50)} / {milliseconds(row.p99)}{mark}"
