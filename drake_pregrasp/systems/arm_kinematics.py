"""Where an arm carries a palm, and which joint positions bring it where it should be."""

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable
from pydrake.systems.framework import Context

from drake_pregrasp.planning.arrays import FloatArray, IntArray

_DAMPING = 1e-4  # Of joints' ways, in metres (and radians) of the palm, squared.
_LARGEST_STEP = 0.2  # Of any joint, in radians.


class ArmKinematics:
    """The kinematics of an arm with a palm.

    It holds no Context: whoever asks brings one of its plant.

    Args:
        plant: A finalized plant with nothing but the arm and its hand.
        palm: The palm's frame P.
        joints: Which positions are the arm's, in the order of the velocities.

    Attributes:
        joints: The same.
        lower: Least positions of these joints.
        upper: Largest ones.
    """

    def __init__(self, plant: MultibodyPlant, palm: Frame, joints: IntArray) -> None:
        self._plant, self._palm, self.joints = plant, palm, joints
        self.lower: FloatArray = plant.GetPositionLowerLimits()[joints]
        self.upper: FloatArray = plant.GetPositionUpperLimits()[joints]

    def palm_pose(self, plant_context: Context) -> RigidTransform:
        """Returns the pose of P in W."""
        return self._palm.CalcPoseInWorld(plant_context)

    def step_to(
        self, plant_context: Context, q: FloatArray, X_WP: RigidTransform, home: FloatArray
    ) -> FloatArray:
        """Returns all positions after a step that brings the palm nearer to a pose.

        It is a damped least-squares step of the arm's joints, which are drawn to their home as far
        as the palm doesn't mind. Near the pose a step leaves an error that is quadratic in the one
        before.

        Args:
            plant_context: To compute in.
            q: Positions to start from, shape (nq,).
            X_WP: Where the palm is to be.
            home: Positions that arms are drawn to, shape (nq,).
        """
        self._plant.SetPositions(plant_context, q)
        J = self._plant.CalcJacobianSpatialVelocity(
            plant_context,
            JacobianWrtVariable.kV,
            self._palm,
            np.zeros(3),
            self._plant.world_frame(),
            self._plant.world_frame(),
        )[:, self.joints]
        inverse = J.T @ np.linalg.inv(J @ J.T + _DAMPING**2 * np.eye(6))
        drawn = _POSTURE_SHARE * (home - q)[self.joints]
        way = inverse @ pose_error(self.palm_pose(plant_context), X_WP)
        way += drawn - inverse @ (J @ drawn)
        way *= min(1.0, _LARGEST_STEP / max(float(np.max(np.abs(way))), _LARGEST_STEP))
        after = np.array(q, dtype=float)
        after[self.joints] = np.clip(after[self.joints] + way, self.lower, self.upper)
        return after


_POSTURE_SHARE = 0.1  # Of its way home that the arm goes at a step, where the palm lets it.


def pose_error(X_WP: RigidTransform, X_WD: RigidTransform) -> FloatArray:
    """Returns the rotation vector and the way from a pose to another, in W, shape (6,)."""
    turn = RotationMatrix(X_WD.rotation() @ X_WP.rotation().inverse()).ToAngleAxis()
    return np.concatenate([turn.axis() * turn.angle(), X_WD.translation() - X_WP.translation()])
