"""Many independent computations, as many at a time as there are processors."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")


def in_processes(
    function: Callable[[Job], Result],
    jobs: Sequence[Job],
    *,
    on_done: Callable[[], None] = lambda: None,
) -> list[Result]:
    """Returns what the function makes of each job, in their order.

    Args:
        function: One that can be pickled: a module's, or a `partial` of it.
        jobs: Its arguments.
        on_done: Called after each.
    """
    # Fresh processes: Drake's systems in Python outlive their diagram, and threads don't survive
    # a fork.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(os.cpu_count(), context, initializer=_ignore_interrupts) as pool:
        futures = [pool.submit(function, job) for job in jobs]
        try:
            for future in as_completed(futures):
                future.result()
                on_done()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        return [future.result() for future in futures]


def _ignore_interrupts() -> None:
    # They reach the parent, which then ends the rest in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
