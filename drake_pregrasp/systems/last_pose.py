"""The last pose at a port that could be used."""

from pydrake.math import RigidTransform
from pydrake.systems.framework import (
    Context,
    DependencyTicket,
    DiscreteStateIndex,
    DiscreteValues,
    InputPort,
    LeafSystem,
)

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.usable_inputs import is_usable_pose


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
        self.tickets: set[DependencyTicket] = {
            port.ticket(),
            system.discrete_state_ticket(self._index),
        }

    def is_usable(self, context: Context) -> bool:
        """Returns whether the pose at the port can be used."""
        return _is_usable(self._port.Eval(context))

    def eval(self, context: Context) -> RigidTransform:
        """Returns the pose at the port, or the stored one."""
        X: RigidTransform = self._port.Eval(context)
        if _is_usable(X):
            return X
        stored = context.get_discrete_state(self._index).value()
        return RigidTransform(stored.reshape(3, 4))

    def store(self, context: Context, discrete_state: DiscreteValues) -> None:
        """Remembers the pose at the port, if it can be used."""
        discrete_state.set_value(self._index, _to_vector(self.eval(context)))


def _is_usable(X: RigidTransform) -> bool:
    return is_usable_pose(X.rotation().matrix(), X.translation())


def _to_vector(X: RigidTransform) -> FloatArray:
    vector: FloatArray = X.GetAsMatrix34().ravel()
    return vector
