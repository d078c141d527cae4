"""Where an arm would like to be while the fingertips of its hand follow their goals."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.framework import (
    BusValue,
    Context,
    DiscreteValues,
    LeafSystem,
    ValueProducer,
)

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.assignment import FREE_TURN, palm_turn
from drake_pregrasp.systems.arm_kinematics import ArmKinematics
from drake_pregrasp.systems.carrier_posture import reach_frame
from drake_pregrasp.systems.hand_kinematics import HandKinematics


class ArmPosture(LeafSystem):
    """Holds the palm of an arm level over the object, turned to where the fingertips go.

    .. pydrake_system::

        name: ArmPosture
        input_ports:
        - tip_goals
        - X_WG
        - V_WG
        - X_WO_estimated
        output_ports:
        - goals
        - nominal_posture
        - X_WH

    Port `tip_goals` accepts a `BusValue` of `RigidTransform` in W, as of `FingertipGoalShaper`.

    Port `X_WG` accepts a `RigidTransform`: the frame that carries the goals.

    Port `V_WG` accepts a `SpatialVelocity`: of that frame in W.

    Port `X_WO_estimated` (optional) accepts a `RigidTransform`: where the object is believed to be;
    `X_WH` needs it.

    Port `goals` emits a `BusValue`: the goals of the tips, and that of the palm, of which the
    orientation counts.

    Port `nominal_posture` emits a vector of nq, for the port of that name of
    `DifferentialInverseKinematicsSystem`: the fingers' home positions, and the arm's that bring the
    palm over the object, as at home. It turns so that fingers are aside from their own azimuths as
    little as they can be on the average, without a jump at half a turn, but only within its range.

    Port `X_WH` emits a `RigidTransform`: the hand's frame H in W, as that of `CarrierPosture`.

    What follows a posture by a gain K lags by the time 1/K behind a steady motion; the posture is
    ahead by that.

    Args:
        hand: The kinematics of fingertips.
        arm: That of the arm.
        palm_frame: Scoped name of the palm's frame P.
        finger_azimuths: Of the fingers about z of W over the object at yaw 0, shape (n,), in
            radians.
        X_GP: The palm over the object at yaw 0.
        home: All joints' positions, as far as the object leaves them free, shape (nq,).
        initial: All joints' positions at the start, shape (nq,).
        yaw: How far the palm is turned then, in radians.
        lead: For when the goals of the tips are, in seconds after the Context's time.
        gain: K, in 1/s.
        period: Seconds between ticks, greater than zero.
        yaw_range: Least and largest angle of the palm, in radians.
    """

    def __init__(
        self,
        *,
        hand: HandKinematics,
        arm: ArmKinematics,
        palm_frame: str,
        finger_azimuths: FloatArray,
        X_GP: RigidTransform,
        home: FloatArray,
        initial: FloatArray,
        yaw: float,
        lead: float,
        gain: float,
        period: float,
        yaw_range: tuple[float, float] = FREE_TURN,
    ) -> None:
        super().__init__()
        self._hand, self._arm, self._palm_frame = hand, arm, palm_frame
        self._azimuths, self._X_GP = np.array(finger_azimuths), X_GP
        self._home = np.array(home, dtype=float)
        self._lead, self._gain_lead, self._yaw_range = lead, 1 / gain, yaw_range
        self._yaw = self.DeclareDiscreteState(np.array([yaw]))
        self._q = self.DeclareDiscreteState(np.array(initial, dtype=float))
        self._tip_goals = self.DeclareAbstractInputPort("tip_goals", AbstractValue.Make(BusValue()))
        self._X_WG = self.DeclareAbstractInputPort("X_WG", AbstractValue.Make(RigidTransform()))
        self._V_WG = self.DeclareAbstractInputPort("V_WG", AbstractValue.Make(SpatialVelocity()))
        self._X_WO = self.DeclareAbstractInputPort(
            "X_WO_estimated", AbstractValue.Make(RigidTransform())
        )
        inputs = {self._tip_goals.ticket(), self._X_WG.ticket(), self._V_WG.ticket()}
        self._turned = self.DeclareCacheEntry(
            "yaw",
            ValueProducer(
                lambda: AbstractValue.Make(0.0),
                lambda context, output: output.set_value(self._calc_yaw(context)),
            ),
            inputs | {self.xd_ticket()},
        )
        self._scratch = self.DeclareCacheEntry(
            "the plant's context",
            ValueProducer(
                lambda: AbstractValue.Make(hand.plant.CreateDefaultContext()),
                lambda context, output: None,
            ),
            {self.nothing_ticket()},
        )
        self._solved = self.DeclareCacheEntry(
            "nominal positions",
            ValueProducer(
                lambda: AbstractValue.Make(np.zeros(len(self._home))),
                lambda context, output: output.set_value(self._solve(context)),
            ),
            inputs | {self.xd_ticket()},
        )
        self.DeclareAbstractOutputPort(
            "goals",
            lambda: AbstractValue.Make(BusValue()),
            self._calc_goals,
            {self._turned.ticket()} | inputs,
        )
        self.DeclareVectorOutputPort(
            "nominal_posture",
            len(self._home),
            lambda context, output: output.SetFromVector(self._solved.Eval(context)),
            {self._solved.ticket()},
        )
        self.DeclareAbstractOutputPort(
            "X_WH",
            lambda: AbstractValue.Make(RigidTransform()),
            self._calc_hand,
            {self.discrete_state_ticket(self._yaw), self._X_WO.ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._store)

    def _calc_yaw(self, context: Context) -> float:
        goals: BusValue = self._tip_goals.Eval(context)
        X_WG: RigidTransform = self._X_WG.Eval(context)
        p_WT = np.array([goals.Find(name).translation() for name in self._hand.tip_frames])
        V_WG: SpatialVelocity = self._V_WG.Eval(context)
        p_WG = X_WG.translation() + V_WG.translational() * self._lead
        before = float(context.get_discrete_state(self._yaw)[0])
        return palm_turn(p_WT - p_WG, self._azimuths, before, self._yaw_range)

    def _palm_goal(self, context: Context, lead: float) -> RigidTransform:
        """Returns where the palm is to be a while after the Context's time."""
        V_WG: SpatialVelocity = self._V_WG.Eval(context)
        p_WG = self._X_WG.Eval(context).translation() + V_WG.translational() * lead
        yaw = self._turned.Eval(context) + V_WG.rotational()[2] * (lead - self._lead)
        yaw = float(np.clip(yaw, *self._yaw_range))
        return RigidTransform(RotationMatrix.MakeZRotation(yaw), p_WG) @ self._X_GP

    def _solve(self, context: Context) -> FloatArray:
        q = self._home.copy()
        q[self._arm.joints] = context.get_discrete_state(self._q).value()[self._arm.joints]
        X_WP = self._palm_goal(context, self._gain_lead)
        return self._arm.step_to(self._scratch.Eval(context), q, X_WP, self._home)

    def _store(self, context: Context, discrete_state: DiscreteValues) -> None:
        discrete_state.set_value(self._yaw, [self._turned.Eval(context)])
        discrete_state.set_value(self._q, self._solved.Eval(context))

    def _calc_goals(self, context: Context, output: AbstractValue) -> None:
        tip_goals: BusValue = self._tip_goals.Eval(context)
        goals = BusValue()
        for name in self._hand.tip_frames:
            goals.Set(name, AbstractValue.Make(tip_goals.Find(name)))
        X_WP = self._palm_goal(context, self._lead)
        goals.Set(self._palm_frame, AbstractValue.Make(X_WP))
        output.set_value(goals)

    def _calc_hand(self, context: Context, output: AbstractValue) -> None:
        yaw = float(context.get_discrete_state(self._yaw)[0])
        output.set_value(reach_frame(self._X_WO.Eval(context), yaw, self._yaw_range))
