"""The benchmark's measurements, each made in a process that has one thread."""

import time
from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator

from drake_pregrasp.planning.kernels import make_kernel
from drake_pregrasp.simulation.scenario_file import load_scenario
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.studies.bench_scene import NUM_SETS, direct_scale, make_scene, make_ticks

SLOW = ("BLAS", "direct")
"""Ways that are timed in every tenth round only, so that they don't take all the time."""

_SLOW_EVERY = 10
_TRIES = 3  # Rounds that don't count.


class TickJob(NamedTuple):
    """One size and strategy, all ways in turn.

    Attributes:
        per_edge: Candidates on an edge of the cube.
        strategy: Name of the strategy.
        rounds: Ticks to time in each way.
    """

    per_edge: int
    strategy: str
    rounds: int


class TickTimes(NamedTuple):
    """How long ticks took.

    Attributes:
        size: Number of candidates.
        strategy: Name of the strategy.
        way: How they were planned.
        ticks: Number of ticks timed.
        p50: Median, in seconds.
        p99: 99th percentile, in seconds.
        scaled: By what times on a sample were multiplied; 1 if all points took part.
    """

    size: int
    strategy: str
    way: str
    ticks: int
    p50: float
    p99: float
    scaled: float


class RunJob(NamedTuple):
    """A simulation of the base case.

    Attributes:
        implementation: Of the kernel.
        period: Seconds between planning ticks.
        duration: Seconds to simulate.
    """

    implementation: str
    period: float
    duration: float


class RunTime(NamedTuple):
    """How fast a simulation was.

    Attributes:
        implementation: Of the kernel.
        rate: Planning ticks a second.
        factor: Seconds simulated in a second, without recording.
    """

    implementation: str
    rate: float
    factor: float


def time_ticks(job: TickJob) -> list[TickTimes]:
    """Times all ways of a size and strategy, in turn, from the same contacts in each round."""
    scene = make_scene(job.per_edge)
    ticks = make_ticks(scene, job.strategy)
    seconds: dict[str, list[float]] = {way: [] for way in ticks}
    for round_ in range(-_TRIES, job.rounds):
        p_OC = scene.starts[round_ % NUM_SETS]
        for way, tick in ticks.items():
            if way in SLOW and round_ % _SLOW_EVERY:
                continue
            if way not in SLOW:
                # The way before has filled the caches with its own; planners tick after themselves.
                tick(scene.starts[(round_ - 1) % NUM_SETS])
            start = time.perf_counter()
            tick(p_OC)
            if round_ >= 0:
                seconds[way].append(time.perf_counter() - start)
    size = len(scene.surface.p_OQ)
    times = []
    for way, values in seconds.items():
        scale = direct_scale(size) if way == "direct" else 1.0
        p50, p99 = scale * np.percentile(values, [50, 99])
        times.append(TickTimes(size, job.strategy, way, len(values), float(p50), float(p99), scale))
    return times


def time_run(job: RunJob) -> RunTime:
    """Times the base case, whose contacts adapt from the start."""
    scenario = load_scenario("a_base")
    scenario.planner.period = job.period
    scenario.planner.static_duration = 0.0
    surface = scenario.make_surface()
    kernel = make_kernel(
        surface.p_OQ,
        surface.nhat_OQ,
        surface.areas,
        surface.p_OCoM,
        implementation=job.implementation,
    )
    surface.__dict__["kernel"] = kernel
    simulator = Simulator(make_diagram(scenario, surface, sink=lambda record: None))
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    simulator.set_target_realtime_rate(0)
    simulator.AdvanceTo(job.period)
    start = time.perf_counter()
    simulator.AdvanceTo(job.period + job.duration)
    return RunTime(job.implementation, 1 / job.period, job.duration / (time.perf_counter() - start))
