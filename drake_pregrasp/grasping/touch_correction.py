"""Correction of an object's estimated pose by the fingertips that touch it."""

import numpy as np

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.geometry.rotations import rotation_matrix

LARGEST_SHIFT, LARGEST_TURN = 0.03, 0.3
"""Largest correction of the position, in metres, and of the yaw, in radians."""

_STD = np.array([0.01, 0.01, 0.09])  # Of the estimate: x and y in metres, and yaw in radians.
_TOUCH_STD = 0.001  # Of the gap of a fingertip that touches, in metres.
_INSIDE_STD = 0.003  # Of the gap of one that is inside and feels nothing, in metres.


def touch_correction(
    gaps: FloatArray,
    rows: FloatArray,
    touching: BoolArray,
    offset: FloatArray,
    inside: BoolArray | None = None,
) -> FloatArray:
    """Returns the change of an object's offset that explains touches best, shape (3,).

    A fingertip that touches at the gap g_i from the surface says that the surface is there. One
    that is inside the object and feels nothing says so less surely: it may as well be beyond an
    edge. With the standard deviations σ_i of a gap, 1 mm and 3 mm, and S of the object's pose, the
    change ξ of an offset b = (x, y, yaw) from where the object was expected minimizes

        Σ (g_i - a_i ξ)²/σ_i² + |S⁻¹ (b + ξ)|²   over these fingertips i.

    It is zero without any. Touches from opposite sides cancel.

    Args:
        gaps: Signed gaps between the fingertips and the surface of the object after the present
            offset, shape (n,), in metres.
        rows: Displacement a_i of the surface along the normal at each fingertip, by unit
            displacements along x and y in metres and by unit yaw in radians, shape (n, 3).
        touching: Mask of the fingertips that touch, shape (n,).
        offset: Present offset b, shape (3,), in metres and radians; zero for a change that does not
            depend on it.
        inside: Mask of the fingertips that are inside and feel nothing, shape (n,); none if not
            set.
    """
    counts = touching if inside is None else touching | inside
    if not counts.any():
        return np.zeros(3)
    std = np.where(touching, _TOUCH_STD, _INSIDE_STD)[counts]
    A = rows[counts] * _STD / std[:, None]
    slope = A.T @ (gaps[counts] / std) - offset / _STD
    return np.asarray(_STD * np.linalg.solve(A.T @ A + np.eye(3), slope))


def touch_rows(p_CoMT: FloatArray, nhat: FloatArray, R_WG: FloatArray) -> FloatArray:
    """Returns the rows a_i for `touch_correction`, shape (n, 3).

    Args:
        p_CoMT: Fingertips' centres from the centre of mass in G, shape (n, 3), in metres.
        nhat: Outward unit normals of the surface at the fingertips in G, shape (n, 3).
        R_WG: Orientation of G in W, shape (3, 3).
    """
    p_CoMT_W, nhat_W = p_CoMT @ R_WG.T, nhat @ R_WG.T
    return np.column_stack([nhat_W[:, :2], np.cross(p_CoMT_W, nhat_W)[:, 2]])


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
    if not offset.any():  # Most of the time.
        return R_WO, p_WO
    x, y, yaw = offset
    turn, p_OCoM_W = rotation_matrix(np.array([0.0, 0.0, yaw])), R_WO @ p_OCoM
    return turn @ R_WO, p_WO + p_OCoM_W - turn @ p_OCoM_W + np.array([x, y, 0.0])


def limited_offset(offset: FloatArray, change: FloatArray, step: float) -> FloatArray:
    """Returns an offset (x, y, yaw) after a limited change, within the largest correction.

    The length of a change is reduced by the standard deviation of a gap (1 mm), so that touches
    that come and go do not shake the hand.

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
    """Returns whether a desired change of the offset, shape (3,), is at most twice that deviation.

    `limited_offset` leaves such changes unmade, or follows them by half.
    """
    return _length(change) <= 2 * _TOUCH_STD


def _length(change: FloatArray) -> float:
    return float(np.linalg.norm(change * _STD[0] / _STD))
