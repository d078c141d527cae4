"""Where an arm is to hold the palm while the fingertips of its hand follow their goals."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable
from pydrake.systems.framework import (
    BasicVector,
    BusValue,
    Context,
    DiscreteValues,
    LeafSystem,
    ValueProducer,
)

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.contacts.assignment import FREE_TURN, palm_turn
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.systems.carrier_posture import reach_frame, upright_frame
from drake_pregrasp.systems.pose_ports import LastPose, validated_poses, validated_velocity

_DAMPING = 1e-4  # Of joints' ways, in metres (and radians) of the palm, squared.
_LARGEST_STEP = 0.2  # Of any joint, in radians.


class ArmKinematics:
    """The kinematics of an arm with a palm.

    It holds no Context: whoever asks brings one of its plant.

    Args:
        plant: A finalized plant with nothing but the arm and its hand.
        palm: The palm's frame P.
        joints: Which positions are the arm's, in the order of the velocities.

    Attributes:
        joints: The same.
        lower: Least positions of these joints.
        upper: Largest ones.
    """

    def __init__(self, plant: MultibodyPlant, palm: Frame, joints: IntArray) -> None:
        self._plant, self._palm, self.joints = plant, palm, joints
        self.lower: FloatArray = plant.GetPositionLowerLimits()[joints]
        self.upper: FloatArray = plant.GetPositionUpperLimits()[joints]

    def palm_pose(self, plant_context: Context) -> RigidTransform:
        """Returns the pose of P in W."""
        return self._palm.CalcPoseInWorld(plant_context)

    def step_to(
        self, plant_context: Context, q: FloatArray, X_WP: RigidTransform, home: FloatArray
    ) -> FloatArray:
        """Returns all positions after a step that brings the palm nearer to a pose.

        It is a damped least-squares step of the arm's joints, which are drawn to their home as far
        as the palm doesn't mind. Near the pose a step leaves an error that is quadratic in the one
        before.

        Args:
            plant_context: To compute in.
            q: Positions to start from, shape (nq,).
            X_WP: Where the palm is to be.
            home: Positions that arms are drawn to, shape (nq,).
        """
        self._plant.SetPositions(plant_context, q)
        J = self._plant.CalcJacobianSpatialVelocity(
            plant_context,
            JacobianWrtVariable.kV,
            self._palm,
            np.zeros(3),
            self._plant.world_frame(),
            self._plant.world_frame(),
        )[:, self.joints]
        inverse = J.T @ np.linalg.inv(J @ J.T + _DAMPING**2 * np.eye(6))
        drawn = _POSTURE_SHARE * (home - q)[self.joints]
        way = inverse @ pose_error(self.palm_pose(plant_context), X_WP)
        way += drawn - inverse @ (J @ drawn)
        way *= min(1.0, _LARGEST_STEP / max(float(np.max(np.abs(way))), _LARGEST_STEP))
        after = np.array(q, dtype=float)
        after[self.joints] = np.clip(after[self.joints] + way, self.lower, self.upper)
        return after


_POSTURE_SHARE = 0.1  # Of its way home that the arm goes at a step, where the palm lets it.


def pose_error(X_WP: RigidTransform, X_WD: RigidTransform) -> FloatArray:
    """Returns the rotation vector and the way from a pose to another, in W, shape (6,)."""
    turn = RotationMatrix(X_WD.rotation() @ X_WP.rotation().inverse()).ToAngleAxis()
    return np.concatenate([turn.axis() * turn.angle(), X_WD.translation() - X_WP.translation()])


SMOOTHING = 0.2
"""Time in which the palm follows a change of estimates, in seconds: arms are heavy."""


class ArmPosture(LeafSystem):
    """Holds the palm of an arm over the object, turned to where the fingertips go.

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

    Port `tip_goals` accepts a `BusValue` of `RigidTransform` in W, as of `FingertipGoalShaper`. As
    long as one isn't finite, the palm doesn't turn.

    Port `X_WG` accepts a `RigidTransform`: the frame that carries the goals.

    Port `V_WG` accepts a `SpatialVelocity`: of that frame in W. If it isn't finite, it is taken for
    zero.

    Port `X_WO_estimated` (optional) accepts a `RigidTransform`: where the object is believed to be;
    `X_WH` and `X_WU` need it. Of this and of `X_WG`, the last pose is used as long as it isn't
    finite, or its rotation is none.

    Port `goals` emits a `BusValue` for `DifferentialInverseKinematicsSystem`: the goals of the tips
    that are finite, and the pose that the palm is to have at the same time. It is over the object,
    as at home, turned so that fingers are aside from their own azimuths as little as they can be on
    the average, without a jump at half a turn, but only within its range.

    Port `nominal_posture` emits a vector of nq: home positions, for what goals leave free.

    Port `X_WH` emits a `RigidTransform`, the frame H of reach in W, and `X_WU` another, the frame U
    of the palm as it is: as those of `CarrierPosture`.

    The palm is a goal of its own, and no mere posture, so that the arm carries and the light
    fingers alone close: an arm that helped them would push the object. It moves with the twist of
    G without a lag, and takes up what jumps, as goals and estimates do, within `SMOOTHING`; the
    fingers make up for that.

    Args:
        tip_frames: Scoped names of the fingertips' frames.
        palm_frame: Scoped name of the palm's frame P.
        finger_azimuths: Of the fingers about z of W over the object at yaw 0, shape (n,), in
            radians.
        X_GP: The palm over the object at yaw 0.
        home: All joints' home positions, shape (nq,).
        p_WG: Where G is at the start, shape (3,), in metres.
        yaw: How far the palm is turned then, in radians.
        lead: For when the goals of the tips are, in seconds after the Context's time.
        period: Seconds between ticks, greater than zero.
        yaw_range: Least and largest angle of the palm, in radians.

    Raises:
        InvalidArgumentError: If `period` isn't positive.
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
    ) -> None:
        super().__init__()
        if not period > 0:
            raise InvalidArgumentError(f"period must be greater than 0 s, not {period}")
        self._tip_frames, self._palm_frame = list(tip_frames), palm_frame
        self._azimuths, self._X_GP = np.array(finger_azimuths), X_GP
        self._home = np.array(home, dtype=float)
        self._lead, self._period, self._yaw_range = lead, period, yaw_range
        # Position of G and yaw of the palm that goals and estimates are smoothed to.
        self._smooth = self.DeclareDiscreteState(np.append(p_WG, yaw))
        pose, bus = AbstractValue.Make(RigidTransform()), AbstractValue.Make(BusValue())
        self._tip_goals = self.DeclareAbstractInputPort("tip_goals", bus)
        self._X_WG = self.DeclareAbstractInputPort("X_WG", pose)
        self._V_WG = self.DeclareAbstractInputPort("V_WG", AbstractValue.Make(SpatialVelocity()))
        self._X_WO = self.DeclareAbstractInputPort("X_WO_estimated", pose)
        self._carrier, self._object = LastPose(self, self._X_WG), LastPose(self, self._X_WO)
        inputs = {self._tip_goals.ticket(), self._X_WG.ticket(), self._V_WG.ticket()}
        self._now = self.DeclareCacheEntry(
            "smoothed position and yaw",
            ValueProducer(
                lambda: AbstractValue.Make(np.zeros(4)),
                lambda context, output: output.set_value(self._calc_now(context)),
            ),
            inputs | {self.xd_ticket()},
        )
        self.DeclareAbstractOutputPort(
            "goals",
            lambda: AbstractValue.Make(BusValue()),
            self._calc_goals,
            {self._now.ticket()} | inputs,
        )
        self.DeclareVectorOutputPort(
            "nominal_posture", len(self._home), self._calc_posture, {self.nothing_ticket()}
        )
        placed = {self.discrete_state_ticket(self._smooth), *self._object.tickets}
        for name, calc in (("X_WH", self._calc_reach), ("X_WU", self._calc_palm)):
            self.DeclareAbstractOutputPort(
                name, lambda: AbstractValue.Make(RigidTransform()), calc, placed
            )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._advance)

    def _rates(self, context: Context) -> FloatArray:
        V_WG = validated_velocity(self._V_WG.Eval(context))
        return np.append(V_WG.translational(), V_WG.rotational()[2])

    def _calc_now(self, context: Context) -> FloatArray:
        smooth: FloatArray = context.get_discrete_state(self._smooth).value()
        ahead = self._lead * self._rates(context)
        p_WG: FloatArray = self._carrier.eval(context).translation()
        poses = self._poses(context)
        p_WT = [X.translation() for X in poses if X is not None]
        yaw = smooth[3] + ahead[3]
        if len(p_WT) == len(poses):
            yaw = palm_turn(np.array(p_WT) - p_WG - ahead[:3], self._azimuths, yaw)
        share = min(1.0, self._period / SMOOTHING)
        now: FloatArray = smooth + share * (np.append(p_WG, yaw - ahead[3]) - smooth)
        return self._within(now)

    def _poses(self, context: Context) -> list[RigidTransform | None]:
        port = f"tip_goals of {self.get_name()}"
        return validated_poses(self._tip_goals.Eval(context), self._tip_frames, port)

    def _within(self, place: FloatArray) -> FloatArray:
        return np.append(place[:3], np.clip(place[3], *self._yaw_range))

    def _advance(self, context: Context, discrete_state: DiscreteValues) -> None:
        now = self._now.Eval(context) + self._period * self._rates(context)
        discrete_state.set_value(self._smooth, self._within(now))
        self._carrier.store(context, discrete_state)
        self._object.store(context, discrete_state)

    def _calc_goals(self, context: Context, output: AbstractValue) -> None:
        goals = BusValue()
        for name, X_WT in zip(self._tip_frames, self._poses(context), strict=True):
            if X_WT is not None:
                goals.Set(name, AbstractValue.Make(X_WT))
        x, y, z, yaw = self._within(self._now.Eval(context) + self._lead * self._rates(context))
        X_WP = RigidTransform(RotationMatrix.MakeZRotation(yaw), [x, y, z]) @ self._X_GP
        goals.Set(self._palm_frame, AbstractValue.Make(X_WP))
        output.set_value(goals)

    def _calc_posture(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._home)

    def _calc_reach(self, context: Context, output: AbstractValue) -> None:
        yaw = float(context.get_discrete_state(self._smooth)[3])
        output.set_value(reach_frame(self._object.eval(context), yaw, self._yaw_range))

    def _calc_palm(self, context: Context, output: AbstractValue) -> None:
        yaw = float(context.get_discrete_state(self._smooth)[3])
        output.set_value(upright_frame(self._object.eval(context), yaw))
