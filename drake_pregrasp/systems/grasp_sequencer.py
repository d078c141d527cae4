"""Sequence of a grasp: the moment of closing, the forces, and the motion of the object."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from drake_pregrasp.arrays import BoolArray, FloatArray, are_valid, norms, validated_numbers
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.hand_description import Fingertip
from drake_pregrasp.config.object_config import GRAVITY
from drake_pregrasp.config.validation import checked
from drake_pregrasp.geometry.rotations import angle_about_z, skew, turn_about_z
from drake_pregrasp.geometry.solids import SignedDistance
from drake_pregrasp.grasping.fingertip_paths import Pace
from drake_pregrasp.grasping.grasp_phases import GraspView, next_state
from drake_pregrasp.grasping.grasp_state import (
    BASE,
    NOT_BLOCKED,
    GraspPhase,
    GraspSettings,
    GraspState,
    Squeeze,
    state_unpacker,
)
from drake_pregrasp.grasping.hand_commands import GraspCommand
from drake_pregrasp.grasping.passing import passing_gaps
from drake_pregrasp.grasping.touch_correction import corrected_pose, touch_rows
from drake_pregrasp.systems import ports
from drake_pregrasp.systems.held_frame import HeldFrame, HeldMemory, HeldObject
from drake_pregrasp.systems.squeeze_program import plan_lift

_UP = np.array([0.0, 0.0, 1.0])


class GraspSequencer(LeafSystem):
    """Approaches, tracks, closes until touch, squeezes, lifts and holds; or opens and backs off.

    .. pydrake_system::

        name: GraspSequencer
        input_ports:
        - close
        - contacts
        - X_WO_estimated
        - V_WO_estimated
        - p_WT
        - f_T_W
        - tracking_status
        - J_WT
        - blocked_finger
        - approach
        - camera_offset
        output_ports:
        - command
        - X_WG
        - hold_contacts
        - grasp_report
        - V_WO_held
        - touching
        - late_fingers

    Port `close` accepts a vector of 1: above 0.5, the hand must close and stay closed. NaN keeps
    the last command. The hand closes once enough fingers are active and at their goals, and can
    balance the object's weight; after `gate_limit`, without fingers that are off their goals.

    Port `contacts` accepts a vector of 7n, as `HandGoalShaper` emits it. If an active contact is
    not finite, no force balances the weight.

    Port `X_WO_estimated` accepts a `RigidTransform`: the estimated pose of the object O in W. If it
    is invalid, the object is treated as lost at its last valid pose.

    Port `V_WO_estimated` accepts a `SpatialVelocity`: that of O in W; zero if it is invalid.

    Port `p_WT` accepts a vector of 3n: the fingertips' centres in W, in metres. The hand does not
    close with a finger whose position is not finite.

    Port `f_T_W` accepts a vector of 3n: the forces that the fingertips press with, in W, in newtons
    (`FingertipSensor`). A force that is not finite counts as unknown: it is neither touch nor loss.

    Port `tracking_status` (optional) accepts a vector of 1: a `TrackingStatus`; any other number
    counts as `LOST`. While goals must not follow the estimate, the hand does not descend, and it
    waits to close without a time limit and reports that. A closing hand opens, until the squeeze
    begins. If the port is unconnected, the object is tracked.

    Port `J_WT` (optional) accepts a vector of 3n nq: the Jacobians of the fingertips' velocities in
    W, shape (n, 3, nq). If it is finite, the squeeze is within the largest torques of the joints.

    Port `blocked_finger` (optional) accepts a vector of 1: the finger whose links stop the hand,
    `BASE`, or `NOT_BLOCKED` (`DifferentialKinematics`). The report says so while the hand stands.

    Port `approach` accepts a vector of 7: the time of the meeting with the object, and the place
    and the velocity of the palm's axis until then (`InterceptionPlanner`). While it is not finite,
    apart from the time, the hand is raised over the object.

    Port `camera_offset` (optional) accepts a vector of 12, as `PoseEstimator` emits it. While the
    hand closes and squeezes, horizontal changes of this offset, with which touch moves the
    estimate, do not move G, because fingers that touch would drag the object. G then moves toward
    the estimate by `touch_correction`, with the speed of closing. While this offset is invalid, the
    last valid one counts.

    Port `command` emits a `GraspCommand`. Its frame G is the estimated pose of O, or on its way
    there while the hand approaches. If a fingertip feels `bump_force` before the hand closes, G
    moves to where it is felt, by at most 0.1 m/s and 30 mm in all, and stays there relative to the
    estimate; the fingertip, whose goal keeps its gap, recedes. While the hand closes, G moves with
    the estimated velocity, and toward the estimate with a time constant of 0.3 s, its centre of
    mass within 2 mm of it. From the squeeze on, G moves with the object that the fingers hold
    (`HeldMotion`), within `TETHER` of the estimate as touch corrects it; for the lift it stops with
    a constant deceleration, and moves along `lift_direction`. Contacts are held from closing or
    giving up until the next approach. A finger holds from the moment the hand closes until it
    releases; it may avoid obstacles at other times. The forces, once the hand closes, are those at
    the points of the object nearest to the fingertips. They balance the weight and the acceleration
    of stop and lift; until the lift, only their part without a wrench is commanded. From the lift
    on, forces against turns of the object are added, and in the hold also against its displacements
    (`restoring_forces`).

    Port `X_WG` emits a `RigidTransform`: the pose of the frame G of the command.

    Port `hold_contacts` emits a vector of 1: 1 while the command holds contacts, and also for the
    last parts of the approach and of `gate_limit`, each as long as closing takes, so that fingers
    arrive at them; else 0.

    Port `grasp_report` emits a vector of 4: the `GraspPhase`, its start in seconds, the `GiveUp`
    and its detail (`describe_give_up`).

    Port `V_WO_held` emits a `SpatialVelocity`: that with which the hand moves O in W while the
    fingers hold the object, as it is commanded, and not as `V_WO_estimated` has it; else NaN.

    Port `touching` emits a vector of n: 1 for each fingertip that touches the object, as of the
    last tick, else 0. Before the hand closes, no fingertip counts as touching.

    Port `late_fingers` emits a vector of n: 1 for a finger that cannot be at its contact when the
    hand closes, which is `gate_limit` after the meeting at the latest; else 0.

    Args:
        config: Configuration of the grasp; `GraspConfig()` by default.
        fingertips: Fingertips of the hand, with their radii and limits for closing.
        mass: Mass of the object, in kg.
        p_OCoM: Centre of mass of the object in O, shape (3,), in metres.
        object_solid: The object in O; None to plan the squeeze at the contacts of `contacts`.
        efforts: Largest torque of each joint, shape (nq,), in N m; empty for no limits.
        stiffness: Horizontal stiffness of the fingertips, or of each, shape (n,), in N/m.
        least_stiffness: Their least stiffness over all directions, as for `stiffness`.
        palm_axis: Unit vector from the object to the palm in W, shape (3,).
        R_WO: Orientation of the object at which `palm_axis` holds, shape (3, 3): the axis turns
            from there about the vertical with G. None: it does not turn.
        gravity: Acceleration of the object along -z of W until the hand stops it, in m/s²: 0 for
            one that something carries.

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
        stiffness: float | FloatArray = 400.0,
        least_stiffness: float | FloatArray = 400.0,
        palm_axis: FloatArray = _UP,
        R_WO: FloatArray | None = None,
        gravity: float = 0.0,
    ) -> None:
        super().__init__()
        config = checked(config or GraspConfig())
        n = len(fingertips)
        self._config, self._mass, self._p_OCoM = config, mass, np.array(p_OCoM)
        self._settings = config.make_settings(fingertips)
        self._palm_axis, self._lift_axis = palm_axis, config.lift_axis
        self._R_OW = None if R_WO is None else R_WO.T
        self._in_air, self._fall = gravity > 0, -gravity * _UP
        self._solid, self._efforts = object_solid, np.empty(0) if efforts is None else efforts
        self._pace = Pace(config.goal_speed, config.tip_acceleration, config.period)
        self._radius = np.array([tip.radius for tip in fingertips])
        self._patch_radii = np.array([tip.planned_patch for tip in fingertips])
        first = GraspState.first(n, self._settings)
        self._unpack = state_unpacker(n)
        self._state = self.DeclareDiscreteState(first.to_vector())
        self._close = self.DeclareVectorInputPort("close", 1)
        self._contacts = self.DeclareVectorInputPort("contacts", 7 * n)
        self._X_WO = self.DeclareAbstractInputPort("X_WO_estimated", ports.POSE)
        self._V_WO = self.DeclareAbstractInputPort("V_WO_estimated", ports.VELOCITY)
        self._p_WT = self.DeclareVectorInputPort("p_WT", 3 * n)
        self._f_T_W = self.DeclareVectorInputPort("f_T_W", 3 * n)
        tracking_status = self.DeclareVectorInputPort("tracking_status", 1)
        self._J_WT = self.DeclareVectorInputPort("J_WT", 3 * n * len(self._efforts))
        self._blocked = self.DeclareVectorInputPort("blocked_finger", 1)
        self._approach = self.DeclareVectorInputPort("approach", 7)
        camera_offset = self.DeclareVectorInputPort("camera_offset", 12)
        self._pose = ports.LastPose(self, self._X_WO, tracking_status)
        cache, output = partial(ports.declare_cache, self), partial(ports.declare_output, self)
        self._grasp = cache("state of the grasp", first, self._calc_grasp, self.xd_ticket())
        held = HeldObject(
            p_OCoM=self._p_OCoM,
            stiffness=np.broadcast_to(np.asarray(stiffness, dtype=float), n),
            least_stiffness=np.broadcast_to(np.asarray(least_stiffness, dtype=float), n),
            friction=config.planned_friction * GRAVITY * mass,
            lift_axis=self._lift_axis,
            settings=self._settings,
            a_W=self._fall,
        )
        touch = self._p_WT, self._f_T_W, camera_offset
        self._held = HeldFrame(self, held, self._grasp, *touch, self._pose, config.period)
        any_value = AbstractValue.Make(object())
        also = (self._pose.source, self._held.offset, self._V_WO, self._contacts, self._approach)
        sources = (self.time_ticket(), self._held.near, *also)
        self._command = command = cache("command", object(), self._calc_command, *sources)
        grasp, now = self._grasp, self.time_ticket()
        output("command", any_value, command.Eval, command)
        output("X_WG", ports.POSE, self._calc_X_WG, command)
        output("hold_contacts", 1, self._calc_hold, now, grasp, self._approach)
        output("grasp_report", 4, self._calc_report, grasp)
        stored = now, grasp, self._held.memory
        output("V_WO_held", ports.VELOCITY, self._held.calc_velocity, *stored)
        output("touching", n, lambda c: grasp.Eval(c).touched.astype(float), grasp)
        output("late_fingers", n, self._calc_late, command, self._p_WT)
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._advance)

    def state(self, context: Context) -> GraspState:
        """Returns the stored state of the grasp."""
        state: GraspState = self._grasp.Eval(context)
        return state

    def _calc_grasp(self, context: Context) -> GraspState:
        return self._unpack(context.get_discrete_state(self._state).value())

    def _calc_command(self, context: Context) -> GraspCommand:
        state: GraspState = self._grasp.Eval(context)
        memory: HeldMemory = self._held.memory.Eval(context)
        time, settings = context.get_time(), self._settings
        _, R_WO, p_WO, is_tracked = self._pose.eval(context)
        V_WO = ports.validated_velocity(self._V_WO.Eval(context))
        offset = self._held.offset.Eval(context)
        R_WE, p_WE, V_WE = R_WO, p_WO, V_WO
        if memory.is_gripped:
            R_WG, p_WG, V_WG = self._held.frame(context)
        else:
            closes = GraspPhase.CLOSE <= state.phase <= GraspPhase.SQUEEZE
            followed = self._held.followed(context) if closes else (R_WO, p_WO)
            (R_WG, p_WG), V_WG = corrected_pose(*followed, self._p_OCoM, offset), V_WO
            R_WE, p_WE = R_WG, p_WG
        axis = self._lift_axis if state.share > 0 else self._palm_axis
        if self._R_OW is not None and state.share == 0:
            axis = turn_about_z(angle_about_z(R_WG @ self._R_OW)) @ axis
        raised, rising = state.height.value(time), state.height.rate(time + self._config.period / 2)
        standoffs = state.standoffs
        if state.phase == GraspPhase.APPROACH:
            p_WL, v_WL = approach = self._approach.Eval(context)[1:].reshape(2, 3)
            if are_valid(approach):
                p_GL_W, raised, rising = R_WG @ self._p_OCoM, 0.0, 0.0
                left = float((p_WL - p_WO - p_GL_W) @ axis)
                standoffs = self._passing_gaps(context, standoffs, left, axis @ R_WG)
                p_WG = p_WL - p_GL_W + np.array([offset[0], offset[1], 0.0])
                V_WG = np.array([V_WG[0], v_WL - skew(V_WG[0]) @ p_GL_W])
        p_WG, V_WG = p_WG + raised * axis, np.array([V_WG[0], V_WG[1] + rising * axis])
        nhat, holding = self._contact_frames(context)[1], state.fingers_hold
        if holding.any():
            R_WE, p_WE, V_WE = R_WG, p_WG, V_WG
        if state.forces.any():
            since = 0.0 if memory.stands else time - memory.last.time
            forces = state.planned_forces(since, settings)
            forces += self._held.restoring_forces(context, R_WG, p_WG)
        else:
            forces = state.touch_forces(nhat, settings.touch_force)
        return GraspCommand(
            R_WO=R_WO,
            p_WO=p_WO,
            V_WO=V_WO,
            R_WG=R_WG,
            p_WG=p_WG,
            V_WG=V_WG,
            R_WE=R_WE,
            p_WE=p_WE,
            V_WE=V_WE,
            is_tracked=is_tracked,
            holds_contacts=state.holds_contacts,
            standoffs=standoffs,
            fingers_hold=holding,
            f_T_W=forces @ R_WG.T,
            nhat_W=np.nan_to_num(nhat @ R_WG.T),
            force_limits=state.force_limits(settings.touch_force),
        )

    def _passing_gaps(
        self, context: Context, standoffs: FloatArray, left: float, up: FloatArray
    ) -> FloatArray:
        """Returns the gaps at which fingertips let an object pass that is a way off, shape (n,)."""
        if self._solid is None or not left > 0:
            return standoffs
        length = self._solid.highest(up) + self._solid.highest(-up)
        p_OC, nhat, _ = self._contact_frames(context)
        way = min(left, length) * up
        return passing_gaps(p_OC, nhat, standoffs, self._radius, way, self._solid)

    def _calc_hold(self, context: Context) -> list[float]:
        state: GraspState = self._grasp.Eval(context)
        left = float(self._approach.Eval(context)[0]) - context.get_time()
        if state.phase == GraspPhase.TRACK:
            left = self._time_to_close(context)
        arrives = state.phase <= GraspPhase.TRACK and left <= self._settings.closing_duration
        return [float(state.holds_contacts or arrives)]

    def _time_to_close(self, context: Context) -> float:
        """Returns the time until the gate ends, in seconds; infinite without a command to close."""
        state: GraspState = self._grasp.Eval(context)
        met = state.since
        if state.phase == GraspPhase.APPROACH:
            met = float(self._approach.Eval(context)[0])
        return max(met, state.asked) + self._settings.gate_limit - float(context.get_time())

    def _calc_late(self, context: Context) -> FloatArray:
        state: GraspState = self._grasp.Eval(context)
        p_OC, nhat, _ = self._contact_frames(context)
        p_GT_goal = p_OC + (self._radius + state.standoffs)[:, None] * nhat
        away = norms(p_GT_goal - self._tips(context)) - self._settings.gate_distance
        is_late = self._pace.least_times(away) > self._time_to_close(context)
        return np.asarray(is_late & (state.phase <= GraspPhase.TRACK), dtype=float)

    def _calc_X_WG(self, context: Context) -> RigidTransform:
        command: GraspCommand = self._command.Eval(context)
        return RigidTransform(RotationMatrix(command.R_WG), command.p_WG)

    def _contact_frames(self, context: Context) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Returns points and normals of the contacts in O, shape (n, 3), and which are active.

        While the hand closes or holds, G stands for O: they are the same numbers in G.
        """
        contacts, n = self._contacts.Eval(context), len(self._radius)
        p_OC, nhat = validated_numbers(contacts[: 6 * n]).reshape(2, n, 3)
        return p_OC, nhat, contacts[6 * n :] > 0

    def _tips(self, context: Context) -> FloatArray:
        """Returns the fingertips' centres in G, shape (n, 3), in metres."""
        p_WT = validated_numbers(self._p_WT.Eval(context)).reshape(-1, 3)
        command: GraspCommand = self._command.Eval(context)
        return np.asarray((p_WT - command.p_WG) @ command.R_WG)

    def _advance(self, context: Context, discrete_state: DiscreteValues) -> None:
        state = replace(self._grasp.Eval(context), offset=self._held.offset.Eval(context))
        command: GraspCommand = self._command.Eval(context)
        p_OC, nhat, active = self._contact_frames(context)
        p_GT = self._tips(context)
        gaps = np.add.reduce((p_GT - p_OC) * nhat, axis=1) - self._radius
        presses, wanted = np.zeros((2, len(p_OC)))
        surface_gaps, rows = gaps, np.zeros(p_OC.shape)
        f_T_W = validated_numbers(self._f_T_W.Eval(context)).reshape(-1, 3)
        felt = norms(f_T_W)
        if closes := state.phase >= GraspPhase.CLOSE:
            forces = np.array([f_T_W, command.f_T_W])
            presses, wanted = -np.sum(forces @ command.R_WG * nhat, axis=2)
        if closes or np.any(felt >= self._settings.bump_force):
            normals = nhat
            if self._solid is not None:
                heights, normals = self._solid.distance_and_gradient(p_GT)
                surface_gaps = heights - self._radius
                # A pad may touch beside its middle, where the surface has another normal.
                normals = np.where(self._patch_radii[:, None] > 0, nhat, normals)
            if not self._in_air:  # In the air, the object moves to where the fingers are.
                rows = touch_rows(p_GT - self._p_OCoM, normals, command.R_WG)
        p_GT_goal = p_OC + (self._radius + state.standoffs)[:, None] * nhat
        distances = norms(p_GT_goal - p_GT)
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
            gaps=gaps,
            felt=felt,
            presses=presses,
            wanted=wanted,
            surface_gaps=surface_gaps,
            rows=rows,
            is_tracked=command.is_tracked,
            blocked=blocked,
            has_met=state.phase != GraspPhase.APPROACH
            or context.get_time() >= self._approach.Eval(context)[0] - 1e-9,
        )
        squeeze = partial(self._plan_squeeze, context)
        after = next_state(state, view, self._settings, self._config.period, squeeze)
        discrete_state.set_value(self._state, after.to_vector())
        self._pose.store(context, discrete_state)
        self._held.store(context, discrete_state, command, p_GT, p_GT_goal)

    def _plan_squeeze(self, context: Context, active: BoolArray) -> Squeeze:
        state: GraspState = self._grasp.Eval(context)
        p_OC, nhat, _ = self._contact_frames(context)
        p_OC, nhat = p_OC[active], nhat[active]
        if self._solid is not None and state.phase >= GraspPhase.CLOSE:
            p_GT = self._tips(context)[active]
            heights, nhat = self._solid.distance_and_gradient(p_GT)
            p_OC = p_GT - heights[:, None] * nhat
        command: GraspCommand = self._command.Eval(context)
        R_WG, settings = command.R_WG, self._settings  # Contacts and forces are in G.
        w_W, v_W = command.V_WG
        left = (1 - state.share) * settings.squeeze_duration
        v_W = v_W + skew(w_W) @ R_WG @ self._p_OCoM + left * self._fall
        load, stop = lift_load(self._mass, settings, self._lift_axis, v_W)
        jacobians = None
        if self._J_WT.HasValue(context):
            J_WT = validated_numbers(self._J_WT.Eval(context)).reshape(len(active), 3, -1)[active]
            jacobians = R_WG.T @ J_WT if np.all(np.isfinite(J_WT)) else None
        return plan_lift(
            *(p_OC - self._p_OCoM, nhat, active, settings),
            load=load @ R_WG,
            stop=stop @ R_WG,
            friction=self._config.planned_friction,
            patch_radii=self._patch_radii,
            jacobians=jacobians,
            efforts=self._efforts,
        )

    def _calc_report(self, context: Context) -> list[float]:
        state: GraspState = self._grasp.Eval(context)
        return [state.phase, state.since, state.reason, state.detail]


def lift_load(
    mass: float, settings: GraspSettings, lift_axis: FloatArray, v_W: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Returns weight and inertia of an object that a hand stops and lifts, in W, in newtons.

    Args:
        mass: Mass of the object, in kg.
        settings: Settings of the grasp.
        lift_axis: Unit vector along which the hand lifts, in W, shape (3,).
        v_W: Velocity of its centre of mass before the stop, in W, shape (3,), in m/s.

    Returns:
        The largest load, and its part while the hand stops, shape (3,) each.
    """
    stop, lift = -v_W / settings.stop_duration, settings.lift_acceleration * lift_axis
    return -mass * (GRAVITY * _UP + stop + lift), -mass * stop
