"""A scenario's hand in its diagram."""

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.grasp_config import hand_limits
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.config.object_config import Box, Conveyor
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.diagrams.hand_station import DrivenHand, add_driven_hand
from drake_pregrasp.diagrams.pregrasp_planner import PregraspPlanner
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.simulation.hand_file import load_hand, load_hand_model
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.loggers import GraspLogger, GraspRecord


def hand_planner(scenario: Scenario) -> PlannerConfig:
    """Returns a scenario's planner, with the limits of its hand where it has one.

    What the scenario says of limits beyond their defaults comes first; but faces that are forbidden
    to a finger are those of the scenario and those of the hand.
    """
    config = scenario.planner
    if not scenario.grasp.has_hand:
        return config
    own, none = config.limits, LimitsConfig()
    limits = hand_limits(
        load_hand(scenario.grasp.hand), scenario.grasp, reach=scenario.grasp.use_reach
    )
    said = {name: value for name, value in vars(own).items() if value != getattr(none, name)}
    if len(own.forbidden_faces) == len(limits.forbidden_faces):
        both = zip(own.forbidden_faces, limits.forbidden_faces, strict=True)
        said["forbidden_faces"] = [list(dict.fromkeys([*a, *b])) for a, b in both]
    return replace(config, limits=replace(limits, **said))


def add_hand(
    builder: DiagramBuilder, scenario: Scenario, surface: ObjectSurface, p_OC: FloatArray
) -> DrivenHand:
    """Adds a scenario's plant with object and hand, and the hand's controller; connects them.

    Args:
        builder: Where to add them.
        scenario: With a hand.
        surface: The object's.
        p_OC: Initial contacts in O, in the order of the fingers, shape (n, 3), in metres.
    """
    grasp = scenario.grasp
    return add_driven_hand(
        builder,
        cast(Box, scenario.object),
        cast(Conveyor, scenario.motion),
        scenario.plant_config,
        grasp,
        load_hand_model(grasp.hand, grasp.yaw_range),
        p_OCoM=surface.p_OCoM,
        p_OC=p_OC,
        target_period=scenario.planner.period,
    )


def connect_hand(
    builder: DiagramBuilder,
    scenario: Scenario,
    hand: DrivenHand,
    planner: PregraspPlanner,
    sink: Callable[[GraspRecord], None] | None,
) -> None:
    """Connects a hand to the planner, to the command to close, and to who watches."""
    controller = hand.controller
    for name in (
        "fingertip_targets",
        "contact_status",
        "X_WO_estimated",
        "V_WO_estimated",
        "tracking_status",
    ):
        builder.Connect(planner.GetOutputPort(name), controller.GetInputPort(name))
    builder.Connect(
        controller.GetOutputPort("hold_contacts"), planner.GetInputPort("hold_contacts")
    )
    command = builder.AddNamedSystem("close_command", _step_at(scenario.grasp.close_at))
    builder.Connect(command.get_output_port(), controller.GetInputPort("close"))
    if sink is None:
        return
    logger = builder.AddNamedSystem(
        "grasp_logger",
        GraspLogger(num_fingers=len(hand.tip_frames), period=scenario.grasp.period, sink=sink),
    )
    for name in ("grasp_report", "p_GT", "p_WT", "f_T_W", "X_WG"):
        builder.Connect(controller.GetOutputPort(name), logger.GetInputPort(name))
    for name in ("X_WO", "X_WD"):
        builder.Connect(hand.station.GetOutputPort(name), logger.GetInputPort(name))


def _step_at(time: float) -> TrajectorySource:
    """Returns a source of 0 that becomes 1 at a time."""
    if time <= 0:
        return TrajectorySource(PiecewisePolynomial(np.ones((1, 1))))
    breaks = [0.0, time, 2 * time]
    return TrajectorySource(PiecewisePolynomial.ZeroOrderHold(breaks, [[0.0, 1.0, 1.0]]))
