"""Contact goals made into fingertip goals that a hand can follow without harm."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.framework import (
    BusValue,
    Context,
    DiscreteValues,
    LeafSystem,
)

from drake_pregrasp.arrays import FloatArray, validated_numbers
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.geometry.rotations import rotation_matrix
from drake_pregrasp.geometry.solids import Solid
from drake_pregrasp.grasping.fingertip_paths import MOVING_CLEARANCE, TipPlaces, shape_goals
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.regions.obstacles import all_are_known, place_obstacles
from drake_pregrasp.systems.pose_ports import (
    LastPose,
    is_valid,
    validated_poses,
    validated_velocity,
)


class FingertipGoalShaper(LeafSystem):
    """Turns contact goals into goals for fingertips, and carries them along with the object.

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

    Port `fingertip_targets` accepts a `BusValue` as `CentroidSelector` emits it: for each name of
    `tip_frames` the pose in W of a contact goal, its z axis along the inward normal. A finger
    without an entry, or with one that isn't finite, keeps the one it had.

    Port `contact_status` accepts a vector of n `ContactStatus` values.

    Port `X_WO_estimated` accepts a `RigidTransform`: where the object O is believed to be in W. As
    long as it isn't finite, or its rotation is none, no new contacts are taken in.

    Port `X_WG` accepts a `RigidTransform`: the frame G that goals are carried in. It takes O's
    place: without a lift it is where O is believed to be. The last one is used until it is finite.

    Port `V_WG` accepts a `SpatialVelocity`: of G in W. Without a lift it is the estimated one of O.
    If it isn't finite, it is taken for zero.

    Port `standoffs` (optional) accepts a vector of n: the gap between each fingertip and the
    surface at its contact, in metres; below zero it presses. By default, and for NaN, it is
    `standoff`.

    Port `hold_contacts` (optional) accepts a number: above 0, contacts stay where they are in O,
    and fingers stay active or not. NaN holds them, too.

    Port `obstacles` (optional) accepts `Obstacles` in W, of which solids are heeded; not by fingers
    that hold their contacts. As long as one has numbers that are no longer finite, tips stay in G.

    Port `X_WU` (optional) accepts a `RigidTransform`: the frame U of the palm. Fingers without an
    active contact wait at their own azimuths in it; without it, or as long as it isn't finite,
    where they are.

    Port `fingers_hold` (optional) accepts a vector of n: above 0, obstacles don't push a finger off
    its contact while contacts are held; by default no active one. NaN is as 1.

    Port `tracking_status` (optional) accepts a `TrackingStatus`; what is none counts as `LOST`. As
    long as the object isn't followed, no new contacts are taken in: `fingertip_targets` are off the
    surface then, and tips keep the standoff that is asked for. Unconnected, it is always tracked.

    Port `tip_goals` emits a `BusValue`: for each name of `tip_frames` a `RigidTransform` in W with
    the goal of the tip's centre, where it will be `lead` after the Context's time; its orientation
    is W's. It plugs into `desired_cartesian_poses` of `DifferentialInverseKinematicsSystem`, with
    masks for positions only.

    Port `contact_frames` emits a vector of 6n: the contacts that tips go to, in O, in metres, one
    after another, then the outward unit normals there, as of the last tick. Where a tip has no
    room, as close to the table, the contact is shifted along the surface.

    Port `p_GT` emits a vector of 3n: the goals in G, as of the last tick, in metres. Tips are to be
    there, over where G is by then, `lead` after the Context's time.

    Goals move at most at `speed` over the object, which is why they never jump with the contacts.
    They keep out of the object and what else there is by the tips' radius and a clearance; round
    the object they take the shorter way. Fingers without an active contact wait above it.

    Args:
        tip_frames: Scoped names of the fingertips' frames.
        tip_radius: In metres; or that of each, shape (n,).
        object_solid: The object in O, convex.
        object_top: How high it reaches over O, in metres.
        fixed: Solids in W to keep out of, as the table.
        p_GT: Where the tips' centres are at the start, in G, shape (n, 3), in metres.
        finger_azimuths: Of the fingers about z of U, shape (n,), in radians.
        period: Seconds between ticks, greater than zero.
        target_period: Seconds between looks at `fingertip_targets`: that of the planner, between
            whose ticks they don't change in O.
        lead: How far ahead `tip_goals` are, in seconds: as long as what follows takes.
        speed: In m/s.
        standoff: In metres.
        withdrawn_radii: How far from z of G each finger without an active contact waits, shape
            (n,), in metres; where it is 0, and by default, as far as they all are at the start.

    Raises:
        InvalidArgumentError: If an argument is out of its range.
    """

    def __init__(
        self,
        *,
        tip_frames: Sequence[str],
        tip_radius: float | FloatArray,
        object_solid: Solid,
        object_top: float,
        fixed: Sequence[Solid],
        p_GT: FloatArray,
        finger_azimuths: FloatArray,
        period: float,
        target_period: float,
        lead: float = 0.0,
        speed: float = 0.3,
        standoff: float = 0.02,
        withdrawn_radii: FloatArray | None = None,
    ) -> None:
        super().__init__()
        n = len(tip_frames)
        if np.shape(p_GT) != (n, 3):
            raise InvalidArgumentError(f"p_GT must have shape ({n}, 3), not {np.shape(p_GT)}")
        for name, value in (
            ("period", period),
            ("target_period", target_period),
            ("speed", speed),
            ("tip_radius", np.min(tip_radius)),
        ):
            if not value > 0:
                raise InvalidArgumentError(f"{name} must be greater than 0, not {value}")
        self._tip_frames = list(tip_frames)
        self._radius: FloatArray = np.broadcast_to(np.asarray(tip_radius, dtype=float), n)
        self._object = object_solid
        mean_radius = np.mean(np.linalg.norm(np.asarray(p_GT)[:, :2], axis=1))
        asked = np.zeros(n) if withdrawn_radii is None else withdrawn_radii
        azimuths = np.asarray(finger_azimuths)
        self._places = TipPlaces(
            tip_radii=self._radius,
            ways_out=np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(n)], axis=1),
            withdrawn_radii=np.where(asked, asked, mean_radius),
            object_top=object_top,
        )
        self._fixed = tuple(fixed)
        self._lead, self._step, self._standoff = lead, speed * period, standoff

        self._tips = self.DeclareDiscreteState(np.array(p_GT, dtype=float).ravel())
        # Before the first tick there is no contact: tips stay, and nothing is held.
        frames = np.concatenate(self._places.first_contacts(np.asarray(p_GT), standoff)).ravel()
        self._asked = self.DeclareDiscreteState(frames)
        self._contacts = self.DeclareDiscreteState(frames)
        self._active = self.DeclareDiscreteState(n)
        pose, bus = AbstractValue.Make(RigidTransform()), AbstractValue.Make(BusValue())
        self._targets = self.DeclareAbstractInputPort("fingertip_targets", bus)
        self._status = self.DeclareVectorInputPort("contact_status", n)
        self._X_WO = self.DeclareAbstractInputPort("X_WO_estimated", pose)
        self._X_WG = self.DeclareAbstractInputPort("X_WG", pose)
        self._V_WG = self.DeclareAbstractInputPort("V_WG", AbstractValue.Make(SpatialVelocity()))
        self._standoffs = self.DeclareVectorInputPort("standoffs", n)
        self._hold = self.DeclareVectorInputPort("hold_contacts", 1)
        self._obstacles = self.DeclareAbstractInputPort(
            "obstacles", AbstractValue.Make(Obstacles())
        )
        self._X_WU = self.DeclareAbstractInputPort("X_WU", pose)
        self._fingers_hold = self.DeclareVectorInputPort("fingers_hold", n)
        self._tracking_status = self.DeclareVectorInputPort("tracking_status", 1)
        self._pose = LastPose(self, self._X_WG)
        self.DeclareAbstractOutputPort(
            "tip_goals",
            lambda: AbstractValue.Make(BusValue()),
            self._calc_tip_goals,
            {
                self.discrete_state_ticket(self._tips),
                *self._pose.tickets,
                self._V_WG.ticket(),
            },
        )
        self.DeclareStateOutputPort("contact_frames", self._contacts)
        self.DeclareStateOutputPort("p_GT", self._tips)
        self.DeclarePeriodicDiscreteUpdateEvent(target_period, 0.0, self._sample_targets)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        held = self._is_held(context)
        active = context.get_discrete_state(self._active).value() > 0
        if not held:
            active = is_active(np.asarray(self._status.Eval(context)))
        standoffs = np.full(len(active), self._standoff)
        if self._standoffs.HasValue(context):
            asked = validated_numbers(self._standoffs.Eval(context))
            standoffs = np.where(np.isnan(asked), standoffs, asked)
        kept = self._contacts if held else self._asked
        p_OC, nhat = context.get_discrete_state(kept).value().reshape(2, -1, 3)
        p_GT: FloatArray = context.get_discrete_state(self._tips).value().reshape(-1, 3)
        self._pose.store(context, discrete_state)
        obstacles = self._placed_obstacles(context)
        if not all_are_known(obstacles):
            return
        goal = np.where(
            active[:, None],
            p_OC + (self._radius + standoffs)[:, None] * nhat,
            self._places.withdrawn(p_GT, self._palm_turn(context)),
        )
        holding = held & active
        if self._fingers_hold.HasValue(context):
            holding = holding & ~(np.asarray(self._fingers_hold.Eval(context)) <= 0)
        gaps = np.where(active, standoffs, MOVING_CLEARANCE)
        X_GW = self._pose.eval(context).inverse()
        R_GW, p_GW = X_GW.rotation().matrix(), X_GW.translation()
        room = self._places.room(
            self._object,
            gaps,
            fixed=[solid.moved(R_GW, p_GW) for solid in self._fixed],
            obstacles=obstacles.solids,
            holding=holding,
        )
        if not held:
            shift = np.where(active[:, None], room.permitted(goal) - goal, 0)
            along = shift - np.sum(shift * nhat, axis=1, keepdims=True) * nhat
            p_OC, goal = p_OC + along, goal + along
        shaped = shape_goals(p_GT, goal, self._step, room)
        discrete_state.set_value(self._active, active.astype(float))
        discrete_state.set_value(self._tips, shaped.ravel())
        discrete_state.set_value(self._contacts, np.concatenate([p_OC, nhat]).ravel())

    def _is_held(self, context: Context) -> bool:
        # NaN isn't at most 0.
        return bool(self._hold.HasValue(context) and not self._hold.Eval(context)[0] <= 0)

    def _is_tracked(self, context: Context) -> bool:
        if not self._tracking_status.HasValue(context):
            return True
        status = TrackingStatus(self._tracking_status.Eval(context)[0])
        return status.is_followed

    def _sample_targets(self, context: Context, discrete_state: DiscreteValues) -> None:
        X_WO: RigidTransform = self._X_WO.Eval(context)
        if self._is_held(context) or not self._is_tracked(context) or not is_valid(X_WO):
            return
        asked: FloatArray = context.get_discrete_state(self._asked).value().copy()
        p_OC, nhat = asked.reshape(2, -1, 3)
        port = f"fingertip_targets of {self.get_name()}"
        X_OW = X_WO.inverse()
        targets = validated_poses(self._targets.Eval(context), self._tip_frames, port)
        for finger, X_WC in enumerate(targets):
            if X_WC is not None:
                X_OC: RigidTransform = X_OW @ X_WC
                p_OC[finger] = X_OC.translation()
                nhat[finger] = -X_OC.rotation().matrix()[:, 2]
        discrete_state.set_value(self._asked, asked)

    def _palm_turn(self, context: Context) -> FloatArray | None:
        """Returns R_GU; None without a pose of the palm that can be used."""
        if not self._X_WU.HasValue(context) or not is_valid(self._X_WU.Eval(context)):
            return None
        R_GW = self._pose.eval(context).rotation().inverse()
        R_GU: FloatArray = (R_GW @ self._X_WU.Eval(context).rotation()).matrix()
        return R_GU

    def _placed_obstacles(self, context: Context) -> Obstacles:
        """Returns the solids of the obstacles in G."""
        if not self._obstacles.HasValue(context):
            return Obstacles()
        in_world = self._obstacles.Eval(context)
        if not isinstance(in_world, Obstacles):
            raise InvalidArgumentError(
                f"port obstacles of {self.get_name()} accepts an Obstacles,"
                f" not a {type(in_world).__name__}"
            )
        X_GW = self._pose.eval(context).inverse()
        solids = Obstacles(in_world.solids)
        return place_obstacles(solids, X_GW.rotation().matrix(), X_GW.translation())

    def _calc_tip_goals(self, context: Context, output: AbstractValue) -> None:
        p_GT: FloatArray = context.get_discrete_state(self._tips).value().reshape(-1, 3)
        X_WG, V_WG = self._pose.eval(context), validated_velocity(self._V_WG.Eval(context))
        R_WG = rotation_matrix(V_WG.rotational() * self._lead) @ X_WG.rotation().matrix()
        p_WT = p_GT @ R_WG.T + X_WG.translation() + V_WG.translational() * self._lead
        goals = BusValue()
        for name, point in zip(self._tip_frames, p_WT, strict=True):
            goals.Set(name, AbstractValue.Make(RigidTransform(point)))
        output.set_value(goals)
