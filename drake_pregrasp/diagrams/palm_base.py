"""Carriers and arms that hold the palm of a hand."""

from collections.abc import Sequence

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.tree import Frame, JacobianWrtVariable, Joint
from pydrake.systems.framework import Context

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.hand_description import Arm, BaseConfig, Carrier
from drake_pregrasp.diagrams.hand_instances import HandInstances
from drake_pregrasp.errors import InvalidArgumentError, OutOfReachError
from drake_pregrasp.geometry.rotations import turn_about_z
from drake_pregrasp.systems.hand_kinematics import moving_joints
from drake_pregrasp.systems.palm_frames import panned, pose_error, turned_frame

_STARTS = 6  # Postures from which an arm searches its initial pose: home, and random ones.
_STEPS = 300  # Largest number of steps of an arm to its initial pose.
_STILL = 1e-4  # Largest step of a joint that ends a search, in radians.
_ARRIVED = 1e-5  # Largest error of the palm at its initial pose, in metres and radians.
_DAMPING = 1e-4  # Damping of joint steps against palm steps, in metres or radians of the palm.
_LARGEST_STEP = 0.2  # Largest step of a joint, in radians.
_POSTURE_SHARE = 0.1  # Share of the distance to home per step, in the null space of the palm.

JOINT_KINDS = ("prismatic", "prismatic", "prismatic", "revolute")
"""Drake's names of the types of a carrier's joints x, y, z and yaw."""

WRIST = 3
"""Index of the yaw among a carrier's joints, behind the slides."""

PAN = "carrier_pan"
"""Name of the joint that turns a carrier from the side about the vertical."""


class PalmCarrier:
    """Four axes that carry a palm, and a fifth that turns them about the vertical if it pans.

    Args:
        config: Description of the axes.
        hand: The hand in a finalized plant that contains nothing else.
        X_LA: Approach of the palm; see `HandModel`.
        p_WB: Position of the axes' frame in W, shape (3,), in metres.
        pans: Whether the hand has the joint `PAN`.

    Attributes:
        joints: Indices of the positions x, y, z and yaw, and of the pan if there is one.
        names: Names of these joints.
        palm_frame: Empty: the axes follow a posture, not the palm a pose.
        X_AW: Pose of W in A with the palm at home.
        p_AL: Positions of the joints x, y and z for a palm over the origin of W, shape (3,).

    Raises:
        InvalidArgumentError: If the model lacks such joints.
    """

    def __init__(
        self,
        config: Carrier,
        hand: HandInstances,
        X_LA: RigidTransform,
        p_WB: FloatArray,
        pans: bool = False,
    ) -> None:
        axes = _base_joints(hand, config.joints)
        joints = [*axes, hand.joint(PAN, "base.joints")] if pans else axes
        self.joints, self.palm_frame = [joint.position_start() for joint in joints], ""
        self.names = [joint.name() for joint in joints]
        self._X_LA, self.X_AW = X_LA, X_LA.inverse()
        # Without a pan, x, y and z are R_AL p_WL + p_AL for a point L on the palm's axis.
        self._R_AL = self.X_AW.rotation().matrix()
        self.p_AL: FloatArray = self._R_AL @ (X_LA.translation() - p_WB)
        self.p_AL[2] += config.palm_height
        for joint, expected in zip(axes, JOINT_KINDS, strict=True):
            if (kind := joint.type_name()) != expected:
                raise InvalidArgumentError(
                    f"base.joints: {joint.name()} is {kind}; three prismatic joints along x, y and"
                    " z come first, then a revolute one about z"
                )

    def with_palm_over(self, q: FloatArray, p_WCoM: FloatArray, yaw: float) -> FloatArray:
        """Returns positions with the palm over an object and the fingers as in q, shape (nq,).

        Args:
            q: Positions of all joints, shape (nq,).
            p_WCoM: Centre of mass of the object in W, shape (3,), in metres.
            yaw: Yaw of the palm, in radians.
        """
        return self.rest_posture(q, p_WCoM, yaw)

    def at_home(self, q: FloatArray) -> FloatArray:
        """Returns positions with the palm at home and the fingers as in q, shape (nq,)."""
        return self.with_palm_over(q, np.zeros(3), 0.0)

    def rest_posture(
        self, home: FloatArray, p_WL: FloatArray, yaw: float, pan: float = 0.0
    ) -> FloatArray:
        """See `systems.differential_kinematics.PalmBase`."""
        posture = np.array(home, dtype=float)
        R_AL = self._R_AL @ turn_about_z(pan).T if pan else self._R_AL
        x, y, z = R_AL @ p_WL + self.p_AL
        posture[self.joints] = (x, y, z, yaw, pan)[: len(self.joints)]
        return posture

    def palm_goal(self, p_WL: FloatArray, yaw: float, pan: float = 0.0) -> RigidTransform:
        """Returns the frame of the palm's axis, turned by a yaw and a pan."""
        return turned_frame(p_WL, panned(self._X_LA, pan), yaw)


