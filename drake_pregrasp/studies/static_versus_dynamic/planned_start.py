"""Contacts that the planner comes to when nothing moves yet."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.grasp_config import hand_limits
from drake_pregrasp.config.planner_config import PlannerConfig
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.pregrasp_planner import AddPregraspPlanner
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.studies.static_versus_dynamic.scene import Scene
from drake_pregrasp.systems.palm_posture import reach_frame

_TICKS = 60
_FOREVER = 1e6


def planner_config(
    scene: Scene, hand: HandModel, *, reach: bool, hold: bool = False
) -> PlannerConfig:
    """Returns the planner's settings.

    Args:
        scene: With the noise to expect.
        hand: The hand.
        reach: Whether it knows what fingers reach.
        hold: Whether contacts stay where they are on the object.
    """
    config = PlannerConfig(static_duration=_FOREVER if hold else 0.0)
    config.estimator.position_std = scene.position_std
    config.estimator.orientation_std = scene.orientation_std
    config.limits = hand_limits(hand.description, scene.grasp(), reach=reach)
    config.limits.recover = not hold
    return config


def planned_start(
    scene: Scene,
    surface: ObjectSurface,
    p_OC: FloatArray,
    X_WO: RigidTransform,
    *,
    hand: HandModel,
    yaw: float,
) -> FloatArray:
    """Returns what contacts come to in 60 ticks of the planner, shape (n, 3), in O, in metres.

    It knows what fingers reach, and the no-touch area as it is at the start.

    Args:
        scene: What happens.
        surface: The object's.
        p_OC: Where contacts start, shape (n, 3), in metres.
        X_WO: Where the object is taken to be.
        hand: The hand.
        yaw: Of the palm, where its range is not limited.
    """
    builder = DiagramBuilder()
    config = planner_config(scene, hand, reach=True)
    planner = AddPregraspPlanner(builder, config, surface, p_OC)
    builder.ExportInput(planner.GetInputPort("X_WO_measured"), "X_WO")
    for name in ("obstacles", "X_WH"):
        builder.ExportInput(planner.GetInputPort(name), name)
    builder.ExportOutput(planner.GetOutputPort("p_WC"), "p_WC")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    obstacles = Obstacles(tuple(moving.solid for moving in scene.obstacles()))
    X_WH = reach_frame(X_WO, yaw, scene.yaw_range)
    for name, value in (("X_WO", X_WO), ("X_WH", X_WH), ("obstacles", obstacles)):
        diagram.GetInputPort(name).FixValue(context, AbstractValue.Make(value))
    simulator.AdvanceTo(_TICKS * config.period)
    p_WC: FloatArray = diagram.GetOutputPort("p_WC").Eval(context).reshape(-1, 3)
    return np.array((X_WO.inverse() @ p_WC.T).T)
