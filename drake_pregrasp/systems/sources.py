"""Sources of a scenario: motion of the object, contact weights, hand pose and obstacles."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.value import AbstractValue
from pydrake.geometry import FrameId, FramePoseVector
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import BodyIndex
from pydrake.polynomial import Polynomial
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, DiscreteValues, LeafSystem
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_pregrasp.arrays import FloatArray, tick_index
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.recorded_poses import RecordedPoses
from drake_pregrasp.geometry.motion_profiles import VelocityProfile
from drake_pregrasp.geometry.solids import Solid
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.systems.ports import OBSTACLES, POSE, declare_output

_FOREVER = 1e9  # Seconds; Drake's trajectories end.


class BodyPose(LeafSystem):
    """Emits the pose of one body of a MultibodyPlant.

    .. pydrake_system::

        name: BodyPose
        input_ports:
        - body_poses
        output_ports:
        - X_WB

    Port `body_poses` accepts a list of `RigidTransform`: the plant's port of that name.

    Port `X_WB` emits a `RigidTransform`: the pose of the body B in the world W.

    The state of a discrete plant is that of the next time step as soon as it has been updated. So a
    system whose tick is at the same time, but for rounding, would see a moving body ahead of its
    time. With `time_step`, the pose of a time step is held until the next one.

    Args:
        body_index: Index of the body B.
        time_step: Time step of the plant, in seconds; 0 to emit the pose of its present state.
    """

    def __init__(self, body_index: BodyIndex, *, time_step: float = 0.0) -> None:
        super().__init__()
        poses = self.DeclareAbstractInputPort("body_poses", AbstractValue.Make([RigidTransform()]))
        index = int(body_index)
        if not time_step:
            declare_output(self, "X_WB", POSE, lambda c: poses.Eval(c)[index], poses)
            return
        held = self.DeclareDiscreteState(np.append(-1.0, np.eye(3, 4)))

        def pose(context: Context) -> RigidTransform:
            step, *X_WB = context.get_discrete_state(held).value()
            if step != tick_index(context.get_time(), time_step):
                return poses.Eval(context)[index]
            X = np.reshape(X_WB, (3, 4))
            return RigidTransform(RotationMatrix.MakeUnchecked(X[:, :3]), X[:, 3])

        def hold(context: Context, discrete_state: DiscreteValues) -> None:
            step = tick_index(context.get_time(), time_step)
            X_WB: RigidTransform = port.Eval(context)  # From the cache: a list of poses is long.
            discrete_state.set_value(held, np.append(step, X_WB.GetAsMatrix34()))

        sources = (poses, self.time_ticket(), self.xd_ticket())
        port = declare_output(self, "X_WB", POSE, pose, *sources)
        self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, hold)


class ObjectMotion(Diagram):
    """Commands the joints that move the object: conveyor and turntable, or a pusher.

    .. pydrake_system::

        name: ObjectMotion
        output_ports:
        - desired_state

    Port `desired_state` emits a vector of 2k: the k positions, which are 0 at time 0, in metres or
    radians, then their k rates, in m/s or rad/s.

    Args:
        profile: Rates over time.
    """

    def __init__(self, profile: VelocityProfile) -> None:
        super().__init__()
        pieces = [[[Polynomial(c)] for c in piece] for piece in profile.coefficients]
        positions = PiecewisePolynomial(pieces, [*profile.times, _FOREVER])
        builder = DiagramBuilder()
        # A plant asks for its desired state in each time step, for which Python would be slow.
        source = builder.AddSystem(TrajectorySource(positions, output_derivative_order=1))
        builder.ExportOutput(source.get_output_port(), "desired_state")
        builder.BuildInto(self)


class PoseReplay(LeafSystem):
    """Emits the recorded pose at the Context's time.

    .. pydrake_system::

        name: PoseReplay
        output_ports:
        - X_WO
        - geometry_pose

    Port `X_WO` emits a `RigidTransform`: the pose of the object O in the world W.

    Port `geometry_pose` emits a `FramePoseVector`: the same pose, for SceneGraph.

    Args:
        poses: Recorded poses.
        frame_id: The object's frame in SceneGraph; by default a new one, for a diagram without it.
    """

    def __init__(self, poses: RecordedPoses, frame_id: FrameId | None = None) -> None:
        super().__init__()
        self._poses = poses
        self._frame_id = FrameId.get_new_id() if frame_id is None else frame_id
        time, poses_model = self.time_ticket(), AbstractValue.Make(FramePoseVector())
        self._pose = declare_output(self, "X_WO", POSE, self._calc_pose, time)
        declare_output(self, "geometry_pose", poses_model, self._calc_geometry_pose, time)

    def _calc_pose(self, context: Context) -> RigidTransform:
        p_WO, R_WO = self._poses.at(context.get_time())
        x, y, z, w = R_WO.as_quat()
        return RigidTransform(RotationMatrix(Quaternion(w, x, y, z)), p_WO)

    def _calc_geometry_pose(self, context: Context) -> FramePoseVector:
        poses = FramePoseVector()
        poses.set_value(self._frame_id, self._pose.Eval(context))
        return poses


class ContactWeights(LeafSystem):
    """Emits the contacts' weights h_i, and -inf for each finger from the time of its loss on.

    .. pydrake_system::

        name: ContactWeights
        output_ports:
        - contact_weights

    Port `contact_weights` emits a vector of n, in m²; -inf means that the finger is lost.

    Args:
        weights: Weights h_i, shape (n,), in m².
        losses: Pairs of a time in seconds and the indices of the contacts that are lost then.

    Raises:
        InvalidArgumentError: If the index of a contact is out of its range.
    """

    def __init__(
        self, weights: FloatArray, losses: Sequence[tuple[float, Sequence[int]]] = ()
    ) -> None:
        super().__init__()
        self._weights = np.array(weights, dtype=float)
        self._losses = [(time, list(contacts)) for time, contacts in losses]
        for contact in (contact for _, contacts in self._losses for contact in contacts):
            if not 0 <= contact < len(self._weights):
                raise InvalidArgumentError(
                    f"there is no contact {contact}; there are 0 to {len(self._weights) - 1}"
                )
        n, time = len(self._weights), self.time_ticket()
        declare_output(self, "contact_weights", n, self._calc_weights, time)

    def _calc_weights(self, context: Context) -> FloatArray:
        weights = self._weights.copy()
        for time, contacts in self._losses:
            if context.get_time() >= time - 1e-9:  # A tick's time may be rounded down.
                weights[contacts] = -np.inf
        return weights


class HandPose(LeafSystem):
    """Emits the pose of a hand that follows the object without turning, or that stays.

    .. pydrake_system::

        name: HandPose
        input_ports:
        - X_WO_estimated
        output_ports:
        - X_WH

    Port `X_WO_estimated` accepts a `RigidTransform`: the estimated pose of the object O in W.

    Port `X_WH` emits a `RigidTransform`: the pose of the hand H in W. Its orientation is constant.
    Its position is constant relative to the object's origin if the hand follows, else in W.

    Args:
        X_WH: Orientation of the hand in W, and its position: relative to the object's origin if the
            hand follows, else in W.
        follow: Whether the hand follows the object.
    """

    def __init__(self, X_WH: RigidTransform, *, follow: bool = True) -> None:
        super().__init__()
        self._X, self._follow = X_WH, follow
        self._X_WO_estimated = self.DeclareAbstractInputPort("X_WO_estimated", POSE)
        declare_output(self, "X_WH", POSE, self._calc_pose, self._X_WO_estimated)

    def _calc_pose(self, context: Context) -> RigidTransform:
        p_WH = self._X.translation()
        if self._follow:
            p_WH = p_WH + self._X_WO_estimated.Eval(context).translation()
        return RigidTransform(self._X.rotation(), p_WH)


@dataclass(frozen=True, eq=False)
class MovingSolid:
    """A solid with a constant velocity.

    Attributes:
        solid: The solid at time zero, in W.
        velocity: Its velocity in W, shape (3,), in m/s.
    """

    solid: Solid
    velocity: FloatArray


class MovingObstacles(LeafSystem):
    """Emits obstacles with constant velocities.

    .. pydrake_system::

        name: MovingObstacles
        output_ports:
        - obstacles

    Port `obstacles` emits `Obstacles` in W, `lookahead` after the Context's time, with their
    velocities.

    Args:
        obstacles: The solids, in the order of their indices.
        lookahead: Seconds by which the obstacles are ahead of the Context's time: the same as for
            the goals that must be clear of them.
    """

    def __init__(self, obstacles: Sequence[MovingSolid], *, lookahead: float = 0.0) -> None:
        super().__init__()
        self._lookahead, self._moving = lookahead, tuple(obstacles)
        declare_output(self, "obstacles", OBSTACLES, self._calc_obstacles, self.time_ticket())

    def _calc_obstacles(self, context: Context) -> Obstacles:
        time = context.get_time() + self._lookahead
        solids = tuple(m.solid.moved(np.eye(3), time * m.velocity) for m in self._moving)
        velocities = np.array([m.velocity for m in self._moving]).reshape(-1, 3)
        return Obstacles(solids, velocities=velocities)
