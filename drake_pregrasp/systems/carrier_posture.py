"""Where a hand's carrier would like to be while its fingertips follow their goals."""

import math
from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
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
from drake_pregrasp.planning.assignment import mean_angle


class CarrierPosture(LeafSystem):
    """Holds the palm of a radial hand over the object, turned to where the fingertips go.

    .. pydrake_system::

        name: CarrierPosture
        input_ports:
        - tip_goals
        - X_WG
        - V_WG
        output_ports:
        - nominal_posture

    Port `tip_goals` accepts a `BusValue` of `RigidTransform` in W, as of `FingertipGoalShaper`.

    Port `X_WG` accepts a `RigidTransform`: the frame that carries the goals.

    Port `V_WG` accepts a `SpatialVelocity`: of that frame in W.

    Port `nominal_posture` emits a vector of nq, for the port of that name of
    `DifferentialInverseKinematicsSystem`: the fingers' home positions, and the carrier over the
    origin of G. It turns so that fingers are aside from their own azimuths as little as they can
    be on the average, without a jump at half a turn.

    What follows a posture by a gain K lags by the time 1/K behind a steady motion; the posture is
    ahead by that.

    Args:
        tip_frames: Scoped names of the fingertips' frames.
        finger_azimuths: Of the fingers about the palm's axis at yaw 0, shape (n,), in radians.
        home: All joints' positions over an object at W's origin, shape (nq,).
        carrier: Which of them are x, y, z and yaw.
        gain: K, in 1/s.
        period: Seconds between ticks, greater than zero.
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
    ) -> None:
        super().__init__()
        self._tip_frames = list(tip_frames)
        self._azimuths = np.array(finger_azimuths)
        self._home = np.array(home, dtype=float)
        self._slides, self._turn = list(carrier[:3]), carrier[3]
        self._lead = 1 / gain
        self._yaw = self.DeclareDiscreteState(np.array([self._home[self._turn]]))
        self._goals = self.DeclareAbstractInputPort("tip_goals", AbstractValue.Make(BusValue()))
        self._X_WG = self.DeclareAbstractInputPort("X_WG", AbstractValue.Make(RigidTransform()))
        self._V_WG = self.DeclareAbstractInputPort("V_WG", AbstractValue.Make(SpatialVelocity()))
        self._turned = self.DeclareCacheEntry(
            "yaw",
            ValueProducer(
                lambda: AbstractValue.Make(0.0),
                lambda context, output: output.set_value(self._calc_yaw(context)),
            ),
            {self.xd_ticket(), self._goals.ticket(), self._X_WG.ticket()},
        )
        self.DeclareVectorOutputPort("nominal_posture", len(self._home), self._calc_posture)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._store_yaw)

    def _calc_yaw(self, context: Context) -> float:
        goals: BusValue = self._goals.Eval(context)
        X_WG: RigidTransform = self._X_WG.Eval(context)
        p_WT = np.array([goals.Find(name).translation() for name in self._tip_frames])
        level = (p_WT - X_WG.translation())[:, :2]
        yaw = mean_angle(np.arctan2(level[:, 1], level[:, 0]) - self._azimuths)
        before = float(context.get_discrete_state(self._yaw)[0])
        return before + math.remainder(yaw - before, 2 * math.pi)

    def _store_yaw(self, context: Context, discrete_state: DiscreteValues) -> None:
        discrete_state.set_value(self._yaw, [self._turned.Eval(context)])

    def _calc_posture(self, context: Context, output: BasicVector) -> None:
        V_WG: SpatialVelocity = self._V_WG.Eval(context)
        posture = self._home.copy()
        posture[self._slides] += self._X_WG.Eval(context).translation()
        posture[self._slides] += V_WG.translational() * self._lead
        posture[self._turn] = self._turned.Eval(context) + V_WG.rotational()[2] * self._lead
        output.SetFromVector(posture)
