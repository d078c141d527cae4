"""Trials that simulate nothing, with rows as a simulation might give."""

import math
import zlib

import numpy as np

from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.grasp_outcome import TrialJob
from drake_pregrasp.studies.static_versus_dynamic.methods import METHODS

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
"""Shares of clean grasps by method; under turning and noise the tested one isn't ahead of all."""


def made_up_trial(job: TrialJob) -> list[dict[str, object]]:
    """Returns rows that follow from the job alone; all methods share a seed's luck in part."""
    luck = np.random.default_rng((zlib.crc32(job.condition.encode()), job.seed)).uniform()
    own = np.random.default_rng((zlib.crc32(repr(tuple(job)).encode()), job.seed))
    return [made_up_row(job, t, luck, own) for t in CONDITIONS[job.condition].closing_times]


def made_up_row(job: TrialJob, close_at: float, luck: float, own) -> dict[str, object]:
    skill = SKILL[job.condition][list(METHODS).index(job.method)]
    clean = bool(0.4 * luck + 0.6 * own.uniform() < skill)
    lifted = clean or own.uniform() < 0.3
    contacts = lifted or own.uniform() < 0.8
    area = job.condition in ("wall", "headline", "sphere")
    return {
        "close_at": close_at,
        "lifted": lifted,
        "pushed_before_mm": own.exponential(0.4) if clean else own.exponential(60),
        "turned_before_deg": own.exponential(0.3),
        "pushed_closing_mm": own.exponential(1.2),
        "slip_mm": own.uniform(0.2, 0.9) if lifted else math.nan,
        "tilt_deg": own.exponential(1.0),
        "residual_n": own.exponential(0.01 if clean else 1.0) if contacts else math.nan,
        "fingers": int(own.integers(2, 6)),
        "waited_s": own.exponential(0.3),
        "withdrawn": float(own.integers(0, 3)),
        "goal_in_area": (0.0 if job.method.startswith("dynamic") else 0.85) if area else math.nan,
        "tip_in_area": own.uniform(0, 0.1) if area else math.nan,
        "q_msv": own.normal(1.9 if clean else 1.6, 0.15) if contacts else math.nan,
        "q_gii": own.normal(0.97 if clean else 0.9, 0.03) if contacts else math.nan,
        "gave_up": "" if contacts else "finger 2 met <nothing> & stopped",
        "clean": clean,
    }


def failing_trial(job: TrialJob) -> list[dict[str, object]]:
    """Fails for one method and seed."""
    if (job.method, job.seed) == ("fixed_plan", 0):
        raise ValueError("no <b>luck\nat all")
    return made_up_trial(job)
