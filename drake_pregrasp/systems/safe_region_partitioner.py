"""The first stage of the planner: a safe region for each contact."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.framework import Context, LeafSystem

from drake_pregrasp.arrays import (
    FARTHEST,
    FloatArray,
    are_valid_points,
    validated_weights,
)
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.no_touch import AxisArea
from drake_pregrasp.geometry.rotations import rotation_matrix
from drake_pregrasp.geometry.sampling import lifted
from drake_pregrasp.geometry.solids import BallSolid
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.regions.constraints import (
    UNCONSTRAINED,
    FingerReach,
    Obstacles,
    RegionConstraints,
)
from drake_pregrasp.regions.obstacles import place_obstacles
from drake_pregrasp.regions.safe_regions import NO_REGION, SafeRegions, compute_safe_regions
from drake_pregrasp.regions.walls import WALL_TESTS, SurfaceGraph, normals_agree
from drake_pregrasp.systems.pose_ports import is_valid, validated_velocity

_NO_OBSTACLES = Obstacles()
_NOWHERE = FingerReach(BallSolid(np.array([FARTHEST, 0.0, 0.0]), 0.0))
_MOMENTS = 4  # Of the horizon, with now, at which obstacles are looked at.


class SafeRegionPartitioner(LeafSystem):
    """Divides the object's surface into the contacts' safe regions (Eq. 1-2). It has no state.

    .. pydrake_system::

        name: SafeRegionPartitioner
        input_ports:
        - X_WO_estimated
        - p_WC
        - contact_weights
        - obstacles
        - X_WH
        - V_WO_estimated
        output_ports:
        - safe_regions

    Port `X_WO_estimated` accepts a `RigidTransform`: where the object O is believed to be in W.
    Without one, as if it isn't finite or its rotation is none, nobody has a region.

    Port `p_WC` accepts a vector of 3n: the contact points c_i in W, one after another, in metres. A
    contact whose place isn't finite is as one whose finger is lost.

    Port `contact_weights` (optional) accepts a vector of n: h_i in m²; -inf says that the finger
    is lost, and so does NaN. Others count as at most `LARGEST_WEIGHT` in size. Unconnected, all are
    zero.

    Port `obstacles` (optional) accepts `Obstacles` in W. One whose numbers are no longer finite may
    be anywhere: contacts have no region then, and their status names it.

    Port `X_WH` (optional) accepts a `RigidTransform`: the pose of the hand H, for the fingers'
    reach. Unconnected, H is W. If it isn't finite, or its rotation is none, fingers that have a
    reach can reach nothing.

    Both are for the time that `X_WO_estimated` is for: if that looks ahead, so must they.

    Port `V_WO_estimated` (optional) accepts a `SpatialVelocity`: of O in W, with which it goes on
    over the horizon. Unconnected, or if it isn't finite, it is taken to stay.

    Port `safe_regions` emits `SafeRegions` over the surface's candidate points.

    Args:
        surface: The object's surface.
        num_contacts: n.
        tip_radii: Radii of the fingertips, shape (n,), in metres; empty for points.
        clearance: Between fingertips and obstacles, in metres.
        tip_gap: Between fingertips, at least, in metres.
        standoff: How far from the surface fingertips wait, in metres: they stay clear of obstacles
            there, too.
        horizon: For how long from now contacts have to stay clear of obstacles, as these and the
            object move on, in seconds.
        reach: For each contact what its finger reaches, in H, or None; empty for no limit.
        closed: For each contact the ground that only it may not touch; empty for none.
        wall_test: How a region is kept from reaching through a thin wall, out of `WALL_TESTS`.
        normal_length: If above zero, Eq. 1 is over six coordinates: the places and, times this
            length in metres, the outward normals. Regions then keep to ground that faces the
            same way as their contact's.

    Raises:
        InvalidArgumentError: If an argument doesn't fit.
    """

    def __init__(
        self,
        *,
        surface: ObjectSurface,
        num_contacts: int,
        tip_radii: FloatArray | None = None,
        clearance: float = 0.0,
        tip_gap: float = 0.0,
        standoff: float = 0.0,
        horizon: float = 0.0,
        reach: Sequence[FingerReach | None] = (),
        closed: Sequence[Sequence[AxisArea]] = (),
        wall_test: str = "none",
        normal_length: float = 0.0,
    ) -> None:
        super().__init__()
        self._tip_radii = np.empty(0) if tip_radii is None else np.array(tip_radii, dtype=float)
        for name, count in (
            ("tip_radii", len(self._tip_radii)),
            ("reach", len(reach)),
            ("closed", len(closed)),
        ):
            if count not in (0, num_contacts):
                raise InvalidArgumentError(f"{name} must be {num_contacts} or none, not {count}")
        if not np.all(self._tip_radii >= 0):
            raise InvalidArgumentError(f"tip_radii must be at least 0 m, not {self._tip_radii}")
        for name, amount in (
            ("clearance", clearance),
            ("tip_gap", tip_gap),
            ("standoff", standoff),
            ("horizon", horizon),
            ("normal_length", normal_length),
        ):
            if not amount >= 0:
                raise InvalidArgumentError(f"{name} must be at least 0, not {amount}")
        if max(tip_gap, standoff) > 0 and not len(self._tip_radii):
            raise InvalidArgumentError("a tip gap or a standoff needs tip_radii")
        if wall_test not in WALL_TESTS:
            raise InvalidArgumentError(
                f"no wall test {wall_test!r}; there are: {', '.join(WALL_TESTS)}"
            )
        self._clearance, self._tip_gap, self._standoff = clearance, tip_gap, standoff
        self._normal_length = normal_length
        self._points = surface.p_OQ
        if normal_length > 0:
            self._points = lifted(surface.p_OQ, surface.nhat_OQ, normal_length)
        self._moments = np.linspace(0.0, horizon, _MOMENTS)[1:] if horizon > 0 else ()
        self._reach, self._closed = tuple(reach), tuple(closed)
        self._wall_test = wall_test
        self._kernel = surface.kernel if normal_length == 0 else None
        self._is_unlimited = wall_test == "none" and not len(self._tip_radii)
        self._is_unlimited &= not any(reach) and not any(closed)
        self._graph = SurfaceGraph(surface) if wall_test == "surface" else None
        self._surface = surface
        self._num_contacts = num_contacts
        self._X_WO_estimated = self.DeclareAbstractInputPort(
            "X_WO_estimated", AbstractValue.Make(RigidTransform())
        )
        self._p_WC = self.DeclareVectorInputPort("p_WC", 3 * num_contacts)
        self._contact_weights = self.DeclareVectorInputPort("contact_weights", num_contacts)
        self._obstacles = self.DeclareAbstractInputPort(
            "obstacles", AbstractValue.Make(Obstacles())
        )
        self._X_WH = self.DeclareAbstractInputPort("X_WH", AbstractValue.Make(RigidTransform()))
        self._V_WO = self.DeclareAbstractInputPort(
            "V_WO_estimated", AbstractValue.Make(SpatialVelocity())
        )
        self.DeclareAbstractOutputPort(
            "safe_regions",
            lambda: AbstractValue.Make(self._no_regions()),
            self._calc_regions,
            {self.all_input_ports_ticket()},
        )

    def _no_regions(self) -> SafeRegions:
        labels = np.full(len(self._surface.p_OQ), NO_REGION)
        return SafeRegions.unlimited(labels, self._num_contacts)

    def _calc_regions(self, context: Context, output: AbstractValue) -> None:
        X_WO: RigidTransform = self._X_WO_estimated.Eval(context)
        if not is_valid(X_WO):
            output.set_value(self._no_regions())
            return
        X_OW = X_WO.inverse()
        p_WC: FloatArray = self._p_WC.Eval(context).reshape(-1, 3)
        weights = np.zeros(self._num_contacts)
        if self._contact_weights.HasValue(context):
            weights = validated_weights(self._contact_weights.Eval(context))
        p_OC = (X_OW @ p_WC.T).T
        placed = are_valid_points(p_OC)
        if not placed.all():
            p_OC[~placed], weights[~placed] = 0.0, -np.inf
        constraints = self._constraints(context, X_OW, p_OC)
        if self._normal_length > 0:
            _, nhat_OC = self._surface.project(p_OC)
            p_OC = lifted(p_OC, nhat_OC, self._normal_length)
        output.set_value(
            compute_safe_regions(
                self._points,
                p_OC,
                weights,
                self._surface.forbidden,
                constraints,
                kernel=self._kernel,
            )
        )

    def _constraints(
        self, context: Context, X_OW: RigidTransform, p_OC: FloatArray
    ) -> RegionConstraints:
        obstacles, later = _NO_OBSTACLES, []
        if self._obstacles.HasValue(context):
            in_world = self._obstacles.Eval(context)
            if not isinstance(in_world, Obstacles):
                raise InvalidArgumentError(
                    f"port obstacles of {self.get_name()} accepts an Obstacles,"
                    f" not a {type(in_world).__name__}"
                )
            obstacles = place_obstacles(in_world, X_OW.rotation().matrix(), X_OW.translation())
            later = [self._obstacles_after(context, in_world, moment) for moment in self._moments]
        elif self._is_unlimited:
            return UNCONSTRAINED
        surface, same_side, fencing = self._surface, None, None
        nhat_OC = np.empty((0, 3))
        if self._wall_test != "none" or len(self._tip_radii):
            _, nhat_OC = surface.project(p_OC)
        if self._wall_test != "none":
            fencing = normals_agree(nhat_OC, surface.forbidden.normals)
            same_side = normals_agree(nhat_OC, surface.nhat_OQ)
            if self._graph is not None:  # Round a rim the way to the other side is short.
                same_side &= self._graph.near_over_the_surface(p_OC, nhat_OC)
        return RegionConstraints(
            obstacles=obstacles,
            later=later,
            clearance=self._clearance,
            tip_radii=self._tip_radii,
            tip_gap=self._tip_gap,
            standoff=self._standoff,
            nhat_OQ=surface.nhat_OQ,
            nhat_OC=nhat_OC,
            reach=self._reach_in_O(context, X_OW),
            closed=self._closed,
            same_side=same_side,
            fencing=fencing,
        )

    def _reach_in_O(self, context: Context, X_OW: RigidTransform) -> list[FingerReach | None]:
        X_OH = X_OW
        if self._X_WH.HasValue(context):
            X_WH: RigidTransform = self._X_WH.Eval(context)
            if not is_valid(X_WH):
                return [reach and _NOWHERE for reach in self._reach]
            X_OH = X_OW @ X_WH
        R_OH, p_OH = X_OH.rotation().matrix(), X_OH.translation()
        return [reach and reach.moved(R_OH, p_OH) for reach in self._reach]

    def _obstacles_after(self, context: Context, in_world: Obstacles, seconds: float) -> Obstacles:
        """Returns where obstacles will be, in O as it will be then."""
        X_WO: RigidTransform = self._X_WO_estimated.Eval(context)
        R_WO, p_WO = X_WO.rotation().matrix(), X_WO.translation()
        if self._V_WO.HasValue(context):
            V_WO = validated_velocity(self._V_WO.Eval(context))
            R_WO = rotation_matrix(V_WO.rotational() * seconds) @ R_WO
            p_WO = p_WO + V_WO.translational() * seconds
        return place_obstacles(in_world, R_WO.T, -R_WO.T @ p_WO, seconds=seconds)
