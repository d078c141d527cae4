"""Systems that choose goals without the planner: a stationary hand, and a reactive choice.

The reactive choice is that of Y. Lee, T.-Y. Lin, A. Alexiev and S. Kim, "Hierarchical Reactive
Grasping via Task-Space Velocity Fields and Joint-Space Quadratic Programming", ICRA 2026, arXiv
2509.01044, as its public tutorial describes it, in an implementation of our own.
`docs/static_versus_dynamic.md` says what is theirs.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import (
    BasicVector,
    BusValue,
    Context,
    DiscreteValues,
    LeafSystem,
)

from drake_pregrasp.arrays import TIME_ROUNDING, BoolArray, FloatArray
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.geometry.solids import SignedDistance
from drake_pregrasp.regions.constraints import Limit, RegionConstraints
from drake_pregrasp.systems.ports import BUS, OBSTACLES, POSE, declare_output, pose_bus

SWITCH_MARGIN = 0.03
"""Cost by which another grasp must be better, in metres."""

ANGLE_COST = 0.1
"""Cost of an angle, in metres per radian."""

_RING_RADIUS = 0.092  # Least radius on which a stationary hand's fingertips wait, in metres.
_SPREAD = 0.02  # Distance of the two fingers from the point opposite the thumb, in metres.
_SHIFT = 0.02  # Distance of grasps beside the middle of the object, in metres.
_EDGE = 0.0125  # Least distance of a contact from the ends of the object, in metres.
_DIRECTIONS = 24  # Directions of grasps around the object.
_CONE = float(np.arctan(GraspConfig.planned_friction))  # Largest angle of forces from normals.
_WORSE = float(np.radians(10))  # Angle by which kept grasps are less opposed than the best one.
_STEPS, _ON_SURFACE = 100, 1e-10  # Largest number of steps along a ray; distance at its end.
_NONE = -1.0  # State without a grasp.


def rays_at(azimuths: FloatArray) -> FloatArray:
    """Returns the horizontal unit vectors at azimuths in radians, shape (n, 3)."""
    return np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(len(azimuths))], axis=1)


def declare_goals(
    system: LeafSystem,
    tip_frames: Sequence[str],
    targets: Callable[[Context], Mapping[int, RigidTransform]],
    status: Callable[[Context], FloatArray],
) -> None:
    """Declares the output ports of the hand's goals, and `contact_weights` if it is missing.

    Args:
        system: System that emits the goals.
        tip_frames: Scoped names of the fingertips' frames.
        targets: Function that returns the targets X_WC by the fingers' indices.
        status: Function that returns the contact status of each finger, shape (n,), without regard
            to lost fingers.
    """
    if not system.HasInputPort("contact_weights"):
        system.DeclareVectorInputPort("contact_weights", len(tip_frames))

    def calc_targets(context: Context) -> BusValue:
        return pose_bus({tip_frames[f]: X_WC for f, X_WC in targets(context).items()})

    def calc_status(context: Context) -> FloatArray:
        lost = np.isneginf(system.GetInputPort("contact_weights").Eval(context))
        return np.where(lost, float(ContactStatus.LOST), status(context))

    everything = system.all_sources_ticket()
    declare_output(system, "fingertip_targets", BUS, calc_targets, everything)
    declare_output(system, "contact_status", len(tip_frames), calc_status, everything)


class RayTarget(NamedTuple):
    """Object that rays meet.

    Attributes:
        solid: The object in O.
        p_OV: Vertices of its surface in O, shape (k, 3), in metres.
        p_OA: Point through which rays pass, in O, shape (3,), in metres.
    """

    solid: SignedDistance
    p_OV: FloatArray
    p_OA: FloatArray

    @property
    def radius(self) -> float:
        """Largest horizontal distance of a vertex from the point A, in metres."""
        return float(np.max(np.linalg.norm((self.p_OV - self.p_OA)[:, :2], axis=1)))

    def contacts(
        self, outward: FloatArray, offsets: FloatArray | float = 0.0
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Returns the points that rays from outside meet first, normals, and which meet any.

        Each step along a ray is as long as the distance from the object (sphere tracing).

        Args:
            outward: Unit vectors against the rays, in O, shape (k, 3).
            offsets: Offsets of the rays from the point A, in O, shape (k, 3), in metres.
        """
        far = float(np.max(np.linalg.norm(self.p_OV - self.p_OA, axis=1))) + 0.1
        points = self.p_OA + offsets + far * outward
        travel = np.zeros(len(outward))
        for _ in range(_STEPS):
            distances = self.solid.distance(points)
            moving = (distances > _ON_SURFACE) & (travel < 2 * far)
            if not np.any(moving):
                break
            travel += np.where(moving, distances, 0)
            points = self.p_OA + offsets + (far - travel)[:, None] * outward
        distances, normals = self.solid.distance_and_gradient(points)
        return points, normals, np.abs(distances) < 1e-6


