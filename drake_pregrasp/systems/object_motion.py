"""Commanded positions and rates of the joints that move the object."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_pregrasp.planning.velocity_profile import VelocityProfile


class ObjectMotion(LeafSystem):
    """Commands the joints under or behind the object: conveyor and turntable, or a pusher.

    .. pydrake_system::

        name: ObjectMotion
        output_ports:
        - desired_state

    Port `desired_state` emits a vector of 2 k: the k positions, from 0 at time 0, then their k
    rates, in metres or radians and seconds.

    Args:
        profile: The rates over time.
    """

    def __init__(self, profile: VelocityProfile) -> None:
        super().__init__()
        self._profile = profile
        self.DeclareVectorOutputPort(
            "desired_state", 2 * profile.size, self._calc_desired_state, {self.time_ticket()}
        )

    def _calc_desired_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.concatenate(self._profile.at(context.get_time())))
