"""The goals for a tick's median, by kernel and size."""

from drake_pregrasp.studies.bench.tick_times import TickTimes

TICK_GOALS = {
    "numba": {
        2_304: (0.25e-3, 0.3e-3, 0.4e-3),
        20_164: (0.5e-3, 1.0e-3, 1.5e-3),
        99_856: (1.0e-3, 3.5e-3, 5e-3),
        1_000_000: (7e-3, 28e-3, 40e-3),
    },
    "numpy": {
        2_304: (1.5e-3, 3.5e-3, 4.5e-3),
        20_164: (6e-3, 10e-3, 12e-3),
        99_856: (10e-3, 22e-3, 28e-3),
        1_000_000: (40e-3, 130e-3, 180e-3),
    },
}
"""Median seconds of a tick, by kernel and size: three, of which..."""

TICK_GOAL_OF = {"position": 0, "vew": 0, "msv": 1, "gii": 2}
"""...each strategy has one."""


def tick_goal(row: TickTimes) -> float | None:
    """Returns the median that is asked of a tick, in seconds, if any is."""
    goals = TICK_GOALS.get(row.way, {}).get(row.size)
    if goals is None or row.strategy not in TICK_GOAL_OF:
        return None
    return goals[TICK_GOAL_OF[row.strategy]]
