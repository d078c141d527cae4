"""Motion of the frame G of an object that fingers hold, as state and cache of a system."""

import math
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.framework import CacheEntry, Context, DiscreteValues, InputPort, LeafSystem

from drake_pregrasp.arrays import FloatArray, pack, unpacker, validated_numbers
from drake_pregrasp.grasping.grasp_state import GraspPhase, GraspSettings, GraspState
from drake_pregrasp.grasping.hand_commands import GraspCommand
from drake_pregrasp.grasping.held_motion import TETHER, HeldMotion
from drake_pregrasp.grasping.object_stiffness import holding_gain, restoring_forces
from drake_pregrasp.grasping.touch_correction import corrected_pose
from drake_pregrasp.systems import ports


class HeldObject(NamedTuple):
    """Properties of an object, a hand and a grasp that decide how the held object moves.

    Attributes:
        p_OCoM: Centre of mass of the object in O, shape (3,), in metres.
        stiffness: Horizontal stiffness of the fingertips, shape (n,), in N/m.
        least_stiffness: Their least stiffness over all directions, shape (n,), in N/m.
        friction: Largest horizontal force that does not move G on a belt, in newtons.
        lift_axis: Unit vector of the lift in W, shape (3,).
        settings: Settings of the grasp.
        a_W: Acceleration of the object until the hand stops it, in W, shape (3,), in m/s²: gravity
            in the air, and zero for an object that something carries.
    """

    p_OCoM: FloatArray
    stiffness: FloatArray
    least_stiffness: FloatArray
    friction: float
    lift_axis: FloatArray
    settings: GraspSettings
    a_W: FloatArray


class HeldMemory(NamedTuple):
    """Motion of G as of the last tick, and what follows from it.

    Attributes:
        last: Motion of G when it was last stored, in the squeeze or before it.
        p_GT: Where the fingertips belong in G since they press firmly, else NaN, shape (n, 3). On
            the table these are their goals: measured places would keep the strain of the touch,
            which then drives the object without end. In the hold, they are their places at the end
            of the lift.
        stands: Whether the object still stands on the table.
        is_gripped: Whether G moves with the fingertips, or as they left it: from the tick after
            the squeeze has begun, and in the air from the first tick of closing on.
    """

    last: HeldMotion
    p_GT: FloatArray
    stands: bool
    is_gripped: bool


_FOLLOWING = 0.3  # Time constant with which a closing hand follows an estimate, in seconds.
_LAG = 0.002  # Largest distance by which it lags behind: more is motion and not noise, in metres.

_AT_REST = HeldMotion.at_rest()
_unpack_motion = unpacker(_AT_REST)
_ON_TABLE = np.array([[0.0, 0.0, 1.0], [1.0, 1.0, 0.0]])  # Turns and velocities of a belt.


