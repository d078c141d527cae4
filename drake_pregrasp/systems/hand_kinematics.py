"""Kinematics of a hand: frames, screws and Jacobians of its fingertips, and its links."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import GeometryId, SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable, ModelInstanceIndex
from pydrake.systems.framework import Context
from scipy.linalg.lapack import dposv

from drake_pregrasp.arrays import BoolArray, FloatArray, IntArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.rotations import skew
from drake_pregrasp.grasping.grasp_state import BASE

LARGEST_RATE = 10.0
"""Largest rate of any joint, in rad/s or m/s."""

_ORIGIN = np.zeros(3)
_FORCE_DIRECTIONS = 3
_LEAST_SHARE = 0.08  # Singular value of a Jacobian below which it is damped, of its largest one.


class HandKinematics:
    """Kinematics of a hand whose joints are all driven to desired positions.

    The caller provides the Context.

    Args:
        plant: A finalized plant that contains only the hand and its carrier or arm.
        tip_frames: Scoped names, `model_instance::frame`, of the frames at the fingertips' centres.

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

    def __init__(self, plant: MultibodyPlant, tip_frames: Sequence[str]) -> None:
        self.plant = plant
        self.num_positions = int(plant.num_positions())
        self.tip_frames = list(tip_frames)
        self._world = plant.world_frame()
        self.frames = [scoped_frame(plant, name) for name in tip_frames]
        self.stiffness, self.damping = _gains(plant)
        drives = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
        self.efforts: FloatArray = np.array([drive.effort_limit() for drive in drives])
        self.lower, self.upper = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
        self.rate_limit = np.minimum(plant.GetVelocityUpperLimits(), LARGEST_RATE)
        self.acceleration_limit = plant.GetAccelerationUpperLimits()
        moves = np.array([moving_joints(plant, frame) for frame in self.frames])
        self._is_own = moves & (np.sum(moves, axis=0) == 1)
        self._spanning, self._shown_by = _spanning_frames(plant, self.frames)
        for name, own in zip(tip_frames, self._is_own, strict=True):
            if np.sum(own) < _FORCE_DIRECTIONS:
                raise InvalidArgumentError(
                    f"{name} has {np.sum(own)} joints of its own; to feel forces in all directions"
                    f" it needs {_FORCE_DIRECTIONS}"
                )

    def own_joints(self, finger: int) -> IntArray:
        """Returns the indices of the joints that move only this finger's tip."""
        return np.flatnonzero(self._is_own[finger])

    def with_limited_forces(
        self, plant_context: Context, torques: FloatArray, limits: FloatArray
    ) -> FloatArray:
        """Returns joint torques, less for fingers that would press horizontally beyond a limit.

        Args:
            plant_context: Context of the plant at the hand's positions.
            torques: Torques of all joints, shape (nq,), in N m.
            limits: Largest horizontal force of each fingertip, shape (n,), in newtons.
        """
        J = self.tip_jacobians(plant_context) * self._is_own[:, None]
        level = _pressing_forces(J, torques) * [1.0, 1.0, 0.0]
        size = np.linalg.norm(level, axis=1)
        excess = level * np.maximum(0.0, 1 - limits / np.maximum(size, 1e-9))[:, None]
        return np.asarray(torques - np.einsum("nij,ni->j", J, excess))

    def tip_positions(self, plant_context: Context) -> FloatArray:
        """Returns the fingertips' centres in W, shape (n, 3), in metres."""
        return _positions_of(self.frames, plant_context)

    def tip_jacobians(self, plant_context: Context) -> FloatArray:
        """Returns the Jacobians of the fingertips' velocities in W, shape (n, 3, nq)."""
        return self._jacobians(plant_context, self.frames)[:, 3:]

    def screws(self, plant_context: Context) -> FloatArray:
        """Returns the screws of the joints in W, shape (6, nq).

        Column j is the spatial velocity, at the origin of W, of all that joint j moves, per unit
        rate. The Jacobian of a body has the columns of the joints that move it, and zeros.
        """
        return self.tips_and_screws(plant_context)[2]

    def tips_and_screws(self, plant_context: Context) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Returns `tip_positions`, `tip_jacobians` and `screws`, in less time than one by one."""
        p_WF = _positions_of(self._spanning, plant_context)
        J = self._jacobians(plant_context, self._spanning)
        w, v = J[:, :3], J[:, 3:]
        shown = self._shown_by, slice(None), np.arange(len(self._shown_by))
        screws = np.concatenate([w[shown], (v + skew(p_WF) @ w)[shown]], axis=1).T
        n = len(self.frames)
        return p_WF[:n], v[:n], screws

    def _jacobians(self, plant_context: Context, frames: Sequence[Frame]) -> FloatArray:
        """Returns the Jacobians of the spatial velocities of frames, shape (k, 6, nq)."""
        # Drake computes it in less time than the Jacobian of the translational velocity.
        calc, world = self.plant.CalcJacobianSpatialVelocity, self._world
        kind = JacobianWrtVariable.kV
        return np.array([calc(plant_context, kind, f, _ORIGIN, world, world) for f in frames])

    def tip_forces(self, plant_context: Context, actuation: FloatArray) -> FloatArray:
        """Returns the forces that fingertips press with, in W, shape (n, 3), in newtons.

        At rest and without gravity, the torques of a finger's own joints are tau = J^T f. With more
        than three joints, f is the least-squares solution. Torques hardly show a force along a
        direction in which a stretched finger hardly moves, with a singular value s near zero: f has
        the component tau/s there, and tau s/s0^2 below s0, so that |f| <= |tau|/s0.

        Args:
            plant_context: Context of the plant at the hand's positions.
            actuation: Torques of all joints, shape (nq,), in N m.
        """
        J = self.tip_jacobians(plant_context) * self._is_own[:, None]
        return _pressing_forces(J, actuation)


def _pressing_forces(J: FloatArray, torques: FloatArray) -> FloatArray:
    """Returns `tip_forces` by the Jacobians of the fingers' own joints, shape (n, 3, nq)."""
    # U and s of J = U s Vᵀ come from J Jᵀ = U s² Uᵀ, which is smaller; Vᵀ tau is s⁻¹ Uᵀ J tau.
    # Fingers share no own joint, so one J of all of them has the same blocks, and zeros else.
    rows = J.reshape(-1, len(torques))
    squared, along = rows @ rows.T, rows @ torques
    roots, forces, failure = dposv(squared, along)
    # The determinant is at most s² (trace/2)², so nothing is damped if it is large enough. It is
    # the squared product of the diagonal of Cholesky's factor.
    volumes = np.multiply.reduce(roots.diagonal().reshape(-1, 3), axis=1)
    traces = np.add.reduce(squared.diagonal().reshape(-1, 3), axis=1)
    if not failure and (4 * volumes**2 > _LEAST_SHARE**2 * traces**3).all():
        return np.asarray(forces.reshape(-1, 3))
    squares, U = np.linalg.eigh(J @ J.swapaxes(1, 2))
    gains = 1 / np.maximum(squares, _LEAST_SHARE**2 * squares[:, -1:])
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
    """Returns the collision geometries of a hand, except those of bodies that do not move.

    A fingertip is the geometry whose centre is within its radius of its frame. If a body has none
    there, all its geometries count as the fingertip.

    Args:
        plant: Finalized plant with the hand.
        tip_frames: Frames of the fingertips.
        tip_radii: Radii of the fingertips, shape (n,), in metres.
        inspector: Inspector of the plant's SceneGraph.
    """
    moves = np.array([moving_joints(plant, frame) for frame in tip_frames])
    own = moves & (np.sum(moves, axis=0) == 1)
    tips: set[GeometryId] = set()
    for frame, radius in zip(tip_frames, tip_radii, strict=True):
        p_BT = frame.GetFixedPoseInBodyFrame().translation()
        there = plant.GetCollisionGeometriesForBody(frame.body())
        places = [inspector.GetPoseInFrame(geometry).translation() for geometry in there]
        near = [np.linalg.norm(place - p_BT) <= radius for place in places]
        tips.update(g for g, is_near in zip(there, near, strict=True) if is_near or not any(near))
    links = {}
    for index in plant.GetBodyIndices(tip_frames[0].model_instance()):
        body_frame = plant.get_body(index).body_frame()
        moved = moving_joints(plant, body_frame)
        if not np.any(moved):
            continue
        fingers = np.flatnonzero(own @ moved)
        finger = int(fingers[0]) if len(fingers) else BASE
        for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(index)):
            is_last = finger != BASE and np.array_equal(moved, moves[finger])
            links[geometry] = HandLink(body_frame, finger, geometry in tips, is_last)
    return links


