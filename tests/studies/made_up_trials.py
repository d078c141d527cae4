"""Trials that simulate nothing, with rows as a simulation might give."""

import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import fields

import numpy as np
import pandas as pd
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.grasp_outcome import Outcome, TrialJob
from pydrake.math import RigidTransform, RotationMatrix

from drake_pregrasp.systems.loggers import GraspRecord

MEASURES = [field.name for field in fields(Outcome) if field.type in (int, float)]
Rows = list[dict[str, object]]


def made_up_trial(job: TrialJob) -> Rows:
    """Returns rows that follow from the job alone."""
    rng = np.random.default_rng((zlib.crc32(repr(tuple(job)).encode()), job.seed))
    return [made_up_row(time, rng) for time in CONDITIONS[job.condition].closing_times]


def made_up_row(close_at: float, rng: np.random.Generator) -> dict[str, object]:
    luck = rng.random()
    row = {name: rng.exponential() if luck < 0.9 else math.nan for name in MEASURES}
    reason = "" if luck < 0.9 else "finger 2 met <nothing> & stopped"
    row |= {"close_at": close_at, "fingers": int(rng.integers(2, 6)), "gave_up": reason}
    return row | {"lifted": luck < 0.7, "clean": luck < 0.5}


def failing_trial(job: TrialJob) -> Rows:
    """Fails for one method and seed."""
    if (job.method, job.seed) == ("fixed_plan", 0):
        raise ValueError("no <b>luck\nat all")
    return made_up_trial(job)


def record(time, phase, *, lift=0.0, slid=0.0, slip=0.0, tilt=0.0, links=(0.0, 0.0, 0.0)):
    """Returns the record of a tick at which five fingertips are around a cube."""
    R = RotationMatrix.MakeXRotation(tilt)
    X_WO = RigidTransform(R, [slid, 0.0, 0.05 + lift])
    tips = np.array([[0.059, 0, 0], [-0.059, 0.01, 0], [0, 0.059, 0], [0, -0.059, 0], [0, 0, 0.2]])
    tips[0, 1] += slip
    return GraspRecord(
        time=time,
        report=np.array([phase, 0.0, 0.0, 0.0]),
        p_WT=(X_WO @ tips.T).T,
        p_GT=tips,
        f_T_W=np.zeros((5, 3)),
        X_WG=X_WO,
        X_WO=X_WO,
        X_WD=RigidTransform(),
        link_forces=np.array(links),
    )


def state_of(context):
    """Returns the time and the discrete state of a diagram."""
    groups = range(context.num_discrete_state_groups())
    values = [context.get_discrete_state(group).value() for group in groups]
    return np.concatenate([[context.get_time()], *values])


def rows_of(jobs: Sequence[TrialJob], trial: Callable[[TrialJob], Rows] = made_up_trial):
    """Returns the table of all rows of trials."""
    return pd.DataFrame([job._asdict() | row for job in jobs for row in trial(job)])
