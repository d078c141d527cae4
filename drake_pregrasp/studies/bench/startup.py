"""How long it takes to import the package, to make a planner's kernel, and to plan at first."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

import drake_pregrasp.studies
from drake_pregrasp.studies.bench.scene import implementations

_SCRIPT = """
import json, sys, time
start = time.perf_counter()
import drake_pregrasp
imported = time.perf_counter()
import numpy as np
from drake_pregrasp.contacts.centroids import select_contacts
from drake_pregrasp.regions.safe_regions import compute_safe_regions
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import make_strategy
from drake_pregrasp.studies.bench.implemented_surface import implemented
surface = drake_pregrasp.box_surface([0.1] * 3, spacing=0.1 / 24)
surface = implemented(surface, sys.argv[1])
kernel = surface.kernel
made = time.perf_counter()
p_OC = surface.p_OQ[::500]
regions = compute_safe_regions(
    surface.p_OQ, p_OC, np.zeros(len(p_OC)), surface.forbidden, kernel=kernel
)
selection = SelectionInput(surface, p_OC, regions, 0.04**2 * np.eye(3))
select_contacts(selection, make_strategy("gii"))
ticked = time.perf_counter()
print(json.dumps([imported - start, made - imported, ticked - made]))
"""


class StartJob(NamedTuple):
    """Fresh processes.

    Attributes:
        processes: How many for each kernel.
        compile: Whether to begin without numba's cache, which takes long.
    """

    processes: int
    compile: bool


class StartTime(NamedTuple):
    """What a fresh process takes, medians, in seconds.

    Attributes:
        implementation: Of the kernel.
        compiles: Whether there was no compiled code yet.
        processes: How many were measured.
        imports: For `import drake_pregrasp`.
        makes: For a surface of 2,304 candidates and its kernel.
        ticks: For the first tick after that.
    """

    implementation: str
    compiles: bool
    processes: int
    imports: float
    makes: float
    ticks: float


def time_starts(job: StartJob) -> list[StartTime]:
    """Times fresh processes, for each kernel that can be made here.

    Compiled code is kept in a folder of its own if there is to be none at first.
    """
    times = []
    with tempfile.TemporaryDirectory() as folder:
        cache = folder if job.compile else None
        for implementation in implementations():
            if job.compile and implementation == "numba":
                times.append(StartTime(implementation, True, 1, *_start(implementation, cache)))
            elif implementation == "numba":
                _start(implementation, cache)  # Whatever has to be compiled is, from then on.
            rows = [_start(implementation, cache) for _ in range(job.processes)]
            medians = np.median(rows, axis=0).tolist()
            times.append(StartTime(implementation, False, job.processes, *medians))
    return times


def _start(implementation: str, cache: str | None) -> list[float]:
    root = Path(drake_pregrasp.studies.__path__[0]).parent.parent
    paths = filter(None, (str(root), os.environ.get("PYTHONPATH")))
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join(paths))
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = cache
    # Safe path: a folder of sources that this is run in would come before the one that is meant.
    command = [sys.executable, "-P", "-c", _SCRIPT, implementation]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    values: list[float] = json.loads(done.stdout)
    return values
