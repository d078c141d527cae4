"""What of the poses and velocities at ports can be used."""

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

from drake_pregrasp.arrays import FloatArray, is_valid_pose, validated_rates
from drake_pregrasp.errors import InvalidArgumentError


class LastPose:
    """Reads poses at a port of a system, and falls back on the last that could be used.

    What it remembers is a discrete state of the system, stored when the system says so; at first
    it is the identity. A pose can't be used if it isn't finite, or its rotation is none.

    Args:
        system: That has the port, and is being built.
        port: Accepts a `RigidTransform`.
    """

    def __init__(self, system: LeafSystem, port: InputPort) -> None:
        self._port = port
        self._index: DiscreteStateIndex = system.DeclareDiscreteState(_to_vector(RigidTransform()))
        self._used = system.DeclareCacheEntry(
            f"what of {port.get_name()} is used",
            ValueProducer(lambda: AbstractValue.Make((RigidTransform(), True)), self._calc_used),
            {port.ticket(), system.discrete_state_ticket(self._index)},
        )
        self.tickets: set[DependencyTicket] = {self._used.ticket()}

    def _calc_used(self, context: Context, output: AbstractValue) -> None:
        X: RigidTransform = self._port.Eval(context)
        if is_valid(X):
            output.set_value((RigidTransform(X), True))  # What is evaluated is overwritten later.
            return
        stored = context.get_discrete_state(self._index).value()
        output.set_value((RigidTransform(stored.reshape(3, 4)), False))

    def is_valid(self, context: Context) -> bool:
        """Returns whether the pose at the port can be used."""
        usable: bool = self._used.Eval(context)[1]
        return usable

    def eval(self, context: Context) -> RigidTransform:
        """Returns the pose at the port, or the stored one."""
        X: RigidTransform = self._used.Eval(context)[0]
        return X

    def store(self, context: Context, discrete_state: DiscreteValues) -> None:
        """Remembers the pose at the port, if there is one that can be used."""
        if self._port.HasValue(context):
            discrete_state.set_value(self._index, _to_vector(self.eval(context)))


def validated_poses(bus: BusValue, names: Sequence[str], port: str) -> list[RigidTransform | None]:
    """Returns the poses of a bus by names, and None for each that isn't there or can't be used.

    Args:
        bus: Of `RigidTransform`.
        names: Of its entries.
        port: What accepted it, for the message.

    Raises:
        InvalidArgumentError: If an entry is of another type.
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
    """Returns a velocity as it is if it is finite and not too large, or else zero."""
    rates = V.get_coeffs()
    usable = validated_rates(rates)
    return V if usable is rates else SpatialVelocity.Zero()


def is_valid(X: RigidTransform) -> bool:
    """Returns whether a pose is one: finite, not too far, and with a rotation."""
    Rp = X.GetAsMatrix34()
    return is_valid_pose(Rp[:, :3], Rp[:, 3])


def _to_vector(X: RigidTransform) -> FloatArray:
    vector: FloatArray = X.GetAsMatrix34().ravel()
    return vector
