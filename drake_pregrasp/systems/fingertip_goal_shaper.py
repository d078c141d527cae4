"""Fingertip goals that a hand can follow without collisions, from contact goals."""

from collections.abc import Sequence

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import BusValue, Context, DiscreteValues, LeafSystem

from drake_pregrasp.arrays import FARTHEST, FloatArray, are_valid
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.validation import checked
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.rotations import rotation_matrix
from drake_pregrasp.geometry.solids import PlacedSolid, SignedDistance, Solid
from drake_pregrasp.grasping.fingertip_paths import MOVING_CLEARANCE, Pace, TipPlaces, shape_goals
from drake_pregrasp.quality.grasp_quality import skew
from drake_pregrasp.regions.obstacles import ANYWHERE
from drake_pregrasp.systems import ports
from drake_pregrasp.systems.palm_posture import FROM_ABOVE

GOAL_SHARE = 0.5
"""Share of `tip_acceleration` for the motion over the object, which may itself accelerate."""


class FingertipGoalShaper(LeafSystem):
    """Turns contact goals into fingertip goals that move with the object.

    .. pydrake_system::

        name: FingertipGoalShaper
        input_ports:
        - fingertip_targets
        - contact_status
        - X_WO_estimated
        - X_WG
        - V_WG
        - standoffs
        - hold_contacts
        - obstacles
        - X_WU
        - fingers_hold
        - tracking_status
        output_ports:
        - tip_goals
        - contact_frames
        - p_GT
        - v_WT

    Port `fingertip_targets` accepts a `BusValue` as `CentroidSelector` emits it: for each name in
    `tip_frames` the pose of a contact goal in W, with its z axis along the inward normal. A finger
    whose entry is missing or invalid keeps its contact.

    Port `contact_status` accepts a vector of n `ContactStatus` values.

    Port `X_WO_estimated` accepts a `RigidTransform`: the estimated pose of the object O in W. While
    it is invalid, contacts are not updated.

    Port `X_WG` accepts a `RigidTransform`: the pose of the frame G in which goals are planned. It
    is the estimated pose of O, raised while the hand approaches or lifts. While it is invalid, its
    last valid value is used.

    Port `V_WG` accepts a `SpatialVelocity`: the velocity of G in W. An invalid one counts as zero.

    Port `standoffs` (optional) accepts a vector of n: the gap between each fingertip and the
    surface at its contact, in metres; negative values press. NaN, and an unconnected port, mean the
    standoff of `config`.

    Port `hold_contacts` (optional) accepts a vector of 1: if it is above 0 or NaN, contacts stay
    where they are in O, and fingers stay active or inactive.

    Port `obstacles` (optional) accepts `Obstacles` in W. Fingertips avoid its solids, unless they
    hold their contacts. While an obstacle has numbers that are not finite, fingertips stay where
    they are in G.

    Port `X_WU` (optional) accepts a `RigidTransform`: the pose of the palm's frame U. Fingers
    without an active contact wait at their own azimuths in U; if the port is unconnected or its
    value is invalid, at their present azimuths.

    Port `fingers_hold` (optional) accepts a vector of n: while contacts are held, obstacles do not
    push a finger with a value above 0 or NaN off its contact. If the port is unconnected, this
    holds for all active fingers.

    Port `tracking_status` (optional) accepts a vector of 1: a `TrackingStatus`; any other number
    counts as `LOST`. While goals must not follow the estimate, contacts are not updated, because
    `fingertip_targets` are then off the surface. Fingertips keep their commanded standoff. If the
    port is unconnected, the object is tracked.

    Port `tip_goals` emits a `BusValue`: for each name in `tip_frames` a `RigidTransform` in W, the
    goal of the fingertip's centre `lead` after the Context's time, with the orientation of W. It
    fits `desired_cartesian_poses` of `DifferentialKinematics`, with masks for positions only.

    Port `contact_frames` emits a vector of 6n: the contacts that the fingertips go to, in O, in
    metres, one after another, then the outward unit normals there, as of the last tick. Where a
    fingertip has no room, for example close to the table, its contact is shifted along the surface.

    Port `p_GT` emits a vector of 3n: the goals in G, as of the last tick, in metres.

    Port `v_WT` emits a vector of 3n: the velocities of the goals in W, in m/s. Each is the sum of
    the velocity of G there and of the goal's velocity over the object as of the last tick.

    Goals move over the object with at most `goal_speed` and half of `tip_acceleration`, so they do
    not jump when contacts do, unless an obstacle or another fingertip pushes them away. They are
    clear of the object and of everything else by the tip radius and a clearance, and go the shorter
    way around the object, or over it if that way is blocked. Fingers without an active contact wait
    above the object.

    Args:
        config: Configuration of the grasp; `period`, `goal_speed`, `tip_acceleration` and
            `standoff` are used.
        tip_frames: Scoped names of the fingertips' frames.
        tip_radius: Radius of the fingertips, or of each, shape (n,), in metres.
        object_solid: The object in O.
        fixed: Solids in W that fingertips avoid, such as the table.
        p_GT: Initial positions of the fingertips' centres in G, shape (n, 3), in metres.
        finger_azimuths: Azimuths of the fingers about z of U, shape (n,), in radians.
        target_period: Seconds between updates of the contacts: the planning period, between whose
            ticks contact goals do not change in O.
        lead: Seconds by which `tip_goals` are ahead: the delay of the system that follows them.
        withdrawn_radii: Distance from z of A at which each finger without an active contact waits,
            shape (n,), in metres. 0, also the default, stands for the mean initial distance of the
            fingertips from z of G.
        X_LA: Approach of the palm; see `HandModel`. Fingers go around z of A, and withdraw along
            it.
        p_OCoM: Centre of mass of the object in O, shape (3,), in metres; by default the origin.

    Raises:
        InvalidArgumentError: If an argument or a field of `config` is out of its range.
    """

    def __init__(
        self,
        config: GraspConfig | None = None,
        *,
        tip_frames: Sequence[str],
        tip_radius: float | FloatArray,
        object_solid: SignedDistance,
        fixed: Sequence[Solid],
        p_GT: FloatArray,
        finger_azimuths: FloatArray,
        target_period: float,
        lead: float = 0.0,
        withdrawn_radii: FloatArray | None = None,
        X_LA: RigidTransform = FROM_ABOVE,
        p_OCoM: FloatArray | None = None,
    ) -> None:
        super().__init__()
        config = checked(config or GraspConfig())
        n = len(tip_frames)
        if np.shape(p_GT) != (n, 3):
            raise InvalidArgumentError(f"p_GT must have shape ({n}, 3), not {np.shape(p_GT)}")
        for name, value in (("target_period", target_period), ("tip_radius", np.min(tip_radius))):
            if not value > 0:
                raise InvalidArgumentError(f"{name} must be greater than 0, not {value}")
        self._tip_frames = list(tip_frames)
        self._radius: FloatArray = np.broadcast_to(np.asarray(tip_radius, dtype=float), n)
        self._object = object_solid
        if isinstance(object_solid, Solid):  # Solids move in each tick, fastest as rows of numbers.
            self._object = PlacedSolid(object_solid.rounded_box())
        mean_radius = np.mean(np.linalg.norm(np.asarray(p_GT)[:, :2], axis=1))
        radii = np.zeros(n) if withdrawn_radii is None else withdrawn_radii
        azimuths = np.asarray(finger_azimuths)
        self._places = TipPlaces(
            tip_radii=self._radius,
            directions=np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(n)], axis=1),
            withdrawn_radii=np.where(radii, radii, mean_radius),
        )
        self._fixed, self._lead = [PlacedSolid(solid.rounded_box()) for solid in fixed], lead
        X_AL = X_LA.inverse()
        self._R_AL, self._p_AL = X_AL.rotation().matrix(), X_AL.translation()
        self._p_OCoM: FloatArray = np.zeros(3) if p_OCoM is None else np.array(p_OCoM)
        acceleration = GOAL_SHARE * config.tip_acceleration
        self._pace = Pace(config.goal_speed, acceleration, config.period)
        self._own_gaps: FloatArray = np.full(n, config.standoff)

        self._tips = self.DeclareDiscreteState(np.array(p_GT, dtype=float).ravel())
        self._rates = self.DeclareDiscreteState(3 * n)
        # Before the first tick there are no contacts: fingertips stay, and nothing is held.
        frames = self._places.first_contacts(np.asarray(p_GT), config.standoff)
        self._targeted = self.DeclareDiscreteState(np.concatenate(frames).ravel())
        self._contacts = self.DeclareDiscreteState(np.concatenate(frames).ravel())
        self._active = self.DeclareDiscreteState(n)
        self._targets = self.DeclareAbstractInputPort("fingertip_targets", ports.BUS)
        self._status = self.DeclareVectorInputPort("contact_status", n)
        self._X_WO = self.DeclareAbstractInputPort("X_WO_estimated", ports.POSE)
        self._X_WG = self.DeclareAbstractInputPort("X_WG", ports.POSE)
        self._V_WG = self.DeclareAbstractInputPort("V_WG", ports.VELOCITY)
        self._standoffs = self.DeclareVectorInputPort("standoffs", n)
        self._hold = self.DeclareVectorInputPort("hold_contacts", 1)
        self._obstacles = self.DeclareAbstractInputPort("obstacles", ports.OBSTACLES)
        self._X_WU = self.DeclareAbstractInputPort("X_WU", ports.POSE)
        self._fingers_hold = self.DeclareVectorInputPort("fingers_hold", n)
        self._tracking_status = self.DeclareVectorInputPort("tracking_status", 1)
        self._pose = ports.LastPose(self, self._X_WG)
        tips, pose = self.discrete_state_ticket(self._tips), self._pose.source
        sources = (tips, pose, self._V_WG)
        ports.declare_output(self, "tip_goals", ports.BUS, self._calc_tip_goals, *sources)
        self.DeclareStateOutputPort("contact_frames", self._contacts)
        self.DeclareStateOutputPort("p_GT", self._tips)
        rates = self.discrete_state_ticket(self._rates)
        ports.declare_output(self, "v_WT", 3 * n, self._calc_rates, rates, *sources)
        self.DeclarePeriodicDiscreteUpdateEvent(target_period, 0.0, self._sample_targets)
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._update)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        held = self._is_held(context)
        stored = context.get_discrete_state(self._active)
        active = is_active(stored.value() if held else self._status.Eval(context))
        asked, gaps = self._standoffs, self._own_gaps
        if asked.HasValue(context) and not are_valid(gaps := asked.Eval(context)):
            gaps = np.where(np.abs(gaps) <= FARTHEST, gaps, self._own_gaps)
        frames = context.get_discrete_state(self._contacts if held else self._targeted).value()
        p_OC, nhat = frames.reshape(2, -1, 3)
        p_GT: FloatArray = context.get_discrete_state(self._tips).value().reshape(-1, 3)
        self._pose.store(context, discrete_state)
        # Paths are planned in the frame A of the approach, in which the palm's axis is z.
        R_WG, p_WG = self._pose.split(context)
        R_AW, R_AG = self._R_AL, self._R_AL @ R_WG
        p_AG = self._p_AL - R_AG @ self._p_OCoM
        p_AW = p_AG - R_AW @ p_WG
        obstacles = ports.eval_solids(self, self._obstacles, context, R_AW, p_AW)
        if ANYWHERE in obstacles:
            discrete_state.set_value(self._rates, np.zeros(p_GT.size))
            return
        goal = p_OC + (self._radius + gaps)[:, None] * nhat
        object_solid = self._object.moved(R_AG, p_AG)
        p_AT, goal = p_GT @ R_AG.T + p_AG, goal @ R_AG.T + p_AG
        if not active.all():
            top = object_solid.highest(np.array([0.0, 0.0, 1.0]))
            withdrawn = self._places.withdrawn(p_AT, self._palm_turn(context), top)
            goal = np.where(active[:, None], goal, withdrawn)
            gaps = np.where(active, gaps, MOVING_CLEARANCE)
        holding = held & active
        if self._fingers_hold.HasValue(context):
            holding = holding & ~(self._fingers_hold.Eval(context) <= 0)
        room = self._places.room(
            object_solid,
            gaps,
            goal,
            fixed=[solid.moved(R_AW, p_AW) for solid in self._fixed],
            obstacles=obstacles,
            holding=holding,
        )
        v_GT = context.get_discrete_state(self._rates).value().reshape(-1, 3)
        has_arrived = self._pace.has_arrived(goal - p_AT, v_GT)
        permitted = goal if held and not has_arrived else room.permitted(goal)
        if not held:
            if permitted is not goal:
                shift = np.where(active[:, None], permitted - goal, 0) @ R_AG
                along = shift - np.sum(shift * nhat, axis=1, keepdims=True) * nhat
                frames, goal = np.concatenate([p_OC + along, nhat]), goal + along @ R_AG.T
            discrete_state.set_value(self._active, active.astype(float))
            discrete_state.set_value(self._contacts, frames.ravel())
        if has_arrived and permitted is goal:
            return
        shaped = (shape_goals(p_AT, v_GT @ R_AG.T, goal, self._pace, room) - p_AG) @ R_AG
        rates = self._pace.limited((shaped - p_GT) / self._pace.period, v_GT)
        discrete_state.set_value(self._tips, shaped.ravel())
        discrete_state.set_value(self._rates, rates.ravel())

    def _is_held(self, context: Context) -> bool:
        # NaN is not <= 0 either, so it holds the contacts.
        return bool(self._hold.HasValue(context) and not self._hold.Eval(context)[0] <= 0)

    def _sample_targets(self, context: Context, discrete_state: DiscreteValues) -> None:
        X_WO: RigidTransform = self._X_WO.Eval(context)
        followed = ports.is_followed(self._tracking_status, context)
        if self._is_held(context) or not followed or not ports.is_valid(X_WO):
            return
        targeted: FloatArray = context.get_discrete_state(self._targeted).value().copy()
        p_OC, nhat = targeted.reshape(2, -1, 3)
        port = f"fingertip_targets of {self.get_name()}"
        X_OW = X_WO.inverse()
        targets = ports.validated_poses(self._targets.Eval(context), self._tip_frames, port)
        for finger, X_WC in enumerate(targets):
            if X_WC is not None:
                X_OC: RigidTransform = X_OW @ X_WC
                p_OC[finger] = X_OC.translation()
                nhat[finger] = -X_OC.rotation().matrix()[:, 2]
        discrete_state.set_value(self._targeted, targeted)

    def _palm_turn(self, context: Context) -> FloatArray | None:
        """Returns the orientation of the palm in A, or None without a valid pose."""
        if not self._X_WU.HasValue(context) or not ports.is_valid(self._X_WU.Eval(context)):
            return None
        return np.asarray(self._R_AL @ self._X_WU.Eval(context).rotation().matrix())

    def _calc_tip_goals(self, context: Context) -> BusValue:
        p_GT: FloatArray = context.get_discrete_state(self._tips).value().reshape(-1, 3)
        R_WG, p_WG = self._pose.split(context)
        w_WG, v_WG = ports.validated_velocity(self._V_WG.Eval(context))
        R_WG = rotation_matrix(w_WG * self._lead) @ R_WG
        p_WT = p_GT @ R_WG.T + p_WG + v_WG * self._lead
        bus, pose = BusValue(), ports.POSE.Clone()
        X_WT = pose.get_mutable_value()
        for name, p in zip(self._tip_frames, p_WT, strict=True):
            X_WT.set_translation(p)
            bus.Set(name, pose)  # A copy.
        return bus

    def _calc_rates(self, context: Context) -> FloatArray:
        p_GT: FloatArray = context.get_discrete_state(self._tips).value().reshape(-1, 3)
        v_GT: FloatArray = context.get_discrete_state(self._rates).value().reshape(-1, 3)
        R_WG, _ = self._pose.split(context)
        w_WG, v_WG = ports.validated_velocity(self._V_WG.Eval(context))
        return np.asarray(p_GT @ (skew(w_WG) @ R_WG).T + v_WG + v_GT @ R_WG.T)
