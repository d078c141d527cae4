"""What the benchmark measures, in full and quickly."""

from collections.abc import Sequence
from dataclasses import dataclass

from drake_pregrasp.studies.bench.base_case import RunJob
from drake_pregrasp.studies.bench.direct_tick import STRATEGIES
from drake_pregrasp.studies.bench.global_times import GlobalJob
from drake_pregrasp.studies.bench.memory import MemoryJob
from drake_pregrasp.studies.bench.scene import (
    MESH,
    NUM_CONTACTS,
    NUM_FORBIDDEN,
    SceneSpec,
    cube,
    implementations,
)
from drake_pregrasp.studies.bench.shares import ShareJob
from drake_pregrasp.studies.bench.startup import StartJob
from drake_pregrasp.studies.bench.tick_times import (
    BY_CONTACTS,
    BY_FORBIDDEN,
    BY_MESH_SIZE,
    BY_SIZE,
    TickJob,
)
from drake_pregrasp.studies.bench.ways import AS_OBSTACLES, OF_THE_HAND, all_ways

PER_EDGE = {16: 200, 24: 200, 35: 200, 71: 100, 158: 50, 500: 20}
"""Ticks of each way at most, by the candidates on an edge of the cube: 1,024 to 1,000,000."""

SECONDS, SECONDS_LARGE, LARGE = 3.0, 12.0, 500
"""After which no further round begins, and for cubes with so many candidates on an edge."""

MARGIN_PER_EDGE = 71
"""Largest cube for the strategy `margin`, which takes hundreds of numbers a candidate."""

MESH_SPACINGS = (0.006, 0.004, 0.0028, 0.0014)
"""Of the mesh, in metres: some 1,000 to 20,000 candidates."""

GROWTH_PER_EDGE = 71
GROWTH_SIZE = 4 * GROWTH_PER_EDGE**2
GROWTH_STRATEGIES = ("position", "gii")
"""On that cube and with these strategies ticks grow with..."""

CONTACTS = (2, 3, NUM_CONTACTS, 8, 16, 32)
FORBIDDEN = (0, 20, NUM_FORBIDDEN, 2000)
"""...the numbers of contacts and of forbidden points."""

PERIODS = {0.05: 2.0, 0.01: 1.0, 0.001: 0.3}
"""Seconds to simulate in each round, by the planning period, in seconds."""

PROFILED = {24: 1000, 71: 400, 158: 200, 500: 20}
PROFILED_STRATEGIES = ("position", "gii")
"""Ticks to profile, by the candidates on an edge of the cube, and with which strategies."""


@dataclass(frozen=True)
class Plan:
    """Everything to measure."""

    memory: Sequence[MemoryJob]
    ticks: Sequence[TickJob]
    choices: Sequence[GlobalJob]
    runs: Sequence[RunJob]
    starts: Sequence[StartJob]
    shares: Sequence[ShareJob]


def full_plan() -> Plan:
    """Returns what takes some nine minutes."""
    return Plan(
        memory=[MemoryJob(40_000)],
        ticks=_tick_jobs(PER_EDGE, MESH_SPACINGS, CONTACTS, FORBIDDEN, tuple(STRATEGIES), SECONDS),
        choices=[GlobalJob(seed, True) for seed in range(8)],
        runs=_run_jobs(PERIODS, rounds=7),
        starts=[StartJob(3, True)],
        shares=_share_jobs(PROFILED),
    )


def quick_plan() -> Plan:
    """Returns what takes less than a minute: fewer sizes, ticks, scenes and rounds, no memory."""
    strategies = (*OF_THE_HAND, "gii of the contact", "margin")
    return Plan(
        memory=[],
        ticks=_tick_jobs(
            {24: 40, 71: 20}, MESH_SPACINGS[1:3], (2, 5, 32), FORBIDDEN[:-1], strategies, 0.3
        ),
        choices=[GlobalJob(seed, False) for seed in range(2)],
        runs=_run_jobs({0.05: 1.0, 0.001: 0.1}, rounds=3),
        starts=[StartJob(1, False)],
        shares=_share_jobs({24: 100}),
    )


def _tick_jobs(
    per_edge: dict[int, int],
    spacings: Sequence[float],
    contacts: Sequence[int],
    forbidden: Sequence[int],
    strategies: Sequence[str],
    seconds: float,
) -> list[TickJob]:
    jobs = [
        TickJob(BY_SIZE, cube(cells), strategy, all_ways(strategy), rounds, limit)
        for cells, rounds in per_edge.items()
        for limit in [SECONDS_LARGE if cells >= LARGE else seconds]
        for strategy in strategies
        if strategy != "margin" or cells <= MARGIN_PER_EDGE
    ]
    kernels, rounds = implementations(), max(per_edge.values())
    ways = (*kernels, "BLAS")
    jobs += [
        TickJob(BY_MESH_SIZE, SceneSpec(MESH, spacing), strategy, ways, rounds, seconds)
        for spacing in spacings
        for strategy in OF_THE_HAND
    ]
    jobs += [
        TickJob(BY_CONTACTS, cube(GROWTH_PER_EDGE, n), strategy, ways, rounds, seconds)
        for n in contacts
        for strategy in GROWTH_STRATEGIES
    ]
    ways = (*ways, AS_OBSTACLES)
    jobs += [
        TickJob(
            BY_FORBIDDEN,
            cube(GROWTH_PER_EDGE, forbidden=m),
            strategy,
            ways,
            rounds,
            seconds,
        )
        for m in forbidden
        for strategy in GROWTH_STRATEGIES
    ]
    return jobs


def _run_jobs(periods: dict[float, float], rounds: int) -> list[RunJob]:
    return [
        RunJob(implementation, period, duration, rounds)
        for period, duration in periods.items()
        for implementation in implementations()
    ]


def _share_jobs(per_edge: dict[int, int]) -> list[ShareJob]:
    return [
        ShareJob(cube(cells), strategy, way, ticks)
        for cells, ticks in per_edge.items()
        for way in reversed(implementations())
        for strategy in PROFILED_STRATEGIES
    ]
