"""Differential inverse kinematics of a whole hand that keeps its links clear."""

from typing import Protocol

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from drake_pregrasp.arrays import FloatArray, are_valid
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.grasping.clearances import approach_rate
from drake_pregrasp.grasping.fingertip_paths import Pace
from drake_pregrasp.grasping.forward_kinematics import HandPose
from drake_pregrasp.grasping.grasp_state import NO_LIMIT, NOT_BLOCKED
from drake_pregrasp.grasping.hand_commands import GraspCommand
from drake_pregrasp.grasping.hand_goals import HandGoals
from drake_pregrasp.grasping.joint_velocities import JointLimits
from drake_pregrasp.regions.obstacles import ANYWHERE
from drake_pregrasp.systems import ports
from drake_pregrasp.systems.hand_kinematics import moving_joints, point_jacobian, scoped_frame
from drake_pregrasp.systems.hand_scene import HandScene
from drake_pregrasp.systems.palm_frames import pose_error

GAIN = 5.0
"""Ratio of the velocity of palm and posture to their distance from their goals, in 1/s."""

_FASTEST = 0.375  # Largest speed of fingertips and palm toward their goals, in m/s.
_USED = 0.75  # Share of the limit of acceleration that is commanded: drives and clearances add.
_PALM_SHARE = 0.2  # Weight of an arm's palm against fingertips that approach, if limits conflict.
_IN_W = np.eye(3), np.zeros(3)  # Rotation and position of W in itself.


class PalmBase(Protocol):
    """Axes or an arm that carry a palm.

    Attributes:
        palm_frame: Scoped name of the palm's frame P, which follows `palm_goal`; empty for axes
            whose positions are the palm's goal, and follow `rest_posture`.
    """

    palm_frame: str

    def palm_goal(self, p_WL: FloatArray, yaw: float, pan: float) -> RigidTransform:
        """Returns the pose of P over a point L on the palm's axis, turned by a yaw and a pan."""

    def rest_posture(
        self, home: FloatArray, p_WL: FloatArray, yaw: float, pan: float
    ) -> FloatArray:
        """Returns the positions that joints move toward, with fingers as at home, shape (nq,)."""


