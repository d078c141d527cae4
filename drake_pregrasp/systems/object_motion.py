"""The commanded motion of the table that carries the object."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem


class ObjectMotion(LeafSystem):
    """Commands a constant twist to the conveyor and turntable under the object.

    .. pydrake_system::

        name: ObjectMotion
        output_ports:
        - desired_state

    Port `desired_state` emits a vector of 4: [v t, w t, v, w], the carriage's position in metres,
    the turntable's angle in radians and their rates, at time t.

    Args:
        linear_velocity: v along x of the world W, in m/s.
        angular_velocity: w about z of W, in rad/s.
    """

    def __init__(self, *, linear_velocity: float, angular_velocity: float) -> None:
        super().__init__()
        self._velocity = np.array([linear_velocity, angular_velocity])
        self.DeclareVectorOutputPort(
            "desired_state", 4, self._calc_desired_state, {self.time_ticket()}
        )

    def _calc_desired_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.concatenate([self._velocity * context.get_time(), self._velocity]))
