"""The diagram of a trial: the same for all arms, but for who says where fingers go."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import ConstantValueSource

from drake_pregrasp.config.sensor_config import SensorConfig
from drake_pregrasp.diagrams.expected_path import initial_pose
from drake_pregrasp.diagrams.hand_controller import HandController
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.hand_station import HandStation, add_driven_hand
from drake_pregrasp.diagrams.pregrasp_planner import PregraspPlanner
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.studies.static_versus_dynamic.scene import BOX, FINGERS, Scene
from drake_pregrasp.studies.static_versus_dynamic.start import Start
from drake_pregrasp.studies.static_versus_dynamic.trial_goals import (
    add_goals,
    arm_start,
)
from drake_pregrasp.systems.loggers import GraspLogger, GraspRecord
from drake_pregrasp.systems.pose_sensor import NoiseSource, NoisyPoseSensor
from drake_pregrasp.systems.sources import ContactWeights, MovingObstacles

PLANT = MultibodyPlantConfig(
    time_step=0.01,
    use_sampled_output_ports=False,
    contact_model="point",
    discrete_contact_approximation="sap",
    sap_near_rigid_threshold=0.02,
)
"""The plant's settings."""


@dataclass(frozen=True, eq=False)
class TrialDiagram:
    """A diagram with the input `close`, and the parts of it that are looked at.

    Attributes:
        diagram: The diagram.
        station: The plant.
        planner: The planner, whose estimate of the pose the hand uses.
        controller: What drives the hand.
        goals: Who says where fingers go, by the ports `fingertip_targets` and `contact_status`.
    """

    diagram: Diagram
    station: HandStation
    planner: PregraspPlanner
    controller: HandController
    goals: System


def make_trial_diagram(
    arm: str,
    scene: Scene,
    start: Start,
    surface: ObjectSurface,
    hand: HandModel,
    sink: Callable[[GraspRecord], None],
) -> TrialDiagram:
    """Wires a trial.

    Args:
        arm: Key of `ARMS`.
        scene: What happens.
        start: Where it starts.
        surface: The object's.
        hand: The hand.
        sink: Gets a record of each control tick.
    """
    grasp, conveyor = scene.grasp(), scene.conveyor()
    X_WO = initial_pose(conveyor, BOX)
    first = arm_start(arm, scene, start, surface, hand, X_WO)
    builder = DiagramBuilder()
    driven = add_driven_hand(
        builder,
        BOX,
        conveyor,
        PLANT,
        grasp,
        hand,
        p_OCoM=surface.p_OCoM,
        p_OC=first.p_OC,
        target_period=first.target_period,
    )
    station, controller = driven.station, driven.controller
    planner, goals = add_goals(builder, arm, first, start, surface, controller, hand)
    measured = _add_sensor(builder, scene, start, station, first.config.period)
    if arm == "world":
        fixed = builder.AddSystem(ConstantValueSource(AbstractValue.Make(X_WO)))
        measured = fixed.get_output_port()
    builder.Connect(measured, planner.GetInputPort("X_WO_measured"))
    weights = builder.AddSystem(ContactWeights(np.zeros(FINGERS), [(scene.lost_at, start.lost)]))
    builder.Connect(weights.get_output_port(), goals.GetInputPort("contact_weights"))
    obstacles = builder.AddSystem(MovingObstacles(scene.obstacles()))
    for system in {planner, goals}:
        if system.HasInputPort("obstacles"):  # Who passes goals on doesn't judge them.
            builder.Connect(obstacles.get_output_port(), system.GetInputPort("obstacles"))
    area = builder.AddSystem(MovingObstacles(scene.area))
    builder.Connect(area.get_output_port(), controller.GetInputPort("obstacles"))
    logger = builder.AddSystem(GraspLogger(num_fingers=FINGERS, period=grasp.period, sink=sink))
    for name in ("grasp_report", "p_GT", "p_WT", "X_WG"):  # Nobody asks for forces.
        builder.Connect(controller.GetOutputPort(name), logger.GetInputPort(name))
    for name in ("X_WO", "X_WD"):
        builder.Connect(station.GetOutputPort(name), logger.GetInputPort(name))
    return TrialDiagram(builder.Build(), station, planner, controller, goals)


def _add_sensor(
    builder: DiagramBuilder, scene: Scene, start: Start, station: HandStation, period: float
) -> OutputPort:
    """Adds what measures the object's pose, and returns its output."""
    noise = builder.AddSystem(
        NoiseSource(size=NoisyPoseSensor.NOISE_SIZE, period=period, seed=start.noise_seed)
    )
    sensor = builder.AddSystem(
        NoisyPoseSensor(SensorConfig(scene.position_std, scene.orientation_std))
    )
    builder.Connect(noise.get_output_port(), sensor.GetInputPort("noise"))
    builder.Connect(station.GetOutputPort("X_WO"), sensor.GetInputPort("X_WO"))
    return sensor.GetOutputPort("X_WO_measured")
