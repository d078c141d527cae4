"""The functions that take most of a tick, as one object, and their reference in numpy."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.selection_input import GoalFunction
from drake_pregrasp.estimation.pose_belief import PoseBelief
from drake_pregrasp.estimation.pose_filter import filter_step, merged
from drake_pregrasp.estimation.pose_track import FilterStep
from drake_pregrasp.estimation.surface_alignment import Alignment, align_pose
from drake_pregrasp.geometry.solids import SignedDistance
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.grasping.clearances import Clearances, clearances
from drake_pregrasp.grasping.fingertip_paths import straight_step
from drake_pregrasp.grasping.forward_kinematics import HandPose, KinematicTree, forward_kinematics
from drake_pregrasp.grasping.hand_goals import HandGoals, goal_velocities, hand_goals
from drake_pregrasp.grasping.interception import Choice, choose_meeting
from drake_pregrasp.grasping.joint_velocities import next_velocities
from drake_pregrasp.quality.force_closure import LargestMinimum, largest_minimum
from drake_pregrasp.regions.constraints import LimitFunction, Predicates
from drake_pregrasp.regions.independent_regions import SlipRadii, slip_radii_within
from drake_pregrasp.regions.safe_regions import LabelCandidates, label_candidates


@dataclass(frozen=True)
class HandKernels:
    """The functions that take most of a control tick, in one implementation.

    Attributes:
        forward_kinematics: `forward_kinematics`.
        hand_goals: `hand_goals`.
        goal_velocities: `goal_velocities`.
        clearances: `clearances`.
        next_velocities: `next_velocities`.
        straight_step: `straight_step`.
        choose_meeting: `choose_meeting`.
        solid: Function that returns a solid with this implementation's distances.
    """

    forward_kinematics: Callable[[KinematicTree, FloatArray], HandPose]
    hand_goals: Callable[..., HandGoals]
    goal_velocities: Callable[..., FloatArray]
    clearances: Callable[..., Clearances]
    next_velocities: Callable[..., tuple[FloatArray, int]]
    straight_step: Callable[..., FloatArray | None]
    choose_meeting: Callable[..., Choice]
    solid: Callable[[SignedDistance], SignedDistance]


@dataclass(frozen=True)
class Kernels:
    """The functions that take most of a tick, in one implementation.

    Attributes:
        name: Library of the implementation: numpy or numba.
        labels: Function from candidate points, shape (N, d), in metres, and the outward unit
            normals there, shape (N, 3), to `label_candidates` for these candidates.
        surface: Function that returns a surface with this implementation's projection.
        limits_at: `Predicates.limits_at`.
        goals: Function from a surface, the weights of strategies by name, and the arguments of
            `make_blend` and `best_point`, to `region_goals`; None to evaluate strategies one by
            one.
        slip_radii: Function that returns `slip_radii_within` of hard fingers.
        largest_minimum: Function that returns `largest_minimum`.
        filter_step: `filter_step` of the pose filter.
        merged: `merged` of the pose filter.
        align_pose: Function that returns `align_pose`.
        hand: Function that returns those of a hand.
    """

    name: str
    labels: Callable[[FloatArray, FloatArray], LabelCandidates]
    surface: Callable[[ObjectSurface], ObjectSurface]
    limits_at: LimitFunction
    goals: Callable[..., GoalFunction] | None
    slip_radii: Callable[[], SlipRadii]
    largest_minimum: Callable[[], LargestMinimum]
    filter_step: FilterStep
    merged: Callable[[PoseBelief], PoseBelief]
    align_pose: Callable[[], Callable[..., Alignment]]
    hand: Callable[[], HandKernels]


REFERENCE = Kernels(
    name="numpy",
    labels=lambda q, nhat: partial(label_candidates, q, nhat),
    surface=lambda surface: surface,
    limits_at=Predicates.limits_at,
    goals=None,
    slip_radii=lambda: slip_radii_within,
    largest_minimum=lambda: largest_minimum,
    filter_step=filter_step,
    merged=merged,
    align_pose=lambda: align_pose,
    hand=lambda: HandKernels(
        forward_kinematics,
        hand_goals,
        goal_velocities,
        clearances,
        next_velocities,
        straight_step,
        choose_meeting,
        lambda solid: solid,
    ),
)
"""The implementation in numpy."""
