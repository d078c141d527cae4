"""Registered sources of a hand's goals, which replace the planner's goals in a study's method."""

from collections.abc import Callable

import numpy as np
from pydrake.systems.framework import System

from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.studies.grasps.baseline_goals import RayTarget, ReactiveChoice, StationaryHand

GoalSource = Callable[[ResolvedScenario], System]
"""Class or function of a module that returns a system for a scenario with a hand.

The system emits `fingertip_targets` and `contact_status`. Its input ports are connected by their
names, as `add_grasping_hand` says. Runs are made in other processes, which import the module.
"""


def stationary_hand(resolved: ResolvedScenario) -> StationaryHand:
    """Returns goals of a hand that follows the object, does not turn, and closes without a plan."""
    assert resolved.hand is not None
    return StationaryHand(
        resolved.hand.kinematics.tip_frames,
        azimuths=resolved.hand.azimuths + resolved.start.yaw,
        target=ray_target(resolved),
        limits=resolved.planner.limits,
    )


def reactive_choice(resolved: ResolvedScenario) -> ReactiveChoice:
    """Returns goals of the three fingers that are nearest to an antipodal grasp."""
    assert resolved.hand is not None
    return ReactiveChoice(
        resolved.hand.kinematics.tip_frames,
        target=ray_target(resolved),
        limits=resolved.planner.limits,
        period=resolved.planner.period,
    )


GOAL_SOURCES: dict[str, GoalSource] = {
    "stationary": stationary_hand,
    "reactive": reactive_choice,
}
"""Sources of goals by the names that methods use. `docs/studies.md` shows how to add one."""


def ray_target(resolved: ResolvedScenario) -> RayTarget:
    """Returns the object, with rays at the height of its centre of mass over the table."""
    limits, p_OV = resolved.planner.limits, np.asarray(resolved.shape.mesh.vertices)
    p_OA = resolved.surface.p_OCoM.copy()
    lowest = float(np.min(p_OV[:, 2])) + max(limits.tip_radii) + limits.clearance
    p_OA[2] = max(p_OA[2], lowest)
    return RayTarget(resolved.shape.solid, p_OV, p_OA)
