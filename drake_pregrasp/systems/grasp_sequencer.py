"""The hand's next move: when it closes, how hard it presses, and where it carries the object."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    LeafSystem,
    ValueProducer,
)

from drake_pregrasp.arrays import BoolArray, FloatArray, validated_numbers
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.grasping.grasp_phases import next_state
from drake_pregrasp.grasping.grasp_state import GraspPhase, GraspSettings, GraspState, GraspView
from drake_pregrasp.grasping.squeeze import Coasting, Squeeze, safest_squeeze
from drake_pregrasp.systems.pose_ports import LastPose, validated_velocity

GRAVITY = 9.81
"""Along -z of W, in m/s²."""

_COASTING_SIZE = 18  # Of `Coasting` as a vector.


class GraspSequencer(LeafSystem):
    """Approaches, tracks, closes until touch, squeezes, lifts and holds; or opens and backs off.

    .. pydrake_system::

        name: GraspSequencer
        input_ports:
        - close
        - contact_status
        - contact_frames
        - X_WO_estimated
        - V_WO_estimated
        - p_WT
        - f_T_W
        - tracking_status
        output_ports:
        - X_WG
        - V_WG
        - standoffs
        - hold_contacts
        - fingers_hold
        - squeeze_forces
        - grasp_report

    Port `close` accepts a number: above 0.5 the hand is to close, and to keep closed. It closes
    once no active finger is on its way to its goal, and there are enough whose forces can balance
    the weight. After `gate_limit` it waits no longer: it closes with the fingers that are there, or
    gives up if they are too few or can't balance. NaN changes nothing.

    Port `contact_status` accepts a vector of n `ContactStatus` values.

    Port `contact_frames` accepts a vector of 6n, as `FingertipGoalShaper` emits it. No force
    balances the weight if one isn't finite.

    Port `X_WO_estimated` accepts a `RigidTransform`, `V_WO_estimated` a `SpatialVelocity`: where
    the object O is believed to be in W, and how it moves. Without a pose, as if it isn't finite or
    its rotation is none, the object is lost where it was; without a velocity it stays.

    Port `p_WT` accepts a vector of 3n, `f_T_W` another: as `FingertipSensor` emits them. The hand
    doesn't close with a finger whose place isn't finite, and feels no force that isn't.

    Port `tracking_status` (optional) accepts a `TrackingStatus`; what is none counts as `LOST`.
    While the object isn't followed, the hand comes no lower, waits to close, without a limit, and
    says so, and opens if not all fingers have touched. If they have, it goes on. Unconnected, the
    object is always tracked.

    Port `X_WG` emits a `RigidTransform`: the frame G that carries the goals. It is O as it is
    estimated, raised while the hand approaches. Once all fingers have touched it follows no
    estimate, for the hand then is what moves the object: it goes on as it went, and for the lift
    it comes to rest and goes straight up.

    Port `V_WG` emits a `SpatialVelocity`: of G in W.

    Port `standoffs` emits a vector of n: the gaps that fingertips are to have, in metres.

    Port `hold_contacts` emits a number: 1 once the hand closes, before that 0.

    Port `fingers_hold` emits a vector of n: 1 for each finger that is on its contact or on its way
    there, from when the hand closes until it lets go; 0 for the others, which may heed obstacles.

    Port `squeeze_forces` emits a vector of 3n: what the tips are to press with, in W, in newtons.

    Port `grasp_report` emits a vector of 4: the `GraspPhase`, since when in seconds, the `GiveUp`
    and what goes with it.

    Args:
        num_fingers: n.
        tip_radius: In metres; or that of each, shape (n,).
        mass: Of the object, in kg.
        p_OCoM: Its centre of mass in O, shape (3,), in metres.
        friction: Coulomb's coefficient that squeezes are planned with.
        settings: How the hand grasps.
        period: Seconds between ticks, greater than zero.

    Raises:
        InvalidArgumentError: If `period` isn't positive.
    """

    def __init__(
        self,
        *,
        num_fingers: int,
        tip_radius: float | FloatArray,
        mass: float,
        p_OCoM: FloatArray,
        friction: float,
        settings: GraspSettings,
        period: float,
    ) -> None:
        super().__init__()
        if not period > 0:
            raise InvalidArgumentError(f"period must be greater than 0 s, not {period}")
        self._radius = np.broadcast_to(np.asarray(tip_radius, dtype=float), num_fingers)
        self._mass, self._friction = mass, friction
        self._p_OCoM = np.array(p_OCoM)
        self._settings, self._period = settings, period
        n = num_fingers
        first = GraspState.first(n, settings)
        self._state = self.DeclareDiscreteState(first.to_vector())
        self._gripped = self.DeclareDiscreteState(_COASTING_SIZE)
        self._close = self.DeclareVectorInputPort("close", 1)
        self._status = self.DeclareVectorInputPort("contact_status", n)
        self._frames = self.DeclareVectorInputPort("contact_frames", 6 * n)
        self._X_WO = self.DeclareAbstractInputPort(
            "X_WO_estimated", AbstractValue.Make(RigidTransform())
        )
        self._V_WO = self.DeclareAbstractInputPort(
            "V_WO_estimated", AbstractValue.Make(SpatialVelocity())
        )
        self._p_WT = self.DeclareVectorInputPort("p_WT", 3 * n)
        self._f_T_W = self.DeclareVectorInputPort("f_T_W", 3 * n)
        self._tracking_status = self.DeclareVectorInputPort("tracking_status", 1)
        self._pose = LastPose(self, self._X_WO)
        stored = {self.xd_ticket()}
        timed = stored | {self.time_ticket()}
        self._remembered = self.DeclareCacheEntry(
            "the state as an object",
            ValueProducer(
                lambda: AbstractValue.Make(first),
                lambda context, output: output.set_value(
                    GraspState.from_vector(context.get_discrete_state(self._state).value())
                ),
            ),
            stored,
        )
        carried = timed | {*self._pose.tickets, self._V_WO.ticket()}
        self._motion = self.DeclareCacheEntry(
            "pose and twist of G",
            ValueProducer(
                lambda: AbstractValue.Make((RigidTransform(), SpatialVelocity())),
                lambda context, output: output.set_value(self._calc_motion(context)),
            ),
            carried,
        )
        self.DeclareAbstractOutputPort(
            "X_WG",
            lambda: AbstractValue.Make(RigidTransform()),
            lambda context, output: output.set_value(self._motion.Eval(context)[0]),
            {self._motion.ticket()},
        )
        self.DeclareAbstractOutputPort(
            "V_WG",
            lambda: AbstractValue.Make(SpatialVelocity()),
            lambda context, output: output.set_value(self._motion.Eval(context)[1]),
            {self._motion.ticket()},
        )
        self.DeclareVectorOutputPort("standoffs", n, self._calc_standoffs, stored)
        self.DeclareVectorOutputPort("hold_contacts", 1, self._calc_hold, stored)
        self.DeclareVectorOutputPort("fingers_hold", n, self._calc_fingers_hold, timed)
        self.DeclareVectorOutputPort(
            "squeeze_forces",
            3 * n,
            self._calc_forces,
            {self._motion.ticket(), self._frames.ticket()},
        )
        self.DeclareVectorOutputPort("grasp_report", 4, self._calc_report, stored)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._advance)

    def _calc_motion(self, context: Context) -> tuple[RigidTransform, SpatialVelocity]:
        state: GraspState = self._remembered.Eval(context)
        time = context.get_time()
        if np.isinf(state.gripped):
            X, V = self._pose.eval(context), validated_velocity(self._V_WO.Eval(context))
            R, p, w, v = X.rotation(), X.translation(), V.rotational(), V.translational()
        else:
            first = Coasting.from_vector(context.get_discrete_state(self._gripped).value())
            coast = self._settings.squeeze_duration
            if state.phase == GraspPhase.BACK_OFF and state.since <= state.gripped + coast:
                coast = np.inf  # What was not lifted goes on with its table: so do the fingers.
            now = first.after(time - state.gripped, coast=coast, stop=self._settings.stop_duration)
            R, p, w, v = RotationMatrix(now.R_WG), now.p_WG, now.w_WG, now.v_WG
        up = np.array([0.0, 0.0, 1.0])
        X_WG = RigidTransform(R, p + state.height.value(time) * up)
        return X_WG, SpatialVelocity(w=w, v=v + state.height.rate(time) * up)

    def _contacts(self, context: Context) -> tuple[FloatArray, FloatArray]:
        p_OC, nhat = validated_numbers(self._frames.Eval(context)).reshape(2, -1, 3)
        return p_OC, nhat

    def _sees(self, context: Context) -> bool:
        if self._tracking_status.HasValue(context):
            status = TrackingStatus(self._tracking_status.Eval(context)[0])
            if not status.is_followed:
                return False
        return self._pose.is_valid(context)

    def _is_to_close(self, context: Context, state: GraspState) -> bool:
        close = float(self._close.Eval(context)[0])
        return np.isfinite(state.asked) if np.isnan(close) else close > 0.5

    def _advance(self, context: Context, discrete_state: DiscreteValues) -> None:
        state: GraspState = self._remembered.Eval(context)
        X_WG, V_WG = self._motion.Eval(context)
        p_OC, nhat = self._contacts(context)
        p_WT = validated_numbers(self._p_WT.Eval(context)).reshape(-1, 3)
        p_GT = (X_WG.inverse() @ p_WT.T).T
        presses = np.zeros(len(p_OC))
        if state.phase >= GraspPhase.CLOSE:  # Before that nobody asks, and forces cost some time.
            f_T_W = validated_numbers(self._f_T_W.Eval(context)).reshape(-1, 3)
            f_T_G = f_T_W @ X_WG.rotation().matrix()
            presses = -np.sum(f_T_G * nhat, axis=1)
        p_GT_goal = p_OC + (self._radius + state.standoffs)[:, None] * nhat
        distances = np.linalg.norm(p_GT_goal - p_GT, axis=1)
        active = is_active(np.asarray(self._status.Eval(context)))
        view = GraspView(
            time=context.get_time(),
            close=self._is_to_close(context, state),
            active=active & np.isfinite(distances),
            distances=distances,
            gaps=np.sum((p_GT - p_OC) * nhat, axis=1) - self._radius,
            presses=presses,
            sees=self._sees(context),
        )
        after = next_state(
            state,
            view,
            self._settings,
            self._period,
            lambda active: self._plan_squeeze(context, active),
        )
        discrete_state.set_value(self._state, after.to_vector())
        self._pose.store(context, discrete_state)
        if np.isinf(state.gripped) and np.isfinite(after.gripped):
            R_WG = X_WG.rotation().matrix()
            first = Coasting(R_WG, X_WG.translation(), V_WG.rotational(), V_WG.translational())
            discrete_state.set_value(self._gripped, first.to_vector())

    def _plan_squeeze(self, context: Context, active: BoolArray) -> Squeeze:
        p_OC, nhat = self._contacts(context)
        if not np.all(np.isfinite(p_OC[active])) or not np.all(np.isfinite(nhat[active])):
            return Squeeze(np.zeros_like(p_OC), GRAVITY * self._mass)
        X_WO = self._pose.eval(context)
        weight_W = np.array([0.0, 0.0, -GRAVITY * self._mass])
        planned = safest_squeeze(
            (p_OC - self._p_OCoM)[active],
            nhat[active],
            np.append(X_WO.rotation().matrix().T @ weight_W, np.zeros(3)),
            friction=self._friction,
            least_normal=self._settings.least_force,
            largest_normal=np.broadcast_to(self._settings.largest_force, active.shape)[active],
        )
        forces = np.zeros_like(p_OC)
        forces[active] = planned.forces
        return Squeeze(forces, planned.residual)

    def _calc_standoffs(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._remembered.Eval(context).standoffs)

    def _calc_hold(self, context: Context, output: BasicVector) -> None:
        output[0] = float(self._remembered.Eval(context).holds_contacts)

    def _calc_fingers_hold(self, context: Context, output: BasicVector) -> None:
        state: GraspState = self._remembered.Eval(context)
        output.SetFromVector(state.fingers_hold(context.get_time()).astype(float))

    def _calc_forces(self, context: Context, output: BasicVector) -> None:
        state: GraspState = self._remembered.Eval(context)
        share = state.force.value(context.get_time())
        if share == 0 and not np.any(state.touched):
            output.SetZero()
            return
        _, nhat = self._contacts(context)
        # A finger that has met the object keeps touching it until all press.
        touch = -self._settings.touch_force * state.touched[:, None] * np.nan_to_num(nhat)
        f_T_G = (1 - share) * touch + share * state.forces
        X_WG, _ = self._motion.Eval(context)
        output.SetFromVector((f_T_G @ X_WG.rotation().matrix().T).ravel())

    def _calc_report(self, context: Context, output: BasicVector) -> None:
        state: GraspState = self._remembered.Eval(context)
        output.SetFromVector([state.phase, state.since, state.reason, state.detail])