class DifferentialKinematics(LeafSystem):
    """Moves the joints of a hand so that fingertips and palm follow goals and all links are clear.

    .. pydrake_system::

        name: DifferentialKinematics
        input_ports:
        - goals
        - command
        - obstacles
        - hand_state
        output_ports:
        - desired_state
        - blocked_finger

    Port `goals` accepts `HandGoals`, as `HandGoalShaper` emits them.

    Port `command` accepts a `GraspCommand`, as `GraspSequencer` emits it. Links are kept clear of
    the object in its frame E. The fingertips press with its forces.

    Port `obstacles` (optional) accepts `Obstacles` in W. Only their solids count, and not those
    with numbers that are not finite.

    Port `hand_state` (optional) accepts a vector of 2 nq: measured positions and velocities of the
    joints. The forces of fingers are limited only if it is connected and finite.

    Port `desired_state` emits a vector of 2 nq: q + K_p^-1 (J^T f + tau) with the reference q and
    the forces f, then the velocities. Joints that are held at these positions by their proportional
    gains K_p press with f. A finger that would press with more than its limits yields: its desired
    positions give way to what holds it back. The torques tau are zero unless `feeds_inertia` is
    set, and else M(q) dv/dt with the mass matrix M of the hand, without dv/dt of the own joints of
    fingers that press: torques that brake them as they touch would lift them off.

    Port `blocked_finger` emits a vector of 1: the index of the finger that stops the hand, `BASE`,
    or `NOT_BLOCKED`, as of the last tick.

    At each tick the velocities v of the joints minimise the errors of goals J v - V first and of
    the posture second (`joint_velocities`), within the limits of speed and acceleration of the
    joints, and such that links keep their clearances (`HandScene`). If no velocity satisfies this,
    the joints stop with their largest deceleration, or follow the goals if a stop is worse
    (`next_velocities`). The reference q is the integral of v, linear
    between ticks. It never follows the measured positions, which lag behind.

    The palm follows its goal with the velocity of the goal and `GAIN` times its distance from it:
    the palm of an arm beside the fingertips, the axes of a carrier in their null space, so that
    they help fingers at the limits of their reach. Only fingers with a contact move the palm.

    Args:
        scene: The hand and what it must be clear of.
        base: Base of the palm.
        home: Home positions of the fingers, and zeros for the base, shape (nq,).
        initial: Initial positions, shape (nq,).
        yaw_range: Smallest and largest angle of the palm, in radians.
        acceleration: Largest acceleration of fingertips on the way to goals, in m/s².
        period: Seconds between ticks, greater than zero.
        plant_time_step: Time step of the hand's plant, in seconds, at whose end the measured
            positions have changed by the measured velocities.
        feeds_inertia: Whether the torques that accelerate the hand are commanded; else it lags
            behind its reference as its drives yield, which slow hands hardly do.

    Raises:
        InvalidArgumentError: If `period` is not positive, or `initial` has another length.
    """

    def __init__(
        self,
        scene: HandScene,
        *,
        base: PalmBase,
        home: FloatArray,
        initial: FloatArray,
        yaw_range: tuple[float, float],
        acceleration: float,
        period: float,
        plant_time_step: float = 0.0,
        feeds_inertia: bool = False,
    ) -> None:
        super().__init__()
        self._scene, self._hand, self._base = scene, scene.hand, base
        hand, nq, n = scene.hand, scene.hand.num_positions, len(scene.hand.frames)
        if not period > 0:
            raise InvalidArgumentError(f"period must be greater than 0 s, not {period}")
        if np.shape(initial) != (nq,):
            raise InvalidArgumentError(f"the hand has {nq} joints, not {np.size(initial)}")
        self._home, self._yaw_range = home, yaw_range
        own = np.concatenate([hand.own_joints(finger) for finger in range(n)])
        self._is_shared = ~np.isin(np.arange(nq), own)
        self._step, self._feeds_inertia = plant_time_step, feeds_inertia
        self._rate = approach_rate(acceleration)
        self._pace = Pace(_FASTEST, _USED * acceleration, period)
        change = hand.acceleration_limit * period
        self._limits = JointLimits(hand.lower, hand.upper, hand.rate_limit, change)
        self._palm = scoped_frame(hand.plant, base.palm_frame) if base.palm_frame else None
        if self._palm is not None:
            self._carrying = moving_joints(hand.plant, self._palm)
            self._palm_body = int(self._palm.body().index())

        # The time of the last tick, and then the reference q, v, and the v before.
        start = np.concatenate([[0.0], initial, np.zeros(2 * nq)])
        self._reference = self.DeclareDiscreteState(start)
        # Torques for the forces of the fingertips, the limits of their forces, and their normals.
        pressing = np.repeat([0.0, NO_LIMIT, 0.0], [nq, 2 * n, 3 * n])
        self._pressing = self.DeclareDiscreteState(pressing)
        self._blocked = self.DeclareDiscreteState([float(NOT_BLOCKED)])
        self._goal_rates = self.DeclareDiscreteState(3 * n)  # Velocities of the last goals.
        self._inertial = self.DeclareDiscreteState(nq)
        any_value = AbstractValue.Make(object())
        self._goals = self.DeclareAbstractInputPort("goals", any_value)
        self._command = self.DeclareAbstractInputPort("command", any_value)
        self._obstacles = self.DeclareAbstractInputPort("obstacles", ports.OBSTACLES)
        self._state = self.DeclareVectorInputPort("hand_state", 2 * nq)
        time, stored = self.time_ticket(), self.xd_ticket()
        placing = (time, stored, self._command, self._obstacles)
        words = "the hand and what is around it, at the Context's time"
        self._placed = ports.declare_context(self, words, scene.diagram, self._place, *placing)
        words, model = "kinematics at the reference of the last tick", hand.pose(initial)
        self._pose = ports.declare_cache(self, words, model, self._calc_pose, stored)
        sources = (time, stored, self._state)
        ports.declare_output(self, "desired_state", 2 * nq, self._calc_desired, *sources)
        self.DeclareStateOutputPort("blocked_finger", self._blocked)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _moved(self, context: Context) -> tuple[float, FloatArray, FloatArray, FloatArray]:
        """Returns the time since the last tick, the present q and v, and the v before that tick."""
        stored: FloatArray = context.get_discrete_state(self._reference).value().copy()
        elapsed = max(0.0, context.get_time() - stored[0])  # The clock may have been set back.
        q, v, v_last = stored[1:].reshape(3, -1)
        moved = np.maximum(self._hand.lower, q + elapsed * v)
        return elapsed, np.minimum(moved, self._hand.upper), v, v_last

    def _place(self, context: Context, placed: Context) -> None:
        command: GraspCommand = self._command.Eval(context)
        solids = ports.eval_solids(self, self._obstacles, context, *_IN_W)
        known = [solid for solid in solids if solid is not ANYWHERE]
        X_WE = RigidTransform(RotationMatrix(command.R_WE), command.p_WE)
        self._scene.place(placed, self._moved(context)[1], X_WE, known)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        command: GraspCommand = self._command.Eval(context)
        _, q, v_last, _ = self._moved(context)
        pose = self._hand.pose(q)
        v, blocked = self._next_velocity(context, q, v_last, pose)
        torques = np.zeros(len(q))
        if command.f_T_W.any():
            torques = command.f_T_W.ravel() @ pose.J_WT.reshape(-1, len(q))
        if self._feeds_inertia:
            plant = self._hand.plant
            placed = plant.GetMyContextFromRoot(self._placed.Eval(context))
            acceleration = (v - v_last) / self._pace.period
            for finger in np.flatnonzero(command.f_T_W.any(axis=1)).tolist():
                acceleration[self._hand.own_joints(finger)] = 0.0  # The object stops them.
            inertial = plant.CalcMassMatrix(placed) @ acceleration
            discrete_state.set_value(self._inertial, inertial)
        reference = np.concatenate([[context.get_time()], q, v, v_last])
        discrete_state.set_value(self._reference, reference)
        pressing = np.concatenate([torques, command.force_limits, command.nhat_W], axis=None)
        discrete_state.set_value(self._pressing, pressing)
        discrete_state.set_value(self._blocked, [float(blocked)])
        goals: HandGoals = self._goals.Eval(context)
        discrete_state.set_value(self._goal_rates, goals.v_WT.ravel())

    def _next_velocity(
        self, context: Context, q: FloatArray, v_last: FloatArray, pose: HandPose
    ) -> tuple[FloatArray, int]:
        """Returns the velocities of the joints until the next tick, and the finger that stops them.

        Args:
            context: Context of the system.
            q: Present positions of the reference, shape (nq,).
            v_last: Present velocities of the reference, shape (nq,).
            pose: Kinematics at q.
        """
        goals: HandGoals = self._goals.Eval(context)
        command: GraspCommand = self._command.Eval(context)
        placed = self._placed.Eval(context)
        kernels, J = self._scene.kernels, pose.J_WT.reshape(-1, len(q))
        v_WT_last = context.get_discrete_state(self._goal_rates).value().copy().reshape(-1, 3)
        V = kernels.goal_velocities(goals, pose, v_last, v_WT_last, self._pace)
        if goals.active is not None:
            # Fingers without a contact do not move the palm, and make up for its last motion.
            alone = np.repeat(~goals.active, 3)[:, None] & self._is_shared
            J, V = np.where(alone, 0.0, J), V - np.where(alone, J, 0.0) @ v_last
        # What follows a goal with a gain lags a steady motion by the time 1/gain, so it aims ahead.
        p_WL, yaw = goals.p_WL + goals.v_WL / GAIN, goals.yaw + goals.yaw_rate / GAIN
        pan = goals.pan + goals.pan_rate / GAIN
        low, high = self._yaw_range
        yaw = max(low, min(yaw, high))
        if self._palm is not None:
            X_WP = RigidTransform(pose.X_WB[self._palm_body]) @ self._palm.GetFixedPoseInBodyFrame()
            J_WP = point_jacobian(self._carrying * pose.screws, X_WP.translation())
            V_WP = GAIN * pose_error(X_WP, self._base.palm_goal(p_WL, yaw, pan))
            V_WP[3:] = self._pace.limited(V_WP[None, 3:], (J_WP[3:] @ v_last)[None])[0]
            share = 1.0 if command.fingers_hold.any() else _PALM_SHARE
            J, V = np.concatenate([J, share * J_WP]), np.concatenate([V, share * V_WP])
        v_posture = GAIN * (self._base.rest_posture(self._home, p_WL, yaw, pan) - q)
        clear = self._scene.clearances(placed, pose, command, self._rate)
        return kernels.next_velocities(q, v_last, J, V, v_posture, self._limits, clear)

    def _calc_pose(self, context: Context) -> HandPose:
        stored = context.get_discrete_state(self._reference).value()
        return self._hand.pose(stored[1 : 1 + self._hand.num_positions])

    def _calc_desired(self, context: Context) -> FloatArray:
        elapsed, q, v, v_last = self._moved(context)
        pressing = context.get_discrete_state(self._pressing).value()
        n = len(self._hand.frames)
        torques, limits, nhat_W = np.split(pressing, [len(q), len(q) + 2 * n])
        is_free = np.where(v > 0, q < self._hand.upper, q > self._hand.lower)
        inertial = context.get_discrete_state(self._inertial).value()
        q, v = q + (torques + inertial) / self._hand.stiffness, v * is_free
        if (limits >= NO_LIMIT).all() or not self._state.HasValue(context):
            return np.concatenate([q, v])
        state = self._state.Eval(context)
        if not are_valid(state):
            return np.concatenate([q, v])
        # A finger that is free lags behind its reference only until it knows a new velocity, which
        # is in its first time step with it. What it lacks apart from that is held back by
        # something it touches.
        hand, (q_now, v_now) = self._hand, state.reshape(2, -1)
        v_known = v_last if elapsed < 1.5 * self._step else v
        behind = q - elapsed * (v - v_known) - (q_now + self._step * v_now)
        torques = hand.stiffness * behind + hand.damping * (v_known - v_now) - inertial
        # A stop would bear a part of the torques that limits leave, and the rest moves the finger.
        J_WT = np.where(hand.moves_freely(q_now), self._pose.Eval(context).J_WT, 0.0)
        limits, nhat_W = limits.reshape(n, 2), nhat_W.reshape(n, 3)
        allowed = hand.with_limited_forces(J_WT, torques, limits, nhat_W)
        return np.concatenate([q - (torques - allowed) / hand.stiffness, v])
