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

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.assignment import FREE_TURN, palm_turn
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.systems.pose_ports import LastPose, validated_poses, validated_velocity


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
        - X_WU

    Port `tip_goals` accepts a `BusValue` of `RigidTransform` in W, as of `FingertipGoalShaper`. As
    long as one isn't finite, the palm doesn't turn.

    Port `X_WG` accepts a `RigidTransform`: the frame that carries the goals.

    Port `V_WG` accepts a `SpatialVelocity`: of that frame in W. If it isn't finite, it is taken for
    zero.

    Port `X_WO_estimated` (optional) accepts a `RigidTransform`: where the object is believed to be;
    `X_WH` and `X_WU` need it. Of this and of `X_WG`, the last pose is used as long as it isn't
    finite, or its rotation is none.

    Port `nominal_posture` emits a vector of nq, for the port of that name of
    `DifferentialInverseKinematicsSystem`: the fingers' home positions, and the carrier over the
    origin of G. It turns so that fingers are aside from their own azimuths as little as they can
    be on the average, without a jump at half a turn, but only within its range.

    Port `X_WH` emits a `RigidTransform`: the frame H in W, that of the fingers' reach. Its origin
    is the object's, over which the palm is, and z is up. It turns with a palm that turns as far as
    it likes; of a palm of limited range it is the middle of that, so that it can turn either way
    while the fingers close.

    Port `X_WU` emits a `RigidTransform`: the frame U in W, of the palm as it is. Its origin is the
    object's, too, z is up, and it always turns with the palm, as of the last tick.

    What follows a posture by a gain K lags by the time 1/K behind a steady motion; the posture is
    ahead by that.

    Args:
        tip_frames: Scoped names of the fingertips' frames.
        finger_azimuths: Of the fingers about the palm's axis at yaw 0, shape (n,), in radians.
        home: All joints' positions over an object at W's origin, shape (nq,).
        carrier: Which of them are x, y, z and yaw.
        gain: K, in 1/s, greater than zero.
        period: Seconds between ticks, greater than zero.
        yaw_range: Least and largest angle of the palm, in radians.

    Raises:
        InvalidArgumentError: If `gain` or `period` isn't positive.
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
        for name, value, unit in (("gain", gain, "1/s"), ("period", period, "s")):
            if not value > 0:
                raise InvalidArgumentError(f"{name} must be greater than 0 {unit}, not {value}")
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
        self._carrier, self._object = LastPose(self, self._X_WG), LastPose(self, self._X_WO)
        self._turned = self.DeclareCacheEntry(
            "yaw",
            ValueProducer(
                lambda: AbstractValue.Make(0.0),
                lambda context, output: output.set_value(self._calc_yaw(context)),
            ),
            {self.xd_ticket(), self._goals.ticket(), self._X_WG.ticket()},
        )
        self.DeclareVectorOutputPort("nominal_posture", len(self._home), self._calc_posture)
        placed = {self.discrete_state_ticket(self._yaw), *self._object.tickets}
        for name, calc in (("X_WH", self._calc_reach), ("X_WU", self._calc_palm)):
            self.DeclareAbstractOutputPort(
                name, lambda: AbstractValue.Make(RigidTransform()), calc, placed
            )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._store_yaw)

    def _calc_yaw(self, context: Context) -> float:
        before = float(context.get_discrete_state(self._yaw)[0])
        port = f"tip_goals of {self.get_name()}"
        poses = validated_poses(self._goals.Eval(context), self._tip_frames, port)
        p_WT = [X.translation() for X in poses if X is not None]
        if len(p_WT) < len(poses):
            return before
        p_WG = self._carrier.eval(context).translation()
        return palm_turn(np.array(p_WT) - p_WG, self._azimuths, before, self._yaw_range)

    def _store_yaw(self, context: Context, discrete_state: DiscreteValues) -> None:
        discrete_state.set_value(self._yaw, [self._turned.Eval(context)])
        self._carrier.store(context, discrete_state)
        self._object.store(context, discrete_state)

    def _calc_posture(self, context: Context, output: BasicVector) -> None:
        V_WG = validated_velocity(self._V_WG.Eval(context))
        posture = self._home.copy()
        posture[self._slides] += self._carrier.eval(context).translation()
        posture[self._slides] += V_WG.translational() * self._lead
        yaw = self._turned.Eval(context) + V_WG.rotational()[2] * self._lead
        posture[self._turn] = np.clip(yaw, *self._yaw_range)
        output.SetFromVector(posture)

    def _calc_reach(self, context: Context, output: AbstractValue) -> None:
        yaw = float(context.get_discrete_state(self._yaw)[0])
        output.set_value(reach_frame(self._object.eval(context), yaw, self._yaw_range))

    def _calc_palm(self, context: Context, output: AbstractValue) -> None:
        yaw = float(context.get_discrete_state(self._yaw)[0])
        output.set_value(upright_frame(self._object.eval(context), yaw))


def reach_frame(X_WO: RigidTransform, yaw: float, yaw_range: tuple[float, float]) -> RigidTransform:
    """Returns the frame H of reach in W: over the object, turned as the palm, or as its middle."""
    middle = sum(yaw_range) / 2
    return upright_frame(X_WO, middle if np.isfinite(middle) else yaw)


def upright_frame(X_WO: RigidTransform, yaw: float) -> RigidTransform:
    """Returns a frame in W with the object's origin and z up, turned by an angle in radians."""
    return RigidTransform(RotationMatrix.MakeZRotation(yaw), X_WO.translation())
