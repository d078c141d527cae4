"""Frames of a palm over an object."""

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_pregrasp.arrays import FloatArray

FROM_ABOVE = RigidTransform()
"""Approach of a palm from above; see `HandModel`."""


def panned(X_LA: RigidTransform, pan: float) -> RigidTransform:
    """Returns an approach that is turned about the vertical by an angle in radians."""
    return RigidTransform(RotationMatrix.MakeZRotation(pan), np.zeros(3)) @ X_LA


def pose_error(X_WP: RigidTransform, X_WD: RigidTransform) -> FloatArray:
    """Returns the rotation vector and the translation from pose P to pose D in W, shape (6,)."""
    turn = RotationMatrix(X_WD.rotation() @ X_WP.rotation().inverse()).ToAngleAxis()
    return np.concatenate([turn.axis() * turn.angle(), X_WD.translation() - X_WP.translation()])


def reach_frame(
    p_WCoM: FloatArray, yaw: float, yaw_range: tuple[float, float], X_LA: RigidTransform
) -> RigidTransform:
    """Returns the frame H of the fingers' reach in W (`HandGoalShaper` defines it).

    Args:
        p_WCoM: Centre of mass of the object in W, shape (3,), in metres.
        yaw: Yaw of the palm, in radians.
        yaw_range: Smallest and largest angle of the palm, in radians.
        X_LA: Approach of the palm; see `HandModel`.
    """
    middle = sum(yaw_range) / 2
    return turned_frame(p_WCoM, X_LA, middle if np.isfinite(middle) else yaw)


def turned_frame(p_WCoM: FloatArray, X_LA: RigidTransform, yaw: float) -> RigidTransform:
    """Returns the frame A of an approach in W, turned by the palm's yaw."""
    turn = RigidTransform(RotationMatrix.MakeZRotation(yaw), np.zeros(3))
    return RigidTransform(p_WCoM) @ X_LA @ turn
