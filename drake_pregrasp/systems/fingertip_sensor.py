"""Sensor of a hand's fingertips."""

import math

import numpy as np
from pydrake.multibody.tree import MultibodyForces
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from drake_pregrasp.arrays import FloatArray, are_valid
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.grasping.forward_kinematics import HandPose
from drake_pregrasp.systems.hand_kinematics import HandKinematics
from drake_pregrasp.systems.ports import declare_cache, declare_context, declare_output

_SMOOTHING = 0.01  # Time constant of measured forces, in seconds.


class FingertipSensor(LeafSystem):
    """Measures the fingertips' positions and forces from the joints, as a real hand can.

    .. pydrake_system::

        name: FingertipSensor
        input_ports:
        - hand_state
        - net_actuation
        output_ports:
        - p_WT
        - f_T_W
        - J_WT

    Port `hand_state` accepts a vector of 2 nq: positions and velocities of the hand's joints.

    Port `net_actuation` (optional) accepts a vector of nq: torques (and forces) of the joints in N
    m (and N), from MultibodyPlant's port of that name. The model neglects gravity, or assumes that
    it is compensated: only forces at the fingertips and inertia load the fingers. If it is
    unconnected, forces are unknown.

    Port `p_WT` emits a vector of 3n: the fingertips' centres in W, in metres; NaN if a position of
    the hand is not finite.

    Port `f_T_W` emits a vector of 3n: the forces that the fingertips press with, in W, in newtons,
    smoothed with a time constant of 10 ms; NaN if a position, velocity or torque is not finite. The
    torques that accelerate the hand do not count: J^T f = tau - M dv/dt - C v with the acceleration
    since the last measurement. In continuous time, this is a momentum observer (De Luca & Mattone,
    2005). A joint at its stop shows no force, because the stop may bear its torque.

    Port `J_WT` emits a vector of 3n nq: the Jacobians of the fingertips' velocities in W, shape (n,
    3, nq); NaN if a position is not finite.

    Args:
        hand: Kinematics of the hand (`HandModel.kinematics`).
        period: Seconds between measurements: the time step of the hand's plant.
        is_sampled: Whether the actuation is that of the last time step, as that of MultibodyPlant's
            sampled ports; else it is that of the next one.

    Raises:
        InvalidArgumentError: If `period` is not positive.
    """

    def __init__(self, hand: HandKinematics, period: float, *, is_sampled: bool = False) -> None:
        super().__init__()
        if not period > 0:
            raise InvalidArgumentError(f"period must be greater than 0 s, not {period}")
        self._hand, self._period, self._is_sampled = hand, period, is_sampled
        self._gain = 1 - math.exp(-period / _SMOOTHING)
        self._no_forces = MultibodyForces(hand.plant)
        nq, n = hand.num_positions, 3 * len(hand.tip_frames)
        # Torques J^T f, and then velocities, actuation and time of the last measurement.
        self._last = self.DeclareDiscreteState(np.repeat([0.0, np.nan], [nq, 2 * nq + 1]))
        self._state = self.DeclareVectorInputPort("hand_state", 2 * nq)
        self._actuation = self.DeclareVectorInputPort("net_actuation", nq)
        model, words = hand.pose(np.zeros(nq)), "kinematics at the measured positions"
        self._pose = pose = declare_cache(self, words, model, self._calc_pose, self._state)
        words = "the hand in its measured state"
        self._placed = declare_context(self, words, hand.plant, self._place, self._state)
        declare_output(self, "p_WT", n, lambda context: pose.Eval(context).p_WT, pose)
        declare_output(self, "f_T_W", n, self._calc_forces, pose, self.xd_ticket())
        declare_output(self, "J_WT", n * nq, lambda context: pose.Eval(context).J_WT, pose)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._measure)

    def _calc_pose(self, context: Context) -> HandPose:
        q = self._state.Eval(context)[: self._hand.num_positions]
        return self._hand.pose(q if are_valid(q) else np.full(len(q), np.nan))

    def _place(self, context: Context, placed: Context) -> None:
        self._hand.plant.SetPositionsAndVelocities(placed, self._state.Eval(context))

    def _measure(self, context: Context, discrete_state: DiscreteValues) -> None:
        time, nq = context.get_time(), self._hand.num_positions
        last: FloatArray = context.get_discrete_state(self._last).value().copy()
        pressing, v_last, actuation_last = last[:-1].reshape(3, nq)
        state, actuation = self._state.Eval(context), np.full(nq, np.nan)
        if self._actuation.HasValue(context):
            actuation = self._actuation.Eval(context)
        v, elapsed = state[nq:], time - last[-1]
        if not (are_valid(state) and are_valid(actuation)):
            pressing = v = actuation = np.full(nq, np.nan)
        elif 0 < elapsed < 1.5 * self._period:  # The clock may have been set.
            placed = self._placed.Eval(context)
            acceleration = (v - v_last) / elapsed
            inertial = self._hand.plant.CalcInverseDynamics(placed, acceleration, self._no_forces)
            newest = (actuation if self._is_sampled else actuation_last) - inertial
            newest = np.where(self._hand.moves_freely(state[:nq]), newest, 0.0)
            pressing = np.where(are_valid(pressing), pressing, newest)
            pressing += self._gain * (newest - pressing)
        measured = np.concatenate([pressing, v, actuation, [time]])
        discrete_state.set_value(self._last, measured)

    def _calc_forces(self, context: Context) -> FloatArray:
        pose: HandPose = self._pose.Eval(context)
        pressing = context.get_discrete_state(self._last).value()[: self._hand.num_positions]
        if not (are_valid(pose.p_WT) and are_valid(pressing)):
            return np.full(pose.p_WT.size, np.nan)
        free = self._hand.moves_freely(self._state.Eval(context)[: len(pressing)])
        return self._hand.tip_forces(np.where(free, pose.J_WT, 0.0), pressing.copy())
