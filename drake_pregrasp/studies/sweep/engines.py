"""Where the runs of a sweep are made: one way to ask for them, whoever does the work."""

import contextlib
import functools
from collections.abc import Callable, Generator, Sequence
from concurrent.futures.process import BrokenProcessPool
from typing import Protocol

from drake_pregrasp.studies.error_words import in_words
from drake_pregrasp.studies.processes import as_they_end
from drake_pregrasp.studies.sweep.plan import SweepRun

ATTEMPTS = 3
"""How often a run is begun whose process ends without a word."""

Maker = Callable[[SweepRun], list[float] | str]
"""Makes a run: its measures, or in words why there are none."""

Ended = Generator[tuple[SweepRun, list[float] | str], None, None]
"""Runs as they end, with what the maker returned."""


class Engine(Protocol):
    """Makes runs, and yields them as they end; closed, it leaves those that wait."""

    def __call__(self, make: Maker, runs: Sequence[SweepRun]) -> Ended:
        """Makes them."""


def local_engine(processes: int | None) -> Engine:
    """Returns the engine that makes runs in processes of this machine.

    Args:
        processes: How many at a time; as many as there are processors if not set.
    """
    return functools.partial(_in_processes, processes=processes)


def _in_processes(make: Maker, runs: Sequence[SweepRun], *, processes: int | None) -> Ended:
    ended = as_they_end(make, runs, processes=processes, attempts=ATTEMPTS)
    with contextlib.closing(ended):
        for index, future in ended:
            try:
                yield runs[index], future.result()
            except BrokenProcessPool:
                yield runs[index], f"its process ended without a word, {ATTEMPTS} times"
            except Exception as error:
                yield runs[index], in_words(error)
