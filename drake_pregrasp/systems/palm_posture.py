"""Posture of the palm over the object while the fingertips follow their goals."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import (
    BusValue,
    Context,
    DiscreteStateIndex,
    DiscreteValues,
    LeafSystem,
)

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.assignment import FREE_TURN, palm_turn
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.quality.grasp_quality import skew
from drake_pregrasp.systems import ports

FROM_ABOVE = RigidTransform()
"""Approach of a palm from above; see `HandModel`."""


def pose_error(X_WP: RigidTransform, X_WD: RigidTransform) -> FloatArray:
    """Returns the rotation vector and the translation from pose P to pose D in W, shape (6,)."""
    turn = RotationMatrix(X_WD.rotation() @ X_WP.rotation().inverse()).ToAngleAxis()
    return np.concatenate([turn.axis() * turn.angle(), X_WD.translation() - X_WP.translation()])


SMOOTHING = 0.2
"""Time constant with which a palm on an arm follows changes of goals and estimates, in seconds."""


class _PalmPosture(LeafSystem):
    """Common ports of systems that hold a palm over the object.

    Args:
        tip_frames: Scoped names of the fingertips' frames.
        finger_azimuths: Azimuths of the fingers at yaw 0, shape (n,), in radians.
        yaw_range: Smallest and largest angle of the palm, in radians.
        period: Seconds between ticks.
        state: Initial state, with the palm's yaw in radians as its last element.
        X_LA: Approach of the palm; see `HandModel`.
        p_OCoM: Centre of mass in O, and in G, shape (3,), in metres.
    """

    def __init__(
        self,
        tip_frames: Sequence[str],
        finger_azimuths: FloatArray,
        yaw_range: tuple[float, float],
        period: float,
        state: FloatArray,
        X_LA: RigidTransform,
        p_OCoM: FloatArray | None,
    ) -> None:
        super().__init__()
        if not period > 0:
            raise InvalidArgumentError(f"period must be greater than 0 s, not {period}")
        self._tip_frames, self._azimuths = list(tip_frames), np.array(finger_azimuths)
        self._yaw_range, self._period, self._X_LA = yaw_range, period, X_LA
        self._p_OCoM: FloatArray = np.zeros(3) if p_OCoM is None else np.array(p_OCoM)
        self._R_LA, self._p_LA = X_LA.rotation().matrix(), X_LA.translation()

        self._state: DiscreteStateIndex = self.DeclareDiscreteState(state)
        self._tip_goals = self.DeclareAbstractInputPort("tip_goals", ports.BUS)
        self._X_WG = self.DeclareAbstractInputPort("X_WG", ports.POSE)
        self._V_WG = self.DeclareAbstractInputPort("V_WG", ports.VELOCITY)
        self._X_WO = self.DeclareAbstractInputPort("X_WO_estimated", ports.POSE)
        self._carrier = ports.LastPose(self, self._X_WG)
        self._object = ports.LastPose(self, self._X_WO)

    def _declare_frames(self) -> None:
        for name, calc in (("X_WH", self._calc_X_WH), ("X_WU", self._calc_X_WU)):
            stored = self.discrete_state_ticket(self._state)
            ports.declare_output(self, name, ports.POSE, calc, stored, self._object.source)

    def _calc_X_WH(self, context: Context) -> RigidTransform:
        yaw = context.get_discrete_state(self._state).value()[-1]
        p_WCoM = self._object.eval(context) @ self._p_OCoM
        return reach_frame(p_WCoM, yaw, self._yaw_range, self._X_LA)

    def _calc_X_WU(self, context: Context) -> RigidTransform:
        yaw = context.get_discrete_state(self._state).value()[-1]
        return turned_frame(self._object.eval(context) @ self._p_OCoM, self._X_LA, yaw)

    def _p_WL(self, context: Context) -> FloatArray:
        """Returns the position in W of the centre of mass of an object at G, shape (3,)."""
        R_WG, p_WG = self._carrier.split(context)
        return np.asarray(p_WG + R_WG @ self._p_OCoM)

    def _rates(self, context: Context) -> FloatArray:
        """Returns the velocity of L with G in W, and the rate of turn about z of A, shape (4,)."""
        w_WG, v_WL = ports.validated_velocity(self._V_WG.Eval(context))
        if self._p_OCoM.any():
            v_WL = v_WL + skew(w_WG) @ (self._carrier.split(context)[0] @ self._p_OCoM)
        return np.array([*v_WL.tolist(), w_WG @ self._R_LA[:, 2]])

    def _yaw_toward(
        self, context: Context, yaw: float, ahead: FloatArray | float, *limits: Any
    ) -> float:
        """Returns `palm_turn` to the tips' goals from L, moved ahead; yaw itself if one lacks."""
        p_WT = [X.translation() for X in self._goal_poses(context) if X is not None]
        if len(p_WT) < len(self._tip_frames):
            return yaw
        p_LT = np.array(p_WT) - self._p_WL(context) - ahead
        p_AT = (p_LT - self._p_LA) @ self._R_LA
        return palm_turn(p_AT, self._azimuths, yaw, *limits)

    def _store_poses(self, context: Context, discrete_state: DiscreteValues) -> None:
        self._carrier.store(context, discrete_state)
        self._object.store(context, discrete_state)

    def _goal_poses(self, context: Context) -> list[RigidTransform | None]:
        port = f"tip_goals of {self.get_name()}"
        return ports.validated_poses(self._tip_goals.Eval(context), self._tip_frames, port)


