"""Kinematics of a hand: its joints, fingertips and links."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import GeometryId, SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Frame, JacobianWrtVariable, ModelInstanceIndex
from scipy.linalg.lapack import dposv

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray, norms
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.rotations import skew
from drake_pregrasp.grasping.forward_kinematics import HandPose, KinematicTree, forward_kinematics
from drake_pregrasp.grasping.grasp_state import BASE

LARGEST_RATE = 10.0
"""Largest rate of any joint, in rad/s or m/s."""

_STIFFEST = 1e7  # Largest horizontal stiffness of a finger, in N/m.
_AT_STOP = 1e-3  # Distance from its limit at which a joint may be at its stop, in rad or m.
_LEAST_SQUARE = 1e-12  # Squared singular value of a finger whose joints are all at their stops.
_LEAST_SHARE = 0.08  # Singular value of a Jacobian below which it is damped, of its largest one.


class HandKinematics:
    """Kinematics of a hand whose joints are all driven to desired positions.

    Args:
        plant: A finalized plant that contains only the hand and its carrier or arm.
        tip_frames: Scoped names, `model_instance::frame`, of the frames at the fingertips' centres.
        forward: Implementation of `forward_kinematics`.

    Attributes:
        plant: The plant.
        tip_frames: Scoped names of the fingertips' frames.
        frames: The fingertips' frames.
        stiffness: Proportional gain of each joint, shape (nq,).
        damping: Derivative gain of each joint, shape (nq,).
        efforts: Largest torque or force of each joint, shape (nq,), in N m or N.
        lower: Lower limit of each joint, shape (nq,).
        upper: Upper limit of each joint, shape (nq,).
        num_positions: Number of joints nq.
        rate_limit: Largest rate of each joint, shape (nq,), at most `LARGEST_RATE`.
        acceleration_limit: Largest acceleration of each joint, shape (nq,), in 1/s².

    Raises:
        InvalidArgumentError: If a frame does not exist, or a joint is not driven.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        tip_frames: Sequence[str],
        forward: Callable[[KinematicTree, FloatArray], HandPose] = forward_kinematics,
    ) -> None:
        self.plant = plant
        self.num_positions = int(plant.num_positions())
        self.tip_frames = list(tip_frames)
        self.frames = [scoped_frame(plant, name) for name in tip_frames]
        self.stiffness, self.damping, self.efforts = _drives(plant)
        self.lower, self.upper = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
        self.rate_limit = np.minimum(plant.GetVelocityUpperLimits(), LARGEST_RATE)
        self.acceleration_limit = plant.GetAccelerationUpperLimits()
        moves = np.array([moving_joints(plant, frame) for frame in self.frames])
        self._is_own = moves & (np.sum(moves, axis=0) == 1)
        self._tree, self._forward = _kinematic_tree(plant, self.frames, moves), forward
        for name, own in zip(tip_frames, self._is_own, strict=True):
            if not np.any(own):
                raise InvalidArgumentError(
                    f"{name} has no joint of its own; to feel forces it needs at least one"
                )

    def own_joints(self, finger: int) -> IntArray:
        """Returns the indices of the joints that move only this finger's tip."""
        return np.flatnonzero(self._is_own[finger])

    def moves_freely(self, q: FloatArray) -> BoolArray:
        """Returns whether each joint is away from its stops, shape (nq,).

        A stop may bear any torque, so only the other joints show forces at the fingertips.

        Args:
            q: Positions of the joints, shape (nq,).
        """
        return np.asarray((self.lower + _AT_STOP < q) & (q < self.upper - _AT_STOP))

    def pose(self, q: FloatArray) -> HandPose:
        """Returns the kinematics at positions of the joints, shape (nq,); NaN where these are."""
        return self._forward(self._tree, q)

    def level_stiffness(self, q: FloatArray) -> FloatArray:
        """Returns the horizontal stiffness of each finger at its tip, shape (n,), in N/m.

        It is the inverse of the mean over horizontal directions of the compliance J K_p^-1 J^T of
        the finger's own joints, and bounded: the base counts as rigid. For the jaws of a gripper,
        which yield along one line, it is too large by 2 along it, and too small across.

        Args:
            q: Positions of the joints, shape (nq,).
        """
        J = (self.pose(q).J_WT * self._is_own[:, None])[:, :2]
        compliance = np.sum(J**2 / self.stiffness, axis=(1, 2)) / 2
        return np.asarray(1 / np.maximum(compliance, 1 / _STIFFEST))

    def least_stiffness(self, q: FloatArray) -> FloatArray:
        """Returns the least stiffness of each finger at its tip, shape (n,), in N/m.

        It is the inverse of the largest eigenvalue of the compliance J K_p^-1 J^T of the finger's
        own joints, over all directions, and bounded: the base counts as rigid.

        Args:
            q: Positions of the joints, shape (nq,).
        """
        J = self.pose(q).J_WT * self._is_own[:, None]
        compliance = np.linalg.norm(J / np.sqrt(self.stiffness), ord=2, axis=(1, 2)) ** 2
        return np.asarray(1 / np.maximum(compliance, 1 / _STIFFEST))

    def with_limited_forces(
        self, J_WT: FloatArray, torques: FloatArray, limits: FloatArray, nhat_W: FloatArray
    ) -> FloatArray:
        """Returns joint torques, less for fingers whose forces would exceed a limit.

        Forces away from the surface have no limit.

        Args:
            J_WT: Jacobians of the fingertips' velocities, shape (n, 3, nq).
            torques: Torques of all joints, shape (nq,), in N m.
            limits: Largest force of each fingertip against its normal, and across it, shape (n, 2),
                in newtons.
            nhat_W: Outward unit normals at the contacts in W, shape (n, 3).
        """
        forces = self.tip_forces(J_WT, torques)
        presses = -np.add.reduce(forces * nhat_W, axis=1)
        across = forces + presses[:, None] * nhat_W
        shares = np.maximum(0.0, 1 - limits[:, 1] / np.maximum(norms(across), 1e-9))
        excess = (
            shares[:, None] * across - np.maximum(0.0, presses - limits[:, 0])[:, None] * nhat_W
        )
        own = (J_WT * self._is_own[:, None]).reshape(-1, len(torques))
        return np.asarray(torques - excess.ravel() @ own)

    def tip_forces(self, J_WT: FloatArray, actuation: FloatArray) -> FloatArray:
        """Returns the forces that fingertips press with, in W, shape (n, 3), in newtons.

        At rest and without gravity, the torques of a finger's own joints are tau = J^T f. With more
        than three joints, f is the least-squares solution. With fewer, only the part of f along the
        directions in which they move the fingertip is known; the rest is 0 here. Torques hardly
        show a force along a direction in which a stretched finger hardly moves, with a singular
        value s near zero: f has the component tau/s there, and tau s/s0^2 below s0, so that
        |f| <= |tau|/s0.

        Args:
            J_WT: Jacobians of the fingertips' velocities, shape (n, 3, nq); zero columns for joints
                at their stops.
            actuation: Torques of all joints, shape (nq,), in N m.
        """
        # U and s of J = U s Vᵀ come from J Jᵀ = U s² Uᵀ, which is smaller; Vᵀ tau is s⁻¹ Uᵀ J tau.
        # Fingers share no own joint, so one J of all of them has the same blocks, and zeros else.
        J = J_WT * self._is_own[:, None]
        rows = J.reshape(-1, len(actuation))
        squared, along = rows @ rows.T, rows @ actuation
        roots, forces, failure = dposv(squared, along)
        # The determinant, which is the squared product of the diagonal of Cholesky's factor, is at
        # most s² (trace/2)², so nothing is damped if it is large enough.
        volumes = np.multiply.reduce(roots.diagonal().reshape(-1, 3), axis=1)
        traces = np.add.reduce(squared.diagonal().reshape(-1, 3), axis=1)
        if not failure and (4 * volumes**2 > _LEAST_SHARE**2 * traces**3).all():
            return np.asarray(forces.reshape(-1, 3))
        squares, U = np.linalg.eigh(J @ J.swapaxes(1, 2))
        largest = np.maximum(squares[:, -1:], _LEAST_SQUARE)
        gains = 1 / np.maximum(squares, _LEAST_SHARE**2 * largest)
        damped: FloatArray = U @ (gains[:, :, None] * (U.swapaxes(1, 2) @ along.reshape(-1, 3, 1)))
        return damped[:, :, 0]


