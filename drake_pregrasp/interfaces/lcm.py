"""Poses in and commands out as LCM messages, in Drake's own types."""

import contextlib
import logging
import math
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from drake import (
    lcmt_allegro_command,
    lcmt_iiwa_command,
    lcmt_panda_command,
    lcmt_panda_status,
    lcmt_scope,
)
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.value import AbstractValue
from pydrake.lcm import DrakeLcmInterface
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, DiscreteValues, LeafSystem
from pydrake.systems.lcm import LcmPublisherSystem, LcmSubscriberSystem, PySerializer

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.recorded_poses import check_pose

POSE_CHANNEL = "OBJECT_POSE"
"""Default channel of `AddPoseSubscriber`, with `lcmt_scope` messages."""

ALLEGRO_CHANNEL = "ALLEGRO_COMMAND"
"""Channel on which drivers of Drake's examples listen to `lcmt_allegro_command`."""

PANDA_CHANNEL = "PANDA_COMMAND"
"""Channel on which drake-franka-driver listens to `lcmt_panda_command`."""

IIWA_CHANNEL = "IIWA_COMMAND"
"""Channel on which `IiwaDriver` of Drake's hardware_sim listens to `lcmt_iiwa_command`."""

_COMMANDS = {
    ALLEGRO_CHANNEL: lcmt_allegro_command,
    IIWA_CHANNEL: lcmt_iiwa_command,
    PANDA_CHANNEL: lcmt_panda_command,
}

_POLL = 1  # Longest wait for a message, in milliseconds.
_SLACK = 1e-3  # Time before a tick at which it has not begun, and after it, in periods.
_OFFSET = _SLACK / 2  # Time after a tick, in periods, at which commands are sent that contain it.
_PHASE_GAIN = 0.05  # Share of a message's phase that the clock of `run_lcm_loop` is shifted by.
_FLOOD = 20  # Messages on a bus in one tick beyond which they are reported.


class _Refusals:
    """Counts what is refused, and warns at the first, the tenth, the hundredth and so on.

    Args:
        what: What is refused, in words.
    """

    def __init__(self, what: str) -> None:
        self._what, self._count, self._next = what, 0, 1

    def add(self, count: int = 1) -> None:
        self._count += count
        if self._count >= self._next:
            logging.getLogger(__name__).warning("%d %s", self._count, self._what)
            self._next = 10 ** len(str(self._count))


class SafeSerializer(PySerializer):
    """Reads messages, and leaves the last one where a message is malformed.

    Args:
        lcm_type: Type of the messages.
        channel: Name of the channel, for the warning.
    """

    def __init__(self, lcm_type: type, channel: str) -> None:
        super().__init__(lcm_type)
        self._malformed = _Refusals(f"malformed messages on {channel} are ignored")

    def Deserialize(self, buffer: bytes, abstract_value: AbstractValue) -> None:
        """Decodes a message into a value, unless it is malformed."""
        try:
            super().Deserialize(buffer, abstract_value)
        except Exception:  # Of LCM's decoder, which raises errors of many kinds.
            self._malformed.add()


class PoseReceiver(LeafSystem):
    """Emits the pose of the object O in the newest message.

    .. pydrake_system::

        name: PoseReceiver
        input_ports:
        - message
        output_ports:
        - X_WO_measured
        - measurement_time

    Port `message` accepts an `lcmt_scope` with the values x, y, z, qw, qx, qy, qz: a position in
    metres and a unit quaternion. Each message has another `utime`.

    Port `X_WO_measured` emits a `RigidTransform`, which is not finite if the message has not seven
    finite values, at most 100, with a quaternion of length 1. `PoseEstimator` refuses such a pose.

    Port `measurement_time` emits a vector of 1: the time at which the message was received, or
    -inf before the first one. Without a hand, the estimator's `lookahead` can make up for the delay
    until then.
    """

    def __init__(self) -> None:
        super().__init__()
        self._message = self.DeclareAbstractInputPort("message", AbstractValue.Make(lcmt_scope()))
        self._received = self.DeclareDiscreteState([0.0, -math.inf])  # utime, and when it came.
        model = AbstractValue.Make(RigidTransform())
        self.DeclareAbstractOutputPort("X_WO_measured", model.Clone, self._calc_pose)
        self.DeclareVectorOutputPort("measurement_time", 1, self._calc_time)
        self.DeclarePerStepDiscreteUpdateEvent(self._store)

    def _calc_pose(self, context: Context, output: AbstractValue) -> None:
        values = np.array(self._message.Eval(context).value)
        X_WO = RigidTransform([math.nan] * 3)
        if values.shape == (7,) and np.all(np.isfinite(values)):
            with contextlib.suppress(InvalidArgumentError):
                check_pose("message", [0.0, *values], previous=-math.inf)
                wxyz = values[3:] / np.linalg.norm(values[3:])
                X_WO = RigidTransform(RotationMatrix(Quaternion(wxyz)), values[:3])
        output.set_value(X_WO)

    def _newest(self, context: Context) -> FloatArray:
        stored: FloatArray = context.get_discrete_state(self._received).value()
        utime = self._message.Eval(context).utime
        return stored if utime == stored[0] else np.array([utime, context.get_time()])

    def _calc_time(self, context: Context, output: Any) -> None:
        output.SetAtIndex(0, self._newest(context)[1])

    def _store(self, context: Context, discrete_state: DiscreteValues) -> None:
        discrete_state.set_value(self._received, self._newest(context))


