"""Many closings from one tracking run, for the strip charts, kept so that they are made once."""

import contextlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_pregrasp.simulation.output import reading_back, without_solver_chatter, write_text
from drake_pregrasp.studies.processes import as_they_end
from drake_pregrasp.studies.settings_file import digest
from drake_pregrasp.studies.static_versus_dynamic.outcome import TrialJob
from drake_pregrasp.studies.static_versus_dynamic.strip_charts import Strip
from drake_pregrasp.studies.static_versus_dynamic.study_settings import study_settings
from drake_pregrasp.studies.static_versus_dynamic.trial import Trial

CLOSINGS = "closings.json"
"""The file they are kept in, in the study's folder."""

CLOSING_TIMES = tuple(0.5 * k for k in range(1, 25))
"""When the hand is told to close, in seconds; a tracking run for each arm goes on to the last."""


def make_strip(job: TrialJob) -> Strip:
    """Makes a trial with all those closings.

    It runs in another process, so it is a module's function.
    """
    with without_solver_chatter():
        trial = Trial(job)
        closings = [(o.close_at, o.clean) for o in trial.outcomes(CLOSING_TIMES)]
    distances = np.array([look.distance for look in trial.looks])
    return Strip(
        arm=job.arm,
        time=np.array([look.time for look in trial.looks]),
        usable=np.array([float(look.usable) for look in trial.looks]),
        clearance_mm=np.where(np.isfinite(distances), 1e3 * distances, np.nan),
        closings=closings,
    )


def strips_of(
    folder: Path,
    jobs: Sequence[TrialJob],
    make: Callable[[TrialJob], Strip] = make_strip,
    *,
    processes: int | None = None,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Strip]:
    """Returns the strip of each trial; those that are not kept yet are made, and kept as they end.

    Args:
        folder: Of the study.
        jobs: The trials.
        make: Makes one, in another process.
        processes: How many at a time; as many as there are processors if not set.
        on_progress: Called with the number of strips made and of those that were missing.

    Raises:
        OutputError: If what is kept can't be read or written.
    """
    path = folder / CLOSINGS
    kept = _read(path)
    settings = digest({**study_settings(), "closing_times": CLOSING_TIMES})
    keys = [f"{job}, settings {settings}" for job in jobs]
    missing = [(key, job) for key, job in zip(keys, jobs, strict=True) if key not in kept]
    on_progress(0, len(missing))
    ended = as_they_end(make, [job for _, job in missing], processes=processes)
    with contextlib.closing(ended):
        for done, (index, future) in enumerate(ended, start=1):
            kept[missing[index][0]] = _said(future.result())
            write_text(path, json.dumps(kept, sort_keys=True) + "\n")
            on_progress(done, len(missing))
    return [_strip(kept[key]) for key in keys]


def _read(path: Path) -> dict[str, Any]:
    if not path.exists():
        return {}
    with reading_back(path):
        text = path.read_text(encoding="utf-8")
    try:
        kept = json.loads(text)
    except ValueError:  # Of a run that was killed while it wrote: they are made again.
        return {}
    return kept if isinstance(kept, dict) else {}


def _said(strip: Strip) -> dict[str, Any]:
    said = {name: np.asarray(value).tolist() for name, value in strip._asdict().items()}
    said["clearance_mm"] = [None if math.isnan(mm) else mm for mm in said["clearance_mm"]]
    return said | {"arm": strip.arm, "closings": strip.closings}


def _strip(said: Mapping[str, Any]) -> Strip:
    clearances = [math.nan if mm is None else mm for mm in said["clearance_mm"]]
    return Strip(
        arm=said["arm"],
        time=np.array(said["time"]),
        usable=np.array(said["usable"]),
        clearance_mm=np.array(clearances),
        closings=[(time, clean) for time, clean in said["closings"]],
    )
