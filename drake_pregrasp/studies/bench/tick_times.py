"""How long planning ticks take, in several ways, in turn."""

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.studies.bench.direct_tick import Tick, direct_scale
from drake_pregrasp.studies.bench.scene import NUM_SETS, SceneSpec, make_scene
from drake_pregrasp.studies.bench.ways import IN_DRAKE, SLOW, make_ticks

BY_SIZE, BY_MESH_SIZE, BY_CONTACTS, BY_FORBIDDEN = "size", "mesh", "contacts", "forbidden"
"""Series: more and more candidates on the cube, on the mesh, contacts, and forbidden points."""

_SLOW_EVERY = 10
"""In every how-manieth round slow ways are timed, so that they don't take all the time."""

_TRIES = 3  # Rounds that don't count.
_FEWEST = 5  # Rounds that count in any case.


class TickJob(NamedTuple):
    """One scene and strategy, some ways in turn.

    Attributes:
        series: What it belongs to: `BY_SIZE`, `BY_MESH_SIZE`, `BY_CONTACTS` or `BY_FORBIDDEN`.
        spec: The scene.
        strategy: One of `STRATEGIES`.
        ways: Names of the ways.
        rounds: Ticks to time in each way at most.
        seconds: After which there is no further round.
    """

    series: str
    spec: SceneSpec
    strategy: str
    ways: Sequence[str]
    rounds: int
    seconds: float


class TickTimes(NamedTuple):
    """How long ticks took.

    Attributes:
        series: As the job's.
        size: Number of candidates.
        contacts: Number of contacts.
        forbidden: Number of forbidden points.
        strategy: One of `STRATEGIES`.
        way: How they were planned.
        ticks: Number of ticks timed.
        p50: Median, in seconds.
        p99: 99th percentile, in seconds.
        scaled: By what times on a sample were multiplied; 1 if all points took part.
        ports: Through Drake, the median over the rounds of what it takes longer than the same
            kernel without, in seconds; else 0.
    """

    series: str
    size: int
    contacts: int
    forbidden: int
    strategy: str
    way: str
    ticks: int
    p50: float
    p99: float
    scaled: float
    ports: float
    own_p50: float
    own_p99: float


def time_ticks(job: TickJob) -> list[TickTimes]:
    """Times ways in turn, from the same contacts in each round."""
    scene = make_scene(job.spec)
    ticks = make_ticks(scene, job.strategy, job.ways)
    seconds: dict[str, list[tuple[float, float]]] = {way: [] for way in ticks}
    start = time.perf_counter()
    for round_ in range(-_TRIES, job.rounds):
        late = time.perf_counter() - start > job.seconds
        if late and (round_ < 0 or round_ >= _FEWEST):
            continue
        for way, tick in ticks.items():
            if way in SLOW and round_ % _SLOW_EVERY:
                continue
            taken = _time_one(tick, scene.starts, round_, alone=way not in SLOW)
            if round_ >= 0:
                seconds[way].append(taken)
    size = len(scene.surface.p_OQ)
    forbidden = len(scene.surface.forbidden)
    times = []
    for way, pairs in seconds.items():
        values = np.array(pairs)
        scale = direct_scale(size) if way == "direct" else 1.0
        (p50, own_p50), (p99, own_p99) = scale * np.percentile(values, [50, 99], axis=0)
        ports = 0.0
        if way.endswith(IN_DRAKE):
            plain = seconds.get(way.removesuffix(IN_DRAKE), pairs)
            ports = float(np.median(values[:, 0] - np.array(plain)[:, 0]))
        times.append(
            TickTimes(
                job.series,
                size,
                job.spec.contacts,
                forbidden,
                job.strategy,
                way,
                len(pairs),
                float(p50),
                float(p99),
                scale,
                ports,
                float(own_p50),
                float(own_p99),
            )
        )
    return times


def _time_one(tick: Tick, starts: FloatArray, round_: int, *, alone: bool) -> tuple[float, float]:
    """Returns the time that a tick takes, and its thread's processor time, in seconds."""
    if alone:
        # The way before has filled the caches with its own; planners tick after themselves.
        tick(starts[(round_ - 1) % NUM_SETS])
    p_OC = starts[round_ % NUM_SETS]
    start, own_start = time.perf_counter(), time.thread_time()
    tick(p_OC)
    own = time.thread_time() - own_start
    return time.perf_counter() - start, own