class _GoalsWithoutPlanner(LeafSystem):
    """Input ports of systems that choose goals on an object, and the obstacles' limits on them.

    Subclasses declare their other input ports, and give the goals to `declare_goals`.

    Args:
        num_fingers: Number of fingers n.
        limits: Limits of the planner, with radii of the fingertips, clearance and standoff.
    """

    def __init__(self, num_fingers: int, limits: LimitsConfig) -> None:
        super().__init__()
        self._constraints = RegionConstraints(
            num_fingers,
            clearance=limits.clearance,
            tip_radii=np.array(limits.tip_radii),
            standoff=limits.standoff,
        )
        self._X_WO = self.DeclareAbstractInputPort("X_WO_estimated", POSE)
        self._weights = self.DeclareVectorInputPort("contact_weights", num_fingers)
        self._obstacles = self.DeclareAbstractInputPort("obstacles", OBSTACLES)

    def _permitted(
        self, context: Context, finger: int, p_WC: FloatArray, nhat_WC: FloatArray
    ) -> BoolArray:
        """Returns the mask of contacts that obstacles permit to a finger, shape (k,).

        Args:
            context: Context of the system.
            finger: Index of the finger.
            p_WC: Contacts in W, shape (k, 3), in metres.
            nhat_WC: Outward unit normals there, shape (k, 3).
        """
        constraints = replace(self._constraints, obstacles=self._obstacles.Eval(context))
        permitted: BoolArray = constraints.limits_at(finger, p_WC, nhat_WC)[0] == Limit.NONE
        return permitted


def _goals_at(
    fingers: Iterable[int], points: FloatArray, normals: FloatArray
) -> Mapping[int, RigidTransform]:
    """Returns targets X_WC by fingers, from contacts and outward normals in W, shape (k, 3)."""
    return {
        finger: RigidTransform(RotationMatrix.MakeFromOneVector(-normal, 2), point)
        for finger, point, normal in zip(fingers, points, normals, strict=True)
    }


