"""Correction of an object's estimated pose by the fingertips that touch it."""

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.geometry.rotations import rotation_matrix

LARGEST_SHIFT, LARGEST_TURN = 0.03, 0.3
"""Largest correction of the position, in metres, and of the yaw, in radians."""

_STD = np.array([0.01, 0.01, 0.09])  # Of the estimate: x and y in metres, and yaw in radians.
_TOUCH_STD = 0.001  # Of the gap of a fingertip that touches, in metres.


def touch_correction(gaps: FloatArray, rows: FloatArray, touching: BoolArray) -> FloatArray:
    """Returns the displacement of an object on which fingertips touch its surface, shape (3,).

    A fingertip that touches at the gap g_i from the estimated surface says that the surface is
    there. With the standard deviations σ of a gap and S of the estimate, it is the ξ = (x, y, yaw)
    that minimizes

        Σ (g_i - a_i ξ)²/σ² + |S⁻¹ ξ|²   over the fingertips i that touch.

    It is zero without touch, and touches from opposite sides cancel.

    Args:
        gaps: Signed gaps between the fingertips and the estimated surface, shape (n,), in metres.
        rows: Displacement a_i of the surface along the normal at each fingertip, by unit
            displacements along x and y in metres and by unit yaw in radians, shape (n, 3).
        touching: Mask of the fingertips that touch, shape (n,).
    """
    A = rows[touching] * _STD / _TOUCH_STD
    scaled = np.linalg.solve(A.T @ A + np.eye(3), A.T @ gaps[touching] / _TOUCH_STD)
    return np.asarray(_STD * scaled)


def corrected_pose(
    R_WO: FloatArray, p_WO: FloatArray, p_OCoM: FloatArray, offset: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Returns orientation and position of an object that is displaced by an offset (x, y, yaw).

    Args:
        R_WO: Estimated orientation, shape (3, 3).
        p_WO: Estimated position in W, shape (3,), in metres.
        p_OCoM: Centre of mass in O, about which the object turns, shape (3,), in metres.
        offset: Offset, shape (3,), in metres and radians.
    """
    x, y, yaw = offset
    turn, p_OCoM_W = rotation_matrix(np.array([0.0, 0.0, yaw])), R_WO @ p_OCoM
    return turn @ R_WO, p_WO + p_OCoM_W - turn @ p_OCoM_W + np.array([x, y, 0.0])


def limited_offset(offset: FloatArray, change: FloatArray, step: float) -> FloatArray:
    """Returns an offset (x, y, yaw) after a limited change, within the largest correction.

    What is left of the change is as large as errors of gaps: touches that come and go do not shake
    the hand.

    Args:
        offset: Offset before, shape (3,), in metres and radians.
        change: Desired change, shape (3,).
        step: Largest length of the change in metres; yaw counts by the ratio of the estimate's
            standard deviations.
    """
    length = _length(change)
    moved = min(step, max(0.0, length - _TOUCH_STD))
    x, y, yaw = offset + change * (moved / max(length, 1e-12))
    share = min(1.0, LARGEST_SHIFT / max(float(np.hypot(x, y)), 1e-12))
    return np.array([share * x, share * y, min(max(yaw, -LARGEST_TURN), LARGEST_TURN)])


def is_settled(change: FloatArray) -> bool:
    """Returns whether a desired change of the offset, shape (3,), is as small as errors of gaps."""
    return _length(change) <= 2 * _TOUCH_STD


def _length(change: FloatArray) -> float:
    return float(np.linalg.norm(change * _STD[0] / _STD))