@dataclass(frozen=True)
class HandLink:
    """A collision geometry of a hand.

    Attributes:
        frame: Frame of its body.
        finger: Index of its finger, or `BASE`.
        is_tip: Whether it is a fingertip.
        is_last: Whether no joint moves it relative to the fingertip.
    """

    frame: Frame
    finger: int
    is_tip: bool
    is_last: bool


def hand_links(
    plant: MultibodyPlant,
    tip_frames: Sequence[Frame],
    tip_radii: Sequence[float] | FloatArray,
    inspector: SceneGraphInspector,
) -> dict[GeometryId, HandLink]:
    """Returns the collision geometries of all bodies that move with a joint of the hand.

    Args:
        plant: Finalized plant with the hand.
        tip_frames: Frames of the fingertips.
        tip_radii: Radii of the fingertips, shape (n,), in metres.
        inspector: Inspector of the plant's SceneGraph.
    """
    moves = np.array([moving_joints(plant, frame) for frame in tip_frames])
    own = moves & (np.sum(moves, axis=0) == 1)
    tips, links = fingertip_geometries(plant, tip_frames, tip_radii, inspector), {}
    for index in map(BodyIndex, range(plant.num_bodies())):
        body_frame = plant.get_body(index).body_frame()
        moved = moving_joints(plant, body_frame)
        if not np.any(moved & np.any(moves, axis=0)):
            continue
        fingers = np.flatnonzero(own @ moved)
        finger = int(fingers[0]) if len(fingers) else BASE
        for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(index)):
            is_last = finger != BASE and np.array_equal(moved, moves[finger])
            links[geometry] = HandLink(body_frame, finger, geometry in tips, is_last)
    return links


