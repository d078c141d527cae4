"""Makes the runs of a sweep on a Dask cluster."""

import concurrent.futures
import functools
import importlib
import logging
from collections.abc import Sequence
from typing import Any

from drake_pregrasp.errors import InvalidArgumentError, OutputError, first_line
from drake_pregrasp.studies.error_words import in_words
from drake_pregrasp.studies.sweep.engines import ATTEMPTS, Ended, Engine, Maker
from drake_pregrasp.studies.sweep.package_digest import differences, package_digest
from drake_pregrasp.studies.sweep.plan import SweepRun

TIMEOUT = 10.0
"""Seconds within which a scheduler has to answer, and to have a worker."""

_LOST = ("cancelled", "lost")


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
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # What matters is said here.
    client = _connect(distributed, address)
    try:
        _check_workers(client, address)
    except BaseException:
        client.close()
        raise
    return functools.partial(_on_cluster, distributed, client, address)


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


def _on_cluster(
    distributed: Any, client: Any, address: str, make: Maker, runs: Sequence[SweepRun]
) -> Ended:
    # A worker that dies is none of these retries: the scheduler moves its runs by itself.
    futures = client.map(make, runs, pure=False, retries=ATTEMPTS - 1)
    run_of = {future.key: run for future, run in zip(futures, runs, strict=True)}
    try:
        ended = distributed.as_completed(futures, loop=client.loop)
        del futures
        for future in ended:
            if future.status in _LOST:
                raise OutputError(
                    f"{address}: the scheduler is gone; the runs so far are kept,"
                    " and the same command goes on"
                )
            error = future.exception()
            run = run_of.pop(future.key)
            yield run, future.result() if error is None else in_words(error)
            future.release()
    finally:
        client.close()
