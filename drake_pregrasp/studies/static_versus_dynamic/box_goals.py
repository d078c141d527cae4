"""Systems that choose goals on a box without the planner: a stationary hand, a reactive choice.

The reactive choice is that of Y. Lee, T.-Y. Lin, A. Alexiev and S. Kim, "Hierarchical Reactive
Grasping via Task-Space Velocity Fields and Joint-Space Quadratic Programming", ICRA 2026, arXiv
2509.01044, as its public tutorial describes it, in an implementation of our own.
`docs/static_versus_dynamic.md` says what is theirs.
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.regions.constraints import Limit, Obstacles, RegionConstraints
from drake_pregrasp.studies.static_versus_dynamic.methods import declare_goals, rays_at

_RING_RADIUS = 0.092  # Radius on which a stationary hand's fingertips wait, in metres.
SWITCH_MARGIN = 0.03  # Cost by which another grasp must be better, in metres.
ANGLE_COST = 0.1  # Cost of an angle, in metres per radian.
_SPREAD = 0.02  # Distance of the two fingers from the point opposite the thumb, in metres.
_SHIFT = 0.02  # Distance of grasps beside the middle of a face, in metres.
_EDGE = 0.0125  # Least distance of a contact from an edge of the box, in metres.
_NONE = -1.0  # State without a grasp.


class _GoalsOnBox(LeafSystem):
    """Input ports of systems that choose goals on a box, and the obstacles' limits on them.

    Subclasses declare their other input ports, and give the goals to `declare_goals`.

    Args:
        num_fingers: Number of fingers n.
        limits: Limits of the planner, with radii of the fingertips, clearance and standoff.
    """

    def __init__(self, num_fingers: int, limits: LimitsConfig) -> None:
        super().__init__()
        self._constraints = RegionConstraints(
            clearance=limits.clearance,
            tip_radii=np.array(limits.tip_radii),
            standoff=limits.standoff,
        )
        self._X_WO = self.DeclareAbstractInputPort(
            "X_WO_estimated", AbstractValue.Make(RigidTransform())
        )
        self._weights = self.DeclareVectorInputPort("contact_weights", num_fingers)
        self._obstacles = self.DeclareAbstractInputPort(
            "obstacles", AbstractValue.Make(Obstacles())
        )

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


class StationaryHand(_GoalsOnBox):
    """Emits goals of fingers on a ring around the object that does not turn with it.

    .. pydrake_system::

        name: StationaryHand
        input_ports:
        - X_WO_estimated
        - contact_weights
        - obstacles
        - close
        output_ports:
        - fingertip_targets
        - contact_status

    The ports are those of `PregraspPlanner`, except `close`, the command to close. Fingers wait on
    a ring around the object, which translates with the object but does not turn. After the command,
    their goals are the intersections of rays from the object's origin with its surface. A finger is
    inactive if it is lost, or if the planner's limits forbid its contact.

    Args:
        tip_frames: Scoped names of the fingertips' frames.
        azimuths: Azimuths of the fingers in W, shape (n,), in radians.
        box_size: Edge lengths of the object, a box centred at the origin of O, in metres.
        limits: Limits of the planner, with radii of the fingertips, clearance and standoff.
    """

    def __init__(
        self,
        tip_frames: Sequence[str],
        *,
        azimuths: FloatArray,
        box_size: Sequence[float],
        limits: LimitsConfig,
    ) -> None:
        super().__init__(len(tip_frames), limits)
        self._rays, self._half = rays_at(azimuths), np.array(box_size) / 2
        self._goal_radius = _RING_RADIUS - (limits.standoff + limits.tip_radii[0])
        self._close = self.DeclareVectorInputPort("close", 1)
        declare_goals(self, tip_frames, self._targets, self._status)

    def _contacts(self, context: Context) -> tuple[FloatArray, FloatArray]:
        """Returns the rays' intersections with the object and the outward normals there, in W."""
        X_WO: RigidTransform = self._X_WO.Eval(context)
        R_WO = X_WO.rotation().matrix()
        rays = self._rays @ R_WO
        reached = self._half / np.maximum(np.abs(rays), 1e-12)
        p_OC = rays * np.min(reached, axis=1, keepdims=True)
        face = np.argmin(reached, axis=1)
        normals = np.eye(3)[face] * np.sign(np.take_along_axis(rays, face[:, None], axis=1))
        return X_WO.translation() + p_OC @ R_WO.T, normals @ R_WO.T

    def _targets(self, context: Context) -> Mapping[int, RigidTransform]:
        if self._close.Eval(context)[0] >= 1:
            points, normals = self._contacts(context)
        else:
            p_WO = self._X_WO.Eval(context).translation()
            points, normals = p_WO + self._goal_radius * self._rays, self._rays
        return _goals_at(range(len(points)), points, normals)

    def _status(self, context: Context) -> FloatArray:
        points, normals = self._contacts(context)
        permitted = [
            self._permitted(context, finger, points[[finger]], normals[[finger]])[0]
            for finger in range(len(points))
        ]
        return np.where(permitted, float(ContactStatus.ACTIVE), float(ContactStatus.OBSTRUCTED))


