"""The compiled implementation, as one object, which is compiled or loaded when it is imported."""

from collections.abc import Callable
from typing import cast

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.estimation.surface_alignment import Alignment
from drake_pregrasp.fast.goals import CompiledGoals
from drake_pregrasp.fast.kernels import HandKernels, Kernels
from drake_pregrasp.fast.labels import CompactCandidates
from drake_pregrasp.fast.pose_steps import compiled_filter_step, compiled_merged
from drake_pregrasp.fast.predicates import compiled_limits_at
from drake_pregrasp.fast.projection import CompiledSurface
from drake_pregrasp.quality.force_closure import LargestMinimum
from drake_pregrasp.regions.independent_regions import SlipRadii
from drake_pregrasp.regions.safe_regions import LabelCandidates


def _labels(q: FloatArray, nhat: FloatArray) -> LabelCandidates:
    return CompactCandidates(q, nhat).label


def _slip_radii() -> SlipRadii:
    # Imported only here, because few planners need what it compiles.
    from drake_pregrasp.fast.margins import compiled_slip_radii

    return compiled_slip_radii


def _largest_minimum() -> LargestMinimum:
    from drake_pregrasp.fast.cones import compiled_largest_minimum

    return cast(LargestMinimum, compiled_largest_minimum)


def _align_pose() -> Callable[..., Alignment]:
    # Imported only here, because only estimates from surface points need what it compiles.
    from drake_pregrasp.fast.alignment import compiled_align_pose

    return compiled_align_pose


def _hand() -> HandKernels:
    # Imported only here, because only hands need what they compile.
    from drake_pregrasp.fast.distances import compiled_solid
    from drake_pregrasp.fast.hand import (
        compiled_clearances,
        compiled_forward_kinematics,
        compiled_next_velocities,
    )
    from drake_pregrasp.fast.meetings import compiled_choose_meeting
    from drake_pregrasp.fast.tip_steps import (
        compiled_goal_velocities,
        compiled_hand_goals,
        compiled_straight_step,
    )

    return HandKernels(
        compiled_forward_kinematics,
        compiled_hand_goals,
        compiled_goal_velocities,
        compiled_clearances,
        compiled_next_velocities,
        compiled_straight_step,
        compiled_choose_meeting,
        compiled_solid,
    )


COMPILED = Kernels(
    name="numba",
    labels=_labels,
    surface=CompiledSurface.of,
    limits_at=compiled_limits_at,
    goals=CompiledGoals,
    slip_radii=_slip_radii,
    largest_minimum=_largest_minimum,
    filter_step=compiled_filter_step,
    merged=compiled_merged,
    align_pose=_align_pose,
    hand=_hand,
)
"""The implementation in numba."""
