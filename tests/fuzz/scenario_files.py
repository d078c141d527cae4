"""Loads many bad scenario files, and reports the outcomes.

    python -m tests.fuzz.scenario_files --count 100000 --seed 0

Each is to be accepted, or refused in one printable line, within a time and a memory.
"""

import contextlib
import multiprocessing
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from command_line import Result, main
from scenario_cases import Case, make_case

from drake_pregrasp.errors import LONGEST_KEY, LONGEST_MESSAGE, PregraspError
from drake_pregrasp.simulation.scenario_file import load_resolved
from drake_pregrasp.simulation.simulation_diagram import make_diagram

SECONDS = 10.0
"""Longest that one file may take, of processor time: other processes do not count."""

BATCH = 1000
"""Files that one process loads: Drake keeps some memory for each diagram."""

BUILT = 50
"""One in so many of the files has its diagram built."""

MEMORY = 2**30
"""Bytes of address space that the process which loads may take beyond those it starts with."""

GOOD = ("accepted", "refused")
"""Outcomes that are as they should be; all others are failures."""

_LONGEST = 2 * LONGEST_MESSAGE + LONGEST_KEY
_LAST = 3 * SECONDS  # Of processor time, until the kernel ends a process that ignores timers.
_PATIENCE = 12 * SECONDS  # Until a process that takes no processor time is killed.


class _TooSlow(BaseException):
    """Not an `Exception`, so that nobody takes it for a fault of a file."""


def load(case: Case, folder: Path, *, build: bool = False) -> tuple[str, str]:
    """Returns what came of a case, and what was said; on demand its diagram is built, too."""
    file = folder / "case.yaml"
    file.write_bytes(case.text)
    for name, data in case.files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)

    def read() -> None:
        resolved = load_resolved(case.name, file=file)
        if build:
            make_diagram(resolved)

    return outcome_of(read)


def outcome_of(read: Callable[[], object]) -> tuple[str, str]:
    """Returns what came of a function that reads files, and what was said."""
    try:
        with _timer():
            read()
    except PregraspError as error:
        said = str(error)
        fits = said.isprintable() and 0 < len(said) <= _LONGEST
        return ("refused" if fits else "unprintable"), said
    except _TooSlow:
        return "slow", ""
    except (Exception, SystemExit):
        return "traceback", traceback.format_exc()
    return "accepted", ""


@contextlib.contextmanager
def _timer() -> Iterator[None]:
    def stop(number: int, frame: object) -> None:
        raise _TooSlow

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


Check = Callable[[int, int, Path], tuple[str, str, str]]
"""Makes and reads a case of a seed, a number and a folder; returns kind, outcome and failure."""


def _work(
    check: Check, seed: int, first: int, end: int, folder: Path, connection: Connection
) -> None:
    tempfile.tempdir = str(folder)  # What this process leaves goes with it.
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())  # Drake's parser is chatty.
    for number in range(first, end):
        start = time.process_time()
        # The kernel ends a process that ignores timers.
        resource.setrlimit(resource.RLIMIT_CPU, (int(start + _LAST), resource.RLIM_INFINITY))
        kind, outcome, failure = check(seed, number, folder)
        connection.send(Result(number, kind, outcome, failure, time.process_time() - start))


def _check(seed: int, number: int, folder: Path) -> tuple[str, str, str]:
    case = make_case(seed, number)
    outcome, said = load(case, folder, build=number % BUILT == 0)
    return case.kind, outcome, "" if outcome in GOOD else f"{case}\n{said}"


def results(seed: int, first: int, end: int) -> Iterator[Result]:
    """Yields what came of the files of a seed from a number up to another."""
    make_diagram(load_resolved("a_base"))  # Compiling counts for no file.
    yield from checked(_check, seed, first, end)


def checked(check: Check, seed: int, first: int, end: int) -> Iterator[Result]:
    """Yields what came of the cases of a check, which processes of bounded memory make."""
    context = multiprocessing.get_context("fork")
    shared = Path("/dev/shm")  # In memory, where there is such a folder.
    with tempfile.TemporaryDirectory(dir=shared if shared.is_dir() else None) as folder:
        while first < end:
            ours, theirs = context.Pipe(duplex=False)
            last = min(end, first + BATCH)
            process = context.Process(
                target=_work, args=(check, seed, first, last, Path(folder), theirs)
            )
            process.start()
            theirs.close()
            try:
                while first < last and ours.poll(_PATIENCE):
                    yield ours.recv()
                    first += 1
            except EOFError:
                pass
            finally:
                process.kill()
                process.join()
            if first < last:
                yield Result(first, "", "died", f"status {process.exitcode}", _LAST)
                first += 1


if __name__ == "__main__":
    sys.exit(main(__doc__, results))