class CommandSender(LeafSystem):
    """Emits commands for the joints of a driver, and stops on silence.

    .. pydrake_system::

        name: CommandSender
        input_ports:
        - desired_state
        - time_since_measurement
        output_ports:
        - command
        - is_stopped

    Port `desired_state` accepts a vector of 2 nq, as `HandController` emits it.

    Port `time_since_measurement` accepts a vector of 1, as `PregraspPlanner` emits it.

    Port `command` emits an `lcmt_allegro_command`, `lcmt_iiwa_command` or `lcmt_panda_command`.
    Positions move from `initial` to the desired ones, no faster than `max_speed`. If the newest
    measurement is older than `timeout`, in simulated time or since its first command by this
    machine's monotonic clock, if there is none yet, or if an input is not finite, positions stay
    and velocities are zero. The stamp is this machine's clock, because drivers refuse old commands.
    Commands belong to the moment right after a tick, when the controller has stored its results.

    Port `is_stopped` emits a vector of 1: 1 on silence, else 0.

    Args:
        lcm_type: Type of the command.
        joints: Places of the driver's joints in `desired_state`.
        initial: Initial positions of all joints, shape (nq,).
        period: Seconds between commands.
        timeout: Age of the newest measurement at which the joints stop, in seconds.
        max_speed: Largest speed of a joint, in rad/s.
        velocity: Whether to command velocities instead of positions, to a Panda.
    """

    def __init__(
        self,
        lcm_type: type[lcmt_allegro_command | lcmt_iiwa_command | lcmt_panda_command],
        joints: Sequence[int],
        initial: FloatArray,
        *,
        period: float,
        timeout: float = 0.2,
        max_speed: float = 2.0,
        velocity: bool = False,
    ) -> None:
        super().__init__()
        self._type, self._joints, self._velocity = lcm_type, list(joints), velocity
        self._period, self._timeout, self._step = period, timeout, max_speed * period
        self._desired = self.DeclareVectorInputPort("desired_state", 2 * len(initial))
        self._age = self.DeclareVectorInputPort("time_since_measurement", 1)
        self._q = self.DeclareDiscreteState(np.asarray(initial)[self._joints])
        # Age at the last command, and the clock at the first one with the newest measurement.
        self._seen = self.DeclareDiscreteState([math.inf, 0.0])
        model = AbstractValue.Make(lcm_type())
        self.DeclareAbstractOutputPort("command", model.Clone, self._calc_command)
        self.DeclareVectorOutputPort("is_stopped", 1, self._calc_stopped)
        self.DeclarePeriodicDiscreteUpdateEvent(period, _OFFSET * period, self._store)

    def _next(self, context: Context) -> tuple[FloatArray, bool]:
        """Returns the commanded positions, and whether the joints stop."""
        q: FloatArray = context.get_discrete_state(self._q).value()
        desired = self._desired.Eval(context)[self._joints]
        age = self._age.Eval(context)[0]
        elapsed = time.monotonic() - self._next_seen(context)[1]
        is_alive = max(age, elapsed) <= self._timeout and age < context.get_time()
        if not (is_alive and np.all(np.isfinite(desired))):
            return q, True
        return q + np.clip(desired - q, -self._step, self._step), False

    def _next_seen(self, context: Context) -> list[float]:
        """Returns the next value of the state `_seen`."""
        age = self._age.Eval(context)[0]
        last, clock = context.get_discrete_state(self._seen).value()
        is_new = age < last + self._period / 2  # Without a measurement it grows by a period.
        return [age, time.monotonic() if is_new else clock]

    def _calc_stopped(self, context: Context, output: Any) -> None:
        output.SetAtIndex(0, self._next(context)[1])

    def _store(self, context: Context, discrete_state: DiscreteValues) -> None:
        discrete_state.set_value(self._q, self._next(context)[0])
        discrete_state.set_value(self._seen, self._next_seen(context))

    def _calc_command(self, context: Context, output: AbstractValue) -> None:
        q, n, command = self._next(context)[0], len(self._joints), self._type()
        command.utime = time.time_ns() // 1000
        if self._type is not lcmt_panda_command:
            command.num_joints, command.joint_position = n, q.tolist()
        elif self._velocity:
            step = q - context.get_discrete_state(self._q).value()
            command.control_mode_expected = lcmt_panda_status.CONTROL_MODE_VELOCITY
            command.num_joint_velocity, command.joint_velocity = n, (step / self._period).tolist()
        else:
            command.control_mode_expected = lcmt_panda_status.CONTROL_MODE_POSITION
            command.num_joint_position, command.joint_position = n, q.tolist()
        output.set_value(command)


