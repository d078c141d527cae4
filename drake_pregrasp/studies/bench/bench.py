"""The benchmark: it measures, and writes a report."""

import argparse
import json
import logging
import multiprocessing
import os
import platform
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar

from drake_pregrasp.kernels import numba_is_installed
from drake_pregrasp.simulation.output import write_text, writing
from drake_pregrasp.studies.bench.base_case import time_run
from drake_pregrasp.studies.bench.global_times import compare_choices
from drake_pregrasp.studies.bench.memory import measure_memory
from drake_pregrasp.studies.bench.outcome import Outcome
from drake_pregrasp.studies.bench.plan import Plan, full_plan, quick_plan
from drake_pregrasp.studies.bench.plots import plot_base_case, plot_growth, plot_ticks
from drake_pregrasp.studies.bench.report import report
from drake_pregrasp.studies.bench.shares import profile_ticks
from drake_pregrasp.studies.bench.startup import time_starts
from drake_pregrasp.studies.bench.tick_times import BY_SIZE, time_ticks
from drake_pregrasp.studies.study_options import add_out_option, step_bar

_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

Job = TypeVar("Job")
Result = TypeVar("Result")


def bench(
    out: str | Path,
    *,
    quick: bool = False,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Runs the benchmark and writes `bench.md`, its plots, and `bench.json`.

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
    outcome = measure(quick_plan() if quick else full_plan(), on_progress)
    write_text(out / "bench.json", json.dumps(outcome.to_json(), indent=1) + "\n")
    with writing(out):
        plot_ticks(out / "ticks.png", outcome.series(BY_SIZE))
        plot_growth(out / "growth.png", outcome)
        plot_base_case(out / "base_case.png", outcome.runs)
    write_text(out / "bench.md", report(outcome))
    return out / "bench.md"


def measure(plan: Plan, on_progress: Callable[[int, int], None]) -> Outcome:
    """Measures everything, in a process of one thread."""
    total, done = sum(len(jobs) for jobs in vars(plan).values()), 0
    outcome, load = Outcome(""), os.getloadavg()[0]

    def measured(function: Callable[[Job], Result], job: Job) -> Result:
        nonlocal done
        result = process.submit(function, job).result()
        done += 1
        on_progress(done, total)
        return result

    with _one_thread_process() as process:
        # Memory comes first: what others leave free later would hide what grows.
        outcome.memory = [measured(measure_memory, job) for job in plan.memory]
        for tick_job in plan.ticks:
            outcome.ticks += measured(time_ticks, tick_job)
        for choice_job in plan.choices:
            outcome.choices += measured(compare_choices, choice_job)
        outcome.shares = [measured(profile_ticks, job) for job in plan.shares]
        outcome.runs = [measured(time_run, job) for job in plan.runs]
        for start_job in plan.starts:
            outcome.starts += measured(time_starts, start_job)
    outcome.machine = (
        f"{platform.machine()}, {os.cpu_count()} cores, load {load:.1f} at first and"
        f" {os.getloadavg()[0]:.1f} at last; Python {platform.python_version()}, {_versions()}"
    )
    return outcome


def _versions() -> str:
    """Returns the names and versions of what the benchmark depends on most."""
    packages = ("numpy", *(["numba"] if numba_is_installed() else []), "scipy", "drake")
    return ", ".join(f"{package} {version(package)}" for package in packages)


@contextmanager
def _one_thread_process() -> Iterator[ProcessPoolExecutor]:
    """Gives a fresh process whose libraries are told, before they load, to use one thread."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    try:
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(1, context, initializer=_be_quiet) as process:
            try:
                yield process
            except BaseException:
                process.shutdown(wait=False, cancel_futures=True)
                raise
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _be_quiet() -> None:
    """Keeps Meshcat from saying where it listens, and leaves interrupts to the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    logging.getLogger("drake").setLevel(logging.WARNING)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `drake-pregrasp bench`."""
    add_out_option(parser, "bench")
    parser.add_argument("--quick", action="store_true", help="leave out what takes long")
    parser.set_defaults(command=_command)


def _command(options: argparse.Namespace) -> int:
    with step_bar() as on_progress:
        report = bench(options.out, quick=options.quick, on_progress=on_progress)
    print(f"report in {report}")
    return 0