def fingertip_geometries(
    plant: MultibodyPlant,
    tip_frames: Sequence[Frame],
    tip_radii: Sequence[float] | FloatArray,
    inspector: SceneGraphInspector,
) -> set[GeometryId]:
    """Returns the collision geometries of fingertips; the arguments are those of `hand_links`.

    A fingertip is the geometry whose centre is within its radius of its frame. If a body has none
    there, all its geometries count as the fingertip. The plant need not be finalized.
    """
    tips: set[GeometryId] = set()
    for frame, radius in zip(tip_frames, tip_radii, strict=True):
        p_BT = frame.GetFixedPoseInBodyFrame().translation()
        there = plant.GetCollisionGeometriesForBody(frame.body())
        places = [inspector.GetPoseInFrame(geometry).translation() for geometry in there]
        near = [np.linalg.norm(place - p_BT) <= radius for place in places]
        tips.update(g for g, is_near in zip(there, near, strict=True) if is_near or not any(near))
    return tips


def finite_limits(
    lower: FloatArray, upper: FloatArray, middle: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """Returns limits of joints, of which those without limits turn once around a middle."""
    return (
        np.where(np.isfinite(lower), lower, middle - np.pi),
        np.where(np.isfinite(upper), upper, middle + np.pi),
    )


def scoped_frame(plant: MultibodyPlant, scoped_name: str) -> Frame:
    """Returns a frame by its scoped name.

    Raises:
        InvalidArgumentError: If there is no such frame.
    """
    instance, _, name = scoped_name.rpartition("::")
    if plant.HasModelInstanceNamed(instance):
        model = plant.GetModelInstanceByName(instance)
        if plant.HasFrameNamed(name, model):
            return plant.GetFrameByName(name, model)
        there = ", ".join(frame_names(plant, model))
        raise InvalidArgumentError(f"{instance} has no frame {name}; there are: {there}")
    raise InvalidArgumentError(f"no model instance {instance!r} for the frame {scoped_name}")


def frame_names(plant: MultibodyPlant, model: ModelInstanceIndex) -> list[str]:
    """Returns the names of a model's frames, except those that Drake adds for its joints."""
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(model)]
    used = [(j.name(), f.name()) for j in joints for f in (j.frame_on_parent(), j.frame_on_child())]
    added = {frame for joint, frame in used if frame.startswith(f"{joint}_")}
    frames = [plant.get_frame(index) for index in plant.GetFrameIndices(model)]
    names = [frame.name() for frame in frames if not frame.is_ephemeral()]
    bodies = [plant.get_body(index).name() for index in plant.GetBodyIndices(model)]
    return [name for name in names if name in bodies or name not in added]


