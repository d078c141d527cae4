"""Smoothing: past poses and twists estimated from all measurements, also the later ones."""

from collections.abc import Sequence

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.pose_belief import (
    PoseBelief,
    PoseFilterNoise,
    PoseMeasurement,
    first_belief,
    shifted,
)
from drake_pregrasp.estimation.pose_filter import filter_step, predict, transitions
from drake_pregrasp.geometry.rotations import rotation_vector


def filter_poses(
    times: FloatArray,
    p_WO: FloatArray,
    R_WO: FloatArray,
    noise: PoseFilterNoise,
) -> list[PoseBelief]:
    """Runs the filter over measured poses and returns its belief after each.

    Args:
        times: Times of the measurements, increasing, shape (k,), in seconds.
        p_WO: Measured positions, shape (k, 3), in metres.
        R_WO: Measured orientations, shape (k, 3, 3).
        noise: Noise and motion that the filter assumes.
    """
    beliefs: list[PoseBelief] = []
    for measurement in map(PoseMeasurement, times.tolist(), p_WO, R_WO):
        if beliefs:
            beliefs.append(filter_step(beliefs[-1], measurement, noise)[1].belief)
        else:
            beliefs.append(first_belief(measurement, noise))
    return beliefs


def smooth(beliefs: Sequence[PoseBelief], noise: PoseFilterNoise) -> list[PoseBelief]:
    """Returns the belief at each time given all measurements.

    This is the smoother of Rauch, Tung and Striebel (1965). Backwards in time, with P⁻ the
    covariance that `predict` gives from one belief to the time of the next and C = P Fᵀ (P⁻)⁻¹,

        x_s = x + C (x_s⁺ - x⁻),    P_s = P + C (P_s⁺ - P⁻) Cᵀ.

    For the orientation x_s⁺ - x⁻ is the rotation vector from the predicted to the smoothed one.
    The newest belief stays as it is, because no later measurement can improve it.

    Args:
        beliefs: The beliefs of a single model after each measurement, times increasing.
        noise: Noise and motion that the filter assumed.

    Raises:
        InvalidArgumentError: If the times do not increase.
    """
    smoothed = list(beliefs[-1:])
    for belief, following in zip(beliefs[-2::-1], beliefs[:0:-1], strict=True):
        dt = following.time - belief.time
        if not dt > 0:
            raise InvalidArgumentError(
                f"beliefs must be in the order of time; {following.time} s follows {belief.time} s"
            )
        smoothed.append(_step_back(belief, smoothed[-1], dt, noise))
    return smoothed[::-1]


def _step_back(
    belief: PoseBelief, later: PoseBelief, dt: float, noise: PoseFilterNoise
) -> PoseBelief:
    predicted = predict(belief, dt, noise)
    theta = rotation_vector(later.R_WO[0] @ predicted.R_WO[0].T)
    offset, change = later.p_WCoM - predicted.p_WCoM, later.V_WCoM - predicted.V_WCoM
    difference = np.hstack([theta[None], offset, change, later.b_W - predicted.b_W])
    F = transitions(belief, dt, noise)
    C = np.linalg.solve(predicted.P, F @ belief.P).transpose(0, 2, 1)
    P = belief.P + C @ (later.P - predicted.P) @ C.transpose(0, 2, 1)
    return shifted(belief, np.einsum("kij,kj->ki", C, difference), P)
