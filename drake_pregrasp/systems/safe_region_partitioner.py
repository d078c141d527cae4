"""First stage of the planner: a safe region for each contact."""

from dataclasses import replace

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, InputPort, LeafSystem

from drake_pregrasp.arrays import (
    FARTHEST,
    BoolArray,
    FloatArray,
    are_valid_points,
    validated_weights,
)
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.config.validation import checked
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.fast.kernels import Kernels
from drake_pregrasp.geometry.rotations import rotation_matrix
from drake_pregrasp.geometry.sampling import lifted
from drake_pregrasp.geometry.solids import BallSolid
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.regions.constraints import Limit, Obstacles, RegionConstraints
from drake_pregrasp.regions.coordinates import GIVEN, QUANTITIES
from drake_pregrasp.regions.finger_measures import FINGER_MEASURES, FingerMeasures
from drake_pregrasp.regions.finger_reach import FingerReach
from drake_pregrasp.regions.obstacles import obstacles_at_times
from drake_pregrasp.regions.safe_regions import (
    NO_REGION,
    LabelCandidates,
    SafeRegions,
    compute_safe_regions,
)
from drake_pregrasp.regions.walls import SurfaceGraph, normals_agree
from drake_pregrasp.systems import ports

_Candidates = tuple[FloatArray, BoolArray | None, LabelCandidates | None]
"""Candidates with all their coordinates; mask of the further ones that are known, or None if none
is; and labels."""

_NOTHING = FingerReach(BallSolid(np.array([FARTHEST, 0.0, 0.0]), 0.0))
_MOMENTS = 4  # Number of times over the horizon, the present included, for which obstacles count.


