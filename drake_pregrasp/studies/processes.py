"""Many independent computations, as many at a time as there are processors."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from typing import TypeVar

_JOBS_A_PROCESS = 100  # A simulated hand leaves some 7 MB behind.

Job = TypeVar("Job")
Result = TypeVar("Result")


def in_processes(
    function: Callable[[Job], Result],
    jobs: Sequence[Job],
    *,
    processes: int | None = None,
    on_done: Callable[[], None] = lambda: None,
) -> list[Result]:
    """Returns what the function makes of each job, in their order.

    Args:
        function: One that can be pickled: a module's, or a `partial` of it.
        jobs: Its arguments.
        processes: How many at a time; as many as there are processors if not set.
        on_done: Called after each.
    """
    results: dict[int, Result] = {}
    with contextlib.closing(as_they_end(function, jobs, processes=processes)) as ended:
        for index, future in ended:
            results[index] = future.result()
            on_done()
    return [results[index] for index in range(len(jobs))]


def as_they_end(
    function: Callable[[Job], Result], jobs: Sequence[Job], *, processes: int | None = None
) -> Generator[tuple[int, "Future[Result]"], None, None]:
    """Yields the index of each job as it ends, with its result or what was raised.

    Close it to leave it early: jobs that wait are dropped, and those under way end first.

    Args:
        function: One that can be pickled: a module's, or a `partial` of it.
        jobs: Its arguments.
        processes: How many at a time; as many as there are processors if not set.
    """
    # Fresh processes: Drake's systems in Python outlive their diagram, and threads don't survive
    # a fork. For the same reason processes are renewed before they have grown large.
    context = multiprocessing.get_context("spawn")
    workers = processes or os.cpu_count() or 1
    for first in range(0, len(jobs), _JOBS_A_PROCESS * workers):
        some = jobs[first : first + _JOBS_A_PROCESS * workers]
        with ProcessPoolExecutor(workers, context, initializer=_prepare) as pool:
            indices = {pool.submit(function, job): first + k for k, job in enumerate(some)}
            try:
                for future in as_completed(indices):
                    yield indices[future], future
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise


def _prepare() -> None:
    # Interrupts reach the parent, which then ends the rest in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    # A parent that is killed can't end its processes, and they would wait for jobs for ever.
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