class StationaryHand(_GoalsWithoutPlanner):
    """Emits goals of fingers on a ring around the object that does not turn with it.

    .. pydrake_system::

        name: StationaryHand
        input_ports:
        - X_WO_estimated
        - contact_weights
        - obstacles
        output_ports:
        - fingertip_targets
        - contact_status

    The ports are those of `PregraspPlanner`. Fingers wait on a ring around the object, which
    translates with the object but does not turn. From a time on, a parameter of the Context
    (`set_time`), their goals are where horizontal rays to the object's middle meet its surface. A
    finger is inactive if it is lost, if its ray meets nothing, or if the planner's limits forbid
    its contact.

    Args:
        tip_frames: Scoped names of the fingertips' frames.
        azimuths: Azimuths of the fingers in W, shape (n,), in radians.
        target: The object.
        limits: Limits of the planner, with radii of the fingertips, clearance and standoff.
    """

    def __init__(
        self,
        tip_frames: Sequence[str],
        *,
        azimuths: FloatArray,
        target: RayTarget,
        limits: LimitsConfig,
    ) -> None:
        super().__init__(len(tip_frames), limits)
        self._rays, self._target = rays_at(azimuths), target
        radius = max(limits.tip_radii)
        ring = max(_RING_RADIUS, target.radius + radius + limits.clearance)
        self._goal_radius = ring - (limits.standoff + radius)
        self._time = self.DeclareNumericParameter(BasicVector([np.inf]))
        declare_goals(self, tip_frames, self._targets, self._status)

    def set_time(self, context: Context, time: float) -> None:
        """Sets the time in seconds from which goals are on the object, in its Context."""
        context.get_mutable_numeric_parameter(self._time).SetFromVector([time])

    def _contacts(self, context: Context) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Returns what the rays meet, the outward normals there, both in W, and which meet any."""
        X_WO: RigidTransform = self._X_WO.Eval(context)
        R_WO = X_WO.rotation().matrix()
        p_OC, normals, met = self._target.contacts(self._rays @ R_WO)
        return X_WO.translation() + p_OC @ R_WO.T, normals @ R_WO.T, met

    def _targets(self, context: Context) -> Mapping[int, RigidTransform]:
        if context.get_time() >= context.get_numeric_parameter(self._time)[0] - TIME_ROUNDING:
            points, normals, met = self._contacts(context)
            fingers = np.flatnonzero(met)
            return _goals_at(fingers.tolist(), points[fingers], normals[fingers])
        p_WA = self._X_WO.Eval(context) @ self._target.p_OA
        return _goals_at(range(len(self._rays)), p_WA + self._goal_radius * self._rays, self._rays)

    def _status(self, context: Context) -> FloatArray:
        points, normals, met = self._contacts(context)
        permitted = [
            met[finger] and self._permitted(context, finger, points[[finger]], normals[[finger]])[0]
            for finger in range(len(points))
        ]
        return np.where(permitted, float(ContactStatus.ACTIVE), float(ContactStatus.OBSTRUCTED))


def antipodal_grasps(target: RayTarget, tip_radius: float) -> tuple[FloatArray, FloatArray]:
    """Returns antipodal grasps from the sides of an object: contacts and outward normals in O.

    A thumb touches one side, in its middle or beside it, and two fingers the opposite one, to
    either side of the point opposite the thumb. Thumb and fingers press within friction cones, and
    about as straight against each other as in the best grasp. Both arrays have shape (k, 3, 3),
    thumb first; k is 0 if there is no such grasp.

    Args:
        target: The object.
        tip_radius: Radius of the fingertips, in metres.
    """
    grasps, angles = [], []
    azimuths = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    for outward, shift in itertools.product(rays_at(azimuths), (0.0, -_SHIFT, _SHIFT)):
        along = np.array([-outward[1], outward[0], 0.0])
        across = (target.p_OV - target.p_OA) @ along
        low, high = np.min(across) + _EDGE, np.max(across) - _EDGE
        spread = min(_SPREAD, (high - low) / 2)
        if spread < tip_radius:
            continue
        middle = np.clip(shift, low + spread, high - spread)
        offsets = (middle + spread * np.array([[0.0], [1.0], [-1.0]])) * along
        rays = np.array([outward, -outward, -outward])
        points, normals, met = target.contacts(rays, offsets)
        opposed = [normals[0] @ outward, -np.mean(normals[1:], axis=0) @ outward]
        if np.all(met):
            grasps.append([points, normals])
            angles.append(np.arccos(np.clip(np.min(opposed), -1, 1)))
    limit = min(min(angles, default=0.0) + _WORSE, _CONE)
    kept = [grasp for grasp, angle in zip(grasps, angles, strict=True) if angle <= limit]
    rounded = np.reshape(kept, (-1, 2, 3, 3)).round(9)
    points, normals = np.unique(rounded, axis=0).swapaxes(0, 1)
    return points, normals


def grasp_costs(p_WT: FloatArray, p_WC: FloatArray) -> FloatArray:
    """Returns the cost of each grasp for each set of fingers, shape (sets, grasps), in metres.

    The cost is the distance of the thumb from its contact, that of the middle of the two fingers
    from the middle of their contacts, and the angles of the line from thumb to fingers, and of the
    line between the two fingers, to the same lines of the contacts.

    Args:
        p_WT: Centres of the fingertips of each set, shape (sets, 3, 3), thumb first, in metres.
        p_WC: Contacts of each grasp, shape (grasps, 3, 3), thumb first, in metres.
    """

    def thumb_and_middle(p: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        thumb, middle = p[:, 0], (p[:, 1] + p[:, 2]) / 2
        lines = np.stack([thumb - middle, p[:, 1] - p[:, 2]])
        return thumb, middle, lines / np.linalg.norm(lines, axis=2, keepdims=True)

    thumb, middle, lines = thumb_and_middle(p_WT)
    thumb_goal, middle_goal, line_goals = thumb_and_middle(p_WC)
    cosines = np.clip(lines @ line_goals.swapaxes(1, 2), -1, 1)
    distances = np.linalg.norm(thumb[:, None] - thumb_goal, axis=2)
    distances += np.linalg.norm(middle[:, None] - middle_goal, axis=2)
    costs: FloatArray = distances + ANGLE_COST * np.sum(np.arccos(cosines), axis=0)
    return costs


class ReactiveChoice(_GoalsWithoutPlanner):
    """Emits goals of the three fingers that are nearest to a grasp, chosen anew at every tick.

    .. pydrake_system::

        name: ReactiveChoice
        input_ports:
        - X_WO_estimated
        - contact_weights
        - obstacles
        - p_WT
        output_ports:
        - fingertip_targets
        - contact_status

    The ports are those of `PregraspPlanner`, except `p_WT`, the centres of the fingertips in W from
    `HandController`. At each tick the system compares all `antipodal_grasps` by any three fingers
    that are not lost, whose contacts the obstacles permit. It keeps the present one unless another
    one is cheaper by `SWITCH_MARGIN`. Other fingers are inactive. If no grasp is permitted,
    all fingers are obstructed.

    Args:
        tip_frames: Scoped names of the fingertips' frames.
        target: The object.
        limits: Limits of the planner, with radii of the fingertips, clearance and standoff.
        period: Seconds between ticks.
    """

    def __init__(
        self, tip_frames: Sequence[str], *, target: RayTarget, limits: LimitsConfig, period: float
    ) -> None:
        n = len(tip_frames)
        super().__init__(n, limits)
        self._sets = np.array(list(itertools.permutations(range(n), 3)))
        self._p_OC, self._nhat = antipodal_grasps(target, max(limits.tip_radii))
        self._chosen = self.DeclareDiscreteState([_NONE])
        self._p_WT = self.DeclareVectorInputPort("p_WT", 3 * n)
        declare_goals(self, tip_frames, self._targets, self._status)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._choose)

    def _contacts(self, context: Context) -> tuple[FloatArray, FloatArray]:
        """Returns contacts and outward normals of all grasps in W, shape (k, 3, 3)."""
        X_WO: RigidTransform = self._X_WO.Eval(context)
        R_WO = X_WO.rotation().matrix()
        return X_WO.translation() + self._p_OC @ R_WO.T, self._nhat @ R_WO.T

    def _choose(self, context: Context, discrete_state: DiscreteValues) -> None:
        if not len(self._p_OC):
            return
        p_WC, nhat_WC = self._contacts(context)
        contacts = p_WC.reshape(-1, 3), nhat_WC.reshape(-1, 3)
        fingers = range(self._weights.size())
        permitted = np.array([self._permitted(context, f, *contacts) for f in fingers])
        permitted = permitted.reshape(len(fingers), -1, 3)  # By finger, grasp and its contact.
        p_WT = np.reshape(self._p_WT.Eval(context), (-1, 3))
        there = ~np.isneginf(self._weights.Eval(context))[self._sets].any(axis=1)
        possible = there[:, None] & permitted[self._sets, :, np.arange(3)].all(axis=1)
        costs = np.where(possible, grasp_costs(p_WT[self._sets], p_WC), np.inf).ravel()
        before, best = int(context.get_discrete_state(self._chosen)[0]), int(np.argmin(costs))
        kept = before >= 0 and costs[before] <= costs[best] + SWITCH_MARGIN
        chosen = before if kept else best
        discrete_state.set_value(self._chosen, [chosen if np.isfinite(costs[chosen]) else _NONE])

    def _grasp(self, context: Context) -> tuple[list[int], int]:
        """Returns the fingers of the present grasp, none without one, and its index."""
        chosen = int(context.get_discrete_state(self._chosen)[0])
        if chosen < 0:
            return [], 0
        fingers, grasp = divmod(chosen, len(self._p_OC))
        return self._sets[fingers].tolist(), grasp

    def _targets(self, context: Context) -> Mapping[int, RigidTransform]:
        fingers, grasp = self._grasp(context)
        if not fingers:
            return {}
        points, normals = (of_all[grasp] for of_all in self._contacts(context))
        return _goals_at(fingers, points, normals)

    def _status(self, context: Context) -> FloatArray:
        fingers, _ = self._grasp(context)
        others = ContactStatus.INACTIVE if fingers else ContactStatus.OBSTRUCTED
        status = np.full(self._weights.size(), float(others))
        status[fingers] = float(ContactStatus.ACTIVE)
        return status
