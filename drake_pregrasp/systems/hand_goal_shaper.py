"""Goals of fingertips and palm that a hand can follow without collisions, from contact goals."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.validation import checked
from drake_pregrasp.contacts.assignment import FREE_TURN
from drake_pregrasp.contacts.contact_pairs import Pair
from drake_pregrasp.contacts.selection_input import is_active
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.fast.kernels import HandKernels
from drake_pregrasp.geometry.rotations import angle_about_z, turn_about_z
from drake_pregrasp.geometry.solids import PlacedSolid, SignedDistance, Solid
from drake_pregrasp.grasping.fingertip_paths import (
    MOVING_CLEARANCE,
    Pace,
    TipPlaces,
    TipRoom,
    shape_goals,
)
from drake_pregrasp.grasping.hand_commands import GraspCommand
from drake_pregrasp.grasping.hand_goals import HandGoals, PalmAxis
from drake_pregrasp.regions.obstacles import ANYWHERE
from drake_pregrasp.systems import ports
from drake_pregrasp.systems.palm_frames import FROM_ABOVE, panned, reach_frame, turned_frame

GOAL_SHARE = 0.5
"""Share of `tip_acceleration` for the motion over the object, which may itself accelerate."""


class HandGoalShaper(LeafSystem):
    """Turns contact goals into goals of fingertips and palm that move with the object.

    .. pydrake_system::

        name: HandGoalShaper
        input_ports:
        - fingertip_targets
        - contact_status
        - command
        - obstacles
        output_ports:
        - goals
        - contacts
        - p_GT
        - X_WH
        - X_WU

    Port `fingertip_targets` accepts a `BusValue` as `CentroidSelector` emits it: for each name in
    `tip_frames` the pose of a contact goal in W, with its z axis along the inward normal. A finger
    whose entry is missing or invalid keeps its contact.

    Port `contact_status` accepts a vector of n `ContactStatus` values.

    Port `command` accepts a `GraspCommand`, as `GraspSequencer` emits it. Goals are planned in its
    frame G, and keep its standoffs. Contacts are not updated while it holds them, or while the
    object is not tracked, because `fingertip_targets` are then off the surface.

    Port `obstacles` (optional) accepts `Obstacles` in W. Fingertips avoid its solids, unless they
    hold their contacts. While an obstacle has numbers that are not finite, fingertips stay where
    they are in G.

    Port `goals` emits `HandGoals`: those of the fingertips `lead` after the Context's time, and
    those of the palm at this time. The palm is over the centre of mass in G. It turns to the yaw of
    `palm_turn`, which brings its fingers nearest to their goals, continuously and within its
    range, but turns only with G while it is off by no more than `yaw_slack`.

    Port `contacts` emits a vector of 7n: the contacts that the fingertips go to, in O, in metres,
    one after another, then the outward unit normals there, then for each finger 1 if it is active
    and else 0, as of the last tick. For jaws that are active, these are not the normals but unit
    vectors along the line between the contacts, outward. Where a fingertip has no room, for example
    close to the table, its contact is shifted across these vectors.

    Port `p_GT` emits a vector of 3n: the goals in G, as of the last tick, in metres.

    Port `X_WH` emits a `RigidTransform`: the frame H of the fingers' reach in W. At yaw 0 it is the
    frame A of the approach; from above, its origin is the centre of mass and its z axis is up. H
    turns with a palm that turns without limits; for a palm of limited range its yaw is the middle
    of that range, from which the palm can turn either way while the fingers close.

    Port `X_WU` emits a `RigidTransform`: the frame U of the palm in W, as of the last tick. It
    is as H, but always turns with the palm.

    Goals move over the object with at most `goal_speed` and half of `tip_acceleration`, so they do
    not jump when contacts do, unless an obstacle or another fingertip pushes them away. They are
    clear of the object and of everything else by the tip radius and a clearance, and go the shorter
    way around the object, or over it if that way is blocked. Fingers without an active contact wait
    above the object, at their own azimuths in U.

    Args:
        config: Configuration of the grasp; `period`, `goal_speed`, `tip_acceleration` and
            `standoff` are used.
        tip_frames: Scoped names of the fingertips' frames.
        tip_radius: Radius of the fingertips, or of each, shape (n,), in metres.
        object_solid: The object in O.
        fixed: Solids in W that fingertips avoid, such as the table.
        p_GT: Initial positions of the fingertips' centres in G, shape (n, 3), in metres.
        finger_azimuths: Azimuths of the fingers about z of U, shape (n,), in radians.
        withdrawn_radii: Distance from z of A at which each finger without an active contact waits,
            shape (n,), in metres.
        target_period: Seconds between updates of the contacts: the planning period, between whose
            ticks contact goals do not change in O.
        yaw: Initial yaw of the palm, in radians.
        yaw_range: Smallest and largest angle of the palm, in radians.
        yaw_slack: The slack of `palm_turn`, by which the yaw may be off before the palm turns, in
            radians.
        lead: Seconds by which fingertip goals are ahead: the delay of the system that follows them.
        X_LA: Approach of the palm; see `HandModel`. Fingers go around z of A, and withdraw along
            it.
        p_OCoM: Centre of mass of the object in O, shape (3,), in metres; by default the origin.
        R_WO: Orientation of the object at which A is that of `X_LA`, shape (3, 3): A turns from
            there about the vertical with G. None: A does not turn.
        jaws: Pairs of fingers that move across z of A, to contacts opposite each other.
        kernels: Implementation of `straight_step` and `hand_goals`; that of `default_kernels` by
            default.

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
        withdrawn_radii: FloatArray,
        target_period: float,
        yaw: float = 0.0,
        yaw_range: tuple[float, float] = FREE_TURN,
        yaw_slack: float = 0.0,
        lead: float = 0.0,
        X_LA: RigidTransform = FROM_ABOVE,
        p_OCoM: FloatArray | None = None,
        R_WO: FloatArray | None = None,
        jaws: Sequence[Pair] = (),
        kernels: HandKernels | None = None,
    ) -> None:
        super().__init__()
        config = checked(config or GraspConfig())
        n = len(tip_frames)
        if np.shape(p_GT) != (n, 3):
            raise InvalidArgumentError(f"p_GT must have shape ({n}, 3), not {np.shape(p_GT)}")
        for name, value in (("target_period", target_period), ("tip_radius", np.min(tip_radius))):
            if not value > 0:
                raise InvalidArgumentError(f"{name} must be greater than 0, not {value}")
        if not yaw_slack >= 0:
            raise InvalidArgumentError(f"yaw_slack must be at least 0, not {yaw_slack}")
        self._tip_frames, self._lead = list(tip_frames), lead
        self._jaws, self._object = list(jaws), object_solid
        if isinstance(object_solid, Solid):  # Solids move in each tick, fastest as rows of numbers.
            self._object = PlacedSolid(object_solid.rounded_box())
        self._fixed = [PlacedSolid(solid.rounded_box()) for solid in fixed]
        self._radius: FloatArray = np.broadcast_to(np.asarray(tip_radius, dtype=float), n)
        x, y = np.cos(finger_azimuths), np.sin(finger_azimuths)
        self._places = TipPlaces(
            tip_radii=self._radius,
            directions=np.stack([x, y, np.zeros(n)], axis=1),
            withdrawn_radii=withdrawn_radii,
        )
        self._X_LA, X_AL = X_LA, X_LA.inverse()
        self._R_OW = R_WO if R_WO is None else R_WO.T
        self._axis = PalmAxis(
            R_AL=np.array(X_AL.rotation().matrix(), order="C"),
            p_AL=np.array(X_AL.translation()),
            p_OCoM=np.zeros(3) if p_OCoM is None else np.array(p_OCoM, dtype=float),
            finger_azimuths=np.array(finger_azimuths, dtype=float),
            yaw_range=yaw_range,
            yaw_slack=yaw_slack,
        )
        acceleration = GOAL_SHARE * config.tip_acceleration
        self._pace = Pace(config.goal_speed, acceleration, config.period)
        self._kernels = kernels or default_kernels().hand()
        self._declare_state(np.array(p_GT, dtype=float), config.standoff, yaw)
        self._declare_ports()
        self.DeclarePeriodicDiscreteUpdateEvent(target_period, 0.0, self._sample_targets)
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._update)

    def _declare_state(self, p_GT: FloatArray, standoff: float, yaw: float) -> None:
        """Declares the state, which starts with goals of the fingertips and a yaw of the palm."""
        self._tips = self.DeclareDiscreteState(p_GT.ravel())
        self._rates = self.DeclareDiscreteState(p_GT.size)
        self._yaw = self.DeclareDiscreteState([yaw])
        self._pan = self.DeclareDiscreteState([0.0])
        # Before the first tick there are no contacts: fingertips stay, and no finger is active.
        frames = self._places.first_contacts(p_GT, standoff)
        contacts = np.concatenate([*frames, np.zeros(len(p_GT))], axis=None)
        self._targeted = self.DeclareDiscreteState(contacts)
        self._contacts = self.DeclareDiscreteState(contacts)

    def _declare_ports(self) -> None:
        self._targets = self.DeclareAbstractInputPort("fingertip_targets", ports.BUS)
        self._status = self.DeclareVectorInputPort("contact_status", len(self._radius))
        any_value = AbstractValue.Make(object())
        self._command = self.DeclareAbstractInputPort("command", any_value)
        self._obstacles = self.DeclareAbstractInputPort("obstacles", ports.OBSTACLES)
        sources = (self.xd_ticket(), self._command)
        self._goals = ports.declare_output(self, "goals", any_value, self._calc_goals, *sources)
        self.DeclareStateOutputPort("contacts", self._contacts)
        self.DeclareStateOutputPort("p_GT", self._tips)
        ports.declare_output(self, "X_WH", ports.POSE, self._calc_X_WH, *sources)
        ports.declare_output(self, "X_WU", ports.POSE, self._calc_X_WU, *sources)

    def _sample_targets(self, context: Context, discrete_state: DiscreteValues) -> None:
        """Stores the contact goals in O, and which fingers have one."""
        command: GraspCommand = self._command.Eval(context)
        if command.holds_contacts:
            return
        targeted: FloatArray = context.get_discrete_state(self._targeted).value().copy()
        p_OC, nhat = targeted[: 6 * len(self._radius)].reshape(2, -1, 3)
        targeted[6 * len(self._radius) :] = active = is_active(self._status.Eval(context))
        if command.is_tracked:
            port = f"fingertip_targets of {self.get_name()}"
            found = ports.validated_poses(self._targets.Eval(context), self._tip_frames, port)
            for finger, X_WC in enumerate(found):
                if X_WC is not None:
                    p_OC[finger] = command.R_WO.T @ (X_WC.translation() - command.p_WO)
                    nhat[finger] = -command.R_WO.T @ X_WC.rotation().matrix()[:, 2]
            goals: HandGoals = self._goals.Eval(context)
            z_A = self._approach(command, goals.pan)[0][2]
            for pair in self._jaws:
                both = [pair.first, pair.second]
                line = pair.line(nhat[pair.first], nhat[pair.second], z_A)
                if active[both].all() and line.any():
                    nhat[both] = -line, line
        discrete_state.set_value(self._targeted, targeted)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        """Moves the goals over the object, and shifts contacts where fingertips have no room."""
        goals: HandGoals = self._goals.Eval(context)
        discrete_state.set_value(self._yaw, [goals.yaw])
        discrete_state.set_value(self._pan, [goals.pan])
        command: GraspCommand = self._command.Eval(context)
        held, n = command.holds_contacts, len(self._radius)
        stored = context.get_discrete_state(self._contacts if held else self._targeted).value()
        p_OC, nhat = stored[: 6 * n].reshape(2, n, 3)
        active = stored[6 * n :] > 0
        p_GT, v_GT, _, _ = self._stored(context)
        R_GW, gaps = command.R_WG.T, command.standoffs
        p_GW = -R_GW @ command.p_WG
        obstacles = ports.eval_solids(self, self._obstacles, context, R_GW, p_GW)
        if ANYWHERE in obstacles:
            discrete_state.set_value(self._rates, np.zeros(p_GT.size))
            return
        goal = p_OC + (self._radius + gaps)[:, None] * nhat
        if not active.all():
            R_AG, p_AG = self._approach(command, goals.pan)
            top = self._object.highest(R_AG[2]) + p_AG[2]
            withdrawn = (self._places.withdrawn(goals.yaw, float(top)) - p_AG) @ R_AG
            goal = np.where(active[:, None], goal, withdrawn)
            gaps = np.where(active, gaps, MOVING_CLEARANCE)
        room = self._places.room(
            self._object,
            gaps,
            fixed=[solid.moved(R_GW, p_GW) for solid in self._fixed],
            obstacles=obstacles,
            holding=held & active & command.fingers_hold,
        )
        moved, contacts = self._kernels.straight_step(p_GT, v_GT, goal, self._pace, room), stored
        is_straight = moved is not None
        if moved is None:
            moved, shift = self._detour(
                p_GT, v_GT, goal, room, command, active[:, None] * nhat, goals.pan
            )
            contacts = np.concatenate([p_OC + shift, nhat, active], axis=None)
        if not held:
            discrete_state.set_value(self._contacts, contacts)
        if moved is p_GT:
            return
        rates = (moved - p_GT) / self._pace.period
        if not is_straight:  # Solids or other tips may have pushed it.
            rates = self._pace.limited(rates, v_GT)
        discrete_state.set_value(self._tips, moved.ravel())
        discrete_state.set_value(self._rates, rates.ravel())

    def _detour(
        self,
        p_GT: FloatArray,
        v_GT: FloatArray,
        goal: FloatArray,
        room: TipRoom,
        command: GraspCommand,
        nhat: FloatArray,
        pan: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Returns the next goals, and shifts of contacts along the surface, in G, shape (n, 3).

        If the fingertips rest at their goals, the same array of goals is returned.

        Args:
            p_GT: Present goals of the fingertips in G, shape (n, 3), in metres.
            v_GT: Their velocities in G, shape (n, 3), in m/s.
            goal: Places in G that they go to, shape (n, 3), in metres.
            room: Free space of the fingertips in G.
            command: Command of the grasp's phase; contacts that it holds are not shifted.
            nhat: Outward unit normals at the contacts in G, zeros where a finger has none, shape
                (n, 3).
            pan: Angle by which A has turned about the vertical, in radians.
        """
        # Paths are planned in the frame A of the approach, in which the palm's axis is z.
        R_AG, p_AG = self._approach(command, pan)
        goal, held = goal @ R_AG.T + p_AG, command.holds_contacts
        room, shift = room.moved(R_AG, p_AG).with_room_at(goal), np.zeros(nhat.shape)
        p_AT, v_AT = p_GT @ R_AG.T + p_AG, v_GT @ R_AG.T
        has_arrived = self._pace.has_arrived(goal - p_AT, v_AT)
        permitted = goal if held and not has_arrived else room.permitted(goal)
        if has_arrived and permitted is goal:
            return p_GT, shift
        if not held and permitted is not goal:
            shift = np.where(nhat.any(axis=1, keepdims=True), (permitted - goal) @ R_AG, 0)
            shift -= np.sum(shift * nhat, axis=1, keepdims=True) * nhat
            goal = goal + shift @ R_AG.T
        return (shape_goals(p_AT, v_AT, goal, self._pace, room) - p_AG) @ R_AG, shift

    def _approach(self, command: GraspCommand, pan: float) -> tuple[FloatArray, FloatArray]:
        """Returns orientation and position of G in the frame A of the approach."""
        R_AL = self._axis.R_AL if self._R_OW is None else self._axis.R_AL @ turn_about_z(pan).T
        R_AG = R_AL @ command.R_WG
        return R_AG, self._axis.p_AL - R_AG @ self._axis.p_OCoM

    def _stored(self, context: Context) -> tuple[FloatArray, FloatArray, float, float]:
        """Returns the goals in G, their velocities there, each (n, 3), and the yaw and the pan."""
        p_GT, v_GT, yaw, pan = (
            context.get_discrete_state(index).value().copy()
            for index in (self._tips, self._rates, self._yaw, self._pan)
        )
        return p_GT.reshape(-1, 3), v_GT.reshape(-1, 3), float(yaw[0]), float(pan[0])

    def _calc_goals(self, context: Context) -> HandGoals:
        command: GraspCommand = self._command.Eval(context)
        p_GT, v_GT, yaw, pan = self._stored(context)
        axis = self._axis
        if self._R_OW is not None:
            heading = angle_about_z(command.R_WG @ self._R_OW)
            pan += math.remainder(heading - pan, 2 * math.pi)
            axis = replace(axis, R_AL=axis.R_AL @ turn_about_z(pan).T)
        yaw += self._pace.period * float(axis.R_AL[2] @ command.V_WG[0])
        goals = self._kernels.hand_goals(axis, command, p_GT, v_GT, yaw, self._lead)
        chosen = self._contacts if command.holds_contacts else self._targeted
        active = context.get_discrete_state(chosen).value()[6 * len(self._radius) :] > 0
        pan_rate = 0.0 if self._R_OW is None else float(command.V_WG[0, 2])
        return replace(goals, active=active, pan=pan, pan_rate=pan_rate)

    def _palm(self, context: Context) -> tuple[FloatArray, float, RigidTransform]:
        """Returns the object's centre of mass in W, and the last tick's yaw and approach X_LA."""
        command: GraspCommand = self._command.Eval(context)
        _, _, yaw, pan = self._stored(context)
        X_LA = panned(self._X_LA, pan)
        return command.p_WO + command.R_WO @ self._axis.p_OCoM, yaw, X_LA

    def _calc_X_WH(self, context: Context) -> RigidTransform:
        p_WCoM, yaw, X_LA = self._palm(context)
        return reach_frame(p_WCoM, yaw, self._axis.yaw_range, X_LA)

    def _calc_X_WU(self, context: Context) -> RigidTransform:
        p_WCoM, yaw, X_LA = self._palm(context)
        return turned_frame(p_WCoM, X_LA, yaw)