class PalmArm:
    """An arm that carries a palm.

    Args:
        config: Description of the arm.
        hand: The hand and the arm in a finalized plant that contains nothing else.
        X_LA: Approach of the palm; see `HandModel`.

    Attributes:
        joints: Indices of the arm's positions.
        lower: Lower limit of each of these, in radians or metres.
        upper: Upper limit of each of these, in radians or metres.
        palm_frame: Scoped name of the palm's frame P.
        X_AP: Pose of the palm in A at yaw 0.
        X_AW: Pose of W in A at yaw 0 with the arm at home.

    Raises:
        InvalidArgumentError: If the model lacks such joints or frames, or home violates limits.
    """

    def __init__(self, config: Arm, hand: HandInstances, X_LA: RigidTransform) -> None:
        joints = _base_joints(hand, config.joints)
        self.joints, self._X_LA = [joint.position_start() for joint in joints], X_LA
        self._palm, self._plant = hand.frame(config.palm, "base.palm"), hand.plant
        self.palm_frame = self._palm.scoped_name().get_full()
        _check_carried(config, hand, joints, self._palm)
        self.lower: FloatArray = self._plant.GetPositionLowerLimits()[self.joints]
        self.upper: FloatArray = self._plant.GetPositionUpperLimits()[self.joints]
        check_home("base.home", config.joints, config.home, self.lower, self.upper)
        self.X_AP = RigidTransform(RollPitchYaw(config.palm_rpy), config.palm_position)
        self._home = np.array(config.home)
        context = self._plant.CreateDefaultContext()
        self._plant.SetPositions(context, self.at_home(self._plant.GetPositions(context)))
        self.X_AW = self.X_AP @ self.palm_pose(context).inverse()

    def palm_pose(self, plant_context: Context) -> RigidTransform:
        """Returns the pose of P in W."""
        return self._palm.CalcPoseInWorld(plant_context)

    def step_to(
        self, plant_context: Context, q: FloatArray, X_WP: RigidTransform, home: FloatArray
    ) -> FloatArray:
        """Returns all positions after a step that brings the palm closer to a pose, shape (nq,).

        The step is a damped least-squares step of the arm's joints, with a step toward their home
        positions in its null space. Convergence near the pose is quadratic.

        Args:
            plant_context: Context of the plant, which is overwritten.
            q: Positions before the step, shape (nq,).
            X_WP: Desired pose of the palm in W.
            home: Home positions, shape (nq,).
        """
        self._plant.SetPositions(plant_context, q)
        world = self._plant.world_frame()
        J = self._plant.CalcJacobianSpatialVelocity(
            plant_context, JacobianWrtVariable.kV, self._palm, np.zeros(3), world, world
        )[:, self.joints]
        inverse = J.T @ np.linalg.inv(J @ J.T + _DAMPING**2 * np.eye(6))
        homeward = _POSTURE_SHARE * (home - q)[self.joints]
        step = inverse @ pose_error(self.palm_pose(plant_context), X_WP)
        step += homeward - inverse @ (J @ homeward)
        step *= min(1.0, _LARGEST_STEP / max(float(np.max(np.abs(step))), _LARGEST_STEP))
        after = np.array(q, dtype=float)
        after[self.joints] = np.clip(after[self.joints] + step, self.lower, self.upper)
        return after

    def with_palm_over(self, q: FloatArray, p_WCoM: FloatArray, yaw: float) -> FloatArray:
        """Returns positions with the palm over an object and the fingers as in q, shape (nq,).

        Args:
            q: Positions of all joints, shape (nq,); those of the arm are ignored.
            p_WCoM: Centre of mass of the object in W, shape (3,), in metres.
            yaw: Yaw of the palm, in radians.

        Raises:
            InvalidArgumentError: If the arm cannot hold the palm there; the message has its error.
        """
        X_WP, errors = self.palm_goal(p_WCoM, yaw), []
        context, random = self._plant.CreateDefaultContext(), np.random.default_rng(0)
        low, high = np.maximum(self.lower, -np.pi), np.minimum(self.upper, np.pi)
        posed = home = self.at_home(q)
        for _ in range(_STARTS):
            for _ in range(_STEPS):
                before, posed = posed, self.step_to(context, posed, X_WP, home)
                self._plant.SetPositions(context, posed)
                errors.append(pose_error(self.palm_pose(context), X_WP))
                if np.max(np.abs(errors[-1])) < _ARRIVED:
                    return posed
                if np.max(np.abs(posed - before)) < _STILL:
                    break
            posed = home = np.array(home)
            posed[self.joints] = random.uniform(low, high)
        error = min(errors, key=lambda error: float(np.linalg.norm(error)))
        place = ", ".join(f"{x:.3g}" for x in X_WP.translation())
        miss = float(np.linalg.norm(error[3:]))
        raise OutOfReachError(
            f"base: the arm cannot hold the palm at ({place}) m, turned by {yaw:.3g} rad; it stays"
            f" {1e3 * miss:.3g} mm and {np.linalg.norm(error[:3]):.3g} rad off",
            miss,
        )

    def at_home(self, q: FloatArray) -> FloatArray:
        """Returns positions with the arm at home and the fingers as in q, shape (nq,)."""
        home = np.array(q, dtype=float)
        home[self.joints] = self._home
        return home

    def rest_posture(
        self, home: FloatArray, p_WL: FloatArray, yaw: float, pan: float = 0.0
    ) -> FloatArray:
        """See `systems.differential_kinematics.PalmBase`."""
        return self.at_home(home)

    def palm_goal(self, p_WL: FloatArray, yaw: float, pan: float = 0.0) -> RigidTransform:
        """See `systems.differential_kinematics.PalmBase`."""
        return turned_frame(p_WL, panned(self._X_LA, pan), yaw) @ self.X_AP


