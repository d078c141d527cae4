"""Second stage of the planner: each contact's goal inside its safe region."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BusValue, Context, DiscreteValues, LeafSystem

from drake_pregrasp.arrays import SLACK, FloatArray, norms, tick_index, validated_covariance
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.config.validation import checked
from drake_pregrasp.contacts.centroids import select_contacts, verify_contacts
from drake_pregrasp.contacts.goal_limits import hold_contacts
from drake_pregrasp.contacts.reassignment import reassigned_goals, surface_symmetries
from drake_pregrasp.contacts.selection_input import (
    ContactGoals,
    ContactStatus,
    GoalFunction,
    SelectionInput,
    WeightFunction,
)
from drake_pregrasp.contacts.strategies import BLEND, make_blend, make_strategy
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.fast.kernels import Kernels
from drake_pregrasp.geometry.rotations import skew
from drake_pregrasp.geometry.surface import CONTACT_TOLERANCE, ObjectSurface
from drake_pregrasp.regions.constraints import NO_CAUSE
from drake_pregrasp.regions.safe_regions import SafeRegions
from drake_pregrasp.systems import ports


class CentroidSelector(LeafSystem):
    """Moves each contact goal inside its safe region, and stores the goals.

    .. pydrake_system::

        name: CentroidSelector
        input_ports:
        - X_WO_estimated
        - p_WO_covariance
        - safe_regions
        - hold_contacts
        - tracking_status
        output_ports:
        - p_WC
        - contact_status
        - fingertip_targets
        - p_WC_previous
        - contact_causes

    Port `X_WO_estimated` accepts a `RigidTransform`: the estimated pose of the object O in W. If it
    is invalid, the object is treated as lost at its last valid pose.

    Port `p_WO_covariance` accepts a vector of 9: the covariance of the estimated position in W,
    row-major, in m². If it is not finite, `position_spread` alone is used. A matrix that is not a
    covariance is replaced by the nearest one.

    Port `safe_regions` accepts the `SafeRegions` of the contacts at `p_WC_previous`.

    Port `hold_contacts` (optional) accepts a vector of 1: if it is above 0 or NaN, all goals stay
    where they are on the object and keep their status, for example while a hand closes on them. If
    a finger is lost meanwhile, its status changes once the goals are released.

    Port `tracking_status` (optional) accepts a vector of 1: a `TrackingStatus`; any other number
    counts as `LOST`. While goals must not follow the estimate, they are held as by `hold_contacts`,
    and `fingertip_targets` are off the surface. If the port is unconnected, the object is tracked.

    Port `p_WC` emits a vector of 3n: the contact goals in W, one after another, in metres. Between
    ticks they move with the object's estimated pose.

    Port `contact_status` emits a vector of n: a `ContactStatus` for each goal of `p_WC`.

    Port `fingertip_targets` emits a `BusValue` with a `RigidTransform` in W for each name in
    `fingertip_frames`. The origin is the contact goal, the z axis is the inward normal of the
    surface, and the x axis is as close as possible to the object's z axis. Lost contacts have no
    entry. While the object is not tracked, the origins are `lost_standoff` off the surface, so that
    a hand backs off from an object that it cannot see. With scoped names of a robot's frames,
    `model_instance::frame`, the bus fits the port `desired_cartesian_poses` of Drake's
    `DifferentialInverseKinematicsSystem`.

    Port `p_WC_previous` emits a vector of 3n: the stored goals, moved with the estimated pose. It
    does not depend on `safe_regions`, so it can close the loop to `SafeRegionPartitioner`.

    Port `contact_causes` emits a vector of n: the index of the contact or obstacle that causes the
    status, or -1.

    With `limits.reassign`, fingers change contacts at the end of a tick, also while the initial
    contacts are held: goals of the same contacts then jump to other fingers, and limits on the
    speed of goals do not apply to the jump. Until the update, `safe_regions` are those before it. A
    contact that comes into reach by the change is active from the next tick on.

    The state holds the goals in O. At a tick, all outputs except `p_WC_previous` are those of the
    tick's new goals, both before and after the discrete update that stores them. Before the update,
    `p_WC_previous` emits the goals of the tick before.

    Args:
        config: Configuration of the planner; `PlannerConfig()` by default. Fields that concern only
            the estimator or the regions are not used.
        surface: The object's surface.
        p_OC: Initial contact points on the surface, in O, shape (n, 3), in metres, n >= 1.
        fingertip_frames: Names of the n entries of `fingertip_targets`; by default `fingertip_0`
            and so on.
        weight_function: A strategy of your own, in place of `config.strategy`: maps a
            `SelectionInput` and the index i of a contact to log(b_n) of the candidates in its safe
            region, shape (k,).
        kernels: Implementation of what takes most of a tick; that of `default_kernels` by default.

    Raises:
        InvalidArgumentError: If an argument or a field of `config` is out of its range.
        ContactError: While running with `verify_contacts`, if a goal is off the allowed surface.
    """

    def __init__(
        self,
        config: PlannerConfig | None = None,
        *,
        surface: ObjectSurface,
        p_OC: FloatArray,
        fingertip_frames: Sequence[str] | None = None,
        weight_function: WeightFunction | None = None,
        kernels: Kernels | None = None,
    ) -> None:
        super().__init__()
        config, kernels = checked(config or PlannerConfig()), kernels or default_kernels()
        p_OC = _checked_contacts(p_OC, surface)
        n = len(p_OC)
        self._fingertip_frames = list(fingertip_frames or [f"fingertip_{i}" for i in range(n)])
        if len(self._fingertip_frames) != n:
            raise InvalidArgumentError(f"{n} contacts need {n} fingertip frames")
        names = ("reading", "contact_model", "length", "stretch", "power", "friction")
        options = {name: getattr(config, name) for name in names}
        self._region_goals: GoalFunction | None = None
        if weight_function is None:
            weights = {config.strategy: 1.0}
            if config.strategy == BLEND:
                weights = asdict(config.blend)
                weight_function = make_blend(weights, **options)
            else:
                weight_function = make_strategy(config.strategy, **options)
            if kernels.goals is not None:
                best = config.best_point
                self._region_goals = kernels.goals(surface, weights, **options, best_point=best)
        self._strategy = weight_function
        self._config, self._surface = config, kernels.surface(surface)
        self._limits_at = kernels.limits_at
        own, implementations = config.limits, dict[str, Any]()  # Compiled only if they are needed.
        if own.independent_radius > 0:
            implementations["slip_radii"] = kernels.slip_radii()
        if "margin" in own.guard:
            implementations["solve"] = kernels.largest_minimum()
        self._limits = own.make_limits(config.period, config.friction, **implementations)

        self._rule = config.limits.reassign
        self._rule.check(config.limits.reaches(), bool(config.limits.pairs))
        self._symmetries = np.eye(3)[None]
        if self._rule.beyond > 0 and self._rule.symmetric:
            self._symmetries = surface_symmetries(surface)

        self._declare_ports(p_OC)

    def _declare_ports(self, p_OC: FloatArray) -> None:
        """Declares the state, which starts with contacts in O, shape (n, 3), and all ports."""
        n, config = len(p_OC), self._config
        self._time_index = self.DeclareDiscreteState(np.array([-np.inf]))
        self._p_OC_index = self.DeclareDiscreteState(p_OC.ravel())
        self._status_index = self.DeclareDiscreteState(np.full(n, float(ContactStatus.INACTIVE)))
        self._causes_index = self.DeclareDiscreteState(np.full(n, float(NO_CAUSE)))
        X_WO = self.DeclareAbstractInputPort("X_WO_estimated", ports.POSE)
        self._p_WO_covariance = self.DeclareVectorInputPort("p_WO_covariance", 9)
        self._safe_regions = self.DeclareAbstractInputPort("safe_regions", ports.REGIONS)
        self._hold = self.DeclareVectorInputPort("hold_contacts", 1)
        tracking_status = self.DeclareVectorInputPort("tracking_status", 1)
        self._pose = ports.LastPose(self, X_WO, tracking_status)
        self._reassigned_index = self.DeclareDiscreteState(np.array([-np.inf]))
        self._goals = goals = ports.declare_cache(
            self,
            "contact goals at the Context's time",
            ContactGoals(p_OC, np.zeros(n), np.zeros(n)),
            self._calc_goals,
            self.time_ticket(),
            self.xd_ticket(),
            self.all_input_ports_ticket(),
        )
        pose, stored = self._pose.source, self.discrete_state_ticket(self._p_OC_index)
        ports.declare_output(self, "p_WC", 3 * n, self._calc_p_WC, goals, pose)
        ports.declare_output(self, "contact_status", n, lambda c: goals.Eval(c).status, goals)
        targets = self._calc_fingertip_targets
        ports.declare_output(self, "fingertip_targets", ports.BUS, targets, goals, pose)
        ports.declare_output(self, "p_WC_previous", 3 * n, self._calc_p_WC_previous, stored, pose)
        ports.declare_output(self, "contact_causes", n, lambda c: goals.Eval(c).causes, goals)
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._store_goals)

    def _calc_goals(self, context: Context) -> ContactGoals:
        config, time = self._config, context.get_time()
        stored_time = context.get_discrete_state(self._time_index)[0]
        p_OC = context.get_discrete_state(self._p_OC_index).value().reshape(-1, 3)
        is_due = tick_index(time, config.period) != tick_index(stored_time, config.period)
        # NaN is not <= 0 either, so it holds the contacts.
        is_held = self._hold.HasValue(context) and not self._hold.Eval(context)[0] <= 0
        _, R_WO, _, is_tracked = self._pose.eval(context)
        if not (is_due and is_tracked) or is_held:
            status = context.get_discrete_state(self._status_index).value()
            causes = context.get_discrete_state(self._causes_index).value()
            return ContactGoals(p_OC, status, causes)
        regions = self._safe_regions.Eval(context)
        if not isinstance(regions, SafeRegions):
            raise InvalidArgumentError(
                f"port safe_regions of {self.get_name()} accepts SafeRegions,"
                f" not a {type(regions).__name__}"
            )
        n, N = len(p_OC), len(self._surface.p_OQ)
        if (given := (len(regions.lost), len(regions.labels))) != (n, N):
            raise InvalidArgumentError(
                f"port safe_regions of {self.get_name()} accepts regions of {n} contacts"
                f" over {N} candidates, not of {given[0]} over {given[1]}"
            )
        covariance_W: FloatArray = self._p_WO_covariance.Eval(context).reshape(3, 3)
        selection = SelectionInput(
            surface=self._surface,
            p_OC=p_OC,
            regions=regions,
            covariance_O=validated_covariance(covariance_W, R_WO, config.position_spread),
            limits_at=self._limits_at,
        )
        if time < config.static_duration - SLACK * config.period:
            goals = hold_contacts(selection)
        else:
            goals = select_contacts(
                selection,
                self._strategy,
                best_point=config.best_point,
                in_turns=config.in_turns,
                limits=self._limits,
                choose=self._region_goals,
            )
        since = time - context.get_discrete_state(self._reassigned_index)[0]
        if self._rule.beyond > 0 and since >= self._rule.every - SLACK * config.period:
            goals = reassigned_goals(selection, goals, self._rule, self._symmetries)
        if config.verify_contacts:
            verify_contacts(self._surface, goals)
        return goals

    def _store_goals(self, context: Context, discrete_state: DiscreteValues) -> None:
        goals: ContactGoals = self._goals.Eval(context)
        discrete_state.set_value(self._time_index, [context.get_time()])
        discrete_state.set_value(self._p_OC_index, goals.p_OC.ravel())
        discrete_state.set_value(self._status_index, goals.status)
        discrete_state.set_value(self._causes_index, goals.causes)
        if goals.reassigned:
            discrete_state.set_value(self._reassigned_index, [context.get_time()])
        self._pose.store(context, discrete_state)

    def _calc_p_WC(self, context: Context) -> FloatArray:
        _, R_WO, p_WO, _ = self._pose.eval(context)
        return np.asarray(self._goals.Eval(context).p_OC @ R_WO.T + p_WO)

    def _calc_p_WC_previous(self, context: Context) -> FloatArray:
        p_OC = context.get_discrete_state(self._p_OC_index).value().reshape(-1, 3)
        _, R_WO, p_WO, _ = self._pose.eval(context)
        return np.asarray(p_OC @ R_WO.T + p_WO)

    def _calc_fingertip_targets(self, context: Context) -> BusValue:
        goals: ContactGoals = self._goals.Eval(context)
        X_WO, _, _, is_tracked = self._pose.eval(context)
        _, normals = self._surface.project(goals.p_OC)
        p_OF = goals.p_OC
        if not is_tracked:
            p_OF = p_OF + self._config.lost_standoff * normals
        have_goals = goals.status != float(ContactStatus.LOST)
        frames = _frames_with_z_along(-normals)
        goal_poses = zip(self._fingertip_frames, frames, p_OF, have_goals, strict=True)
        return ports.pose_bus(
            {
                name: X_WO @ RigidTransform(RotationMatrix(R), p)
                for name, R, p, has_goal in goal_poses
                if has_goal
            }
        )


def _frames_with_z_along(z: FloatArray) -> FloatArray:
    """Returns rotation matrices, shape (n, 3, 3), given their last columns, shape (n, 3)."""
    # Along z of O itself, no direction is the closest one, so x of O takes its place.
    up = np.eye(3)[np.where(np.abs(z[:, 2]) < 1 - 1e-9, 2, 0)]
    x = up - z * np.sum(up * z, axis=1, keepdims=True)
    x /= norms(x)[:, None]
    return np.stack([x, (skew(z) @ x[:, :, None])[:, :, 0], z], axis=2)


def _checked_contacts(contacts: FloatArray, surface: ObjectSurface) -> FloatArray:
    """Returns a copy of contacts in O, shape (n, 3); raises an error if one is off the surface."""
    p_OC = np.array(contacts, dtype=float)
    if p_OC.ndim != 2 or p_OC.shape[1] != 3 or len(p_OC) == 0:
        raise InvalidArgumentError(f"p_OC must have shape (n, 3), n >= 1, not {p_OC.shape}")
    off = np.flatnonzero(~(np.abs(surface.distance(p_OC)) <= CONTACT_TOLERANCE))
    if len(off):
        raise InvalidArgumentError(
            f"contact {off[0]} at {p_OC[off[0]]} m is farther than {CONTACT_TOLERANCE} m off"
            " the object's surface"
        )
    return p_OC
