"""Kinematic model of a hand, from its model file and its description."""

from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.planning import RobotDiagram, RobotDiagramBuilder
from scipy.spatial import cKDTree
from scipy.stats.qmc import Halton

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.config.hand_description import Arm, BaseConfig, Carrier, HandDescription
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.diagrams.hand_parsing import HAND, add_hand_model
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.mesh_surface import AxisArea
from drake_pregrasp.geometry.solids import SignedDistance, Solid
from drake_pregrasp.systems.fingertip_sensor import HandKinematics, frame_names
from drake_pregrasp.systems.hand_scene import HandScene
from drake_pregrasp.systems.palm_posture import ArmKinematics, pose_error

_STEPS = 300  # Largest number of steps of an arm to its initial pose.
_ARRIVED = 1e-5  # Largest error of the palm at its initial pose, in metres and radians.
_TWO_TURNS = 4 * np.pi
_JOINT_KINDS = ("prismatic", "prismatic", "prismatic", "revolute")
_WORKSPACE_SAMPLES = 3000  # Places of a fingertip; 90 % are nearer to the next than half a step.
_LARGEST_STEP = 0.012  # Largest distance to another place that a finger reaches, in metres.


class PalmCarrier:
    """Four axes that carry a palm.

    Args:
        config: Description of the axes.
        plant: A finalized plant that contains only the hand.
        hand: Model instance of the hand.

    Attributes:
        joints: Indices of the positions x, y, z and yaw.

    Raises:
        InvalidArgumentError: If the model lacks such joints.
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
        """Returns positions with the palm over an object and the fingers as in q, shape (nq,).

        Args:
            q: Positions of all joints, shape (nq,).
            p_WO: Position of the object in W, shape (3,), in metres.
            yaw: Yaw of the palm, in radians.
        """
        posed = np.array(q, dtype=float)
        posed[self.joints] = [*(p_WO + np.array([0.0, 0.0, self._height])), yaw]
        return posed

    def seen_from_object(self, hand: HandKinematics, q: FloatArray) -> FloatArray:
        """Returns the fingertips' centres over an object at yaw 0, along the axes of W, (k, n, 3).

        Args:
            hand: Kinematics of the fingertips.
            q: Positions of all joints, shape (k, nq); those of the carrier are ignored.
        """
        return _tip_positions(hand, [self.posed(positions, np.zeros(3), 0.0) for positions in q])


class PalmArm:
    """An arm that carries a palm.

    Args:
        config: Description of the arm.
        plant: A finalized plant that contains only the hand and the arm.
        hand: Model instance of both.

    Attributes:
        joints: Indices of the arm's positions.
        palm_frame: Scoped name of the palm's frame P.
        kinematics: Kinematics of the arm.
        X_GP: Pose of the palm over the object at yaw 0.

    Raises:
        InvalidArgumentError: If the model lacks such joints or frames, or home violates limits.
    """

    def __init__(self, config: Arm, plant: MultibodyPlant, hand: ModelInstanceIndex) -> None:
        self.joints = _positions(plant, hand, config.joints)
        if not plant.HasFrameNamed(config.palm, hand):
            there = ", ".join(frame_names(plant, hand))
            raise InvalidArgumentError(
                f"base.palm: there is no frame {config.palm}; there are: {there}"
            )
        palm = plant.GetFrameByName(config.palm, hand)
        self.palm_frame = palm.scoped_name().get_full()
        self._plant = plant
        self.kinematics = arm = ArmKinematics(plant, palm, np.array(self.joints))
        _check_home("base.home", config.joints, config.home, arm.lower, arm.upper)
        self.X_GP = RigidTransform(RollPitchYaw(config.palm_rpy), config.palm_position)
        self._home = np.array(config.home)

    def posed(self, q: FloatArray, p_WO: FloatArray, yaw: float) -> FloatArray:
        """Returns positions with the palm over an object and the fingers as in q, shape (nq,).

        Args:
            q: Positions of all joints, shape (nq,); those of the arm are ignored.
            p_WO: Position of the object in W, shape (3,), in metres.
            yaw: Yaw of the palm, in radians.

        Raises:
            InvalidArgumentError: If the arm cannot hold the palm there.
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
            f"base: the arm cannot hold the palm at ({place}) m, turned by {yaw:.3g} rad; it stays"
            f" {1e3 * np.linalg.norm(error[3:]):.3g} mm and {np.linalg.norm(error[:3]):.3g} rad off"
        )

    def with_home(self, q: FloatArray) -> FloatArray:
        """Returns positions with the arm at home, shape (nq,)."""
        home = np.array(q, dtype=float)
        home[self.joints] = self._home
        return home

    def seen_from_object(self, hand: HandKinematics, q: FloatArray) -> FloatArray:
        """Returns the fingertips' centres over an object at yaw 0, as `PalmCarrier` does."""
        context = hand.plant.CreateDefaultContext()
        hand.plant.SetPositions(context, self.with_home(q[0]))
        X_GW = self.X_GP @ self.kinematics.palm_pose(context).inverse()
        p_WT = _tip_positions(hand, map(self.with_home, q))
        seen: FloatArray = p_WT @ X_GW.rotation().matrix().T + X_GW.translation()
        return seen


