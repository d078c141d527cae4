"""Sources of a scenario: motion of the object, contact weights, hand pose and obstacles."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.value import AbstractValue
from pydrake.geometry import FrameId, FramePoseVector
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import BodyIndex
from pydrake.polynomial import Polynomial
from pydrake.systems.framework import (
    BasicVector,
    Context,
    Diagram,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
)
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial
from scipy.spatial.distance import pdist

from drake_pregrasp.arrays import TIME_ROUNDING, FloatArray, tick_index
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.recorded_poses import RecordedPoses
from drake_pregrasp.geometry.motion_profiles import VelocityProfile
from drake_pregrasp.geometry.solids import Solid
from drake_pregrasp.regions.capability_weights import capability_weights
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.systems.ports import BODY_POSES, OBSTACLES, POSE, declare_output

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
        poses = self.DeclareAbstractInputPort("body_poses", BODY_POSES)
        index = int(body_index)
        if not time_step:
            declare_output(self, "X_WB", POSE, lambda c: poses.Eval(c)[index], poses)
            return
        held = self.DeclareDiscreteState(np.append(-1.0, np.eye(3, 4)))

        def pose(context: Context) -> RigidTransform:
            stored = context.get_discrete_state(held).value()
            if stored[0] != tick_index(context.get_time(), time_step):
                return poses.Eval(context)[index]
            return RigidTransform(stored[1:].reshape(3, 4))

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

    Port `desired_state` emits a vector of 2k: the k positions, in metres or radians, then their k
    rates, in m/s or rad/s.

    Args:
        profile: Rates over time.
        start: Position of the first joint at time 0, in metres; the others start at 0.
    """

    def __init__(self, profile: VelocityProfile, start: float = 0.0) -> None:
        super().__init__()
        coefficients = profile.coefficients.copy()
        coefficients[:, 0, 0] += start
        pieces = [[[Polynomial(c)] for c in piece] for piece in coefficients]
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
    """Emits the contacts' weights h_i over time, and -inf for each finger while it is lost.

    .. pydrake_system::

        name: ContactWeights
        input_ports:
        - p_WC
        output_ports:
        - contact_weights

    Port `p_WC` (optional) accepts a vector of 3n: the contacts in W, such as `p_WC_previous` of the
    planner, in metres. Only `capability` without `length` needs it.

    Port `contact_weights` emits a vector of n, in m²; -inf means that the finger is lost.

    Args:
        weights: Weights h_i of equally capable fingers, shape (n,), in m².
        losses: Pairs of a time in seconds and the indices of the contacts that are lost then.
        returns: Pairs of a time in seconds and the indices of the contacts that come back then.
        capability: Function that maps a time in seconds to the capability of each finger, shape
            (n,); its `capability_weights` are added. By default fingers are equally capable.
        length: Length L of `capability_weights`, in metres; 0 for the smallest distance between two
            contacts of `p_WC`, of those that are not lost.

    Raises:
        InvalidArgumentError: If the index of a contact is out of its range.
    """

    def __init__(
        self,
        weights: FloatArray,
        losses: Sequence[tuple[float, Sequence[int]]] = (),
        returns: Sequence[tuple[float, Sequence[int]]] = (),
        *,
        capability: Callable[[float], FloatArray] | None = None,
        length: float = 0.0,
    ) -> None:
        super().__init__()
        self._weights, n = np.array(weights, dtype=float), len(weights)
        self._capability, self._length = capability, length
        changes = [(e, 1) for e in losses] + [(e, -1) for e in returns]
        self._changes = [(at, list(those), step) for (at, those), step in changes if len(those)]
        for contact in (contact for _, contacts, _ in self._changes for contact in contacts):
            if not 0 <= contact < n:
                raise InvalidArgumentError(f"there is no contact {contact}; there are 0 to {n - 1}")
        port = self._p_WC = self.DeclareVectorInputPort("p_WC", 3 * n)
        declare_output(self, "contact_weights", n, self._calc_weights, self.time_ticket(), port)

    def _calc_weights(self, context: Context) -> FloatArray:
        if not self._changes and self._capability is None:
            return self._weights
        time, losses = context.get_time(), np.zeros(len(self._weights))
        for at, contacts, step in self._changes:
            losses[contacts] += step * (time >= at - TIME_ROUNDING)
        weights = np.where(losses > 0, -np.inf, self._weights)
        if self._capability is None:
            return weights
        capability = np.where(losses > 0, 0.0, self._capability(time))
        length = self._length
        if length == 0 and self._p_WC.HasValue(context):
            distances = pdist(self._p_WC.Eval(context).reshape(-1, 3)[capability > 0])
            length = float(distances.min()) if len(distances) else 0.0
        return weights + capability_weights(capability, length)


class CloseCommand(LeafSystem):
    """Commands a hand to close from a time on.

    .. pydrake_system::

        name: CloseCommand
        output_ports:
        - close

    Port `close` emits a vector of 1: 0 before the time, 1 from it on.

    The time is a parameter of the Context, in seconds, so that a study can grasp at several times
    with one diagram (`set_time`).

    Args:
        time: Default time, in seconds.
    """

    def __init__(self, time: float) -> None:
        super().__init__()
        self._time = self.DeclareNumericParameter(BasicVector([time]))
        sources = (self.time_ticket(), self.all_parameters_ticket())
        declare_output(self, "close", 1, self._calc_close, *sources)

    def set_time(self, context: Context, time: float) -> None:
        """Sets the time in seconds from which the hand closes, in a Context of this system."""
        context.get_mutable_numeric_parameter(self._time).SetFromVector([time])

    def _calc_close(self, context: Context) -> float:
        at = context.get_numeric_parameter(self._time)[0]
        return float(context.get_time() >= at - TIME_ROUNDING)


class HandFramePose(LeafSystem):
    """Emits the pose of a hand that follows the object without turning, or that stays.

    .. pydrake_system::

        name: HandFramePose
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

    def at(self, time: float) -> Solid:
        """Returns the solid at a time in seconds, in W."""
        shift = time * self.velocity
        return self.solid.moved(np.eye(3), shift) if shift.any() else self.solid


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
        self._lookahead = lookahead
        velocities = np.array([m.velocity for m in obstacles]).reshape(-1, 3)
        self._start = Obstacles(tuple(m.solid for m in obstacles), velocities=velocities)
        declare_output(self, "obstacles", OBSTACLES, self._calc_obstacles, self.time_ticket())

    def _calc_obstacles(self, context: Context) -> Obstacles:
        return self._start.after(context.get_time() + self._lookahead)
