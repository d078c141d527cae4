"""What look-back gains: filtered against smoothed past poses."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import FloatArray, pack
from drake_pregrasp.config.planner_config import filter_noise
from drake_pregrasp.estimation.pose_filter import PoseBelief
from drake_pregrasp.estimation.pose_smoother import filter_poses, smooth
from drake_pregrasp.studies.lookahead_runs import (
    PERIOD,
    LookaheadJob,
    LookaheadRun,
    lookahead_scenario,
)


class LookbackErrors(NamedTuple):
    """Root mean square errors of past poses.

    Attributes:
        position: In metres.
        orientation: In radians.
        velocity: In m/s.
    """

    position: float
    orientation: float
    velocity: float


def lookback_errors(
    job: LookaheadJob, run: LookaheadRun
) -> tuple[LookbackErrors, LookbackErrors, bool]:
    """Measures a run's true poses with noise, filters and smooths them.

    Returns:
        The errors of the filter's beliefs, of the smoothed ones, and whether the newest are equal.
    """
    scenario = lookahead_scenario(job)
    noise = filter_noise(scenario.planner.estimator)
    rng = np.random.default_rng(job.seed)
    n_p, n_R = rng.standard_normal((2, len(run.p_WO), 3))
    turns = Rotation.from_rotvec(scenario.sensor.orientation_std * n_R)
    R_WO = Rotation.from_quat(run.R_WO)
    times: FloatArray = PERIOD * np.arange(len(run.p_WO), dtype=float)
    beliefs = filter_poses(
        times,
        run.p_WO + scenario.sensor.position_std * n_p,
        (turns * R_WO).as_matrix(),
        noise,
    )
    smoothed = smooth(beliefs, noise)
    v_WO = np.gradient(run.p_WO, PERIOD, axis=0)
    same = bool(np.array_equal(pack(beliefs[-1]), pack(smoothed[-1])))
    return (
        _errors(beliefs, run.p_WO, R_WO, v_WO),
        _errors(smoothed, run.p_WO, R_WO, v_WO),
        same,
    )


def _errors(
    beliefs: Sequence[PoseBelief], p_WO: FloatArray, R_WO: Rotation, v_WO: FloatArray
) -> LookbackErrors:
    past = slice(1, -1)  # Where the true velocity is a central difference.
    p = np.array([belief.p_WCoM for belief in beliefs]) - p_WO
    v = np.array([belief.v_WCoM for belief in beliefs]) - v_WO
    R = Rotation.from_matrix([belief.R_WO for belief in beliefs])
    theta = (R * R_WO.inv()).as_rotvec()
    return LookbackErrors(*(_rms(e[past]) for e in (p, theta, v)))


def _rms(vectors: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))
