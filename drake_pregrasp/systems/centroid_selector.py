"""The second stage of the planner: each contact's goal inside its safe region."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import (
    BasicVector,
    BusValue,
    Context,
    DiscreteValues,
    LeafSystem,
    ValueProducer,
)

from drake_pregrasp.arrays import FloatArray, validated_covariance
from drake_pregrasp.contacts.centroids import select_contacts, verify_contacts
from drake_pregrasp.contacts.goal_limits import ContactLimits, hold_contacts
from drake_pregrasp.contacts.selection_input import ContactGoals, ContactStatus, SelectionInput
from drake_pregrasp.contacts.strategies import BLEND, make_blend, make_strategy
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.geometry.surface import CONTACT_TOLERANCE, ObjectSurface
from drake_pregrasp.quality.force_closure import FRICTION
from drake_pregrasp.regions.constraints import NO_CAUSE
from drake_pregrasp.regions.safe_regions import SafeRegions
from drake_pregrasp.systems.pose_ports import LastPose
from drake_pregrasp.ticks import SLACK, tick_is_due


class CentroidSelector(LeafSystem):
    """Moves each contact goal inside its safe region (Eq. 3-7). It remembers the goals.

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

    Port `X_WO_estimated` accepts a `RigidTransform`: where the object O is believed to be in W. One
    that isn't finite, or whose rotation is none, stands for an object that is lost where it was.

    Port `p_WO_covariance` accepts a vector of 9: the estimate's covariance in W, row-major, in m².
    It is left out of Eq. 3 if it isn't finite.

    Port `safe_regions` accepts the `SafeRegions` of the contacts at `p_WC_previous`.

    Port `hold_contacts` (optional) accepts a number: above 0, goals stay where they are on the
    object, and active or not, as while a hand closes on them. A finger that is lost meanwhile
    isn't reported before contacts are let go. NaN holds them, too.

    Port `tracking_status` (optional) accepts a `TrackingStatus`; what is none counts as `LOST`. As
    long as the estimate isn't to be followed, goals are held as by `hold_contacts`, and
    `fingertip_targets` are off the surface. Unconnected, the object is always tracked.

    Port `p_WC` emits a vector of 3n: the contact goals in W, one after another, in metres. At a
    tick they are that tick's new goals, before and after the discrete update that stores them;
    between ticks they are carried with the object's estimated pose.

    Port `contact_status` emits a vector of n `ContactStatus` values, for the goals of `p_WC`.

    Port `contact_causes` emits a vector of n: the index of the contact or obstacle behind a status
    that has one, else -1.

    Port `fingertip_targets` emits a `BusValue` that maps each name of `fingertip_frames` to a
    `RigidTransform` in W: its origin is the contact goal, its z axis the inward normal of the
    surface there, its x axis lies as near to the object's z axis as that allows. Lost contacts are
    left out. While the object isn't tracked, origins are `lost_standoff` off the surface, so that a
    hand backs off what it no longer sees. With scoped names of a robot's frames,
    `model_instance::frame`, it fits the port `desired_cartesian_poses` of Drake's
    `DifferentialInverseKinematicsSystem`.

    Port `p_WC_previous` emits a vector of 3n: the stored goals, carried with the estimated pose. It
    does not depend on `safe_regions`, so it closes the loop to `SafeRegionPartitioner`.

    The state holds the goals in O, so that what is held moves rigidly with the object.

    Args:
        surface: The object's surface.
        p_OC: Initial contact points on the object's surface, in O, shape (n, 3), in metres, n >= 1.
        period: Seconds between ticks, greater than zero.
        strategy: `position` tracking (Eq. 3), a measure, `msv`, `gii` or `vew` (Eq. 5-7), the
            force-closure `margin`, or a `blend` of them.
        reading: Of the partial grasp matrix, for a measure: `contact` or `hand`.
        stretch: Whether to stretch a measure's weights over each region.
        power: Exponent of a measure's weights.
        friction: Coulomb's coefficient, for the margin.
        blend: The weight of each strategy by its name, for `blend`; what is missing is zero.
        best_point: Whether to move to the candidate of the largest weight, not to the centroid.
        in_turns: Whether contacts move one after another, each seeing where those before it went,
            not all as if the others stayed.
        position_spread: Standard deviation in metres, added to the estimate's covariance in Eq. 3:
            the filter's own is of millimetres, and would pick the candidate nearest to the centre.
        static_duration: Seconds for which the initial contacts are held on the object.
        lost_standoff: How far off the surface, along the outward normals, targets are while the
            object isn't tracked, in metres.
        limits: What holds goals back.
        verify_contacts: Whether to check each active goal against the mesh, and raise a
            `ContactError` if it isn't on its surface. It takes time: a switch for finding faults.
        fingertip_frames: Names for `fingertip_targets`; by default `fingertip_0` and so on.

    Raises:
        InvalidArgumentError: If an argument is out of its range.
    """

    def __init__(
        self,
        *,
        surface: ObjectSurface,
        p_OC: FloatArray,
        period: float,
        strategy: str = "position",
        reading: str = "hand",
        stretch: bool = True,
        power: float = 1.0,
        friction: float = FRICTION,
        blend: Mapping[str, float] | None = None,
        best_point: bool = False,
        in_turns: bool = False,
        position_spread: float = 0.04,
        static_duration: float = 0.0,
        lost_standoff: float = 0.02,
        limits: ContactLimits | None = None,
        verify_contacts: bool = False,
        fingertip_frames: Sequence[str] | None = None,
    ) -> None:
        super().__init__()
        p_OC = np.array(p_OC, dtype=float)
        if p_OC.ndim != 2 or p_OC.shape[1] != 3 or len(p_OC) == 0:
            raise InvalidArgumentError(f"p_OC must have shape (n, 3), n >= 1, not {p_OC.shape}")
        if not period > 0:
            raise InvalidArgumentError(f"period must be greater than 0 s, not {period}")
        if not position_spread > 0:
            raise InvalidArgumentError(
                f"position_spread must be greater than 0 m, not {position_spread}"
            )
        if not static_duration >= 0:
            raise InvalidArgumentError(
                f"static_duration must be at least 0 s, not {static_duration}"
            )
        if not 0 <= lost_standoff < np.inf:
            raise InvalidArgumentError(
                f"lost_standoff must be at least 0 m and finite, not {lost_standoff}"
            )
        off = np.flatnonzero(~(np.abs(surface.distance(p_OC)) <= CONTACT_TOLERANCE))
        if len(off):
            raise InvalidArgumentError(
                f"contact {off[0]} at {p_OC[off[0]]} m is farther than {CONTACT_TOLERANCE} m off"
                " the object's surface"
            )
        n = len(p_OC)
        if fingertip_frames is None:
            fingertip_frames = [f"fingertip_{i}" for i in range(n)]
        if len(fingertip_frames) != n:
            raise InvalidArgumentError(f"{n} contacts need {n} fingertip frames")
        self._surface = surface
        self._period = period
        if strategy == BLEND:
            self._strategy = make_blend(
                blend or {}, reading=reading, stretch=stretch, power=power, friction=friction
            )
        else:
            self._strategy = make_strategy(
                strategy, reading=reading, stretch=stretch, power=power, friction=friction
            )
        self._best_point = best_point
        self._in_turns = in_turns
        self._spread = position_spread
        self._static_duration = static_duration
        self._lost_standoff = lost_standoff
        self._fingertip_frames = list(fingertip_frames)
        self._limits = limits or ContactLimits()
        self._verify_contacts = verify_contacts

        self._time_index = self.DeclareDiscreteState(np.array([-np.inf]))
        self._p_OC_index = self.DeclareDiscreteState(p_OC.ravel())
        self._status_index = self.DeclareDiscreteState(np.full(n, float(ContactStatus.INACTIVE)))
        self._causes_index = self.DeclareDiscreteState(np.full(n, float(NO_CAUSE)))
        self._X_WO_estimated = self.DeclareAbstractInputPort(
            "X_WO_estimated", AbstractValue.Make(RigidTransform())
        )
        self._p_WO_covariance = self.DeclareVectorInputPort("p_WO_covariance", 9)
        self._safe_regions = self.DeclareAbstractInputPort(
            "safe_regions", AbstractValue.Make(object())
        )
        self._hold = self.DeclareVectorInputPort("hold_contacts", 1)
        self._tracking_status = self.DeclareVectorInputPort("tracking_status", 1)
        self._pose = LastPose(self, self._X_WO_estimated)
        self._goals = self.DeclareCacheEntry(
            "contact goals at the Context's time",
            ValueProducer(
                lambda: AbstractValue.Make(ContactGoals(p_OC, np.zeros(n), np.zeros(n))),
                self._calc_goals,
            ),
            {self.time_ticket(), self.xd_ticket(), self.all_input_ports_ticket()},
        )
        posed_goals = {self._goals.ticket(), *self._pose.tickets}
        self.DeclareVectorOutputPort("p_WC", 3 * n, self._calc_p_WC, posed_goals)
        self.DeclareVectorOutputPort("contact_status", n, self._calc_status, {self._goals.ticket()})
        self.DeclareAbstractOutputPort(
            "fingertip_targets",
            lambda: AbstractValue.Make(BusValue()),
            self._calc_fingertip_targets,
            posed_goals | {self._tracking_status.ticket()},
        )
        self.DeclareVectorOutputPort(
            "p_WC_previous",
            3 * n,
            self._calc_p_WC_previous,
            {self.discrete_state_ticket(self._p_OC_index), *self._pose.tickets},
        )
        self.DeclareVectorOutputPort("contact_causes", n, self._calc_causes, {self._goals.ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._store_goals)

    def _stored_p_OC(self, context: Context) -> FloatArray:
        p_OC: FloatArray = context.get_discrete_state(self._p_OC_index).value().reshape(-1, 3)
        return p_OC

    def _calc_goals(self, context: Context, output: AbstractValue) -> None:
        time = context.get_time()
        stored_time = context.get_discrete_state(self._time_index)[0]
        p_OC = self._stored_p_OC(context)
        # NaN isn't at most 0.
        held = self._hold.HasValue(context) and not self._hold.Eval(context)[0] <= 0
        held = held or not self._is_tracked(context)
        if held or not tick_is_due(time, stored_time, self._period):
            status = context.get_discrete_state(self._status_index).value()
            causes = context.get_discrete_state(self._causes_index).value()
            output.set_value(ContactGoals(p_OC, status, causes))
            return
        R_WO: FloatArray = self._X_WO_estimated.Eval(context).rotation().matrix()
        covariance_W: FloatArray = self._p_WO_covariance.Eval(context).reshape(3, 3)
        selection = SelectionInput(
            surface=self._surface,
            p_OC=p_OC,
            regions=self._regions(context),
            covariance_O=validated_covariance(covariance_W, R_WO, self._spread),
        )
        if time < self._static_duration - SLACK * self._period:
            goals = hold_contacts(selection)
        else:
            goals = select_contacts(
                selection,
                self._strategy,
                best_point=self._best_point,
                in_turns=self._in_turns,
                limits=self._limits,
            )
        if self._verify_contacts:
            verify_contacts(self._surface, goals)
        output.set_value(goals)

    def _is_tracked(self, context: Context) -> bool:
        if self._tracking_status.HasValue(context):
            status = TrackingStatus(self._tracking_status.Eval(context)[0])
            if not status.is_followed:
                return False
        return self._pose.is_valid(context)

    def _regions(self, context: Context) -> SafeRegions:
        regions = self._safe_regions.Eval(context)
        if not isinstance(regions, SafeRegions):
            raise InvalidArgumentError(
                f"port safe_regions of {self.get_name()} accepts SafeRegions,"
                f" not a {type(regions).__name__}"
            )
        return regions

    def _store_goals(self, context: Context, discrete_state: DiscreteValues) -> None:
        goals: ContactGoals = self._goals.Eval(context)
        discrete_state.set_value(self._time_index, [context.get_time()])
        discrete_state.set_value(self._p_OC_index, goals.p_OC.ravel())
        discrete_state.set_value(self._status_index, goals.status)
        discrete_state.set_value(self._causes_index, goals.causes)
        self._pose.store(context, discrete_state)

    def _in_world(self, context: Context, p_OC: FloatArray) -> FloatArray:
        X_WO = self._pose.eval(context)
        p_WC: FloatArray = (X_WO @ p_OC.T).T
        return p_WC

    def _calc_p_WC(self, context: Context, output: BasicVector) -> None:
        goals: ContactGoals = self._goals.Eval(context)
        output.SetFromVector(self._in_world(context, goals.p_OC).ravel())

    def _calc_p_WC_previous(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._in_world(context, self._stored_p_OC(context)).ravel())

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        goals: ContactGoals = self._goals.Eval(context)
        output.SetFromVector(goals.status)

    def _calc_causes(self, context: Context, output: BasicVector) -> None:
        goals: ContactGoals = self._goals.Eval(context)
        output.SetFromVector(goals.causes)

    def _calc_fingertip_targets(self, context: Context, output: AbstractValue) -> None:
        goals: ContactGoals = self._goals.Eval(context)
        X_WO = self._pose.eval(context)
        _, normals = self._surface.project(goals.p_OC)
        p_OF = goals.p_OC
        if not self._is_tracked(context):
            p_OF = p_OF + self._lost_standoff * normals
        targets = BusValue()
        for name, p_OFi, normal, status in zip(
            self._fingertip_frames, p_OF, normals, goals.status, strict=True
        ):
            if status == ContactStatus.LOST:
                continue
            X_OF = RigidTransform(_frame_with_z_along(-normal), p_OFi)
            targets.Set(name, AbstractValue.Make(X_WO @ X_OF))
        output.set_value(targets)


def _frame_with_z_along(z: FloatArray) -> RotationMatrix:
    # Only exactly along z of O there is no way nearest to it.
    up = np.eye(3)[2 if abs(z[2]) < 1 - 1e-9 else 0]
    x = up - z * (up @ z)
    x /= np.linalg.norm(x)
    return RotationMatrix(np.column_stack([x, np.cross(z, x), z]))