def reach_frame(
    p_WCoM: FloatArray, yaw: float, yaw_range: tuple[float, float], X_LA: RigidTransform
) -> RigidTransform:
    """Returns the frame H of reach in W (`CarrierPosture` defines it).

    Args:
        p_WCoM: Centre of mass of the object in W, shape (3,), in metres.
        yaw: Yaw of the palm, in radians.
        yaw_range: Smallest and largest angle of the palm, in radians.
        X_LA: Approach of the palm; see `HandModel`.
    """
    middle = sum(yaw_range) / 2
    return turned_frame(p_WCoM, X_LA, middle if np.isfinite(middle) else yaw)


def turned_frame(p_WCoM: FloatArray, X_LA: RigidTransform, yaw: float) -> RigidTransform:
    """Returns the frame A of an approach in W, turned by the palm's yaw."""
    turn = RigidTransform(RotationMatrix.MakeZRotation(yaw), np.zeros(3))
    return RigidTransform(p_WCoM) @ X_LA @ turn


class CarrierPosture(_PalmPosture):
    """Holds the palm of a radial hand over the object, turned toward the fingertips' goals.

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

    Port `tip_goals` accepts a `BusValue` of `RigidTransform` in W, as `FingertipGoalShaper` emits
    it. While a goal is missing or invalid, the palm does not turn.

    Port `X_WG` accepts a `RigidTransform`: the pose of the frame G in which the goals are planned.

    Port `V_WG` accepts a `SpatialVelocity`: the velocity of G in W. An invalid one counts as zero.

    Port `X_WO_estimated` (optional) accepts a `RigidTransform`: the estimated pose of the object O.
    `X_WH` and `X_WU` need it. While this pose or `X_WG` is invalid, its last valid value is used.

    Port `nominal_posture` emits a vector of nq, for the port of that name of
    `DifferentialKinematics`: home positions of the fingers, and the carrier over the centre of mass
    in G. The palm turns to the yaw of `palm_turn`, which brings its fingers nearest to their goals,
    continuously and within its range.

    Port `X_WH` emits a `RigidTransform`: the frame H of the fingers' reach in W. At yaw 0 it is the
    frame A of the approach; from above, its origin is the centre of mass and its z axis is up. H
    turns with a palm that turns without limits; for a palm of limited range its yaw is the middle
    of that range, from which the palm can turn either way while the fingers close.

    Port `X_WU` emits a `RigidTransform`: the frame U of the palm in W, as of the last tick. It
    is as H, but always turns with the palm.

    A system that follows a posture with the gain K lags a constant velocity by the time 1/K, so the
    posture is predicted ahead by 1/K.

    Args:
        tip_frames: Scoped names of the fingertips' frames.
        finger_azimuths: Azimuths of the fingers about the palm's axis at yaw 0, shape (n,), in
            radians.
        home: Positions of all joints over an object with its centre of mass at W's origin, shape
            (nq,).
        carrier: Indices of the positions x, y, z and yaw.
        gain: Gain K with which the posture is followed, in 1/s, greater than zero.
        period: Seconds between ticks, greater than zero.
        yaw_range: Smallest and largest angle of the palm, in radians.
        X_LA: Approach of the palm; see `HandModel`.
        p_OCoM: Centre of mass of the object in O, shape (3,), in metres; by default the origin.

    Raises:
        InvalidArgumentError: If `gain` or `period` is not positive.
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
        X_LA: RigidTransform = FROM_ABOVE,
        p_OCoM: FloatArray | None = None,
    ) -> None:
        yaw = np.array(home, dtype=float)[[carrier[3]]]
        super().__init__(tip_frames, finger_azimuths, yaw_range, period, yaw, X_LA, p_OCoM)
        if not gain > 0:
            raise InvalidArgumentError(f"gain must be greater than 0 1/s, not {gain}")
        self._home, self._lead = np.array(home, dtype=float), 1 / gain
        self._slides, self._turn = np.array(carrier[:3]), carrier[3]
        stored, inputs = self.xd_ticket(), (self._tip_goals, self._X_WG)
        self._turned = ports.declare_cache(self, "yaw", 0.0, self._calc_yaw, stored, *inputs)
        nq, turned = len(self._home), self._turned
        sources = (stored, turned, self._X_WG, self._V_WG)
        ports.declare_output(self, "nominal_posture", nq, self._calc_posture, *sources)
        self._declare_frames()
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._store)

    def _calc_yaw(self, context: Context) -> float:
        yaw = float(context.get_discrete_state(self._state)[0])
        return self._yaw_toward(context, yaw, 0.0, self._yaw_range)

    def _store(self, context: Context, discrete_state: DiscreteValues) -> None:
        discrete_state.set_value(self._state, [self._turned.Eval(context)])
        self._store_poses(context, discrete_state)

    def _calc_posture(self, context: Context) -> FloatArray:
        rates, posture = self._rates(context), self._home.copy()
        posture[self._slides] += (self._p_WL(context) + self._lead * rates[:3]) @ self._R_LA
        yaw = self._turned.Eval(context) + rates[3] * self._lead
        low, high = self._yaw_range
        posture[self._turn] = max(low, min(yaw, high))
        return posture


class ArmPosture(_PalmPosture):
    """Holds the palm of an arm over the object, turned toward the fingertips' goals.

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
        - X_WU

    The ports are those of `CarrierPosture`, except for these:

    Port `goals` emits a `BusValue` for `DifferentialKinematics`: the valid goals of the fingertips,
    and the desired pose of the palm at the same time. The palm is over the object as at home, and
    turned as `CarrierPosture` turns it.

    Port `nominal_posture` emits a vector of nq: the home positions, for the joints that the goals
    leave free.

    The palm has a goal of its own instead of a posture, so that the arm carries the hand and only
    the light fingers close: a closing arm would push the object. The palm moves with the velocity
    of G without a lag. It follows jumps of goals and estimates with the time constant `SMOOTHING`,
    and the fingers compensate meanwhile.

    Args:
        tip_frames: Scoped names of the fingertips' frames.
        palm_frame: Scoped name of the palm's frame P.
        finger_azimuths: Azimuths of the fingers about z of W over the object at yaw 0, shape (n,),
            in radians.
        X_GP: Pose of the palm in A at yaw 0.
        home: Home positions of all joints, shape (nq,).
        p_WG: Initial position in W of the centre of mass of an object at G, shape (3,), in metres.
        yaw: Initial yaw of the palm, in radians.
        lead: Seconds by which the fingertips' goals are ahead of the Context's time.
        period: Seconds between ticks, greater than zero.
        yaw_range: Smallest and largest angle of the palm, in radians.
        X_LA: Approach of the palm; see `HandModel`.
        p_OCoM: Centre of mass of the object in O, shape (3,), in metres; by default the origin.

    Raises:
        InvalidArgumentError: If `period` is not positive.
    """

    def __init__(
        self,
        *,
        tip_frames: Sequence[str],
        palm_frame: str,
        finger_azimuths: FloatArray,
        X_GP: RigidTransform,
        home: FloatArray,
        p_WG: FloatArray,
        yaw: float,
        lead: float,
        period: float,
        yaw_range: tuple[float, float] = FREE_TURN,
        X_LA: RigidTransform = FROM_ABOVE,
        p_OCoM: FloatArray | None = None,
    ) -> None:
        # The state is the smoothed position of L and yaw of the palm.
        state = np.append(p_WG, yaw)
        super().__init__(tip_frames, finger_azimuths, yaw_range, period, state, X_LA, p_OCoM)
        self._palm_frame, self._X_GP, self._lead = palm_frame, X_GP, lead
        self._home = np.array(home, dtype=float)
        inputs = (self.xd_ticket(), self._tip_goals, self._X_WG, self._V_WG)
        self._now = ports.declare_cache(
            self, "smoothed position", np.zeros(4), self._calc_now, *inputs
        )
        ports.declare_output(self, "goals", ports.BUS, self._calc_goals, self._now, *inputs)
        nq, nothing = len(self._home), self.nothing_ticket()
        ports.declare_output(self, "nominal_posture", nq, lambda c: self._home, nothing)
        self._declare_frames()
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._advance)

    def _calc_now(self, context: Context) -> FloatArray:
        smooth: FloatArray = context.get_discrete_state(self._state).value()
        ahead = self._lead * self._rates(context)
        p_WL = self._p_WL(context)
        yaw = self._yaw_toward(context, smooth[3] + ahead[3], ahead[:3])
        share = min(1.0, self._period / SMOOTHING)
        now: FloatArray = smooth + share * (np.append(p_WL, yaw - ahead[3]) - smooth)
        return self._within(now)

    def _within(self, place: FloatArray) -> FloatArray:
        return np.append(place[:3], np.clip(place[3], *self._yaw_range))

    def _advance(self, context: Context, discrete_state: DiscreteValues) -> None:
        now = self._now.Eval(context) + self._period * self._rates(context)
        discrete_state.set_value(self._state, self._within(now))
        self._store_poses(context, discrete_state)

    def _calc_goals(self, context: Context) -> BusValue:
        tips = zip(self._tip_frames, self._goal_poses(context), strict=True)
        goals = {name: X_WT for name, X_WT in tips if X_WT is not None}
        *p_WL, yaw = self._within(self._now.Eval(context) + self._lead * self._rates(context))
        X_WP = turned_frame(np.array(p_WL), self._X_LA, yaw) @ self._X_GP
        return ports.pose_bus(goals | {self._palm_frame: X_WP})