CarrierOrArm = PalmCarrier | PalmArm


def make_base(
    config: BaseConfig,
    hand: HandInstances,
    X_LA: RigidTransform,
    p_WB: FloatArray,
    pans: bool = False,
) -> CarrierOrArm:
    """Returns the base that a description names in a model."""
    if isinstance(config, Carrier):
        return PalmCarrier(config, hand, X_LA, p_WB, pans)
    return PalmArm(config, hand, X_LA)


def _base_joints(hand: HandInstances, names: list[str]) -> list[Joint]:
    joints = [hand.joint(name, "base.joints") for name in names]
    for place, joint in enumerate(joints):
        if any(joint is other for other in joints[:place]):
            raise InvalidArgumentError(f"base.joints: {joint.name()} is listed twice")
        if joint.num_positions() != 1:
            raise InvalidArgumentError(
                f"base.joints: {joint.name()} is {joint.type_name()}; it must slide or turn"
            )
    return joints


def _check_carried(config: Arm, hand: HandInstances, joints: list[Joint], palm: Frame) -> None:
    """Raises an error unless all joints of an arm, and no others, move the palm."""
    moves = moving_joints(hand.plant, palm)
    for joint in joints:
        if not moves[joint.velocity_start()]:
            problem = f"{joint.name()} does not move the palm {config.palm}"
            raise InvalidArgumentError(f"base.joints: {problem}; is the hand welded to the arm?")
        moves[joint.velocity_start()] = False
    for joint in hand.moving_joints():
        if moves[joint.velocity_start()]:
            problem = f"{joint.name()} moves {config.palm}, and is not one of base.joints"
            raise InvalidArgumentError(f"base.palm: {problem}")


def check_home(
    key: str, names: Sequence[str], home: list[float], lower: FloatArray, upper: FloatArray
) -> None:
    """Raises an error unless a key holds home positions of some joints within their limits."""
    if len(home) != len(names):
        raise InvalidArgumentError(
            f"{key}: {len(home)} positions must be {len(names)}, one for each of its own joints:"
            f" {', '.join(names)}"
        )
    for name, value, least, most in zip(names, home, lower, upper, strict=True):
        if not least <= value <= most:
            raise InvalidArgumentError(
                f"{key}: {value:g} of {name} must be from {least:g} to {most:g}"
            )