class HeldFrame:
    """Moves the frame G with an object that fingers hold (`HeldMotion`), within `TETHER` of it.

    An object in the air falls freely until the hand stops it; pushes of the fingers do not count.

    Args:
        system: System that has the ports, and is being built.
        held: Properties of the object, the hand and the grasp.
        grasp: Cache entry of the `GraspState`.
        p_WT: Port that accepts the fingertips' centres in W, a vector of 3n, in metres.
        f_T_W: Port that accepts the forces that they press with, in W, a vector of 3n, in newtons.
        camera_offset: Port that accepts the displacement of what cameras show, a vector of 12.
        pose: Estimated pose of the object.
        period: Seconds between ticks of the system.

    Attributes:
        offset: Cache entry of the offset (x, y, yaw) of G from the estimate, shape (3,): that of
            the `GraspState`, such that changes of `camera_offset` do not move G while the hand
            closes and squeezes.
        memory: Cache entry of the `HeldMemory`.
        motion: Cache entry of the `HeldMotion` by the fingertips alone.
        near: Cache entry of the `HeldMotion` within the tether.
    """

    def __init__(
        self,
        system: LeafSystem,
        held: HeldObject,
        grasp: CacheEntry,
        p_WT: InputPort,
        f_T_W: InputPort,
        camera_offset: InputPort,
        pose: ports.LastPose,
        period: float,
    ) -> None:
        n = len(held.stiffness)
        self._held, self._in_air = held, bool(held.a_W.any())
        self._p_WT, self._f_T_W, self._pose = p_WT, f_T_W, pose
        self._camera_offset = camera_offset
        self._grasp, self._period, self._gain = grasp, period, holding_gain(period)
        self._last = system.DeclareDiscreteState(pack(_AT_REST))
        self._sticking = system.DeclareDiscreteState(np.full(3 * n, np.nan))
        self._last_shown = system.DeclareDiscreteState(3)
        self._before_lift = system.DeclareDiscreteState(np.full(3 * n, np.nan))
        self._followed = system.DeclareDiscreteState(pack(_AT_REST))
        stored, cache = system.xd_ticket(), partial(ports.declare_cache, system)
        shown = stored, camera_offset
        self.offset = cache("offset of G", np.zeros(3), self._calc_offset, *shown)
        model = HeldMemory(_AT_REST, np.empty((n, 3)), True, False)
        self.memory = cache("motion of G at the last tick", model, self._calc_memory, stored)
        sources = (system.time_ticket(), stored, p_WT, f_T_W)
        self.motion = cache("motion of held object", _AT_REST, self._calc_motion, *sources)
        words = "motion near the estimate"
        self.near = cache(words, _AT_REST, self._calc_near, self.motion, pose.source, self.offset)

    def _shown(self, context: Context) -> FloatArray:
        """Returns the last valid displacement of what cameras show in W, shape (3,), in metres."""
        last: FloatArray = context.get_discrete_state(self._last_shown).value().copy()
        if not self._camera_offset.HasValue(context):
            return last
        b_W = validated_numbers(self._camera_offset.Eval(context)[:3])
        return np.where(np.isfinite(b_W), b_W, last)

    def followed(self, context: Context) -> tuple[FloatArray, FloatArray]:
        """Returns the orientation and position of the object that a closing hand follows.

        It is the estimate when the hand begins to close. While it closes, it moves with the
        estimated velocity, and toward the estimate with a time constant, its centre of mass within
        2 mm of it: fingers that touch would push the object by the noise of each new measurement.
        """
        _, R_WO, p_WO, _ = self._pose.eval(context)
        state: GraspState = self._grasp.Eval(context)
        last = _unpack_motion(context.get_discrete_state(self._followed).value())
        time, p_OCoM = context.get_time(), self._held.p_OCoM
        if not state.since <= last.time <= time:  # The clock may have been set back.
            return R_WO, p_WO
        now = last.at(time, p_OCoM)
        now = replace(now, p_WG=now.p_WG - self._revealed(context))
        away = float(np.linalg.norm(now.p_WG - p_WO + (now.R_WG - R_WO) @ p_OCoM))
        left = min(math.exp((last.time - time) / _FOLLOWING), _LAG / max(away, _LAG))
        now = now.nearer(R_WO, p_WO, p_OCoM, 1 - left)
        return now.R_WG, now.p_WG

    def _revealed(self, context: Context) -> FloatArray:
        """Returns how much farther cameras displace what they show than they did at the last tick.

        The estimate has moved against it, in W, shape (3,), in metres.
        """
        last = context.get_discrete_state(self._last_shown).value()
        return np.asarray(self._shown(context) - last)

    def _calc_offset(self, context: Context) -> FloatArray:
        state: GraspState = self._grasp.Eval(context)
        if not GraspPhase.CLOSE <= state.phase <= GraspPhase.SQUEEZE:
            return state.offset
        x, y, _ = self._revealed(context)
        return np.asarray(state.offset + np.array([x, y, 0.0]))

    def _calc_memory(self, context: Context) -> HeldMemory:
        state: GraspState = self._grasp.Eval(context)
        last = _unpack_motion(context.get_discrete_state(self._last).value())
        p_GT = context.get_discrete_state(self._sticking).value().copy()
        sticks = bool(np.isfinite(p_GT).any())
        has_lifted = state.phase > GraspPhase.SQUEEZE
        opened = state.phase == GraspPhase.BACK_OFF and state.since <= last.time
        is_gripped = math.isfinite(state.gripped) and (has_lifted or sticks)
        if self._in_air and GraspPhase.CLOSE <= state.phase <= GraspPhase.SQUEEZE:
            is_gripped = last.time >= state.since
        return HeldMemory(last, p_GT.reshape(-1, 3), opened or not has_lifted, is_gripped)

    def _calc_motion(self, context: Context) -> HeldMotion:
        memory: HeldMemory = self.memory.Eval(context)
        state: GraspState = self._grasp.Eval(context)
        last, p_GT, time = memory.last, memory.p_GT, context.get_time()
        settings = self._held.settings
        if not memory.stands:
            return self._stopping(last, time)
        now = last.at(time, self._held.p_OCoM)
        if state.phase == GraspPhase.BACK_OFF or self._in_air:
            return now
        p_WT = validated_numbers(self._p_WT.Eval(context)).reshape(-1, 3)
        on = state.active & np.all(np.isfinite(p_WT) & np.isfinite(p_GT), axis=1)
        if not np.any(on):
            return now
        k = self._held.stiffness[on]
        push = k @ (p_WT[on] - now.p_WG - p_GT[on] @ now.R_WG.T)
        # Fingers whose forces are limited are moved by other fingers, too. Such a shift may slow G
        # down, but G is pushed on only where fingers press less along the push than they should.
        f_T_W = validated_numbers(self._f_T_W.Eval(context)).reshape(-1, 3)
        lacking = state.planned_forces(0.0, settings) @ now.R_WG.T - f_T_W
        felt = np.sum(lacking[on], axis=0) @ push / max(float(np.linalg.norm(push)), 1e-12)
        if np.isfinite(felt) and push @ (now.V_WG[1] - now.V_WBelt[1]) >= 0:
            push *= min(1.0, max(0.0, 2 * float(felt) / settings.touch_force))
        return now.yielding(push, np.sum(k), self._held.friction, time - last.time, self._period)

    def _calc_near(self, context: Context) -> HeldMotion:
        motion: HeldMotion = self.motion.Eval(context)
        _, R_WO, p_WO, is_tracked = self._pose.eval(context)
        memory: HeldMemory = self.memory.Eval(context)
        if not (is_tracked and memory.stands) or self._in_air:
            return motion
        _, p_WG = corrected_pose(R_WO, p_WO, self._held.p_OCoM, self.offset.Eval(context))
        return motion.within(p_WG, TETHER)

    def _stopping(self, last: HeldMotion, time: float) -> HeldMotion:
        """Returns the motion at a time in the lift or after it, in which G comes to rest."""
        return last.stopping(time, self._held.settings.stop_duration)

    def frame(self, context: Context) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Returns R_WG, p_WG and V_WG of the held object; V_WG is that after half a period."""
        motion: HeldMotion = self.near.Eval(context)
        memory: HeldMemory = self.memory.Eval(context)
        V_WG = motion.V_WG
        if not memory.stands:
            middle = context.get_time() + self._period / 2
            V_WG = self._stopping(memory.last, middle).V_WG
        return motion.R_WG, motion.p_WG, V_WG

    def calc_velocity(self, context: Context) -> SpatialVelocity:
        """Returns the velocity with which the hand moves the object in W, or NaN if it does not.

        A push counts from the next tick on, when it is known what the tether has left of it.
        """
        memory: HeldMemory = self.memory.Eval(context)
        state: GraspState = self._grasp.Eval(context)
        if state.share == 0 or not np.isfinite(memory.p_GT).any():
            return SpatialVelocity(np.full(6, np.nan))
        last, time = memory.last, context.get_time()
        if memory.stands:
            w_WG, v_WG = last.at(time, self._held.p_OCoM).V_WG
        else:
            w_WG, v_WG = self._stopping(last, time).V_WG
        rising = state.height.rate(time) * self._held.lift_axis
        return SpatialVelocity(w=w_WG, v=v_WG + rising)

    def restoring_forces(self, context: Context, R_WG: FloatArray, p_WG: FloatArray) -> FloatArray:
        """Returns the forces that keep the object in its place, in G, shape (n, 3), in newtons.

        They act against turns since the squeeze, and in the hold also against displacements since
        the lift. They are zero until the lift, and for fingers that do not hold or were not
        measured.

        Args:
            context: Context of the system.
            R_WG: Present orientation of G, shape (3, 3).
            p_WG: Present position of G, shape (3,), in metres.
        """
        state: GraspState = self._grasp.Eval(context)
        p_GT = (validated_numbers(self._p_WT.Eval(context)).reshape(-1, 3) - p_WG) @ R_WG
        before = context.get_discrete_state(self._before_lift).value().reshape(-1, 3)
        d, forces = p_GT - before, np.zeros(p_GT.shape)
        on = state.active & np.isfinite(d).all(axis=1)
        lifted = p_GT
        if state.phase == GraspPhase.HOLD:
            lifted = self.memory.Eval(context).p_GT
            on &= np.isfinite(lifted).all(axis=1)
        if not (state.phase in (GraspPhase.LIFT, GraspPhase.HOLD) and on.any()):
            return forces
        k = self._held.least_stiffness[on]
        middle, moved = k @ before[on] / np.sum(k), k @ (p_GT - lifted)[on] / np.sum(k)
        d = d[on] - k @ d[on] / np.sum(k) + moved
        forces[on] = restoring_forces(before[on] - middle, d, k, self._gain)
        return forces

    def store(
        self,
        context: Context,
        discrete_state: DiscreteValues,
        command: GraspCommand,
        p_GT: FloatArray,
        p_GT_goal: FloatArray,
    ) -> None:
        """Stores the displacement of what cameras show, and what `HeldMemory` contains.

        The motion of G, the pose that it follows, and the places of the fingertips are stored while
        the hand closes or squeezes; after that they are kept.

        Args:
            context: Context of the system.
            discrete_state: Its next discrete state.
            command: Present command, with the motion of G until the fingers grip.
            p_GT: Present places of the fingertips in G, shape (n, 3), in metres.
            p_GT_goal: Their goals in G, shape (n, 3), in metres.
        """
        discrete_state.set_value(self._last_shown, self._shown(context))
        state: GraspState = self._grasp.Eval(context)
        if state.phase == GraspPhase.LIFT:
            discrete_state.set_value(self._sticking, p_GT.ravel())
        if not GraspPhase.CLOSE <= state.phase <= GraspPhase.SQUEEZE:
            return
        time, V_WO = context.get_time(), command.V_WO
        if state.phase == GraspPhase.CLOSE:
            followed = HeldMotion(time, *self.followed(context), V_WO, V_WO, np.zeros(3))
            discrete_state.set_value(self._followed, pack(followed))
        motion: HeldMotion = self.near.Eval(context)
        memory: HeldMemory = self.memory.Eval(context)
        if not memory.is_gripped:
            V_WBelt = V_WO if self._in_air else _ON_TABLE * V_WO
            if state.touched.any() and not self._in_air:  # Fingers may push it beside the belt.
                V_WBelt = memory.last.V_WBelt
            a_W = self._held.a_W
            motion = HeldMotion(time, command.R_WG, command.p_WG, V_WBelt, V_WBelt, a_W)
        discrete_state.set_value(self._last, pack(motion))
        sticks = state.phase == GraspPhase.SQUEEZE
        sticking = p_GT_goal.ravel() if sticks else np.full(p_GT_goal.size, np.nan)
        discrete_state.set_value(self._sticking, sticking)
        discrete_state.set_value(self._before_lift, p_GT.ravel())
