"""Sensor of a hand's fingertips."""

import numpy as np
from pydrake.systems.framework import Context, LeafSystem

from drake_pregrasp.arrays import FloatArray, are_valid
from drake_pregrasp.grasping.forward_kinematics import HandPose
from drake_pregrasp.systems.hand_kinematics import HandKinematics
from drake_pregrasp.systems.ports import declare_cache, declare_output


class FingertipSensor(LeafSystem):
    """Measures the fingertips' positions and forces from the joints, as a real hand can.

    .. pydrake_system::

        name: FingertipSensor
        input_ports:
        - hand_state
        - net_actuation
        - inertial_torque
        output_ports:
        - p_WT
        - f_T_W
        - J_WT

    Port `hand_state` accepts a vector of 2 nq: positions and velocities of the hand's joints.

    Port `net_actuation` accepts a vector of nq: torques (and forces) of the joints in N m (and N),
    from MultibodyPlant's port of that name. The model neglects gravity, or assumes that it is
    compensated: only forces at the fingertips and inertia load the fingers.

    Port `inertial_torque` (optional) accepts a vector of nq: torques (and forces) that accelerate
    the hand as commanded (`DifferentialKinematics`). If it is unconnected, inertia is neglected.

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
        self._inertial = self.DeclareVectorInputPort("inertial_torque", nq)
        model, words = hand.pose(np.zeros(nq)), "kinematics at the measured positions"
        self._pose = pose = declare_cache(self, words, model, self._calc_pose, self._state)
        declare_output(self, "p_WT", n, lambda context: pose.Eval(context).p_WT, pose)
        loads = self._actuation, self._inertial
        declare_output(self, "f_T_W", n, self._calc_forces, pose, *loads)
        declare_output(self, "J_WT", n * nq, lambda context: pose.Eval(context).J_WT, pose)

    def _calc_pose(self, context: Context) -> HandPose:
        q = self._state.Eval(context)[: self._hand.num_positions]
        return self._hand.pose(q if are_valid(q) else np.full(len(q), np.nan))

    def _calc_forces(self, context: Context) -> FloatArray:
        pose: HandPose = self._pose.Eval(context)
        actuation = self._actuation.Eval(context)
        if self._inertial.HasValue(context):
            actuation = actuation - self._inertial.Eval(context)
        if not (are_valid(pose.p_WT) and are_valid(actuation)):
            return np.full(pose.p_WT.size, np.nan)
        return self._hand.tip_forces(pose.J_WT, actuation)
