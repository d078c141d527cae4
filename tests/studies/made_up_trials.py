"""Trials that simulate nothing, with rows as a simulation might give."""

import math
import os
import pickle
import time
import zlib
from concurrent.futures import Future
from pathlib import Path

import numpy as np

from drake_pregrasp import ScenarioError
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.outcome import Outcome, TrialJob
from drake_pregrasp.studies.static_versus_dynamic.strip_charts import Strip

SKILL = {
    "nominal": (0.3, 0.9, 0.98, 0.97, 0.97, 0.98, 0.98),
    "one_lost": (0.2, 0.8, 0.93, 0.93, 0.9, 0.97, 0.98),
    "two_lost": (0.1, 0.35, 0.6, 0.6, 0.55, 0.9, 0.95),
    "turning": (0.05, 0.1, 0.1, 0.96, 0.98, 0.1, 0.97),
    "wall": (0.02, 0.2, 0.35, 0.35, 0.2, 0.9, 0.95),
    "headline": (0.0, 0.02, 0.05, 0.25, 0.15, 0.2, 0.97),
    "sphere": (0.1, 0.4, 0.45, 0.45, 0.4, 0.92, 0.93),
    "noise": (0.2, 0.7, 0.9, 0.9, 0.98, 0.7, 0.72),
}
"""Shares of clean grasps by arm; under turning and noise the tested arm isn't ahead of all."""

ARM_ORDER = ("world", "carried", "frozen", "reassigned", "still", "dynamic", "dynamic_reach")


def made_up_trial(job: TrialJob) -> list[Outcome]:
    """Returns rows that follow from the job alone; all arms share a seed's luck in part."""
    luck = np.random.default_rng((zlib.crc32(job.condition.encode()), job.seed)).uniform()
    own = np.random.default_rng((zlib.crc32(repr(tuple(job)).encode()), job.seed))
    return [made_up_outcome(job, t, luck, own) for t in CONDITIONS[job.condition].closing_times]


def made_up_outcome(job: TrialJob, close_at: float, luck: float, own) -> Outcome:
    skill = SKILL[job.condition][ARM_ORDER.index(job.arm)]
    clean = 0.4 * luck + 0.6 * own.uniform() < skill
    lifted = clean or own.uniform() < 0.3
    contacts = lifted or own.uniform() < 0.8
    area = job.condition in ("wall", "headline", "sphere")
    return Outcome(
        *job,
        close_at,
        lifted=lifted,
        level=lifted,
        pushed_before_mm=own.exponential(0.4) if clean else own.exponential(60),
        turned_before_deg=own.exponential(0.3),
        pushed_closing_mm=min(own.exponential(1.2), 4.9) if clean else own.exponential(6),
        slip_mm=own.uniform(0.2, 0.9) if lifted else math.nan,
        tilt_deg=own.exponential(1.0),
        residual_n=own.exponential(0.01 if clean else 1.0) if contacts else math.nan,
        fingers=int(own.integers(4, 6) if clean else own.integers(2, 6)) if contacts else 0,
        waited_s=min(own.exponential(0.3), 1.5),
        withdrawn=float(own.integers(0, 3)),
        goal_in_area=(0.0 if job.arm.startswith("dynamic") else 0.85) if area else math.nan,
        tip_in_area=own.uniform(0, 0.1) if area else math.nan,
        q_msv=own.normal(1.9 if clean else 1.6, 0.15) if contacts else math.nan,
        q_gii=own.normal(0.97 if clean else 0.9, 0.03) if contacts else math.nan,
        gave_up="" if contacts else "fewer than two contacts <after 1.5 s> & none left",
    )


def failing_trial(job: TrialJob) -> list[Outcome]:
    """Fails in three ways, one of them with an error that can't be sent to another process."""
    if (job.arm, job.seed) == ("frozen", 0):
        raise ScenarioError("somewhere", "key", "doesn't fit,\nnot at all")
    if (job.arm, job.seed) == ("still", 0):
        return made_up_trial(job)[:-1]
    if (job.arm, job.seed) == ("dynamic_reach", 1):
        return None
    return made_up_trial(job)


def slow_trial(job: TrialJob) -> list[Outcome]:
    """Takes as long as a simulation might."""
    time.sleep(0.3)
    return made_up_trial(job)


def dying_trial(job: TrialJob) -> list[Outcome]:
    """Ends its process without a word."""
    if job.seed == 1:
        os._exit(7)
    return made_up_trial(job)


def at_once(function, jobs, *, processes=None):
    """Does what `as_they_end` does without processes, but for the order, which is reversed.

    All goes through pickle there and back, as it would with processes.
    """
    for index, job in reversed(list(enumerate(jobs))):
        sent_function, sent_job = pickle.loads(pickle.dumps((function, job)))
        future = Future()
        future.set_result(pickle.loads(pickle.dumps(sent_function(sent_job))))
        yield index, future


def made_up_strip(folder: Path, job: TrialJob) -> Strip:
    """Returns a strip that follows from the job alone, and leaves a file that says so."""
    (folder / f"{job.arm}_{job.seed}").touch(exist_ok=False)
    rng = np.random.default_rng(zlib.crc32(repr(tuple(job)).encode()))
    clearance = np.where(np.arange(4) == 2, np.nan, rng.normal(size=4))
    closings = [(0.5, True), (1.0, bool(rng.integers(2)))]
    return Strip(job.arm, rng.uniform(size=4), np.arange(4.0), clearance, closings)


def main() -> None:
    """Runs the command with slow trials: `python made_up_trials.py --out ...`."""
    import argparse
    import sys

    from drake_pregrasp.studies.static_versus_dynamic.command import add_command
    from drake_pregrasp.studies.static_versus_dynamic.experiment import Experiment

    parser = argparse.ArgumentParser()
    add_command(parser.add_subparsers(), lambda: Experiment(slow_trial, {}))
    options = parser.parse_args(["static-versus-dynamic", *sys.argv[1:]])
    sys.exit(options.command(options))


if __name__ == "__main__":
    main()