def frame_poses(frames: Sequence[Frame], plant_context: Context) -> FloatArray:
    """Returns the rotation and, as the last column, the position of frames in W, (k, 3, 4)."""
    poses = [frame.CalcPoseInWorld(plant_context).GetAsMatrix34() for frame in frames]
    return np.array(poses).reshape(-1, 3, 4)


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
    joints = [plant.get_joint(index).name() for index in plant.GetJointIndices(model)]
    added = tuple(f"{joint}_" for joint in joints)
    names = [plant.get_frame(index).name() for index in plant.GetFrameIndices(model)]
    bodies = [plant.get_body(index).name() for index in plant.GetBodyIndices(model)]
    return [name for name in names if name in bodies or not name.startswith(added)]


def _gains(plant: MultibodyPlant) -> tuple[FloatArray, FloatArray]:
    stiffness, damping = np.zeros((2, plant.num_positions()))
    last = -1
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(index)
        position = actuator.joint().position_start()
        if position <= last:  # Actuation ports follow the actuators, positions the joints.
            raise InvalidArgumentError(
                f"actuator {actuator.name()} must come in the order of the joints, one for each"
            )
        last = position
        if actuator.has_controller():
            gains = actuator.get_controller_gains()
            stiffness[position], damping[position] = gains.p, gains.d
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        if joint.num_positions() and not stiffness[joint.position_start()] > 0:
            raise InvalidArgumentError(
                f"joint {joint.name()} is not driven; give it an effort and drake:controller_gains"
            )
    return stiffness, damping


