"""Model values of abstract ports, and validation of the values that enter through them."""

from collections.abc import Sequence

from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.framework import (
    BusValue,
    Context,
    DependencyTicket,
    DiscreteStateIndex,
    DiscreteValues,
    InputPort,
    LeafSystem,
    ValueProducer,
)

from drake_pregrasp.arrays import is_valid_pose, validated_rates
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.pose_track import FOLLOWED
from drake_pregrasp.regions.constraints import Obstacles

POSE = AbstractValue.Make(RigidTransform())
"""Model value of a port with a `RigidTransform`."""

VELOCITY = AbstractValue.Make(SpatialVelocity())
"""Model value of a port with a `SpatialVelocity`."""

BUS = AbstractValue.Make(BusValue())
"""Model value of a port with a `BusValue`."""

OBSTACLES = AbstractValue.Make(Obstacles())
"""Model value of a port with `Obstacles`."""


class LastPose:
    """Reads poses at a port of a system, and falls back on the last valid one.

    The last valid pose is a discrete state of the system, which the system stores at its updates.
    It is the identity at first. A pose is valid if it is finite and its rotation is a rotation.

    Args:
        system: System that has the port, and is being built.
        port: Port that accepts a `RigidTransform`.

    Attributes:
        tickets: Dependency tickets of everything that is computed from the pose.
    """

    def __init__(self, system: LeafSystem, port: InputPort) -> None:
        self._port = port
        self._index: DiscreteStateIndex = system.DeclareDiscreteState(
            RigidTransform().GetAsMatrix34().ravel()
        )
        self._valid = system.DeclareCacheEntry(
            f"valid pose of {port.get_name()}",
            ValueProducer(lambda: AbstractValue.Make((RigidTransform(), True)), self._calc_valid),
            {port.ticket(), system.discrete_state_ticket(self._index)},
        )
        self.tickets: set[DependencyTicket] = {self._valid.ticket()}

    def _calc_valid(self, context: Context, output: AbstractValue) -> None:
        X: RigidTransform = self._port.Eval(context)
        if is_valid(X):
            output.set_value((RigidTransform(X), True))  # A copy: Drake overwrites port values.
            return
        stored = context.get_discrete_state(self._index).value()
        output.set_value((RigidTransform(stored.reshape(3, 4)), False))

    def is_valid(self, context: Context) -> bool:
        """Returns whether the pose at the port is valid."""
        usable: bool = self._valid.Eval(context)[1]
        return usable

    def eval(self, context: Context) -> RigidTransform:
        """Returns the pose at the port if it is valid, else the stored one."""
        X: RigidTransform = self._valid.Eval(context)[0]
        return X

    def store(self, context: Context, discrete_state: DiscreteValues) -> None:
        """Stores the last valid pose, if the port is connected."""
        if self._port.HasValue(context):
            X = self.eval(context)
            discrete_state.set_value(self._index, X.GetAsMatrix34().ravel())


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


def validated_velocity(V: SpatialVelocity) -> SpatialVelocity:
    """Returns a velocity if it is finite and not too large, else zero."""
    rates = V.get_coeffs()
    return V if validated_rates(rates) is rates else SpatialVelocity.Zero()


def is_valid(X: RigidTransform) -> bool:
    """Returns whether a pose is finite, not too far away, and has a valid rotation."""
    Rp = X.GetAsMatrix34()
    return is_valid_pose(Rp[:, :3], Rp[:, 3])


def eval_obstacles(system: LeafSystem, port: InputPort, context: Context) -> Obstacles:
    """Returns the obstacles at a port in W; none if the port is unconnected.

    Raises:
        InvalidArgumentError: If the value has another type.
    """
    if not port.HasValue(context):
        return Obstacles()
    obstacles = port.Eval(context)
    if not isinstance(obstacles, Obstacles):
        raise InvalidArgumentError(
            f"port {port.get_name()} of {system.get_name()} accepts an Obstacles,"
            f" not a {type(obstacles).__name__}"
        )
    return obstacles


def is_followed(port: InputPort, context: Context) -> bool:
    """Returns whether goals may follow the estimate, by an optional port `tracking_status`."""
    return not port.HasValue(context) or port.Eval(context)[0] in FOLLOWED