def AddPoseSubscriber(
    builder: DiagramBuilder, lcm: DrakeLcmInterface, channel: str = POSE_CHANNEL
) -> PoseReceiver:
    """Adds a subscriber to a channel and a `PoseReceiver`, and returns the latter.

    Args:
        builder: Builder of the diagram.
        lcm: Bus, from `DrakeLcm` or `ApplyLcmBusConfig`.
        channel: Channel with `lcmt_scope` messages.
    """
    subscriber = LcmSubscriberSystem(channel, SafeSerializer(lcmt_scope, channel), lcm)
    builder.AddNamedSystem(f"subscriber({channel})", subscriber)
    receiver: PoseReceiver = builder.AddNamedSystem("pose_receiver", PoseReceiver())
    builder.Connect(subscriber.get_output_port(), receiver.GetInputPort("message"))
    return receiver


def AddCommandPublisher(
    builder: DiagramBuilder,
    lcm: DrakeLcmInterface,
    channel: str,
    joints: Sequence[int],
    initial: FloatArray,
    *,
    period: float,
    **options: Any,
) -> CommandSender:
    """Adds a `CommandSender` and a publisher on a channel, and returns the former.

    Args:
        builder: Builder of the diagram.
        lcm: Bus, from `DrakeLcm` or `ApplyLcmBusConfig`.
        channel: `ALLEGRO_CHANNEL`, `IIWA_CHANNEL` or `PANDA_CHANNEL`, or one that starts so; it
            tells the type.
        joints: As for `CommandSender`.
        initial: As for `CommandSender`.
        period: As for `CommandSender`.
        options: Further arguments of `CommandSender`.

    Raises:
        InvalidArgumentError: If the channel starts with none of these names.
    """
    lcm_type = type_of_channel(channel, _COMMANDS)
    sender = CommandSender(lcm_type, joints, initial, period=period, **options)
    publisher = LcmPublisherSystem.Make(
        channel, lcm_type, lcm, publish_period=period, publish_offset=_OFFSET * period
    )
    builder.AddNamedSystem(f"sender({channel})", sender)
    builder.AddNamedSystem(f"publisher({channel})", publisher)
    builder.Connect(sender.GetOutputPort("command"), publisher.get_input_port())
    return sender


def type_of_channel(channel: str, types: Mapping[str, Any]) -> Any:
    """Returns the entry of the name with which a channel starts."""
    for name, found in types.items():
        if channel.startswith(name):
            return found
    raise InvalidArgumentError(f"channel must start with {' or '.join(types)}, not {channel}")


def run_lcm_loop(
    simulator: Simulator, lcm: DrakeLcmInterface, *, period: float, duration: float = math.inf
) -> None:
    """Advances a diagram in real time, and runs a tick as soon as a message arrives.

    A tick that has no message within half a period runs without one. The clock follows the phase of
    the first message after each tick, so that messages do not wait for the next tick.

    Args:
        simulator: Simulator of the diagram.
        lcm: Bus of the diagram's subscribers.
        period: Seconds between ticks.
        duration: Time at which to stop, in seconds; the simulator's time starts anywhere.
    """
    context = simulator.get_context()
    start = time.monotonic() - context.get_time()
    tick, slack = math.floor(context.get_time() / period) + 1, _SLACK * period
    came, flood = 0, _Refusals(f"messages are more than {_FLOOD} in a tick; the newest counts")
    while context.get_time() < duration:
        now, due = time.monotonic() - start, tick * period
        before, came = came, came + lcm.HandleSubscriptions(_POLL if now < due + period / 2 else 0)
        is_fresh = came > before
        now = time.monotonic() - start
        if is_fresh and not before:
            start += _PHASE_GAIN * (now - round(now / period) * period)
        if now < due + (-0.5 if is_fresh else 0.5) * period:
            # A message counts as received at the time of the context, which follows the clock.
            simulator.AdvanceTo(min(duration, max(context.get_time(), min(now, due - slack))))
            continue
        simulator.AdvanceTo(min(duration, due))
        simulator.AdvanceTo(min(duration, due + slack))  # Stores the tick, and sends commands.
        if came > _FLOOD:
            flood.add(came - _FLOOD)
        tick, came = tick + 1, 0
