"""Sensor of a hand's fingertips."""

import numpy as np
from pydrake.systems.framework import Context, LeafSystem

from drake_pregrasp.arrays import FloatArray, are_valid, validated_numbers
from drake_pregrasp.systems.hand_kinematics import HandKinematics
from drake_pregrasp.systems.ports import declare_context, declare_output


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

    Port `net_actuation` accepts a vector of nq: torques (and forces) of the joints in N m (and N),
    from MultibodyPlant's port of that name. The model neglects gravity, or assumes that it is
    compensated, and inertia: only forces at the fingertips load the fingers.

    Port `p_WT` emits a vector of 3n: the fingertips' centres in W, in metres; NaN if a position of
    the hand is not finite.

    Port `f_T_W` emits a vector of 3n: the forces that the fingertips press with, in W, in newtons;
    NaN if a position or a torque is not finite.

    Port `J_WT` emits a vector of 3n nq: the Jacobians of the fingertips' velocities in W, shape (n,
    3, nq); NaN if a position is not finite.

    Args:
        hand: Kinematics of the hand.
    """

    def __init__(self, hand: HandKinematics) -> None:
        super().__init__()
        self._hand = hand
        nq, n = hand.num_positions, 3 * len(hand.tip_frames)
        self._state = self.DeclareVectorInputPort("hand_state", 2 * nq)
        self._actuation = self.DeclareVectorInputPort("net_actuation", nq)
        words = "the hand's plant at the measured positions"
        words, calc = "the hand's plant at the measured positions", self._calc_posed
        self._posed = posed = declare_context(self, words, hand.plant, calc, self._state)
        declare_output(self, "p_WT", n, self._calc_positions, posed)
        declare_output(self, "f_T_W", n, self._calc_forces, posed, self._actuation)
        declare_output(self, "J_WT", n * nq, self._calc_jacobians, posed)

    def _calc_posed(self, context: Context, posed: Context) -> None:
        q = self._state.Eval(context)[: self._hand.num_positions]
        self._hand.plant.SetPositions(posed, q if are_valid(q) else np.zeros(len(q)))

    def _if_known(self, context: Context, measured: FloatArray) -> FloatArray:
        """Returns what was measured, or NaN if a position is not finite: Drake aborts on NaN."""
        q = self._state.Eval(context)[: self._hand.num_positions]
        return measured if are_valid(q) else np.full_like(measured, np.nan)

    def _calc_positions(self, context: Context) -> FloatArray:
        return self._if_known(context, self._hand.tip_positions(self._posed.Eval(context)))

    def _calc_jacobians(self, context: Context) -> FloatArray:
        return self._if_known(context, self._hand.tip_jacobians(self._posed.Eval(context)))

    def _calc_forces(self, context: Context) -> FloatArray:
        # One NaN makes all forces NaN: the joints of others count times zero.
        actuation = validated_numbers(self._actuation.Eval(context))
        forces = self._hand.tip_forces(self._posed.Eval(context), actuation)
        return self._if_known(context, forces)