def moving_joints(plant: MultibodyPlant, frame: Frame) -> BoolArray:
    """Returns for each joint's velocity whether it moves a frame, shape (nq,)."""
    moves = np.zeros(plant.num_velocities(), dtype=bool)
    for index in plant.GetJointIndices():
        joint, body = plant.get_joint(index), frame.body().index()
        if joint.num_velocities() and body in plant.GetBodiesKinematicallyAffectedBy([index]):
            start = joint.velocity_start()
            moves[start : start + joint.num_velocities()] = True
    return moves


def _spanning_frames(
    plant: MultibodyPlant, tip_frames: Sequence[Frame]
) -> tuple[list[Frame], IntArray]:
    """Returns frames that together show all joints, and the index of a frame for each joint.

    The frames of the fingertips come first.
    """
    frames: list[Frame] = []
    shown_by = np.full(plant.num_velocities(), -1)
    bodies = [plant.get_joint(i).child_body().body_frame() for i in plant.GetJointIndices()]
    for frame in [*tip_frames, *bodies]:
        new = moving_joints(plant, frame) & (shown_by < 0)
        if len(frames) < len(tip_frames) or np.any(new):
            shown_by[new] = len(frames)
            frames.append(frame)
    return frames, shown_by


def _positions_of(frames: Sequence[Frame], plant_context: Context) -> FloatArray:
    return np.array([frame.CalcPoseInWorld(plant_context).translation() for frame in frames])


def point_jacobian(screws: FloatArray, p_W: FloatArray) -> FloatArray:
    """Returns the Jacobian of the spatial velocity of a body at a point in W, shape (6, nq).

    Args:
        screws: Screws of the joints that move the body, and zeros, shape (6, nq).
        p_W: The point, shape (3,), in metres.
    """
    w, v = screws[:3], screws[3:]
    return np.concatenate([w, v - skew(p_W) @ w])
