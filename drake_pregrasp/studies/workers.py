"""Calls a function for many independent jobs, in local processes or on a Dask cluster."""

import contextlib
import logging
import multiprocessing
import os
import queue
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, NamedTuple

from threadpoolctl import threadpool_limits

from drake_pregrasp.errors import InvalidArgumentError, OutputError, first_line, one_line
from drake_pregrasp.simulation.output import handling
from drake_pregrasp.studies.package_digest import differences, package_digest

ATTEMPTS = 3
"""Number of times that a job runs alone if its process is killed."""

JOBS_A_WORKER = 100
"""Number of jobs after which a process is replaced: Drake's Python systems are never freed."""

TIMEOUT = 10.0
"""Time in seconds within which a Dask scheduler must answer and have a worker."""

_POLL_PERIOD = 0.2  # Seconds between checks for an interrupt while no job ends.
_MOST_ON_CLUSTER = 1000  # Largest number of jobs that the scheduler has at a time.

# A run with a hand redirects the output of its process, and a Dask worker may have threads.
_ONE_AT_A_TIME = threading.Lock()


class Failure(NamedTuple):
    """Error of a failed job, in one line."""

    error: str


@dataclass(frozen=True)
class _Call:
    """Calls the function in a worker; returns a `Failure`, as not all errors can be pickled."""

    function: Callable[[Any], Any]
    modules: tuple[str, ...]
    package: Mapping[str, str]

    def __call__(self, job: Any) -> Any:
        try:
            with _ONE_AT_A_TIME, threadpool_limits(1, user_api="blas"):
                if differing := differences(package_digest(*self.modules), self.package):
                    raise InvalidArgumentError(f"this worker has another package: {differing}")
                return self.function(job)
        except Exception as error:
            return Failure(one_line(error))


def call_for_all(
    function: Callable[[Any], Any],
    jobs: Sequence[Any],
    on_result: Callable[[int, Any], None],
    *,
    modules: Sequence[str] = (),
    processes: int | None = None,
    scheduler: str | None = None,
) -> None:
    """Calls a function for each job in parallel, and passes results on as they arrive.

    Args:
        function: Function that can be pickled: a module's function, or a `partial` of one.
        jobs: Arguments of the calls.
        on_result: Called in this process with the index of a job, and its result or a `Failure`.
        modules: Names of the modules whose source must be the same in all workers.
        processes: Number of local processes; the number of processors if not set.
        scheduler: Address of a Dask scheduler whose workers replace the local processes.

    Raises:
        InvalidArgumentError: If the scheduler or its workers cannot be used.
        OutputError: If the connection to the scheduler is lost.
        KeyboardInterrupt: If SIGINT or SIGTERM arrives; no further job is started.
    """
    call = _Call(function, tuple(modules), package_digest(*modules))
    with _noted_interrupts() as interrupted:
        dispatcher = _Dispatcher(call, jobs, on_result, interrupted)
        if scheduler is None:
            dispatcher.call_locally(processes or os.cpu_count() or 1)
        else:
            dispatcher.call_on_cluster(scheduler)