def _drives(plant: MultibodyPlant) -> FloatArray:
    """Returns the gains of positions and velocities, and the efforts, shape (3, nq)."""
    drives = np.zeros((3, plant.num_positions()))
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(index)
        if actuator.has_controller():
            gains = actuator.get_controller_gains()
            position = actuator.joint().position_start()
            drives[:, position] = gains.p, gains.d, actuator.effort_limit()
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        if joint.num_positions() and not drives[0, joint.position_start()] > 0:
            raise InvalidArgumentError(
                f"joint {joint.name()} is not driven; give it an effort and drake:controller_gains"
            )
    return drives


def moving_joints(plant: MultibodyPlant, frame: Frame) -> BoolArray:
    """Returns for each joint's velocity whether it moves a frame, shape (nq,)."""
    moves = np.zeros(plant.num_velocities(), dtype=bool)
    for index in plant.GetJointIndices():
        joint, body = plant.get_joint(index), frame.body().index()
        if joint.num_velocities() and body in plant.GetBodiesKinematicallyAffectedBy([index]):
            start = joint.velocity_start()
            moves[start : start + joint.num_velocities()] = True
    return moves


def _kinematic_tree(
    plant: MultibodyPlant, tip_frames: Sequence[Frame], moves_tip: BoolArray
) -> KinematicTree:
    context, world, nq = plant.CreateDefaultContext(), plant.world_frame(), plant.num_positions()
    plant.SetPositions(context, np.zeros(nq))
    bodies = map(BodyIndex, range(plant.num_bodies()))
    frames = [plant.get_body(index).body_frame() for index in bodies]
    X_WB = np.array([frame.CalcPoseInWorld(context).GetAsMatrix34() for frame in frames])
    moves = np.array([moving_joints(plant, frame) for frame in frames])
    depths = np.zeros(nq, dtype=np.int64)  # Number of joints that move what a joint carries.
    screws, before, kind = np.empty((6, nq)), np.full(nq, nq), JacobianWrtVariable.kV
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    for joint in (joint for joint in joints if joint.num_velocities()):
        j, body = joint.velocity_start(), joint.child_body().index()
        frame, depths[j] = frames[body], np.sum(moves[body])
        calc = plant.CalcJacobianSpatialVelocity
        w, v = calc(context, kind, frame, np.zeros(3), world, world)[:, j].reshape(2, 3)
        screws[:, j] = np.append(w, v + np.cross(X_WB[body, :, 3], w))
    moved_by = np.full(len(frames), nq)
    for body in np.flatnonzero(moves.any(axis=1)):
        movers = np.flatnonzero(moves[body])
        last, *earlier = movers[np.argsort(-depths[movers])].tolist()
        moved_by[body], before[last] = last, earlier[0] if earlier else nq
    order = np.argsort(depths, kind="stable")
    return KinematicTree(
        screws=screws,
        before=before,
        order=order,
        levels=tuple(np.split(order, np.flatnonzero(np.diff(depths[order])) + 1)),
        X_WB=X_WB,
        moved_by=moved_by,
        tip_bodies=np.array([int(frame.body().index()) for frame in tip_frames]),
        p_BT=np.array([f.GetFixedPoseInBodyFrame().translation() for f in tip_frames]),
        moves_tip=moves_tip,
    )


def point_jacobian(screws: FloatArray, p_W: FloatArray) -> FloatArray:
    """Returns the Jacobian of the spatial velocity of a body at a point in W, shape (6, nq).

    Args:
        screws: Screws of the joints that move the body, and zeros, shape (6, nq).
        p_W: The point, shape (3,), in metres.
    """
    w, v = screws[:3], screws[3:]
    return np.concatenate([w, v - skew(p_W) @ w])