class SafeRegionPartitioner(LeafSystem):
    """Divides the object's surface into the contacts' safe regions. It has no state.

    .. pydrake_system::

        name: SafeRegionPartitioner
        input_ports:
        - X_WO_estimated
        - p_WC
        - contact_weights
        - obstacles
        - X_WH
        - V_WO_estimated
        - finger_coordinates
        - candidate_coordinates
        - X_WU
        - late_fingers
        output_ports:
        - safe_regions

    Port `X_WO_estimated` accepts a `RigidTransform`: the estimated pose of the object O in W. If it
    is invalid, all regions are empty.

    Port `p_WC` accepts a vector of 3n: the contact points c_i in W, one after another, in metres. A
    contact whose point is not finite counts as one whose finger is lost.

    Port `contact_weights` (optional) accepts a vector of n: h_i in m². -inf or NaN means that the
    finger is lost. Finite weights are limited to `LARGEST_WEIGHT` in magnitude. If the port is
    unconnected, all weights are zero.

    Port `obstacles` (optional) accepts `Obstacles` in W. An obstacle whose numbers are no longer
    finite has an unknown place: all regions are then empty, and the contacts' status names it.

    Port `X_WH` (optional) accepts a `RigidTransform`: the pose in W of the hand frame H, in which
    the fingers' reach is given. If the port is unconnected, H is W. If the pose is invalid, fingers
    with a limited reach can reach nothing.

    `obstacles`, `X_WH` and `X_WU` must be for the same time as `X_WO_estimated`: if the estimate
    looks ahead, they must look ahead too.

    Port `V_WO_estimated` (optional) accepts a `SpatialVelocity`: the velocity of O in W, with which
    the object is predicted over the horizon. If the port is unconnected or the velocity is invalid,
    the object is assumed to stay.

    Port `finger_coordinates` (optional) accepts a vector of n k: the k further coordinates of each
    finger, one finger after another, in metres. One that is not finite is that of the candidate
    nearest to the contact. If the port is unconnected, they are those of `config.coordinates`.

    Port `candidate_coordinates` (optional) accepts a vector of N k: the k further coordinates of
    each candidate, one candidate after another, in metres. A coordinate that is not finite at every
    candidate is left out. If the port is unconnected, they are those of `config.coordinates`.

    Port `X_WU` (optional) accepts a `RigidTransform`: the pose in W of the palm's frame U, in which
    the fingers' measures are given. If the port is unconnected, U is H. If the pose is invalid,
    the fingers can reach nothing.

    Port `late_fingers` (optional) accepts a vector of n: above 0.5 for a finger that cannot be at
    its contact in time. It has no region, and its candidates belong to the others. If the port is
    unconnected, no finger is late.

    Port `safe_regions` emits `SafeRegions` over the surface's candidate points. With `p_WC`
    connected to `p_WC_previous` of `CentroidSelector`, the regions at a tick change with the
    discrete update of that tick, because the stored contacts do.

    Args:
        config: Configuration of the planner, of which `limits`, `wall_test`, `normal_length` and
            `coordinates` (their number is k) are used; `PlannerConfig()` by default.
        surface: The object's surface.
        num_contacts: Number of contacts n.
        finger_measures: Measures of the fingers in U, from `HomeFingers.measures`; None if
            neither a weight nor a limit needs them.
        kernels: Implementation of the labels; that of `default_kernels` by default.

    Raises:
        InvalidArgumentError: If a field of `config` is out of its range, a list in `limits` or of
            `fingers` has neither 0 nor n elements, a gap or standoff lacks `tip_radii`, or a weight
            or a limit lacks `finger_measures`.
    """

    def __init__(
        self,
        config: PlannerConfig | None = None,
        *,
        surface: ObjectSurface,
        num_contacts: int,
        finger_measures: FingerMeasures | None = None,
        kernels: Kernels | None = None,
    ) -> None:
        super().__init__()
        config, kernels = checked(config or PlannerConfig()), kernels or default_kernels()
        self._labels = kernels.labels
        limits = config.limits
        lists = {name: getattr(limits, name) for name in ("tip_radii", "reach", "forbidden_faces")}
        lists |= {f"coordinates[{j}].fingers": c.fingers for j, c in enumerate(config.coordinates)}
        for name, values in lists.items():
            if (count := len(values)) not in (0, num_contacts):
                raise InvalidArgumentError(f"{name} must be {num_contacts} or none, not {count}")
        if max(limits.tip_gap, limits.standoff) > 0 and not len(limits.tip_radii):
            raise InvalidArgumentError("a tip gap or a standoff needs tip_radii")
        if finger_measures is None and config.needs_finger_measures:
            raise InvalidArgumentError(f"{', '.join(FINGER_MEASURES)} need the fingers of a hand")
        self._limits, self._wall_test = limits, config.wall_test
        least = limits.least_measures()
        self._finger_measures = finger_measures and replace(finger_measures, least=least)
        self._tip_radii = np.array(limits.tip_radii, dtype=float)
        self._reach, self._closed = limits.reaches(), limits.closed()
        self._normal_length = config.normal_length
        self._points = surface.p_OQ
        if config.normal_length > 0:
            self._points = lifted(surface.p_OQ, surface.nhat_OQ, config.normal_length)
        N, k = len(surface.p_OQ), len(config.coordinates)
        self._fingers, own = np.full((num_contacts, k), np.nan), np.full((N, k), np.nan)
        for j, axis in enumerate(config.coordinates):
            if axis.fingers:
                self._fingers[:, j] = axis.scale * np.array(axis.fingers)
            if axis.candidates != GIVEN:
                own[:, j] = axis.scale * QUANTITIES[axis.candidates](surface)
        self._moments = np.linspace(0.0, limits.horizon, _MOMENTS if limits.horizon else 1)
        self._is_unlimited = (
            config.wall_test == "none"
            and finger_measures is None
            and not len(self._tip_radii)
            and not any(self._reach)
            and not any(self._closed)
        )
        self._unconstrained = RegionConstraints(num_contacts)
        self._graph = SurfaceGraph(surface) if config.wall_test == "surface" else None
        self._surface, self._num_contacts = kernels.surface(surface), num_contacts
        self._own = self._make_candidates(own)
        self._declare_ports()

    def _declare_ports(self) -> None:
        """Declares the ports, and the cache entry of the candidates."""
        (n, k), N = self._fingers.shape, len(self._points)
        self._X_WO_estimated = self.DeclareAbstractInputPort("X_WO_estimated", ports.POSE)
        self._p_WC = self.DeclareVectorInputPort("p_WC", 3 * n)
        self._contact_weights = self.DeclareVectorInputPort("contact_weights", n)
        self._obstacles = self.DeclareAbstractInputPort("obstacles", ports.OBSTACLES)
        self._X_WH = self.DeclareAbstractInputPort("X_WH", ports.POSE)
        self._V_WO = self.DeclareAbstractInputPort("V_WO_estimated", ports.VELOCITY)
        self._finger_values = self.DeclareVectorInputPort("finger_coordinates", n * k)
        values = self.DeclareVectorInputPort("candidate_coordinates", N * k)
        self._candidate_values = values
        self._candidates = ports.declare_cache(
            self, "candidates of Eq. 1", self._own, self._calc_candidates, values
        )
        self._X_WU = self.DeclareAbstractInputPort("X_WU", ports.POSE)
        self._late = self.DeclareVectorInputPort("late_fingers", n)
        model, inputs = AbstractValue.Make(self._no_regions()), self.all_input_ports_ticket()
        ports.declare_output(self, "safe_regions", model, self._calc_regions, inputs)

    def _no_regions(self) -> SafeRegions:
        labels = np.full(len(self._surface.p_OQ), NO_REGION)
        return SafeRegions.unlimited(labels, self._num_contacts)

    def _make_candidates(self, values: FloatArray) -> _Candidates:
        is_known: BoolArray = np.logical_and.reduce(np.abs(values) <= FARTHEST)
        points = np.hstack([self._points, values[:, is_known]])
        label = self._labels(points, self._surface.nhat_OQ)
        return points, is_known if is_known.any() else None, label

    def _calc_candidates(self, context: Context) -> _Candidates:
        if not self._candidate_values.HasValue(context):
            return self._own
        values = self._candidate_values.Eval(context)
        return self._make_candidates(values.reshape(len(self._points), -1))

    def _coordinates(
        self, context: Context, p_OC: FloatArray, points: FloatArray, is_known: BoolArray
    ) -> FloatArray:
        """Returns the further coordinates of the contacts that the candidates have, (n, k)."""
        fingers = self._fingers
        if self._finger_values.HasValue(context):
            fingers = self._finger_values.Eval(context).reshape(fingers.shape)
        fingers = fingers[:, is_known]
        at_contacts = points[self._surface.nearest_candidates(p_OC), -fingers.shape[1] :]
        return np.where(np.abs(fingers) <= FARTHEST, fingers, at_contacts)

    def _calc_regions(self, context: Context) -> SafeRegions:
        X_WO: RigidTransform = self._X_WO_estimated.Eval(context)
        if not ports.is_valid(X_WO):
            return self._no_regions()
        weights = np.zeros(self._num_contacts)
        if self._contact_weights.HasValue(context):
            weights = validated_weights(self._contact_weights.Eval(context))
        p_WC: FloatArray = self._p_WC.Eval(context).reshape(-1, 3)
        X_OW = X_WO.inverse()
        p_OC = (X_OW @ p_WC.T).T
        if not (valid := are_valid_points(p_OC)).all():
            p_OC[~valid], weights[~valid] = 0.0, -np.inf
        is_late = np.zeros(self._num_contacts, dtype=bool)
        if self._late.HasValue(context):
            is_late = (self._late.Eval(context) > 0.5) & (weights > -np.inf)
            weights[is_late] = -np.inf
        constraints = self._unconstrained
        if not self._is_unlimited or self._obstacles.HasValue(context):
            constraints = self._constraints(context, X_WO, X_OW, p_OC)
        c = p_OC
        if self._normal_length > 0:
            _, nhat_OC = self._surface.project(p_OC)
            c = lifted(p_OC, nhat_OC, self._normal_length)
        points, is_known, label = self._candidates.Eval(context)
        if is_known is not None:
            c = np.hstack([c, self._coordinates(context, p_OC, points, is_known)])
        forbidden = self._surface.forbidden
        regions = compute_safe_regions(points, c, weights, forbidden, constraints, label=label)
        if not is_late.any():
            return regions
        limits = np.where(is_late, int(Limit.LATE), regions.limits)
        return replace(regions, lost=regions.lost & ~is_late, limits=limits)

    def _constraints(
        self, context: Context, X_WO: RigidTransform, X_OW: RigidTransform, p_OC: FloatArray
    ) -> RegionConstraints:
        surface, same_side, active_forbidden_points = self._surface, None, None
        nhat_OC = np.empty((0, 3))
        if self._wall_test != "none" or len(self._tip_radii):
            _, nhat_OC = surface.project(p_OC)
        if self._wall_test != "none":
            active_forbidden_points = normals_agree(nhat_OC, surface.forbidden.normals)
            same_side = normals_agree(nhat_OC, surface.nhat_OQ)
            if self._graph is not None:  # Around a rim, the path to the other side is short.
                same_side &= self._graph.near_over_the_surface(p_OC, nhat_OC)
        later: list[Obstacles] = []
        obstacles = ports.eval_obstacles(self, self._obstacles, context)
        if obstacles.solids or len(obstacles.points):
            R_OW, p_OW = self._predicted_frames(context, X_WO)
            obstacles, *later = obstacles_at_times(obstacles, R_OW, p_OW, self._moments)
        reach, finger_measures = self._reach, self._finger_measures
        if (X_OH := self._hand_pose(self._X_WH, context, X_OW)) is None:
            reach, X_OH = [reach and _NOTHING for reach in self._reach], X_OW
        if finger_measures is not None:
            port = self._X_WU if self._X_WU.HasValue(context) else self._X_WH
            if (X_OU := self._hand_pose(port, context, X_OW)) is None:
                reach, X_OU = [_NOTHING] * self._num_contacts, X_OW
            R_OU, p_OU = X_OU.rotation().matrix(), X_OU.translation()
            finger_measures = replace(finger_measures, R_OU=R_OU, p_OU=p_OU)
        return RegionConstraints(
            self._num_contacts,
            obstacles=obstacles,
            later=later,
            clearance=self._limits.clearance,
            tip_radii=self._tip_radii,
            tip_gap=self._limits.tip_gap,
            standoff=self._limits.standoff,
            nhat_OQ=surface.nhat_OQ,
            nhat_OC=nhat_OC,
            reach=reach,
            reach_pose=(X_OH.rotation().matrix(), X_OH.translation()),
            finger_measures=finger_measures,
            closed=self._closed,
            same_side=same_side,
            active_forbidden_points=active_forbidden_points,
        )

    def _hand_pose(
        self, port: InputPort, context: Context, X_OW: RigidTransform
    ) -> RigidTransform | None:
        """Returns the pose in O at a port, which is that of W if unconnected; None if invalid."""
        if not port.HasValue(context):
            return X_OW
        X_WF: RigidTransform = port.Eval(context)
        return X_OW @ X_WF if ports.is_valid(X_WF) else None

    def _predicted_frames(
        self, context: Context, X_WO: RigidTransform
    ) -> tuple[FloatArray, FloatArray]:
        """Returns the poses of W in the predicted frames O, shapes (t, 3, 3) and (t, 3)."""
        (w, v), port = np.zeros((2, 3)), self._V_WO
        if len(self._moments) > 1 and port.HasValue(context):
            w, v = ports.validated_velocity(port.Eval(context))
        back = rotation_matrix(-w * self._moments[:, None])
        R_OW = X_WO.rotation().matrix().T @ back
        p_WO = X_WO.translation() + self._moments[:, None] * v
        return R_OW, -(R_OW @ p_WO[:, :, None])[:, :, 0]