@dataclass(frozen=True)
class _Dispatcher:
    call: _Call
    jobs: Sequence[Any]
    on_result: Callable[[int, Any], None]
    interrupted: threading.Event

    def call_locally(self, workers: int) -> None:
        untried = deque(range(len(self.jobs)))
        suspects: deque[int] = deque()
        kills: Counter[int] = Counter()
        killed: list[int] = []

        def on_end(index: int, future: "Future[Any]") -> None:
            if _is_broken(future):
                killed.append(index)
            else:
                self.on_result(index, _result(future))

        while untried or suspects:
            # One of several jobs in a broken pool killed its process, or never started: they are
            # tried alone later, and only kills of a job that ran alone count.
            source = untried or suspects
            most = min(len(untried), JOBS_A_WORKER * workers) or 1
            batch = deque(source.popleft() for _ in range(most))
            # Threads do not survive a fork, so processes are spawned.
            context = multiprocessing.get_context("spawn")
            processes = min(workers, most)
            with ProcessPoolExecutor(processes, context, initializer=_prepare_worker) as pool:
                try:
                    # Two jobs for each process, so that no process is idle.
                    self._drain(pool, batch, 2 * processes, on_end)
                except BaseException:
                    pool.shutdown(wait=False, cancel_futures=True)
                    raise
            source.extendleft(reversed(batch))
            for index in killed:
                kills[index] += most == 1
                if kills[index] < ATTEMPTS:
                    suspects.append(index)
                else:
                    self.on_result(index, Failure(f"its process was killed, {ATTEMPTS} times"))
            killed.clear()

    def call_on_cluster(self, address: str) -> None:
        with _connected(address, self.call) as client:

            def check(is_fine: bool) -> None:
                if not is_fine:
                    problem = "the scheduler is gone; results so far are stored, and the same"
                    raise OutputError(f"{address}: {problem} command resumes the study")

            def on_end(index: int, future: "Future[Any]") -> None:
                check(not future.cancelled())
                self.on_result(index, _result(future))

            # The scheduler itself moves the jobs of a killed worker to other workers.
            executor = client.get_executor(pure=False)
            indices = deque(range(len(self.jobs)))
            self._drain(
                executor,
                indices,
                _MOST_ON_CLUSTER,
                on_end,
                lambda: check(client.status == "running"),
            )

    def _drain(
        self,
        executor: Executor,
        indices: deque[int],
        most: int,
        on_end: Callable[[int, "Future[Any]"], None],
        on_idle: Callable[[], None] = lambda: None,
    ) -> None:
        """Submits jobs, `most` at a time, until all have ended or a process is killed."""
        ended: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        index_of: dict[Future[Any], int] = {}
        broken = False
        while index_of or (indices and not broken):
            while indices and len(index_of) < most and not broken:
                try:
                    with _sigint_blocked():  # Local processes inherit the mask while they import.
                        future = executor.submit(self.call, self.jobs[indices[0]])
                except BrokenProcessPool:
                    broken = True
                else:
                    index_of[future] = indices.popleft()
                    future.add_done_callback(ended.put)
            if self.interrupted.is_set():
                raise KeyboardInterrupt
            try:
                future = ended.get(timeout=_POLL_PERIOD if index_of else 0)
            except queue.Empty:
                on_idle()
                continue
            broken = broken or _is_broken(future)
            on_end(index_of.pop(future), future)


def _is_broken(future: "Future[Any]") -> bool:
    return not future.cancelled() and isinstance(future.exception(), BrokenProcessPool)


@contextlib.contextmanager
def _connected(address: str, call: _Call) -> Iterator[Any]:
    import distributed

    for name in ("distributed", "distributed.client", "distributed.core"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # Errors are reported here.
    try:
        client = distributed.Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        raise InvalidArgumentError(
            f"--scheduler: {address}: no scheduler answers within {TIMEOUT:g} s:"
            f" {first_line(error)}"
        ) from error
    try:
        _check_workers(client, address, call)
        yield client
    finally:
        # A client whose scheduler is gone may never close.
        closing = threading.Thread(target=client.close, daemon=True)
        closing.start()
        closing.join(TIMEOUT)


def _check_workers(client: Any, address: str, call: _Call) -> None:
    try:
        client.wait_for_workers(1, timeout=TIMEOUT)
    except OSError as error:  # Includes TimeoutError.
        raise InvalidArgumentError(
            f"--scheduler: {address} has no workers; start some: dask worker {address} --nthreads 1"
        ) from error
    found = client.run(package_digest, *call.modules, on_error="return")
    for worker, theirs in found.items():
        if isinstance(theirs, BaseException):
            problem = f"cannot import the package: {first_line(theirs)}"
        elif differing := differences(theirs, call.package):
            problem = f"has another package: {differing}"
        else:
            continue
        raise InvalidArgumentError(f"--scheduler: worker {worker} {problem}")


def _result(future: "Future[Any]") -> Any:
    try:
        return future.result()
    except Exception as error:  # The result cannot be pickled, or Dask has failed.
        return Failure(one_line(error))


@contextlib.contextmanager
def _noted_interrupts() -> Generator[threading.Event, None, None]:
    """Sets an event on SIGINT or SIGTERM; an exception could leave a pool or a client locked."""
    came = threading.Event()
    # Other threads cannot set handlers; and what the parent ignores stays ignored.
    is_main = threading.current_thread() is threading.main_thread()
    numbers = (signal.SIGINT, signal.SIGTERM)
    handled = [n for n in numbers if is_main and callable(signal.getsignal(n))]
    with handling(lambda number, frame: came.set(), *handled):
        yield came


@contextlib.contextmanager
def _sigint_blocked() -> Generator[None, None, None]:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _prepare_worker() -> None:
    # A terminal interrupts all processes; this one leaves its end to the parent.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    # A killed parent cannot end its processes, which would wait for jobs forever.
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
