"""A hand's model and its description, fitted together."""

import contextlib
import logging
from collections.abc import Iterator

import numpy as np
from pydrake.common import Parallelism
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.planning import RobotDiagramBuilder, SceneGraphCollisionChecker

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.hand_description import Arm, BaseConfig, Carrier, HandDescription
from drake_pregrasp.config.limits_config import SectorReach
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.diagrams.hand_parsing import HAND, add_hand_model
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.systems.fingertip_sensor import HandKinematics, frame_names
from drake_pregrasp.systems.palm_posture import ArmKinematics, pose_error

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


_TWO_TURNS = 4 * np.pi


class HandModel:
    """A hand by itself, for its kinematics.

    Args:
        description: The hand.
        yaw_range: Of its wrist, as for `add_hand_model`.

    Attributes:
        description: The same.
        checker: What Drake's `DifferentialInverseKinematicsSystem` takes.
        kinematics: Of the fingertips.
        base: Of what carries the palm.
        tip_radii: Of the fingertips, shape (n,), in metres.
        withdrawn_radii: As `FingertipGoalShaper` takes them, shape (n,).
        azimuths: Of the fingertips about z, over the object at yaw 0 and at home, shape (n,).

    Raises:
        InvalidArgumentError: If the model and its description don't fit together.
    """

    def __init__(
        self, description: HandDescription, yaw_range: tuple[float, float] = FREE_TURN
    ) -> None:
        builder = RobotDiagramBuilder(time_step=0.0)
        plant = builder.plant()
        hand = add_hand_model(plant, description, yaw_range)
        plant.Finalize()
        self.description = description
        self.base = make_base(description.base, plant, hand)
        frames = [f"{HAND}::{tip.frame}" for tip in description.fingertips]
        self.kinematics = HandKinematics(plant, frames)
        self.tip_radii: FloatArray = np.array([tip.radius for tip in description.fingertips])
        self.withdrawn_radii: FloatArray = np.array(
            [tip.withdrawn_radius for tip in description.fingertips]
        )
        with _without_chatter():
            self.checker = SceneGraphCollisionChecker(
                model=builder.Build(),
                robot_model_instances=[hand],
                edge_step_size=1.0,
                configuration_distance_function=lambda a, b: float(np.linalg.norm(a - b)),
                implicit_context_parallelism=Parallelism(parallelize=False),
            )
        self._fingers_home = self._place_fingers()
        p_HT = self.home_tips()
        self.azimuths: FloatArray = np.arctan2(p_HT[:, 1], p_HT[:, 0])
        self._check_reach(p_HT)

    def home(self, p_WO: FloatArray, yaw: float) -> FloatArray:
        """Returns the home positions of all joints over an object, shape (nq,).

        Args:
            p_WO: Where the object is in W, shape (3,), in metres.
            yaw: Of the palm, in radians.

        Raises:
            InvalidArgumentError: If an arm can't bring the palm there.
        """
        return self.base.posed(self._fingers_home, p_WO, yaw)

    def yaw_range(self, asked: tuple[float, float] = FREE_TURN) -> tuple[float, float]:
        """Returns the palm's least and largest angle, in radians: what is asked for, if any is.

        Otherwise it is what the model's wrist has, if that can't make a full turn either way, which
        is a range of less than two turns. A wrist of more is as good as endless: it can always go
        on. The palm of an arm has no joint of its own, so its range is what is asked for.

        Args:
            asked: Endless for nothing.

        Raises:
            InvalidArgumentError: If more is asked for than the model has.
        """
        if not isinstance(self.base, PalmCarrier):
            return asked
        wrist = self.base.joints[-1]
        low, high = float(self.kinematics.lower[wrist]), float(self.kinematics.upper[wrist])
        if asked != FREE_TURN:
            if not low <= asked[0] <= asked[1] <= high:
                raise InvalidArgumentError(
                    f"wrist_range {list(asked)} must be within the model's own, from {low:g} to"
                    f" {high:g}"
                )
            return asked
        return (low, high) if high - low < _TWO_TURNS else FREE_TURN

    @property
    def relaxed(self) -> FloatArray:
        """Positions that joints of an arm and of fingers are drawn to, shape (nq,)."""
        if isinstance(self.base, PalmArm):
            return self.base.with_home(self._fingers_home)
        return self._fingers_home

    def tips_at(self, q: FloatArray) -> FloatArray:
        """Returns the fingertips' centres in W at positions q, shape (n, 3), in metres."""
        plant = self.kinematics.plant
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, q)
        return self.kinematics.tip_positions(context)

    def home_tips(self) -> FloatArray:
        """Returns the tips' centres at home, in the frame H of reach, shape (n, 3), in metres."""
        return self.base.seen_from_object(self.kinematics, self._fingers_home)

    @property
    def largest_offsets(self) -> FloatArray:
        """How far tips may be aside from their fingers' azimuths, shape (n,), in radians."""
        reaches = [tip.reach for tip in self.description.fingertips]
        return np.array(
            [reach.half_angle if isinstance(reach, SectorReach) else np.pi for reach in reaches]
        )

    def _place_fingers(self) -> FloatArray:
        """Returns home positions of the fingers, with zeros for what carries them, shape (nq,)."""
        plant, kinematics = self.kinematics.plant, self.kinematics
        names = np.array(_joint_names(plant))
        home = np.zeros(kinematics.num_positions)
        left = np.ones(len(home), dtype=bool)
        left[self.base.joints] = False
        for index, tip in enumerate(self.description.fingertips):
            own = kinematics.own_joints(index)
            key = f"fingertips[{index}].home"
            if len(own) != len(tip.home):
                raise InvalidArgumentError(
                    f"{key}: {len(tip.home)} positions must be {len(own)}, for the joints that move"
                    f" {tip.frame} only: {', '.join(names[own])}"
                )
            home[own], left[own] = tip.home, False
            lower, upper = kinematics.lower[own], kinematics.upper[own]
            for name, value, least, most in zip(names[own], tip.home, lower, upper, strict=True):
                if not least <= value <= most:
                    raise InvalidArgumentError(
                        f"{key}: {value:g} of {name} must be from {least:g} to {most:g}"
                    )
        if np.any(left):
            raise InvalidArgumentError(
                f"{', '.join(names[left])}: neither of base.joints, nor of one finger alone"
            )
        return home

    def _check_reach(self, p_HT: FloatArray) -> None:
        for index, tip in enumerate(self.description.fingertips):
            key = f"fingertips[{index}].reach"
            try:
                reach = tip.reach.make_reach()
            except InvalidArgumentError as error:
                raise InvalidArgumentError(f"{key}: {error}") from error
            p_HC = p_HT[index : index + 1]
            if not reach.permits(p_HC, _any_normal(reach.direction), p_HC)[0]:
                place = ", ".join(f"{x:.3g}" for x in p_HT[index])
                raise InvalidArgumentError(
                    f"{key}: it must hold the finger's own home, where {tip.frame} is at ({place})"
                    " m in H"
                )


def _joint_names(plant: MultibodyPlant) -> list[str]:
    """Returns for each position the name of its joint."""
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    moving = [joint for joint in joints if joint.num_positions()]
    return [joint.name() for joint in sorted(moving, key=lambda joint: joint.position_start())]


def _any_normal(direction: FloatArray | None) -> FloatArray:
    """Returns a normal that no bound on incidence minds, shape (1, 3)."""
    return np.zeros((1, 3)) if direction is None else direction[None]


@contextlib.contextmanager
def _without_chatter() -> Iterator[None]:
    """Keeps Drake from saying how many contexts it makes."""
    logger = logging.getLogger("drake")
    before = logger.level
    logger.setLevel(logging.WARNING)
    try:
        yield
    finally:
        logger.setLevel(before)
