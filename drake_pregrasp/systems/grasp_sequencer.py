"""Sequence of a grasp: the moment of closing, the forces, and the motion of the object."""

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.tree import UniformGravityFieldElement
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from drake_pregrasp.arrays import BoolArray, FloatArray, norms, pack, unpacker, validated_numbers
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.hand_description import Fingertip
from drake_pregrasp.config.validation import checked
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.geometry.solids import SignedDistance
from drake_pregrasp.grasping.grasp_phases import next_state
from drake_pregrasp.grasping.grasp_state import (
    BASE,
    NOT_BLOCKED,
    GraspPhase,
    GraspState,
    GraspView,
    Ramp,
    Squeeze,
)
from drake_pregrasp.grasping.held_motion import HeldMotion
from drake_pregrasp.systems import ports
from drake_pregrasp.systems.squeeze_program import plan_squeeze

GRAVITY: float = UniformGravityFieldElement.kDefaultStrength
"""Acceleration of gravity along -z of W, in m/s²."""

_AT_REST = HeldMotion.at_rest()
_unpack_motion = unpacker(_AT_REST)
_UP = np.array([0.0, 0.0, 1.0])
_WEIGHT_DURATION = 0.1  # Seconds in which fingers take over the weight at the start of the lift.


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
        - J_WT
        - blocked_finger
        output_ports:
        - X_WG
        - V_WG
        - standoffs
        - hold_contacts
        - fingers_hold
        - squeeze_forces
        - grasp_report
        - V_WO_held
        - force_limits

    Port `close` accepts a vector of 1: above 0.5, the hand must close and stay closed. It closes
    once enough fingers are active, all of these are at their goals, and they can balance the
    object's weight. After `gate_limit` it closes without the fingers that are off their goals, or
    gives up if the others cannot hold the object. NaN keeps the last command.

    Port `contact_status` accepts a vector of n `ContactStatus` values.

    Port `contact_frames` accepts a vector of 6n, as `FingertipGoalShaper` emits it. If an active
    contact is not finite, no force balances the weight.

    Port `X_WO_estimated` accepts a `RigidTransform`: the estimated pose of the object O in W. If it
    is invalid, the object is treated as lost at its last valid pose.

    Port `V_WO_estimated` accepts a `SpatialVelocity`: that of O in W; zero if it is invalid.

    Port `p_WT` accepts a vector of 3n: the fingertips' centres in W, in metres. The hand does not
    close with a finger whose position is not finite.

    Port `f_T_W` accepts a vector of 3n: the forces that the fingertips press with, in W, in newtons
    (`FingertipSensor`). A force that is not finite counts as unknown: it is neither touch nor loss.

    Port `tracking_status` (optional) accepts a vector of 1: a `TrackingStatus`; any other number
    counts as `LOST`. While goals must not follow the estimate, the hand does not descend, and it
    waits to close without a time limit and reports that. A closing hand opens, unless all fingers
    have touched the object. If the port is unconnected, the object is tracked.

    Port `J_WT` (optional) accepts a vector of 3n nq: the Jacobians of the fingertips' velocities in
    W, shape (n, 3, nq). If it is finite, the squeeze is within the largest torques of the joints.

    Port `blocked_finger` (optional) accepts a vector of 1: the finger whose links stop the hand,
    `BASE`, or `NOT_BLOCKED` (`DifferentialKinematics`). The report says so while the hand stands.

    Port `X_WG` emits a `RigidTransform`: the pose of the frame G in which goals are planned. It is
    the estimated pose of O, raised while the hand approaches. When all fingers touch, they stick to
    the object, and G moves with them and no longer with the estimate, so that on average they are
    at their goals: a table that accelerates takes the hand along, and no strain of the touch pushes
    the object. For the lift, G stops and moves straight along `lift_direction`.

    Port `V_WG` emits a `SpatialVelocity`: the velocity of G in W, on average until the next tick.

    Port `standoffs` emits a vector of n: the desired gap of each fingertip, in metres.

    Port `hold_contacts` emits a vector of 1: 1 from closing or giving up until the next approach.

    Port `fingers_hold` emits a vector of n: 1 for each finger on its contact or on the way to it,
    from the moment the hand closes until it releases; 0 for fingers that may avoid obstacles.

    Port `squeeze_forces` emits a vector of 3n: the desired forces of the fingertips, in W, in
    newtons; once the hand closes, at the points of the object nearest to the fingertips. They
    balance weight and acceleration of the lift. The table carries the weight until the lift.

    Port `grasp_report` emits a vector of 4: the `GraspPhase`, its start in seconds, the `GiveUp`
    and its detail (`describe_give_up`).

    Port `V_WO_held` emits a vector of 7: 1 while the fingers hold the object, then the angular
    velocity of O in W, in rad/s, and its velocity, in m/s, without the estimate; else zeros.

    Port `force_limits` emits a vector of n, in newtons: `GraspState.force_limits`.

    Args:
        config: Configuration of the grasp; `GraspConfig()` by default.
        fingertips: Fingertips of the hand, with their radii and limits for closing.
        mass: Mass of the object, in kg.
        p_OCoM: Centre of mass of the object in O, shape (3,), in metres.
        object_solid: The object in O; None to plan the squeeze at the contacts of `contact_frames`.
        efforts: Largest torque of each joint, shape (nq,), in N m; empty for no limits.
        palm_axis: Unit vector from the object to the palm in W, shape (3,).

    Raises:
        InvalidArgumentError: If a field of `config` is out of its range.
    """

    def __init__(
        self,
        config: GraspConfig | None = None,
        *,
        mass: float,
        p_OCoM: FloatArray,
        fingertips: Sequence[Fingertip] = (),
        object_solid: SignedDistance | None = None,
        efforts: FloatArray | None = None,
        palm_axis: FloatArray = _UP,
    ) -> None:
        super().__init__()
        config = checked(config or GraspConfig())
        n = len(fingertips)
        self._config, self._mass, self._p_OCoM = config, mass, np.array(p_OCoM)
        self._settings = config.make_settings(fingertips)
        self._palm_axis, self._lift_axis = palm_axis, config.lift_axis
        self._solid, self._efforts = object_solid, np.empty(0) if efforts is None else efforts
        self._radius = np.array([tip.radius for tip in fingertips])
        first = GraspState.first(n, self._settings)
        self._state = self.DeclareDiscreteState(first.to_vector())
        self._last = self.DeclareDiscreteState(pack(_AT_REST))
        # Goals of the fingertips in G since they press firmly, else NaN. Their measured places
        # would keep the strain of the touch, which then drives the object without end.
        self._sticking = self.DeclareDiscreteState(np.full(3 * n, np.nan))
        self._close = self.DeclareVectorInputPort("close", 1)
        self._status = self.DeclareVectorInputPort("contact_status", n)
        self._frames = self.DeclareVectorInputPort("contact_frames", 6 * n)
        self._X_WO = self.DeclareAbstractInputPort("X_WO_estimated", ports.POSE)
        self._V_WO = self.DeclareAbstractInputPort("V_WO_estimated", ports.VELOCITY)
        self._p_WT = self.DeclareVectorInputPort("p_WT", 3 * n)
        self._f_T_W = self.DeclareVectorInputPort("f_T_W", 3 * n)
        tracking_status = self.DeclareVectorInputPort("tracking_status", 1)
        self._J_WT = self.DeclareVectorInputPort("J_WT", 3 * n * len(self._efforts))
        self._blocked = self.DeclareVectorInputPort("blocked_finger", 1)
        self._pose = ports.LastPose(self, self._X_WO, tracking_status)
        stored, time = self.xd_ticket(), self.time_ticket()
        cache, output = partial(ports.declare_cache, self), partial(ports.declare_output, self)
        self._remembered = state = cache("stored state", first, self._calc_remembered, stored)
        sources = (time, stored, self._p_WT)
        self._held = held = cache("motion of held object", _AT_REST, self._calc_held, *sources)
        sources = (held, self._pose.source, self._V_WO)
        self._motion = motion = cache("level motion of G", _AT_REST, self._calc_motion, *sources)
        self._X_WG = output("X_WG", ports.POSE, self._calc_X_WG, motion)
        output("V_WG", ports.VELOCITY, self._calc_V_WG, motion)
        output("standoffs", n, lambda c: state.Eval(c).standoffs, state)
        output("hold_contacts", 1, lambda c: state.Eval(c).holds_contacts, state)
        output("fingers_hold", n, self._calc_fingers_hold, state, time)
        output("squeeze_forces", 3 * n, self._calc_forces, time, stored, motion, self._frames)
        output("grasp_report", 4, self._calc_report, state)
        output("V_WO_held", 7, self._calc_V_WO_held, held)
        output("force_limits", n, self._calc_force_limits, state, time)
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._advance)

    def _calc_remembered(self, context: Context) -> GraspState:
        return GraspState.from_vector(context.get_discrete_state(self._state).value())

    def _sticking_tips(self, context: Context) -> FloatArray:
        return np.asarray(context.get_discrete_state(self._sticking).value().reshape(-1, 3))

    def _last_motion(self, context: Context) -> tuple[HeldMotion, bool]:
        """Returns the last motion of G in the squeeze, and whether the object still stands."""
        state: GraspState = self._remembered.Eval(context)
        last = _unpack_motion(context.get_discrete_state(self._last).value())
        opened = state.phase == GraspPhase.BACK_OFF and state.since <= last.time
        return last, opened or state.phase <= GraspPhase.SQUEEZE

    def _calc_held(self, context: Context) -> HeldMotion:
        """Returns the motion of G by the fingertips alone."""
        state: GraspState = self._remembered.Eval(context)
        (last, stands), time = self._last_motion(context), context.get_time()
        if not stands:
            return last.stopping(time, self._settings.stop_duration)
        if state.phase == GraspPhase.BACK_OFF:
            return last.without_acceleration().at(time)
        p_GT = self._sticking_tips(context)
        p_WT = validated_numbers(self._p_WT.Eval(context)).reshape(-1, 3)
        on = state.active & np.all(np.isfinite(p_WT) & np.isfinite(p_GT), axis=1)
        now = last.at(time)
        if np.any(on):
            now = now.following(p_WT[on], p_GT[on], time - last.time, self._config.period)
        return now

    def _calc_motion(self, context: Context) -> HeldMotion:
        state: GraspState = self._remembered.Eval(context)
        if math.isfinite(state.gripped) and (
            state.phase > GraspPhase.SQUEEZE or np.isfinite(self._sticking_tips(context)).any()
        ):
            held: HeldMotion = self._held.Eval(context)
            return held
        V_WO = ports.validated_velocity(self._V_WO.Eval(context))
        return HeldMotion(context.get_time(), *self._pose.split(context), V_WO, np.zeros((2, 3)))

    def _calc_X_WG(self, context: Context) -> RigidTransform:
        motion: HeldMotion = self._motion.Eval(context)
        p_WG = motion.p_WG + self._raised(context, Ramp.value)
        return RigidTransform(RotationMatrix(motion.R_WG), p_WG)

    def _calc_V_WG(self, context: Context) -> SpatialVelocity:
        motion: HeldMotion = self._motion.Eval(context)
        return self._rising(context, motion.V_WG + self._config.period / 2 * motion.A_WG)

    def _calc_V_WO_held(self, context: Context) -> FloatArray:
        force = self._remembered.Eval(context).force.value(context.get_time())
        if force == 0 or np.isnan(self._sticking_tips(context)).all():
            return np.zeros(7)
        return np.append(1.0, self._rising(context, self._held.Eval(context).V_WG).get_coeffs())

    def _calc_fingers_hold(self, context: Context) -> FloatArray:
        state: GraspState = self._remembered.Eval(context)
        return state.fingers_hold(context.get_time()).astype(float)

    def _calc_force_limits(self, context: Context) -> FloatArray:
        state: GraspState = self._remembered.Eval(context)
        return state.force_limits(context.get_time(), self._settings.touch_force)

    def _rising(self, context: Context, V_WG: FloatArray) -> SpatialVelocity:
        return SpatialVelocity(w=V_WG[0], v=V_WG[1] + self._raised(context, Ramp.rate))

    def _raised(self, context: Context, change: Callable[[Ramp, float], float]) -> FloatArray:
        state, time = self._remembered.Eval(context), context.get_time()
        axis = self._lift_axis if state.force.value(time) > 0 else self._palm_axis
        return np.asarray(change(state.height, time) * axis)

    def _contacts(self, context: Context) -> tuple[FloatArray, FloatArray]:
        p_OC, nhat = validated_numbers(self._frames.Eval(context)).reshape(2, -1, 3)
        return p_OC, nhat

    def _tips(self, context: Context) -> FloatArray:
        """Returns the fingertips' centres in G, shape (n, 3), in metres."""
        p_WT = validated_numbers(self._p_WT.Eval(context)).reshape(-1, 3)
        X_WG: RigidTransform = self._X_WG.Eval(context)
        return np.asarray((p_WT - X_WG.translation()) @ X_WG.rotation().matrix())

    def _advance(self, context: Context, discrete_state: DiscreteValues) -> None:
        state: GraspState = self._remembered.Eval(context)
        p_OC, nhat = self._contacts(context)
        p_GT = self._tips(context)
        presses = np.zeros(len(p_OC))
        if state.phase >= GraspPhase.CLOSE:  # Forces are slow to compute, and not used before.
            f_T_W = validated_numbers(self._f_T_W.Eval(context)).reshape(-1, 3)
            f_T_G = f_T_W @ self._X_WG.Eval(context).rotation().matrix()
            presses = -np.sum(f_T_G * nhat, axis=1)
        p_GT_goal = p_OC + (self._radius + state.standoffs)[:, None] * nhat
        distances = norms(p_GT_goal - p_GT)
        active = is_active(self._status.Eval(context))
        close = float(self._close.Eval(context)[0])
        blocked = NOT_BLOCKED
        if self._blocked.HasValue(context):
            finger = float(self._blocked.Eval(context)[0])
            blocked = int(finger) if finger in range(BASE, len(active)) else NOT_BLOCKED
        view = GraspView(
            time=context.get_time(),
            close=math.isfinite(state.asked) if math.isnan(close) else close > 0.5,
            active=active & np.isfinite(distances),
            distances=distances,
            gaps=np.add.reduce((p_GT - p_OC) * nhat, axis=1) - self._radius,
            presses=presses,
            is_tracked=self._pose.is_tracked(context),
            blocked=blocked,
        )
        squeeze = partial(self._plan_squeeze, context)
        after = next_state(state, view, self._settings, self._config.period, squeeze)
        if after is not state:
            discrete_state.set_value(self._state, after.to_vector())
        self._pose.store(context, discrete_state)
        if not GraspPhase.CLOSE <= state.phase <= GraspPhase.SQUEEZE:
            return  # In other phases nothing is gripped, or the motion is kept.
        discrete_state.set_value(self._last, pack(self._motion.Eval(context)))
        sticks = state.phase == GraspPhase.SQUEEZE
        sticking = p_GT_goal.ravel() if sticks else np.full(p_GT.size, np.nan)
        discrete_state.set_value(self._sticking, sticking)

    def _plan_squeeze(self, context: Context, active: BoolArray) -> Squeeze:
        p_OC, nhat = (part[active] for part in self._contacts(context))
        if self._solid is not None and self._remembered.Eval(context).phase >= GraspPhase.CLOSE:
            p_OT = self._tips(context)[active]
            distances, nhat = self._solid.distance_and_gradient(p_OT)
            p_OC = p_OT - distances[:, None] * nhat
        forces, settings = np.zeros((len(active), 3)), self._settings
        R_WO, _ = self._pose.split(context)
        if not np.all(np.isfinite([p_OC, nhat])):
            return Squeeze(forces, GRAVITY * self._mass)
        # A ramp of duration T over the height h accelerates by at most 6 h / T^2.
        lift = 6 * settings.lift_height / settings.lift_duration**2
        load_O = -self._mass * (GRAVITY * _UP + lift * self._lift_axis) @ R_WO
        jacobians = None
        if self._J_WT.HasValue(context):
            J_WT = validated_numbers(self._J_WT.Eval(context)).reshape(len(active), 3, -1)[active]
            jacobians = R_WO.T @ J_WT if np.all(np.isfinite(J_WT)) else None
        plan = partial(
            plan_squeeze,
            *(p_OC - self._p_OCoM, nhat, np.append(load_O, np.zeros(3))),
            friction=self._config.planned_friction,
            largest_normal=np.broadcast_to(settings.largest_force, active.shape)[active],
            jacobians=jacobians,
            efforts=self._efforts,
        )
        planned = plan(least_normal=settings.least_force)
        if planned.residual > settings.imbalance:  # The least force of a finger tips the object.
            planned = plan(least_normal=min(settings.least_force, 2 * settings.touch_force))
        forces[active] = planned.forces
        return planned._replace(forces=forces)

    def _calc_forces(self, context: Context) -> FloatArray:
        state: GraspState = self._remembered.Eval(context)
        share = state.force.value(context.get_time())
        if share == 0 and not state.touched.any():
            return np.zeros(state.forces.shape)
        _, nhat = self._contacts(context)
        touch = -self._settings.touch_force * state.touched[:, None] * np.nan_to_num(nhat)
        R_GW = self._motion.Eval(context).R_WG.T
        planned, on = state.forces @ R_GW, state.active
        last, stands = self._last_motion(context)
        lifted = 0.0 if stands else min(1.0, (context.get_time() - last.time) / _WEIGHT_DURATION)
        planned[on, 2] -= (1 - lifted) * np.sum(planned[on, 2]) / max(1, np.sum(on))
        return np.asarray((1 - share) * touch @ R_GW + share * planned)

    def _calc_report(self, context: Context) -> list[float]:
        state: GraspState = self._remembered.Eval(context)
        return [state.phase, state.since, state.reason, state.detail]
