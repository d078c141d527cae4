"""Where a hand's fingertips are and what they feel, from its joints."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, ValueProducer

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.usable_inputs import known_numbers
from drake_pregrasp.systems.hand_kinematics import HandKinematics


class FingertipSensor(LeafSystem):
    """Measures positions of fingertips and the forces they press with, as a real hand can.

    .. pydrake_system::

        name: FingertipSensor
        input_ports:
        - hand_state
        - net_actuation
        output_ports:
        - p_WT
        - f_T_W

    Port `hand_state` accepts a vector of 2 nq: positions and velocities of the hand's joints.

    Port `net_actuation` accepts a vector of nq: their torques (and forces) in N m (and N), as of
    MultibodyPlant's port of that name. Nothing but the forces at the tips may load the fingers: no
    gravity, or one that is compensated, and no quick motion.

    Port `p_WT` emits a vector of 3n: the fingertips' centres in W, in metres; NaN if one of the
    hand's positions isn't finite, for nobody knows then.

    Port `f_T_W` emits a vector of 3n: the forces that the tips press with, in W, in newtons; NaN if
    a position or torque isn't finite.

    Args:
        hand: Its kinematics.
    """

    def __init__(self, hand: HandKinematics) -> None:
        super().__init__()
        self._hand = hand
        nq, n = hand.num_positions, len(hand.tip_frames)
        self._state = self.DeclareVectorInputPort("hand_state", 2 * nq)
        self._actuation = self.DeclareVectorInputPort("net_actuation", nq)
        self._posed = self.DeclareCacheEntry(
            "the hand's plant at the measured positions",
            ValueProducer(
                lambda: AbstractValue.Make(hand.plant.CreateDefaultContext()), self._calc_posed
            ),
            {self._state.ticket()},
        )
        self.DeclareVectorOutputPort("p_WT", 3 * n, self._calc_positions, {self._posed.ticket()})
        self.DeclareVectorOutputPort(
            "f_T_W", 3 * n, self._calc_forces, {self._posed.ticket(), self._actuation.ticket()}
        )

    def _positions(self, context: Context) -> FloatArray:
        return known_numbers(self._state.Eval(context)[: self._hand.num_positions])

    def _calc_posed(self, context: Context, output: AbstractValue) -> None:
        q = self._positions(context)
        self._hand.plant.SetPositions(output.get_mutable_value(), q)

    def _calc_positions(self, context: Context, output: BasicVector) -> None:
        if np.any(np.isnan(self._positions(context))):  # Drake ends the process for such ones.
            output.SetFromVector(np.full(output.size(), np.nan))
            return
        output.SetFromVector(self._hand.tip_positions(self._posed.Eval(context)).ravel())

    def _calc_forces(self, context: Context, output: BasicVector) -> None:
        actuation = known_numbers(self._actuation.Eval(context))
        if np.any(np.isnan(actuation)) or np.any(np.isnan(self._positions(context))):
            output.SetFromVector(np.full(output.size(), np.nan))
            return
        forces = self._hand.tip_forces(self._posed.Eval(context), actuation)
        output.SetFromVector(forces.ravel())
