"""Many independent computations, as many at a time as there are processors."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
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
    function: Callable[[Job], Result],
    jobs: Sequence[Job],
    *,
    processes: int | None = None,
    attempts: int = 1,
) -> Generator[tuple[int, "Future[Result]"], None, None]:
    """Yields the index of each job as it ends, with its result or what was raised.

    Close it to leave it early: jobs that wait are dropped, and those under way end first.

    Args:
        function: One that can be pickled: a module's, or a `partial` of it.
        jobs: Its arguments.
        processes: How many at a time; as many as there are processors if not set.
        attempts: How often a job is begun whose process ends without a word, which all jobs at that
            time are suspected of. The last attempt is alone, so that no other is blamed for it.
    """
    workers = processes or os.cpu_count() or 1
    waiting = deque(range(len(jobs)))
    alone: deque[int] = deque()
    breaks: Counter[int] = Counter()
    while waiting or alone:
        source, most = (alone, 1) if alone else (waiting, _JOBS_A_PROCESS * workers)
        some = deque(source.popleft() for _ in range(min(len(source), most)))
        with contextlib.closing(_in_one_pool(function, jobs, some, workers)) as ended:
            for index, future in ended:
                died = isinstance(future.exception(), BrokenProcessPool)
                breaks[index] += died
                if not died or breaks[index] >= attempts:
                    yield index, future
                elif breaks[index] == attempts - 1:
                    alone.append(index)
                else:
                    some.append(index)
        source.extendleft(reversed(some))


def _in_one_pool(
    function: Callable[[Job], Result], jobs: Sequence[Job], indices: deque[int], workers: int
) -> Generator[tuple[int, "Future[Result]"], None, None]:
    """Yields jobs as they end; if the pool breaks, those not begun are left in `indices`."""
    # Fresh processes: Drake's systems in Python outlive their diagram, and threads don't survive
    # a fork. For the same reason processes are renewed before they have grown large.
    context = multiprocessing.get_context("spawn")
    under_way: dict[Future[Result], int] = {}
    broken = False
    with ProcessPoolExecutor(workers, context, initializer=_prepare) as pool:
        try:
            while under_way or (indices and not broken):
                # One more for each process, so that none waits for the next.
                while indices and len(under_way) < 2 * workers and not broken:
                    try:
                        with _without_interrupts():
                            future = pool.submit(function, jobs[indices[0]])
                        under_way[future] = indices.popleft()
                    except BrokenProcessPool:
                        broken = True
                for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                    broken = broken or isinstance(future.exception(), BrokenProcessPool)
                    yield under_way.pop(future), future
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


@contextlib.contextmanager
def _without_interrupts() -> Generator[None, None, None]:
    """Holds interrupts back until its end, also in processes that begin inside.

    A terminal interrupts all processes, those too that still import what they need. And one whose
    parent is interrupted while it starts it would wait for words that never come.
    """
    came: list[int] = []
    handlers = {}
    if threading.current_thread() is threading.main_thread():  # No other can set handlers.
        for number in (signal.SIGINT, signal.SIGTERM):
            if callable(signal.getsignal(number)):
                handlers[number] = signal.signal(number, lambda number, frame: came.append(number))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for held, handler in handlers.items():
            signal.signal(held, handler)
        if came:
            signal.raise_signal(came[0])


def _prepare() -> None:
    # Interrupts reach the parent, which then ends the rest in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    # A parent that is killed can't end its processes, and they would wait for jobs for ever.
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
