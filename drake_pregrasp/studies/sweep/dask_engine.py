"""Makes the runs of a sweep on a Dask cluster."""

import asyncio
import concurrent.futures
import functools
import importlib
import logging
import queue
import threading
from collections.abc import Sequence
from typing import Any

from drake_pregrasp.errors import InvalidArgumentError, OutputError, first_line
from drake_pregrasp.studies.error_words import in_words
from drake_pregrasp.studies.sweep.engines import ATTEMPTS, Ended, Engine, Maker
from drake_pregrasp.studies.sweep.package_digest import differences, package_digest
from drake_pregrasp.studies.sweep.plan import SweepRun

TIMEOUT = 10.0
"""Seconds within which a scheduler has to answer, and to have a worker."""

_LOGGERS = ("distributed", "distributed.client", "distributed.core")
_LOST = ("cancelled", "lost")
_LOOK_PERIOD = 1.0  # Seconds after which to see whether the scheduler is still there.


def dask_engine(address: str) -> Engine:
    """Returns the engine that makes runs on the workers of a Dask scheduler.

    Args:
        address: Of the scheduler, as `tcp://host:8786`.

    Raises:
        InvalidArgumentError: If the extra `sweep` isn't installed, no scheduler answers, it has no
            workers, or their package is another one: they would give other numbers.
    """
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as error:
        raise InvalidArgumentError(
            "--scheduler: needs the extra sweep: pip install 'drake_pregrasp[sweep]'"
        ) from error
    for name in _LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL)  # What matters is said here.
    client = _connect(distributed, address)
    try:
        _check_workers(client, address)
    except BaseException:
        client.close()
        raise
    return functools.partial(_on_cluster, client, address)


def _connect(distributed: Any, address: str) -> Any:
    try:
        return distributed.Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        raise InvalidArgumentError(
            f"--scheduler: {address}: no scheduler answers within {TIMEOUT:g} s:"
            f" {first_line(error)}"
        ) from error


def _check_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=TIMEOUT)
    except (TimeoutError, OSError, concurrent.futures.TimeoutError) as error:
        raise InvalidArgumentError(
            f"--scheduler: {address} has no workers; start some: dask worker {address} --nthreads 1"
        ) from error
    for worker, found in client.run(package_digest, on_error="return").items():
        if isinstance(found, BaseException):
            problem = f"can't import the package: {first_line(found)}"
        elif differing := differences(found, package_digest()):
            problem = f"has another package: {differing}"
        else:
            continue
        raise InvalidArgumentError(f"--scheduler: worker {worker} {problem}")


def _on_cluster(client: Any, address: str, make: Maker, runs: Sequence[SweepRun]) -> Ended:
    # A worker that dies is none of these retries: the scheduler moves its runs by itself.
    # The main thread only waits at a queue: an interrupt inside the client could leave it locked.
    ended: queue.SimpleQueue[tuple[str, list[float] | str | None]] = queue.SimpleQueue()
    try:
        futures = {f.key: f for f in client.map(make, runs, pure=False, retries=ATTEMPTS - 1)}
        run_of = dict(zip(futures, runs, strict=True))
        for future in futures.values():
            future.add_done_callback(lambda future: ended.put((future.key, _found(future))))
        while futures:
            key, found = _next(ended, client, address)
            yield run_of[key], found
            del futures[key]
    finally:
        closing = threading.Thread(target=client.close, daemon=True)
        closing.start()
        closing.join(TIMEOUT)


def _found(future: Any) -> list[float] | str | None:
    """Returns what a run came to; None if it is no longer known of."""
    try:
        if future.status in _LOST:
            return None
        error = future.exception()
        found: list[float] | str = future.result() if error is None else in_words(error)
    except (Exception, asyncio.CancelledError):
        return None
    return found


def _next(
    ended: "queue.SimpleQueue[tuple[str, list[float] | str | None]]", client: Any, address: str
) -> tuple[str, list[float] | str]:
    while client.status == "running" or not ended.empty():
        try:
            key, found = ended.get(timeout=_LOOK_PERIOD)
        except queue.Empty:
            continue
        if found is None:
            break
        return key, found
    raise OutputError(
        f"{address}: the scheduler is gone; the runs so far are kept, and the same command goes on"
    )
