"""Look-back: past poses and twists in the light of all measurements, also the later ones."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.pose_filter import (
    PoseBelief,
    PoseFilterNoise,
    first_belief,
    predict,
    transitions,
    update,
)
from drake_pregrasp.geometry.rotations import rotation_matrix, rotation_vector


def filter_poses(
    times: FloatArray,
    p_WCoM: FloatArray,
    R_WO: FloatArray,
    noise: PoseFilterNoise,
    p_OCoM: FloatArray | None = None,
) -> list[PoseBelief]:
    """Runs the filter over measured poses and returns its belief after each.

    Args:
        times: When they were measured, increasing, shape (k,), in seconds.
        p_WCoM: Where they put the centre of mass, shape (k, 3), in metres.
        R_WO: Measured orientations, shape (k, 3, 3).
        noise: What the filter assumes.
        p_OCoM: See `measurement_covariance`.
    """
    beliefs: list[PoseBelief] = []
    for time, p, R in zip(times, p_WCoM, R_WO, strict=True):
        if beliefs:
            prior = predict(beliefs[-1], float(time) - beliefs[-1].time, noise)
            beliefs.append(update(prior, p, R, noise, p_OCoM))
        else:
            beliefs.append(first_belief(float(time), p, R, noise, p_OCoM))
    return beliefs


def smooth(beliefs: Sequence[PoseBelief], noise: PoseFilterNoise) -> list[PoseBelief]:
    """Returns what is believed of each time once all measurements are known.

    The smoother of Rauch, Tung and Striebel (1965): backwards in time, with P⁻ the covariance that
    `predict` gives from one belief to the time of the next and C = P Fᵀ (P⁻)⁻¹,

        x_s = x + C (x_s⁺ - x⁻),    P_s = P + C (P_s⁺ - P⁻) Cᵀ.

    For the orientation x_s⁺ - x⁻ is the rotation vector from the predicted to the smoothed one.
    The newest belief stays as it is: later measurements are what smoothing takes its gain from.

    Args:
        beliefs: The filter's beliefs after each measurement, times increasing.
        noise: What the filter assumed.

    Raises:
        InvalidArgumentError: If the times don't increase.
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
    F_position, F_orientation = transitions(belief, dt)
    dx, P_position = _correct_back(
        belief.P_position,
        predicted.P_position,
        later.P_position,
        F_position,
        np.concatenate([later.p_WCoM - predicted.p_WCoM, later.v_WCoM - predicted.v_WCoM]),
    )
    theta = rotation_vector(later.R_WO @ predicted.R_WO.T)
    de, P_orientation = _correct_back(
        belief.P_orientation,
        predicted.P_orientation,
        later.P_orientation,
        F_orientation,
        np.concatenate([theta, later.w_WO - predicted.w_WO]),
    )
    return replace(
        belief,
        p_WCoM=belief.p_WCoM + dx[:3],
        v_WCoM=belief.v_WCoM + dx[3:],
        R_WO=rotation_matrix(de[:3]) @ belief.R_WO,
        w_WO=belief.w_WO + de[3:],
        P_position=P_position,
        P_orientation=P_orientation,
    )


def _correct_back(
    P: FloatArray, P_predicted: FloatArray, P_later: FloatArray, F: FloatArray, dx: FloatArray
) -> tuple[FloatArray, FloatArray]:
    C = np.linalg.solve(P_predicted, F @ P).T
    return C @ dx, P + C @ (P_later - P_predicted) @ C.T
