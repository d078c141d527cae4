"""Registered sources of a hand's goals, which replace the planner's goals in a study's method."""

from collections.abc import Callable

import numpy as np
from pydrake.systems.framework import DiagramBuilder, System

from drake_pregrasp.diagrams.grasping_hand import GoalInputs
from drake_pregrasp.diagrams.wiring import connect
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.studies.grasps.baseline_goals import RayTarget, ReactiveChoice, StationaryHand

RegisteredSource = Callable[[ResolvedScenario, DiagramBuilder, GoalInputs], System]
"""Function that adds a system with the outputs `fingertip_targets` and `contact_status`.

Its arguments are the scenario with a hand, the builder of the diagram, and the systems that the
source may read. It is a module's function, because runs are made in other processes.
"""


def add_stationary_hand(
    resolved: ResolvedScenario, builder: DiagramBuilder, inputs: GoalInputs
) -> System:
    """Adds goals of a hand that follows the object, does not turn, and closes without a plan."""
    assert resolved.hand is not None
    goals = StationaryHand(
        resolved.hand.kinematics.tip_frames,
        azimuths=resolved.hand.azimuths + resolved.start.yaw,
        target=ray_target(resolved),
        limits=resolved.planner.limits,
    )
    _add(builder, inputs, goals)
    return goals


def add_reactive_choice(
    resolved: ResolvedScenario, builder: DiagramBuilder, inputs: GoalInputs
) -> System:
    """Adds goals of the three fingers that are nearest to an antipodal grasp."""
    assert resolved.hand is not None
    goals = ReactiveChoice(
        resolved.hand.kinematics.tip_frames,
        target=ray_target(resolved),
        limits=resolved.planner.limits,
        period=resolved.planner.period,
    )
    _add(builder, inputs, goals)
    connect(builder, inputs.controller, "p_WT", goals)
    return goals


GOAL_SOURCES: dict[str, RegisteredSource] = {
    "stationary": add_stationary_hand,
    "reactive": add_reactive_choice,
}
"""Sources of goals by the names that methods use. CONTRIBUTING.md shows how to add one."""


def ray_target(resolved: ResolvedScenario) -> RayTarget:
    """Returns the object, with rays at the height of its centre of mass over the table."""
    limits, p_OV = resolved.planner.limits, np.asarray(resolved.shape.mesh.vertices)
    p_OA = resolved.surface.p_OCoM.copy()
    lowest = float(np.min(p_OV[:, 2])) + max(limits.tip_radii) + limits.clearance
    p_OA[2] = max(p_OA[2], lowest)
    return RayTarget(resolved.shape.solid, p_OV, p_OA)


def _add(builder: DiagramBuilder, inputs: GoalInputs, goals: System) -> None:
    builder.AddNamedSystem("goal_source", goals)
    connect(builder, inputs.planner, "X_WO_estimated", goals)
    connect(builder, inputs.weights, "contact_weights", goals)
    connect(builder, inputs.obstacles, "obstacles", goals)
