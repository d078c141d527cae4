"""How long a planning tick takes, in several ways, and how fast the base case simulates."""

import json
import multiprocessing
import os
import platform
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from drake_pregrasp.simulation.output import write_text, writing
from drake_pregrasp.studies.bench_plot import plot_bench
from drake_pregrasp.studies.bench_report import bench_markdown
from drake_pregrasp.studies.bench_runs import (
    RunJob,
    RunTime,
    TickJob,
    TickTimes,
    time_run,
    time_ticks,
)
from drake_pregrasp.studies.bench_scene import implementations

STRATEGIES = ("position", "msv", "gii", "vew")

ROUNDS = {16: 200, 24: 200, 35: 200, 71: 100, 158: 50, 500: 20}
"""Ticks of each way by the candidates on an edge of the cube: 1,024 to 1,000,000 in all."""

QUICK_LARGEST = 71
"""Candidates on an edge up to which a quick benchmark goes, and..."""

QUICK_SHARE = 4
"""...by what it divides the ticks."""

PERIODS = {0.05: 20.0, 0.01: 10.0, 0.001: 4.0}
"""Seconds to simulate by the planning period, in seconds."""

_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def bench(
    out: str | Path,
    *,
    quick: bool = False,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Runs the benchmark and writes `bench.json`, `bench.md` and `bench.png`.

    Args:
        out: Their folder; made if it isn't there.
        quick: Whether to leave out what takes long.
        on_progress: Called with the number of measurements done and of all.

    Returns:
        The path of `bench.md`.

    Raises:
        OutputError: If the folder can't be written.
    """
    out = Path(out)
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
    share = QUICK_SHARE if quick else 1
    tick_jobs = [
        TickJob(per_edge, strategy, rounds // share)
        for per_edge, rounds in ROUNDS.items()
        if per_edge <= QUICK_LARGEST or not quick
        for strategy in STRATEGIES
    ]
    run_jobs = [
        RunJob(implementation, period, duration / share)
        for period, duration in PERIODS.items()
        for implementation in implementations()
    ]
    total = len(tick_jobs) + len(run_jobs)
    ticks: list[TickTimes] = []
    runs: list[RunTime] = []
    done = 0
    with _one_thread_process() as process:
        for job in tick_jobs:
            ticks += process.submit(time_ticks, job).result()
            done += 1
            on_progress(done, total)
        for run_job in run_jobs:
            runs.append(process.submit(time_run, run_job).result())
            done += 1
            on_progress(done, total)
    machine = f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    content = {
        "machine": machine,
        "ticks": [row._asdict() for row in ticks],
        "runs": [row._asdict() for row in runs],
    }
    write_text(out / "bench.json", json.dumps(content, indent=1) + "\n")
    with writing(out):
        plot_bench(out / "bench.png", ticks)
    write_text(out / "bench.md", bench_markdown(ticks, runs, machine))
    return out / "bench.md"


@contextmanager
def _one_thread_process() -> Iterator[ProcessPoolExecutor]:
    """Gives a fresh process whose libraries are told, before they load, to use one thread."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    try:
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process:
            yield process
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
