"""Interception of the object by the palm: the meeting, the path to it, and its certificate."""

from dataclasses import replace
from functools import partial

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from drake_pregrasp.arrays import FloatArray, are_valid, pack, unpacker
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.fast.kernels import HandKernels
from drake_pregrasp.geometry.rotations import angle_about_z, skew, turn_about_z
from drake_pregrasp.grasping.catch_limits import CatchLimit
from drake_pregrasp.grasping.grasp_state import GraspPhase
from drake_pregrasp.grasping.interception import MeetingSettings, rest_limit
from drake_pregrasp.grasping.palm_paths import Meeting, moved
from drake_pregrasp.systems import ports

_SHORTEST = 0.1  # Shortest rest of a quintic that follows a new estimate, in seconds.
_STOP = 0.3  # Duration of a stop without a meeting, in seconds.


class InterceptionPlanner(LeafSystem):
    """Plans when and where the palm meets the object, and moves the palm there.

    .. pydrake_system::

        name: InterceptionPlanner
        input_ports:
        - X_WO_estimated
        - V_WO_estimated
        - p_WO_covariance
        - tracking_status
        - X_WG
        - grasp_report
        output_ports:
        - approach
        - catch_certificate

    Port `X_WO_estimated` accepts a `RigidTransform`: the estimated pose of the object O in W. If it
    is invalid, the object is treated as lost.

    Port `V_WO_estimated` accepts a `SpatialVelocity`: that of O in W; zero if it is invalid.

    Port `p_WO_covariance` (optional) accepts a vector of 9: the covariance of the estimated p_WO in
    m², row-major; zero if it is unconnected or not finite.

    Port `tracking_status` (optional) accepts a vector of 1: a `TrackingStatus`. While the object is
    not tracked, the palm comes to rest. If the port is unconnected, the object is tracked.

    Port `X_WG` accepts a `RigidTransform`: the pose of the frame G in which goals of fingertips are
    planned. A hand that approaches again after another phase starts there.

    Port `grasp_report` accepts a vector of 4, as `GraspSequencer` emits it. Meetings are planned in
    the phase `APPROACH`.

    Port `approach` emits a vector of 7: the time of the meeting in seconds, infinite without one or
    while the object is not tracked; the place of the palm's axis, where the object's centre of mass
    will be in the hand, in W, in metres; and its mean velocity until the next tick, in m/s.

    Port `catch_certificate` emits a vector of 5, as of the last tick: the `CatchLimit` that
    prevents every meeting, then the time of the planned meeting in seconds and the place of the
    object's centre of mass there in W, in metres, or NaN. Once the palm has met the object, it is
    the limit that prevents the hand to close and to stop with it. It stays from the squeeze on.

    At each tick, meeting times and descents are compared (`choose_meeting`) for the palm's present
    motion and the object's predicted one. The palm then moves on a quintic to the place over the
    object, with the object's velocity and acceleration, and on another one down to it. Shortly
    before the meeting the choice is only changed if the rest of its path exceeds a limit, as the
    object is estimated then (`rest_limit`); and the palm moves relative to the estimate. Before
    that, a plan for which there is no alternative stays as long as its rest is possible.

    Args:
        settings: Settings of the interception.
        R_AW: Orientation of W in the approach A of the palm, shape (3, 3).
        R_WO: Orientation of the object at which A is that of `R_AW`, shape (3, 3): A turns from
            there about the vertical with the estimated object. None: A does not turn.
        p_OCoM: Centre of mass of the object in O, shape (3,), in metres.
        p_WL: Initial place of the palm's axis in W, shape (3,), in metres.
        commitment: Seconds before the meeting from which on it stays while it is possible; at
            least the time until the meeting that `settings.earliest` asks for.
        predicts: Whether the object's motion is predicted; else it counts as resting.
        period: Seconds between ticks.
        kernels: Implementation of `choose_meeting`; that of `default_kernels` by default.
    """

    def __init__(
        self,
        settings: MeetingSettings,
        *,
        R_AW: FloatArray,
        p_OCoM: FloatArray,
        p_WL: FloatArray,
        commitment: float,
        predicts: bool,
        period: float,
        R_WO: FloatArray | None = None,
        kernels: HandKernels | None = None,
    ) -> None:
        super().__init__()
        self._choose_meeting = (kernels or default_kernels().hand()).choose_meeting
        self._settings, self._R_AW, self._p_OCoM = settings, R_AW, np.array(p_OCoM)
        self._R_OW = None if R_WO is None else R_WO.T
        self._commitment, self._predicts, self._period = commitment, predicts, period
        first = Meeting.at_rest(R_AW @ p_WL)
        self._unpack = unpacker(first)
        self._plan = self.DeclareDiscreteState(pack(first))
        unseen = np.append(float(CatchLimit.SIGHT), np.full(4, np.nan))
        self._certificate = self.DeclareDiscreteState(unseen)
        self._X_WO = self.DeclareAbstractInputPort("X_WO_estimated", ports.POSE)
        self._V_WO = self.DeclareAbstractInputPort("V_WO_estimated", ports.VELOCITY)
        self._covariance = self.DeclareVectorInputPort("p_WO_covariance", 9)
        tracking_status = self.DeclareVectorInputPort("tracking_status", 1)
        self._X_WG = self.DeclareAbstractInputPort("X_WG", ports.POSE)
        self._report = self.DeclareVectorInputPort("grasp_report", 4)
        self._pose = ports.LastPose(self, self._X_WO, tracking_status)
        cache, stored = partial(ports.declare_cache, self), self.xd_ticket()
        self._meeting = cache("plan of the last tick", first, self._calc_meeting, stored)
        seen, words = (self._pose.source, self._V_WO), "motion of the object along the axes of A"
        self._motion = cache(words, np.zeros((3, 3)), self._calc_motion, *seen)
        self._R_AW_now = cache("R_AW", R_AW, self._calc_R_AW, self._pose.source)
        sources = (self.time_ticket(), self._meeting, self._motion, self._pose.source)
        ports.declare_output(self, "approach", 7, self._calc_approach, *sources)
        self.DeclareStateOutputPort("catch_certificate", self._certificate)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _calc_meeting(self, context: Context) -> Meeting:
        return self._unpack(context.get_discrete_state(self._plan).value())

    def _calc_R_AW(self, context: Context) -> FloatArray:
        """Returns the orientation of W in A, which turns with the estimated object if it turns."""
        if self._R_OW is None:
            return self._R_AW
        heading = angle_about_z(self._pose.eval(context)[1] @ self._R_OW)
        return self._R_AW @ turn_about_z(heading).T

    def _calc_motion(self, context: Context) -> FloatArray:
        """Returns position, velocity and acceleration of the centre of mass, shape (3, 3)."""
        _, R_WO, p_WO, _ = self._pose.eval(context)
        w_WO, v_WO = ports.validated_velocity(self._V_WO.Eval(context))
        p_OCoM_W = R_WO @ self._p_OCoM
        R_AW: FloatArray = self._R_AW_now.Eval(context)
        motion = np.array([p_WO + p_OCoM_W, v_WO + skew(w_WO) @ p_OCoM_W, np.zeros(3)]) @ R_AW.T
        motion[2] = self._settings.gravity
        return motion if self._predicts else motion * [[1.0], [0.0], [0.0]]

    def _palm(self, context: Context, ahead: float = 0.0) -> FloatArray:
        """Returns position, velocity and acceleration of the palm in a time ahead, (3, 3)."""
        plan, time = self._meeting.Eval(context), context.get_time() + ahead
        base = plan.object_at(time)
        # If the object is lost, the palm starts its stop with the object's last velocity.
        if plan.follows and (self._pose.eval(context).is_tracked or not plan.meets):
            base = moved(self._motion.Eval(context), ahead)
        palm: FloatArray = base + plan.offset_at(time)
        return palm

    def _calc_approach(self, context: Context) -> FloatArray:
        plan, x = self._meeting.Eval(context), self._palm(context)[0]
        v = (self._palm(context, self._period)[0] - x) / self._period
        is_tracked = self._pose.eval(context).is_tracked
        time = plan.time if plan.meets and is_tracked else np.inf
        R_AW = self._R_AW_now.Eval(context)
        return np.concatenate([[time], x @ R_AW, v @ R_AW])

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        self._pose.store(context, discrete_state)
        phase, since = self._report.Eval(context)[:2]
        if phase == GraspPhase.APPROACH:
            plan, limit = self._next_plan(context)
            certificate = np.append(float(limit), np.full(4, np.nan))
            if limit == CatchLimit.NONE:
                there = moved(self._motion.Eval(context), plan.time - context.get_time())[0]
                certificate[1:] = plan.time, *(there @ self._R_AW_now.Eval(context))
        else:
            X_WG: RigidTransform = self._X_WG.Eval(context)
            place = self._R_AW_now.Eval(context) @ (X_WG @ self._p_OCoM)
            away = place - self._motion.Eval(context)[0]
            plan = Meeting.above(float(away[2]) if are_valid(away) else 0.0)
            certificate = context.get_discrete_state(self._certificate).value().copy()
            if phase in (GraspPhase.TRACK, GraspPhase.CLOSE):
                closed = context.get_time() - since if phase == GraspPhase.CLOSE else 0.0
                certificate[0] = self._limit_of_grip(context, closed)
        discrete_state.set_value(self._plan, pack(plan))
        discrete_state.set_value(self._certificate, certificate)

    def _limit_of_grip(self, context: Context, closed: float) -> CatchLimit:
        """Returns what prevents a hand that has met the object, and closed for a time, to stop it.

        Args:
            context: Context of the system.
            closed: Time since it began to close, in seconds.
        """
        if not self._pose.eval(context).is_tracked:
            return CatchLimit.SIGHT
        motion, now, settings = self._motion.Eval(context), context.get_time(), self._settings
        settings = replace(settings, follow=max(0.0, settings.follow - closed))
        met = replace(self._meeting.Eval(context), time=now)
        return rest_limit(np.zeros((3, 3)), motion, now, met, settings)

    def _next_plan(self, context: Context) -> tuple[Meeting, CatchLimit]:
        """Returns the plan from now on, and what prevents a meeting."""
        now, plan = context.get_time(), self._meeting.Eval(context)
        palm, motion = self._palm(context), self._motion.Eval(context)
        if not self._pose.eval(context).is_tracked:
            return _stopping(plan, palm, now), CatchLimit.SIGHT
        offset, settings = palm - motion, self._settings
        is_final = plan.meets and plan.time - now <= max(self._commitment, settings.earliest)
        over, time, height = plan.over, plan.time, plan.height
        rest = partial(rest_limit, offset, motion, now, plan, settings)
        if not is_final or rest() != CatchLimit.NONE:
            variance = 0.0
            if self._covariance.HasValue(context):
                variance = float(np.sum(self._covariance.Eval(context)[::4]))
                variance = max(0.0, variance) if np.isfinite(variance) else 0.0
            choice = self._choose_meeting(offset, motion, variance, now, plan, settings)
            if choice.limit == CatchLimit.NONE:
                over, time, height = choice.over, choice.time, choice.height
            elif is_final or not plan.meets or rest() != CatchLimit.NONE:
                return _stopping(plan, palm, now), choice.limit
        is_same = plan.meets and np.allclose((over, time), (plan.over, plan.time))
        if over <= now:  # The palm is over the object, and goes down directly.
            over, height = time, 0.0
        if is_same and (over - now < _SHORTEST or time <= now):
            motion = moved(motion, plan.start - now)  # Where it goes if the object is lost.
            return replace(plan, follows=True, motion=motion), CatchLimit.NONE
        plan = Meeting(now, over, time, height, offset, motion, follows=False, meets=True)
        return plan, CatchLimit.NONE


def _stopping(plan: Meeting, palm: FloatArray, now: float) -> Meeting:
    """Returns the plan of a palm that comes to rest, or rests, without a meeting."""
    is_moving = plan.meets or plan.follows
    return Meeting.stopping(palm, now, _STOP) if is_moving else plan
