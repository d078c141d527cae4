"""Where a hand's carrier would like to be while its fingertips follow their goals."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.framework import (
    BasicVector,
    BusValue,
    Context,
    DiscreteValues,
    LeafSystem,
    ValueProducer,
)

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.assignment import FREE_TURN, palm_turn


class CarrierPosture(LeafSystem):
    """Holds the palm of a radial hand over the object, turned to where the fingertips go.

    .. pydrake_system::

        name: CarrierPosture
        input_ports:
        - tip_goals
        - X_WG
        - V_WG
        - X_WO_estimated
        output_ports:
        - nominal_posture
        - X_WH

    Port `tip_goals` accepts a `BusValue` of `RigidTransform` in W, as of `FingertipGoalShaper`.

    Port `X_WG` accepts a `RigidTransform`: the frame that carries the goals.

    Port `V_WG` accepts a `SpatialVelocity`: of that frame in W.

    Port `X_WO_estimated` (optional) accepts a `RigidTransform`: where the object is believed to be;
    `X_WH` needs it.

    Port `nominal_posture` emits a vector of nq, for the port of that name of
    `DifferentialInverseKinematicsSystem`: the fingers' home positions, and the carrier over the
    origin of G. It turns so that fingers are aside from their own azimuths as little as they can
    be on the average, without a jump at half a turn, but only within its range.

    Port `X_WH` emits a `RigidTransform`: the hand's frame H in W, that of the fingers' reach. Its
    origin is the object's, over which the palm is, and it turns with the palm, as of the last tick.
    A palm of limited range is taken in the middle of it, so that it can turn either way while the
    fingers close.

    What follows a posture by a gain K lags by the time 1/K behind a steady motion; the posture is
    ahead by that.

    Args:
        tip_frames: Scoped names of the fingertips' frames.
        finger_azimuths: Of the fingers about the palm's axis at yaw 0, shape (n,), in radians.
        home: All joints' positions over an object at W's origin, shape (nq,).
        carrier: Which of them are x, y, z and yaw.
        gain: K, in 1/s.
        period: Seconds between ticks, greater than zero.
        yaw_range: Least and largest angle of the palm, in radians.
    """

    def __init__(
        self,
        *,
        tip_frames: Sequence[str],
        finger_azimuths: FloatArray,
        home: FloatArray,
        carrier: Sequence[int],
        gain: float,
        period: float,
        yaw_range: tuple[float, float] = FREE_TURN,
    ) -> None:
        super().__init__()
        self._tip_frames = list(tip_frames)
        self._azimuths = np.array(finger_azimuths)
        self._home = np.array(home, dtype=float)
        self._slides, self._turn = list(carrier[:3]), carrier[3]
        self._lead, self._yaw_range = 1 / gain, yaw_range
        self._yaw = self.DeclareDiscreteState(np.array([self._home[self._turn]]))
        self._goals = self.DeclareAbstractInputPort("tip_goals", AbstractValue.Make(BusValue()))
        self._X_WG = self.DeclareAbstractInputPort("X_WG", AbstractValue.Make(RigidTransform()))
        self._V_WG = self.DeclareAbstractInputPort("V_WG", AbstractValue.Make(SpatialVelocity()))
        self._X_WO = self.DeclareAbstractInputPort(
            "X_WO_estimated", AbstractValue.Make(RigidTransform())
        )
        self._turned = self.DeclareCacheEntry(
            "yaw",
            ValueProducer(
                lambda: AbstractValue.Make(0.0),
                lambda context, output: output.set_value(self._calc_yaw(context)),
            ),
            {self.xd_ticket(), self._goals.ticket(), self._X_WG.ticket()},
        )
        self.DeclareVectorOutputPort("nominal_posture", len(self._home), self._calc_posture)
        self.DeclareAbstractOutputPort(
            "X_WH",
            lambda: AbstractValue.Make(RigidTransform()),
            self._calc_hand,
            {self.discrete_state_ticket(self._yaw), self._X_WO.ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._store_yaw)

    def _calc_yaw(self, context: Context) -> float:
        goals: BusValue = self._goals.Eval(context)
        X_WG: RigidTransform = self._X_WG.Eval(context)
        p_WT = np.array([goals.Find(name).translation() for name in self._tip_frames])
        before = float(context.get_discrete_state(self._yaw)[0])
        return palm_turn(p_WT - X_WG.translation(), self._azimuths, before, self._yaw_range)

    def _store_yaw(self, context: Context, discrete_state: DiscreteValues) -> None:
        discrete_state.set_value(self._yaw, [self._turned.Eval(context)])

    def _calc_posture(self, context: Context, output: BasicVector) -> None:
        V_WG: SpatialVelocity = self._V_WG.Eval(context)
        posture = self._home.copy()
        posture[self._slides] += self._X_WG.Eval(context).translation()
        posture[self._slides] += V_WG.translational() * self._lead
        yaw = self._turned.Eval(context) + V_WG.rotational()[2] * self._lead
        posture[self._turn] = np.clip(yaw, *self._yaw_range)
        output.SetFromVector(posture)

    def _calc_hand(self, context: Context, output: AbstractValue) -> None:
        yaw = float(context.get_discrete_state(self._yaw)[0])
        output.set_value(reach_frame(self._X_WO.Eval(context), yaw, self._yaw_range))


def reach_frame(X_WO: RigidTransform, yaw: float, yaw_range: tuple[float, float]) -> RigidTransform:
    """Returns the hand's frame H in W: over the object, turned as the palm, or as its middle."""
    middle = sum(yaw_range) / 2
    turn = RotationMatrix.MakeZRotation(middle if np.isfinite(middle) else yaw)
    return RigidTransform(turn, X_WO.translation())
