"""What carries a palm, by its model: four axes, or an arm."""

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from drake_pregrasp.diagrams.hand_description import Arm, BaseConfig, Carrier
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.systems.arm_kinematics import ArmKinematics, pose_error
from drake_pregrasp.systems.hand_kinematics import HandKinematics, frame_names

_STEPS = 300  # That an arm takes to its first pose, at most.
_ARRIVED = 1e-5  # Metres and radians, of the palm.
_JOINT_KINDS = ("prismatic", "prismatic", "prismatic", "revolute")


class PalmCarrier:
    """Four axes that carry a palm.

    Args:
        config: Which they are.
        plant: A finalized plant with nothing but the hand.
        hand: Its model instance.

    Attributes:
        joints: Which positions are x, y, z and yaw.

    Raises:
        InvalidArgumentError: If the model has no such joints.
    """

    def __init__(self, config: Carrier, plant: MultibodyPlant, hand: ModelInstanceIndex) -> None:
        self.joints = _positions(plant, hand, config.joints)
        self._height = config.palm_height
        for name, expected in zip(config.joints, _JOINT_KINDS, strict=True):
            kind = plant.GetJointByName(name, hand).type_name()
            if kind != expected:
                raise InvalidArgumentError(
                    f"base.joints: {name} is {kind}; three prismatic joints along x, y and z come"
                    " first, then a revolute one about z"
                )

    def posed(self, q: FloatArray, p_WO: FloatArray, yaw: float) -> FloatArray:
        """Returns positions with the palm over an object, those of the fingers as they were.

        Args:
            q: All joints' positions, shape (nq,).
            p_WO: Where the object is in W, shape (3,), in metres.
            yaw: Of the palm, in radians.
        """
        posed = np.array(q, dtype=float)
        posed[self.joints] = [*(p_WO + np.array([0.0, 0.0, self._height])), yaw]
        return posed

    def seen_from_object(self, hand: HandKinematics, q: FloatArray) -> FloatArray:
        """Returns the fingertips' centres over an object at yaw 0, shape (n, 3), in metres.

        They are in a frame with its origin in the object's, and W's axes.

        Args:
            hand: The kinematics of the fingertips.
            q: All joints' positions, shape (nq,); those of the carrier don't matter.
        """
        context = hand.plant.CreateDefaultContext()
        hand.plant.SetPositions(context, self.posed(q, np.zeros(3), 0.0))
        return hand.tip_positions(context)


class PalmArm:
    """An arm that carries a palm.

    Args:
        config: Which it is.
        plant: A finalized plant with nothing but the hand and the arm.
        hand: Their model instance.

    Attributes:
        joints: Which positions are the arm's.
        palm_frame: Scoped name of the palm's frame P.
        kinematics: Of the arm.
        X_GP: The palm over the object at yaw 0.

    Raises:
        InvalidArgumentError: If the model has no such joints or frame, or home is beyond limits.
    """

    def __init__(self, config: Arm, plant: MultibodyPlant, hand: ModelInstanceIndex) -> None:
        self.joints = _positions(plant, hand, config.joints)
        if len(config.home) != len(self.joints):
            raise InvalidArgumentError(
                f"base.home: {len(config.home)} positions must be {len(self.joints)}, one a joint"
            )
        if not plant.HasFrameNamed(config.palm, hand):
            there = ", ".join(frame_names(plant, hand))
            raise InvalidArgumentError(
                f"base.palm: there is no frame {config.palm}; there are: {there}"
            )
        lower, upper = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
        for name, joint, value in zip(config.joints, self.joints, config.home, strict=True):
            if not lower[joint] <= value <= upper[joint]:
                raise InvalidArgumentError(
                    f"base.home: {value:g} of {name} must be from {lower[joint]:g} to"
                    f" {upper[joint]:g}"
                )
        palm = plant.GetFrameByName(config.palm, hand)
        self.palm_frame = palm.scoped_name().get_full()
        self._plant = plant
        self.kinematics = ArmKinematics(plant, palm, np.array(self.joints))
        self.X_GP = RigidTransform(RollPitchYaw(config.palm_rpy), config.palm_position)
        self._home = np.array(config.home)

    def posed(self, q: FloatArray, p_WO: FloatArray, yaw: float) -> FloatArray:
        """Returns positions with the palm over an object, those of the fingers as they were.

        Args:
            q: All joints' positions, shape (nq,); the arm's don't matter.
            p_WO: Where the object is in W, shape (3,), in metres.
            yaw: Of the palm, in radians.

        Raises:
            InvalidArgumentError: If the arm can't bring the palm there.
        """
        X_WP = RigidTransform(RotationMatrix.MakeZRotation(yaw), p_WO) @ self.X_GP
        context = self._plant.CreateDefaultContext()
        posed = home = self.with_home(q)
        for _ in range(_STEPS):
            posed = self.kinematics.step_to(context, posed, X_WP, home)
            self._plant.SetPositions(context, posed)
            error = pose_error(self.kinematics.palm_pose(context), X_WP)
            if np.max(np.abs(error)) < _ARRIVED:
                return posed
        place = ", ".join(f"{x:.3g}" for x in X_WP.translation())
        raise InvalidArgumentError(
            f"base: the arm can't hold the palm at ({place}) m, turned by {yaw:.3g} rad; it stays"
            f" {1e3 * np.linalg.norm(error[3:]):.3g} mm and {np.linalg.norm(error[:3]):.3g} rad off"
        )

    def with_home(self, q: FloatArray) -> FloatArray:
        """Returns positions with the arm at home, shape (nq,)."""
        home = np.array(q, dtype=float)
        home[self.joints] = self._home
        return home

    def seen_from_object(self, hand: HandKinematics, q: FloatArray) -> FloatArray:
        """Returns the fingertips' centres over an object, as `PalmCarrier` does; by the fingers."""
        context = hand.plant.CreateDefaultContext()
        hand.plant.SetPositions(context, q)
        X_GW = self.X_GP @ self.kinematics.palm_pose(context).inverse()
        seen: FloatArray = (X_GW @ hand.tip_positions(context).T).T
        return seen


PalmBase = PalmCarrier | PalmArm


def make_base(config: BaseConfig, plant: MultibodyPlant, hand: ModelInstanceIndex) -> PalmBase:
    """Returns what a description says, found in a model."""
    if isinstance(config, Carrier):
        return PalmCarrier(config, plant, hand)
    return PalmArm(config, plant, hand)


def _positions(plant: MultibodyPlant, hand: ModelInstanceIndex, names: list[str]) -> list[int]:
    there = [plant.get_joint(index).name() for index in plant.GetJointIndices(hand)]
    for name in names:
        if name not in there:
            raise InvalidArgumentError(
                f"base.joints: there is no joint {name}; there are: {', '.join(there)}"
            )
    joints = [plant.GetJointByName(name, hand) for name in names]
    for joint in joints:
        if joint.num_positions() != 1:
            raise InvalidArgumentError(
                f"base.joints: {joint.name()} is {joint.type_name()}; it must slide or turn"
            )
    return [joint.position_start() for joint in joints]