def box_grasps(size: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Returns antipodal grasps of a box by its side faces: contacts and outward normals in O.

    A thumb touches a face, in its middle or beside it, and two fingers the opposite one, to either
    side of the point opposite the thumb. Both arrays have shape (k, 3, 3), thumb first.

    Args:
        size: Edge lengths of the box, centred at the origin of O, in metres.
    """
    half, grasps = np.array(size) / 2, []
    for axis, sign, shift in itertools.product((0, 1), (1.0, -1.0), (0.0, -_SHIFT, _SHIFT)):
        normal, along = sign * np.eye(3)[axis], np.eye(3)[1 - axis]
        room = half[1 - axis] - _EDGE
        spread = min(_SPREAD, room)
        middle = np.clip(shift, spread - room, room - spread) * along
        faces = np.array([normal, -normal, -normal])
        aside = np.array([[0.0], [1.0], [-1.0]]) * spread * along
        grasps.append((half[axis] * faces + middle + aside, faces))
    points, normals = np.unique(grasps, axis=0).swapaxes(0, 1)
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


class ReactiveChoice(_GoalsOnBox):
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
    `HandController`. At each tick the system compares all grasps of `box_grasps`, by any three
    fingers that are not lost, whose contacts the obstacles permit. It keeps the present one unless
    another one is cheaper by `SWITCH_MARGIN`. Other fingers are inactive. If no grasp is permitted,
    all fingers are obstructed.

    Args:
        tip_frames: Scoped names of the fingertips' frames.
        box_size: Edge lengths of the object, a box centred at the origin of O, in metres.
        limits: Limits of the planner, with radii of the fingertips, clearance and standoff.
        period: Seconds between ticks.
    """

    def __init__(
        self,
        tip_frames: Sequence[str],
        *,
        box_size: Sequence[float],
        limits: LimitsConfig,
        period: float,
    ) -> None:
        n = len(tip_frames)
        super().__init__(n, limits)
        self._sets = np.array(list(itertools.permutations(range(n), 3)))
        self._p_OC, self._nhat = box_grasps(box_size)
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
        p_WC, nhat_WC = self._contacts(context)
        # All fingertips are alike, so what the obstacles permit to one they permit to all.
        permitted = self._permitted(context, 0, p_WC.reshape(-1, 3), nhat_WC.reshape(-1, 3))
        p_WT = np.reshape(self._p_WT.Eval(context), (-1, 3))
        there = ~np.isneginf(self._weights.Eval(context))[self._sets].any(axis=1)
        possible = there[:, None] & permitted.reshape(-1, 3).all(axis=1)
        costs = np.where(possible, grasp_costs(p_WT[self._sets], p_WC), np.inf).ravel()
        before, best = int(context.get_discrete_state(self._chosen)[0]), int(np.argmin(costs))
        kept = before >= 0 and costs[before] <= costs[best] + SWITCH_MARGIN
        chosen = before if kept else best
        discrete_state.set_value(self._chosen, [chosen if np.isfinite(costs[chosen]) else _NONE])

    def _grasp(self, context: Context) -> tuple[list[int], int]:
        """Returns the fingers of the present grasp, none without one, and its index."""
        chosen = int(context.get_discrete_state(self._chosen)[0])
        fingers, grasp = divmod(chosen, len(self._p_OC))
        return self._sets[fingers].tolist() if chosen >= 0 else [], grasp

    def _targets(self, context: Context) -> Mapping[int, RigidTransform]:
        fingers, grasp = self._grasp(context)
        points, normals = (of_all[grasp] for of_all in self._contacts(context))
        return _goals_at(fingers, points[: len(fingers)], normals[: len(fingers)])

    def _status(self, context: Context) -> FloatArray:
        fingers, _ = self._grasp(context)
        others = ContactStatus.INACTIVE if fingers else ContactStatus.OBSTRUCTED
        status = np.full(self._weights.size(), float(others))
        status[fingers] = float(ContactStatus.ACTIVE)
        return status