PalmBase = PalmCarrier | PalmArm


def make_base(config: BaseConfig, plant: MultibodyPlant, hand: ModelInstanceIndex) -> PalmBase:
    """Returns the base that a description names in a model."""
    if isinstance(config, Carrier):
        return PalmCarrier(config, plant, hand)
    return PalmArm(config, plant, hand)


def _tip_positions(hand: HandKinematics, q: Iterable[FloatArray]) -> FloatArray:
    """Returns the fingertips' centres in W at positions of all joints, shape (k, n, 3)."""
    context, p_WT = hand.plant.CreateDefaultContext(), []
    for positions in q:
        hand.plant.SetPositions(context, positions)
        p_WT.append(hand.tip_positions(context))
    return np.array(p_WT)


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


def _check_home(
    key: str, names: Sequence[str], home: list[float], lower: FloatArray, upper: FloatArray
) -> None:
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


class HandModel:
    """Kinematic model of a hand without a scene.

    Args:
        description: Description of the hand.
        yaw_range: Range of the wrist, as for `add_hand_model`.

    Attributes:
        description: Description of the hand.
        kinematics: Kinematics of the fingertips.
        base: Carrier or arm of the palm.
        fingers_home: Home positions of the fingers, and zeros for the base, shape (nq,).
        tip_radii: Radii of the fingertips, shape (n,), in metres.
        withdrawn_radii: Radii for `FingertipGoalShaper`, shape (n,), in metres.
        p_HT: Fingertips at home, over the object at yaw 0, shape (n, 3), in metres.
        azimuths: Azimuths of the fingertips at home, over the object at yaw 0, shape (n,), in
            radians.

    Raises:
        InvalidArgumentError: If the model and its description do not match.
    """

    def __init__(
        self, description: HandDescription, yaw_range: tuple[float, float] = FREE_TURN
    ) -> None:
        self.description, self._yaw_range = description, yaw_range
        self._diagram = self._parse()  # Keeps the plant alive.
        plant = self._diagram.plant()
        self.base = make_base(description.base, plant, plant.GetModelInstanceByName(HAND))
        self.kinematics = self._kinematics(self._diagram)
        self.tip_radii: FloatArray = np.array([tip.radius for tip in description.fingertips])
        self.withdrawn_radii: FloatArray = np.array(
            [tip.withdrawn_radius for tip in description.fingertips]
        )
        self.fingers_home = self._place_fingers()
        self.p_HT = self.base.seen_from_object(self.kinematics, self.fingers_home[None])[0]
        self.azimuths: FloatArray = np.arctan2(self.p_HT[:, 1], self.p_HT[:, 0])
        self._check_reach(self.p_HT)

    def _parse(self) -> RobotDiagram:
        builder = RobotDiagramBuilder(time_step=0.0)
        add_hand_model(builder.plant(), self.description, self._yaw_range)
        builder.plant().Finalize()
        return builder.Build()

    def _kinematics(self, diagram: RobotDiagram) -> HandKinematics:
        frames = [f"{HAND}::{tip.frame}" for tip in self.description.fingertips]
        return HandKinematics(diagram.plant(), frames)

    def make_scene(self, object_solid: SignedDistance, fixed: Sequence[Solid]) -> HandScene:
        """Returns a scene of the hand with an object.

        Args:
            object_solid: The object in O.
            fixed: Solids in W that do not move, such as the table.
        """
        diagram = self._parse()
        return HandScene(
            diagram,
            self._kinematics(diagram),
            tip_radii=self.tip_radii,
            object_solid=object_solid,
            fixed=fixed,
        )

    def home(self, p_WO: FloatArray, yaw: float) -> FloatArray:
        """Returns the home positions of all joints over an object, shape (nq,).

        Args:
            p_WO: Position of the object in W, shape (3,), in metres.
            yaw: Yaw of the palm, in radians.

        Raises:
            InvalidArgumentError: If an arm cannot hold the palm there.
        """
        return self.base.posed(self.fingers_home, p_WO, yaw)

    def yaw_range(self, asked: tuple[float, float] = FREE_TURN) -> tuple[float, float]:
        """Returns the palm's smallest and largest angle, in radians.

        A finite requested range is used as it is. Otherwise a wrist that cannot make a full turn
        either way, with a range of less than two turns, keeps the range of its model, and any other
        wrist is unlimited. The palm of an arm has no wrist joint, so the request is its range.

        Args:
            asked: Requested range; infinite for no request.

        Raises:
            InvalidArgumentError: If the request exceeds the range of the model.
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

    def check_contacts(self, p_OC: FloatArray, normals: FloatArray) -> None:
        """Checks that no contact is on a face that is forbidden to its finger.

        Args:
            p_OC: Contacts in O, in the order of the fingers, shape (n, 3), in metres.
            normals: Outward unit normals of the surface at the contacts, in O, shape (n, 3).

        Raises:
            InvalidArgumentError: If a contact is on such a face.
        """
        for tip, point, normal in zip(self.description.fingertips, p_OC, normals, strict=True):
            for face in (forbidden := tip.forbidden_faces):
                if AxisArea(face).holds(normal[None])[0]:
                    x, y, z = point
                    raise InvalidArgumentError(
                        f"the contact at ({x:.3g}, {y:.3g}, {z:.3g}) m is nearest to {tip.frame},"
                        f" to which {face} is forbidden (all of these: {', '.join(forbidden)})"
                    )

    def in_workspace(self, p_HT: FloatArray) -> BoolArray:
        """Returns the mask of places of each fingertip that its joints reach, shape (n, k).

        Args:
            p_HT: Centres of each fingertip over the object at yaw 0, shape (n, k, 3), in metres.
        """
        near = zip(self.workspaces, self._steps, p_HT, strict=True)
        return np.array([tree.query(places)[0] <= step for tree, step, places in near])

    @cached_property
    def _steps(self) -> list[float]:
        gaps = [tree.query(tree.data, k=2)[0][:, 1] for tree in self.workspaces]
        return [min(_LARGEST_STEP, 2 * float(np.quantile(gap, 0.9))) for gap in gaps]

    @cached_property
    def workspaces(self) -> list[cKDTree]:
        """Places of each fingertip over the object, at evenly drawn positions of its joints."""
        kinematics, fingers = self.kinematics, range(len(self.azimuths))
        own = [kinematics.own_joints(finger) for finger in fingers]
        shares = Halton(max(map(len, own)), seed=0).random(_WORKSPACE_SAMPLES)
        q = np.tile(self.fingers_home, (_WORKSPACE_SAMPLES, 1))
        for joints in own:
            lower, upper = kinematics.lower[joints], kinematics.upper[joints]
            q[:, joints] = lower + shares[:, : len(joints)] * (upper - lower)
        p_HT = self.base.seen_from_object(kinematics, q)
        return [cKDTree(p_HT[:, finger]) for finger in fingers]

    def tips_at(self, q: FloatArray) -> FloatArray:
        """Returns the fingertips' centres in W at positions q, shape (n, 3), in metres."""
        return np.array(_tip_positions(self.kinematics, [q])[0])

    @property
    def largest_offsets(self) -> FloatArray:
        """Largest angles between fingertips and their fingers' azimuths, shape (n,), in radians."""
        tips = self.description.fingertips
        return np.array([tip.reach.make_reach().half_angle for tip in tips])

    def _place_fingers(self) -> FloatArray:
        kinematics = self.kinematics
        joints = map(kinematics.plant.get_joint, kinematics.plant.GetJointIndices())
        moving = sorted((j.position_start(), j.name()) for j in joints if j.num_positions())
        names = np.array([name for _, name in moving])
        home = np.zeros(kinematics.num_positions)
        left = np.ones(len(home), dtype=bool)
        left[self.base.joints] = False
        for index, tip in enumerate(self.description.fingertips):
            own = kinematics.own_joints(index)
            lower, upper = kinematics.lower[own], kinematics.upper[own]
            _check_home(f"fingertips[{index}].home", names[own].tolist(), tip.home, lower, upper)
            home[own], left[own] = tip.home, False
        if np.any(left):
            raise InvalidArgumentError(
                f"{', '.join(names[left])}: neither of base.joints, nor of one finger alone"
            )
        return home

    def _check_reach(self, p_HT: FloatArray) -> None:
        """Checks that each finger reaches its home, where it is at the best angle."""
        for index, tip in enumerate(self.description.fingertips):
            key = f"fingertips[{index}].reach"
            try:
                reach = tip.reach.make_reach()
            except InvalidArgumentError as error:
                raise InvalidArgumentError(f"{key}: {error}") from error
            p_HC = p_HT[index : index + 1]
            normals = np.zeros((1, 3)) if reach.direction is None else reach.direction[None]
            if not reach.permits(p_HC, normals, p_HC)[0]:
                place = ", ".join(f"{x:.3g}" for x in p_HT[index])
                raise InvalidArgumentError(
                    f"{key}: it must hold the finger's own home, where {tip.frame} is at ({place})"
                    " m in H"
                )
