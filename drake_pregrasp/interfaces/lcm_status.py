"""Status of joints as LCM messages, in Drake's own types."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from drake import lcmt_allegro_status, lcmt_iiwa_status, lcmt_panda_status
from pydrake.common.value import AbstractValue
from pydrake.lcm import DrakeLcmInterface
from pydrake.systems.framework import Context, DiagramBuilder, DiscreteValues, LeafSystem
from pydrake.systems.lcm import LcmSubscriberSystem

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.interfaces.lcm import SafeSerializer, type_of_channel

# Types of status, and their fields with positions, velocities and torques of the motors. The torque
# that an iiwa reports has the opposite sign.
_STATUS = {
    "ALLEGRO_STATUS": (
        lcmt_allegro_status,
        ("joint_position_measured", "joint_velocity_estimated", "joint_torque_commanded"),
        1.0,
    ),
    "IIWA_STATUS": (
        lcmt_iiwa_status,
        ("joint_position_measured", "joint_velocity_estimated", "joint_torque_measured"),
        -1.0,
    ),
    "PANDA_STATUS": (lcmt_panda_status, ("joint_position", "joint_velocity", "joint_torque"), 1.0),
}


class StatusReceiver(LeafSystem):
    """Emits what the newest status of a driver tells of its joints.

    .. pydrake_system::

        name: StatusReceiver
        input_ports:
        - message
        output_ports:
        - state_estimated
        - torque_measured

    Port `message` accepts an `lcmt_allegro_status`, `lcmt_iiwa_status` or `lcmt_panda_status`.

    Port `state_estimated` emits a vector of 2 nq: positions and velocities. They are the initial
    positions, and zero, before the first message with finite values of all joints, and the last
    ones that were usable after a message without.

    Port `torque_measured` emits a vector of nq: the torques of the motors, in N m.

    Args:
        lcm_type: Type of the status.
        fields: Names of its fields with positions, velocities and torques.
        initial: Positions of the joints before the first message, shape (nq,).
        sign: Sign of the torques in the message.
    """

    def __init__(
        self, lcm_type: type, fields: Sequence[str], initial: FloatArray, *, sign: float = 1.0
    ) -> None:
        super().__init__()
        n = len(initial)
        self._fields, self._signs = list(fields), np.repeat([1.0, 1.0, sign], n)
        self._message = self.DeclareAbstractInputPort("message", AbstractValue.Make(lcm_type()))
        self._last = self.DeclareDiscreteState(np.append(initial, np.zeros(2 * n)))
        for name, places in (
            ("state_estimated", slice(2 * n)),
            ("torque_measured", slice(2 * n, 3 * n)),
        ):
            calc = partial(self._calc, places)
            self.DeclareVectorOutputPort(name, places.stop - (places.start or 0), calc)
        self.DeclarePerStepDiscreteUpdateEvent(self._store)

    def _newest(self, context: Context) -> FloatArray:
        """Returns positions, velocities and torques, shape (3 nq,)."""
        message = self._message.Eval(context)
        values = np.concatenate([getattr(message, name) for name in self._fields])
        last: FloatArray = context.get_discrete_state(self._last).value()
        if values.shape == last.shape and np.all(np.isfinite(values)):
            signed: FloatArray = self._signs * values
            return signed
        return last

    def _calc(self, places: slice, context: Context, output: Any) -> None:
        output.SetFromVector(self._newest(context)[places])

    def _store(self, context: Context, discrete_state: DiscreteValues) -> None:
        discrete_state.set_value(self._last, self._newest(context))


def AddStatusSubscriber(
    builder: DiagramBuilder, lcm: DrakeLcmInterface, channel: str, initial: FloatArray
) -> StatusReceiver:
    """Adds a subscriber to the status of a driver and a `StatusReceiver`, and returns the latter.

    Args:
        builder: Builder of the diagram.
        lcm: Bus, from `DrakeLcm` or `ApplyLcmBusConfig`.
        channel: Channel that starts with `ALLEGRO_STATUS`, `IIWA_STATUS` or `PANDA_STATUS`; it
            tells the type.
        initial: As for `StatusReceiver`.

    Raises:
        InvalidArgumentError: If the channel starts with none of these names.
    """
    lcm_type, fields, sign = type_of_channel(channel, _STATUS)
    subscriber = LcmSubscriberSystem(channel, SafeSerializer(lcm_type, channel), lcm)
    receiver = StatusReceiver(lcm_type, fields, initial, sign=sign)
    builder.AddNamedSystem(f"subscriber({channel})", subscriber)
    builder.AddNamedSystem(f"receiver({channel})", receiver)
    builder.Connect(subscriber.get_output_port(), receiver.GetInputPort("message"))
    return receiver
