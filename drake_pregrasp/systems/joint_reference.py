"""Desired joint states, integrated from the velocities of differential inverse kinematics."""

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from drake_pregrasp.arrays import FloatArray, are_valid, validated_numbers, validated_rates
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.grasping.grasp_state import NO_LIMIT
from drake_pregrasp.systems.fingertip_sensor import LARGEST_RATE, HandKinematics
from drake_pregrasp.systems.ports import declare_context, declare_output


class JointReference(LeafSystem):
    """Integrates joint velocities to desired joint states, and adds the forces of the fingertips.

    .. pydrake_system::

        name: JointReference
        input_ports:
        - commanded_velocity
        - f_T_W
        - force_limits
        - hand_state
        output_ports:
        - position
        - desired_state
        - velocity

    Port `commanded_velocity` accepts a vector of nq, as `DifferentialKinematics` emits it; it is
    sampled once each period. If it is not finite, the reference stops.

    Port `f_T_W` (optional) accepts a vector of 3n: the forces that the fingertips should press
    with, in W, in newtons. A force that is not finite counts as zero.

    Port `force_limits` (optional) accepts a vector of n: the largest horizontal force of each
    fingertip, in newtons; `NO_LIMIT` or NaN for none. A finger that would press with more yields:
    its desired positions give way to what holds it back.

    Port `hand_state` (optional) accepts a vector of 2 nq: measured positions and velocities of the
    joints. Forces are limited only if it is connected and finite.

    Port `position` emits a vector of nq: the reference q at the Context's time. Differential
    inverse kinematics must start from it, not from the measured positions, which lag behind.

    Port `desired_state` emits a vector of 2 nq: q + K_p^-1 J^T f, then the velocities. Joints that
    are held at these positions by their proportional gains K_p press with f.

    Port `velocity` emits a vector of nq: the joints' velocities between the last tick and the next.

    The reference is linear between ticks, so a controller may sample it at any rate. A joint at its
    limit stays there.

    Args:
        hand: Kinematics of the hand.
        period: Seconds between ticks, greater than zero.
        initial: Initial positions, shape (nq,).
        plant_time_step: Time step of the hand's plant, in seconds, at whose end the measured
            positions have changed by the measured velocities.

    Raises:
        InvalidArgumentError: If `period` is not positive, or `initial` has another length.
    """

    def __init__(
        self,
        hand: HandKinematics,
        *,
        period: float,
        initial: FloatArray,
        plant_time_step: float = 0.0,
    ) -> None:
        super().__init__()
        nq, n = hand.num_positions, len(hand.tip_frames)
        if not period > 0:
            raise InvalidArgumentError(f"period must be greater than 0 s, not {period}")
        if np.shape(initial) != (nq,):
            raise InvalidArgumentError(f"the hand has {nq} joints, not {np.size(initial)}")
        self._hand, self._step = hand, plant_time_step
        self._start = self.DeclareDiscreteState(np.array([0.0]))
        self._q = self.DeclareDiscreteState(np.array(initial, dtype=float))
        self._v = self.DeclareDiscreteState(np.zeros(nq))
        self._v_last = self.DeclareDiscreteState(np.zeros(nq))
        self._commanded = self.DeclareVectorInputPort("commanded_velocity", nq)
        self._forces = self.DeclareVectorInputPort("f_T_W", 3 * n)
        self._limits = self.DeclareVectorInputPort("force_limits", n)
        self._state = self.DeclareVectorInputPort("hand_state", 2 * nq)
        time, stored = self.time_ticket(), self.xd_ticket()
        words = "the hand's plant at the reference"
        self._posed = declare_context(self, words, hand.plant, self._calc_posed, time, stored)
        self._position = declare_output(self, "position", nq, self._reference, time, stored)
        sources = (self._forces, self._limits, self._state)
        declare_output(self, "desired_state", 2 * nq, self._calc_desired, time, stored, *sources)
        self.DeclareStateOutputPort("velocity", self._v)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._sample)

    def _reference(self, context: Context) -> FloatArray:
        elapsed = context.get_time() - context.get_discrete_state(self._start)[0]
        q, v = (context.get_discrete_state(index).value() for index in (self._q, self._v))
        moved = np.maximum(self._hand.lower, q + elapsed * v)
        return np.asarray(np.minimum(moved, self._hand.upper))

    def _sample(self, context: Context, discrete_state: DiscreteValues) -> None:
        v = validated_rates(self._commanded.Eval(context))
        discrete_state.set_value(self._start, [context.get_time()])
        discrete_state.set_value(self._q, self._position.Eval(context))
        discrete_state.set_value(self._v_last, context.get_discrete_state(self._v).value())
        discrete_state.set_value(self._v, v / max(1.0, np.abs(v).max() / LARGEST_RATE))

    def _calc_posed(self, context: Context, posed: Context) -> None:
        self._hand.plant.SetPositions(posed, self._position.Eval(context))

    def _calc_desired(self, context: Context) -> FloatArray:
        q = self._position.Eval(context)
        v = context.get_discrete_state(self._v).value()
        is_free = np.where(v > 0, q < self._hand.upper, q > self._hand.lower)
        if self._forces.HasValue(context) and (f_T_W := self._forces.Eval(context)).any():
            f_T_W = validated_numbers(f_T_W).reshape(-1, 3)
            f_T_W[np.isnan(f_T_W).any(axis=1)] = 0.0
            jacobians = self._hand.tip_jacobians(self._posed.Eval(context))
            q = q + f_T_W.ravel() @ jacobians.reshape(f_T_W.size, -1) / self._hand.stiffness
        v = v * is_free
        return np.concatenate([self._yielding(context, q, v), v])

    def _yielding(self, context: Context, q: FloatArray, v: FloatArray) -> FloatArray:
        """Returns desired positions with which no finger presses harder than it may.

        A finger that is free lags behind its reference only until it knows a new velocity; what it
        lacks apart from that is held back by something it touches.
        """
        if not (self._limits.HasValue(context) and self._state.HasValue(context)):
            return q
        limits = self._limits.Eval(context)
        if (limits >= NO_LIMIT).all() or not are_valid(state := self._state.Eval(context)):
            return q
        limits = np.nan_to_num(validated_numbers(limits), nan=NO_LIMIT)
        hand, (q_now, v_now) = self._hand, state.reshape(2, -1)
        elapsed = context.get_time() - context.get_discrete_state(self._start)[0]
        # Joints do not know a new velocity before their first time step with it.
        is_new = elapsed < 1.5 * self._step
        v_known = context.get_discrete_state(self._v_last).value() if is_new else v
        behind = q - elapsed * (v - v_known) - (q_now + self._step * v_now)
        torques = hand.stiffness * behind + hand.damping * (v_known - v_now)
        allowed = hand.with_limited_forces(self._posed.Eval(context), torques, limits)
        return np.asarray(q - (torques - allowed) / hand.stiffness)
