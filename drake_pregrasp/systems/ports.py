"""Declaration of ports and cache entries, and validation of the values that enter through ports."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce, SpatialVelocity
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.perception import PointCloud
from pydrake.systems.framework import (
    BasicVector,
    BusValue,
    CacheEntry,
    Context,
    DependencyTicket,
    DiscreteStateIndex,
    DiscreteValues,
    InputPort,
    LeafSystem,
    OutputPort,
    System,
    ValueProducer,
)

from drake_pregrasp.arrays import (
    FARTHEST,
    FloatArray,
    are_valid_points,
    is_valid_pose,
    validated_rates,
)
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.pose_track import FOLLOWED
from drake_pregrasp.geometry.solids import Solid
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.regions.obstacles import place_obstacles

POSE = AbstractValue.Make(RigidTransform())
"""Model value of a port with a `RigidTransform`."""

VELOCITY = AbstractValue.Make(SpatialVelocity())
"""Model value of a port with a `SpatialVelocity`."""

BODY_POSES = AbstractValue.Make([RigidTransform()])
"""Model value of a port with a list of `RigidTransform`, one for each body of a plant."""

BODY_MOTIONS = {
    "body_poses": BODY_POSES,
    "body_spatial_velocities": AbstractValue.Make([SpatialVelocity()]),
}
"""Model values of ports with poses and velocities of all bodies, by the names in a plant."""

APPLIED_FORCES = AbstractValue.Make([ExternallyAppliedSpatialForce()])
"""Model value of a port with a list of `ExternallyAppliedSpatialForce`."""

BUS = AbstractValue.Make(BusValue())
"""Model value of a port with a `BusValue`."""

CLOUD = AbstractValue.Make(PointCloud(0))
"""Model value of a port with a `PointCloud`."""

NO_OBSTACLES = Obstacles()

OBSTACLES = AbstractValue.Make(NO_OBSTACLES)
"""Model value of a port with `Obstacles`."""

REGIONS = AbstractValue.Make(object())
"""Model value of a port with `SafeRegions`."""

Model: TypeAlias = AbstractValue | int
"""Model value of a port; or its size, for a vector."""

Source: TypeAlias = InputPort | CacheEntry | DependencyTicket
"""Something that a computation depends on."""


def applied_force(
    body: BodyIndex, p_BoBq_B: FloatArray, F_Bq_W: SpatialForce
) -> list[ExternallyAppliedSpatialForce]:
    """Returns a list with a force on a body, for the port `applied_spatial_force` of a plant.

    Args:
        body: Index of the body B.
        p_BoBq_B: Point Bq of B at which the force is applied, in B, shape (3,), in metres.
        F_Bq_W: Force at Bq in W.
    """
    force = ExternallyAppliedSpatialForce()
    force.body_index, force.p_BoBq_B, force.F_Bq_W = body, p_BoBq_B, F_Bq_W
    return [force]


def declare_inputs(system: LeafSystem, **models: Model) -> dict[str, InputPort]:
    """Declares input ports in the order of the keywords, and returns them by name.

    Args:
        system: System that is being built.
        models: Model value or size of each port.
    """
    return {
        name: system.DeclareVectorInputPort(name, model)
        if isinstance(model, int)
        else system.DeclareAbstractInputPort(name, model)
        for name, model in models.items()
    }


def copied_inputs(ports: Mapping[str, InputPort], context: Context) -> dict[str, Any]:
    """Returns the values of connected ports by name.

    Vectors and poses are copies, because Drake overwrites the values of ports later.
    """
    values = {name: port.Eval(context) for name, port in ports.items() if port.HasValue(context)}
    poses = {name: RigidTransform(X) for name, X in values.items() if type(X) is RigidTransform}
    return values | poses  # Vectors are copies already.


def declare_output(
    system: LeafSystem, name: str, model: Model, calc: Callable[[Context], Any], *sources: Source
) -> OutputPort:
    """Declares an output port that emits the value that a function returns.

    Args:
        system: System that is being built.
        name: Name of the port.
        model: Model value or size of the port.
        calc: Function that computes the value in a Context, for a vector of any shape.
        sources: Everything that the value depends on.
    """
    tickets = _tickets(sources)
    if isinstance(model, int):
        return system.DeclareVectorOutputPort(name, model, _setting_vector(calc), tickets)
    return system.DeclareAbstractOutputPort(name, model.Clone, _setting_value(calc), tickets)


def declare_cache(
    system: LeafSystem,
    description: str,
    model: Any,
    calc: Callable[[Context], Any],
    *sources: Source,
) -> CacheEntry:
    """Declares a cache entry for the value that a function returns.

    Args:
        system: System that is being built.
        description: Content of the entry.
        model: Value of the same type.
        calc: Function that computes the value in a Context.
        sources: Everything that the value depends on.
    """
    producer = ValueProducer(lambda: AbstractValue.Make(model), _setting_value(calc))
    return system.DeclareCacheEntry(description, producer, _tickets(sources))


def declare_context(
    system: LeafSystem,
    description: str,
    of: System,
    calc: Callable[[Context, Context], None],
    *sources: Source,
) -> CacheEntry:
    """Declares a cache entry that keeps a context of another system.

    Args:
        system: System that declares the entry.
        description: Description of the entry.
        of: System whose context is kept.
        calc: Function that changes the kept context, its second argument.
        sources: What the kept context depends on.
    """
    producer = ValueProducer(
        lambda: AbstractValue.Make(of.CreateDefaultContext()),
        lambda context, output: calc(context, output.get_mutable_value()),
    )
    return system.DeclareCacheEntry(description, producer, _tickets(sources))


def _setting_vector(calc: Callable[[Context], Any]) -> Callable[[Context, BasicVector], None]:
    return lambda context, output: output.SetFromVector(np.asarray(calc(context)).ravel())


def _setting_value(calc: Callable[[Context], Any]) -> Callable[[Context, AbstractValue], None]:
    return lambda context, output: output.set_value(calc(context))


def _tickets(sources: Sequence[Source]) -> set[DependencyTicket]:
    return {s if isinstance(s, DependencyTicket) else s.ticket() for s in sources}


class ValidPose(NamedTuple):
    """A valid pose of a frame O in W.

    Attributes:
        X_WO: The pose.
        R_WO: Its rotation matrix, shape (3, 3).
        p_WO: Its position, shape (3,), in metres.
        is_tracked: Whether it is the present pose, and goals may follow it.
    """

    X_WO: RigidTransform
    R_WO: FloatArray
    p_WO: FloatArray
    is_tracked: bool


class LastPose:
    """Reads poses at a port of a system, and falls back on the last valid one.

    The last valid pose is a discrete state of the system, which the system stores at its updates.
    It is the identity at first. A pose is valid if it is finite and its rotation is a rotation.

    Args:
        system: System that has the port, and is being built.
        port: Port that accepts a `RigidTransform`.
        tracking_status: Optional port that accepts a `TrackingStatus`.

    Attributes:
        source: Cache entry of the `ValidPose`, on which everything computed from it depends.
    """

    def __init__(self, system: LeafSystem, port: InputPort, tracking_status: InputPort) -> None:
        self._port, self._tracking_status = port, tracking_status
        self._index: DiscreteStateIndex = system.DeclareDiscreteState(
            RigidTransform().GetAsMatrix34().ravel()
        )
        self.source = declare_cache(
            system,
            f"valid pose of {port.get_name()}",
            ValidPose(RigidTransform(), np.eye(3), np.zeros(3), True),
            self._calc_pose,
            port,
            tracking_status,
            system.discrete_state_ticket(self._index),
        )

    def _calc_pose(self, context: Context) -> ValidPose:
        X: RigidTransform = self._port.Eval(context)
        is_sound, status = is_valid(X), self._tracking_status
        stored = X if is_sound else context.get_discrete_state(self._index).value().reshape(3, 4)
        X = RigidTransform(stored)  # A copy: Drake overwrites port values.
        matrix = X.GetAsMatrix34()
        is_followed = not status.HasValue(context) or float(status.Eval(context)[0]) in FOLLOWED
        return ValidPose(X, matrix[:, :3], matrix[:, 3], is_sound and is_followed)

    def eval(self, context: Context) -> ValidPose:
        """Returns the pose at the port if it is valid, else the stored one."""
        pose: ValidPose = self.source.Eval(context)
        return pose

    def store(self, context: Context, discrete_state: DiscreteValues) -> None:
        """Stores the last valid pose, if the port is connected."""
        if self._port.HasValue(context):
            X_WO = self.source.Eval(context).X_WO
            discrete_state.set_value(self._index, X_WO.GetAsMatrix34().ravel())


def pose_bus(poses: Mapping[str, RigidTransform]) -> BusValue:
    """Returns a bus of poses by name."""
    bus, value = BusValue(), POSE.Clone()
    for name, pose in poses.items():
        value.set_value(pose)
        bus.Set(name, value)  # A copy.
    return bus


def validated_poses(bus: BusValue, names: Sequence[str], port: str) -> list[RigidTransform | None]:
    """Returns the poses of a bus by name, and None for each that is missing or invalid.

    Args:
        bus: Bus of `RigidTransform` values.
        names: Names of the poses.
        port: Name of the port that accepted the bus, for the message.

    Raises:
        InvalidArgumentError: If an entry has another type.
    """
    poses: list[RigidTransform | None] = []
    for name in names:
        X = bus.Find(name)
        if X is not None and not isinstance(X, RigidTransform):
            raise InvalidArgumentError(
                f"port {port} accepts a RigidTransform for {name}, not a {type(X).__name__}"
            )
        poses.append(X if X is not None and is_valid(X) else None)
    return poses


def validated_velocity(V: SpatialVelocity) -> FloatArray:
    """Returns angular and linear velocity, shape (2, 3); zeros if not finite or too large."""
    return validated_rates(V.get_coeffs()).reshape(2, 3)


def points_in(cloud: PointCloud, heights: Sequence[float] = (-FARTHEST, FARTHEST)) -> FloatArray:
    """Returns the points of a cloud that are finite and within `FARTHEST`, shape (N, 3).

    Args:
        cloud: The cloud.
        heights: Two heights, in metres, between which points count.
    """
    xyzs = cloud.xyzs()
    is_between = (xyzs[2] > heights[0]) & (xyzs[2] < heights[1])  # False for NaN.
    points: FloatArray = np.asarray(xyzs[:, is_between].T, dtype=float)
    return points[are_valid_points(points)]


def is_valid(X: RigidTransform) -> bool:
    """Returns whether a pose is finite, not too far away, and has a valid rotation."""
    # Mostly it is near, and its rotation exact up to rounding, which Drake finds out faster.
    if np.vdot(p := X.translation(), p) <= FARTHEST**2 and X.rotation().IsValid():
        return True
    return is_valid_pose(X.GetAsMatrix34())


def eval_obstacles(system: LeafSystem, port: InputPort, context: Context) -> Obstacles:
    """Returns the obstacles at a port, in W; no obstacles if the port is unconnected.

    Raises:
        InvalidArgumentError: If the value has another type.
    """
    if not port.HasValue(context):
        return NO_OBSTACLES
    obstacles = port.Eval(context)
    if not isinstance(obstacles, Obstacles):
        raise InvalidArgumentError(
            f"port {port.get_name()} of {system.get_name()} accepts an Obstacles,"
            f" not a {type(obstacles).__name__}"
        )
    return obstacles


def eval_solids(
    system: LeafSystem, port: InputPort, context: Context, R_GW: FloatArray, p_GW: FloatArray
) -> tuple[Solid, ...]:
    """Returns the solids of the obstacles at a port, in a frame G (`place_obstacles`)."""
    if not port.HasValue(context):
        return ()
    solids = eval_obstacles(system, port, context).solids
    return place_obstacles(Obstacles(solids), R_GW, p_GW).solids if solids else ()
