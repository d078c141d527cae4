"""A scenario's diagram: plant, sensor, planner, and those who watch."""

from collections.abc import Callable

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_pregrasp.diagrams.hand_station import TABLE, DrivenHand, HandStation
from drake_pregrasp.diagrams.object_plant import ObjectPlant
from drake_pregrasp.diagrams.pregrasp_planner import AddPregraspPlanner, PregraspPlanner
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.grasp_quality import GraspQuality
from drake_pregrasp.simulation.hand_wiring import add_hand, connect_hand, hand_planner
from drake_pregrasp.simulation.obstacle_config import moving_solid
from drake_pregrasp.simulation.recording import add_recording, shown_path
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityMonitor
from drake_pregrasp.systems.loggers import GraspRecord, TickLogger, TickRecord
from drake_pregrasp.systems.obstacle_visualizer import ObstacleVisualizer
from drake_pregrasp.systems.pose_sensor import NoiseSource, NoisyPoseSensor
from drake_pregrasp.systems.sources import ContactWeights, HandPose, MovingObstacles


def make_diagram(
    scenario: Scenario,
    surface: ObjectSurface,
    *,
    sink: Callable[[TickRecord], None] | None = None,
    grasp_sink: Callable[[GraspRecord], None] | None = None,
    meshcat: Meshcat | None = None,
) -> Diagram:
    """Wires a scenario's diagram.

    Args:
        scenario: What to simulate.
        surface: The object's surface, from `scenario.make_surface()`.
        sink: Gets a record of each planning tick.
        grasp_sink: Gets a record of each control tick, if there is a hand.
        meshcat: Where to draw and record, if at all.
    """
    config = hand_planner(scenario)
    n = scenario.num_contacts
    builder = DiagramBuilder()
    p_OC = scenario.initial_p_OC(surface)
    hand = None
    if scenario.grasp.has_hand:
        hand = add_hand(builder, scenario, surface, p_OC)
        object_plant: ObjectPlant | HandStation = hand.station
    else:
        object_plant = builder.AddNamedSystem(
            "object_plant", ObjectPlant(scenario.object, scenario.motion, scenario.plant_config)
        )
    noise = builder.AddNamedSystem(
        "noise",
        NoiseSource(
            size=NoisyPoseSensor.NOISE_SIZE, period=config.period, seed=scenario.random_seed
        ),
    )
    sensor = builder.AddNamedSystem(
        "pose_sensor",
        NoisyPoseSensor(scenario.sensor, period=config.period, seed=scenario.random_seed),
    )
    weights = builder.AddNamedSystem(
        "contact_weights",
        ContactWeights(
            np.array(scenario.contact_weights or [0.0] * n),
            [(event.at, event.contacts) for event in scenario.damage],
        ),
    )
    planner = AddPregraspPlanner(
        builder,
        config,
        surface,
        p_OC,
        fingertip_frames=None if hand is None else hand.tip_frames,
    )
    monitor = builder.AddNamedSystem(
        "grasp_quality_monitor",
        GraspQualityMonitor(scenario.measures, surface=surface, num_contacts=n),
    )
    _add_obstacles(builder, scenario, planner, hand, meshcat)
    if config.limits.reach:
        _connect_hand_frame(builder, scenario, planner, hand)
    if hand is not None:
        connect_hand(builder, scenario, hand, planner, grasp_sink)
    X_WO = object_plant.GetOutputPort("X_WO")
    builder.Connect(X_WO, sensor.GetInputPort("X_WO"))
    builder.Connect(noise.get_output_port(), sensor.GetInputPort("noise"))
    for port in ("X_WO_measured", "measurement_time"):
        builder.Connect(sensor.GetOutputPort(port), planner.GetInputPort(port))
    builder.Connect(weights.get_output_port(), planner.GetInputPort("contact_weights"))
    builder.Connect(X_WO, monitor.GetInputPort("X_WO"))
    for port in ("p_WC", "contact_status"):
        builder.Connect(planner.GetOutputPort(port), monitor.GetInputPort(port))
    if sink is not None:
        logger = builder.AddNamedSystem(
            "tick_logger",
            TickLogger(
                num_contacts=n,
                quality_size=len(GraspQuality.names()),
                period=config.period,
                sink=sink,
            ),
        )
        builder.Connect(X_WO, logger.GetInputPort("X_WO"))
        builder.Connect(monitor.get_output_port(), logger.GetInputPort("grasp_quality"))
        for port in (
            "p_WC",
            "contact_status",
            "contact_causes",
            "safe_regions",
            "X_WO_estimated",
            "tracking_status",
            "time_since_measurement",
        ):
            builder.Connect(planner.GetOutputPort(port), logger.GetInputPort(port))
    if meshcat is not None:
        path, direction = shown_path(scenario)
        add_recording(
            builder,
            meshcat,
            object_plant=object_plant,
            planner=planner,
            surface=surface,
            tile_surface=scenario.make_surface(scenario.recording.tile_size),
            num_contacts=n,
            path=path,
            direction=direction,
            publish_period=scenario.recording.publish_period,
            obstacle_names=scenario.obstacle_names,
            live=scenario.simulator_config.target_realtime_rate > 0,
        )
    diagram = builder.Build()
    diagram.set_name("pregrasp_simulation")
    return diagram


def _add_obstacles(
    builder: DiagramBuilder,
    scenario: Scenario,
    planner: PregraspPlanner,
    hand: DrivenHand | None,
    meshcat: Meshcat | None,
) -> None:
    solids = [moving_solid(o) for o in scenario.obstacles]
    shown = MovingObstacles(solids, lookahead=scenario.planner.estimator.lookahead)
    if hand is not None:
        # The table comes last: obstacles keep the indices that they have in the scenario.
        obstacles = builder.AddNamedSystem("heeded_obstacles", MovingObstacles([*solids, TABLE]))
        builder.Connect(obstacles.get_output_port(), planner.GetInputPort("obstacles"))
    if not solids:
        return
    builder.AddNamedSystem("moving_obstacles", shown)
    if hand is not None:
        builder.Connect(shown.get_output_port(), hand.controller.GetInputPort("obstacles"))
    else:
        builder.Connect(shown.get_output_port(), planner.GetInputPort("obstacles"))
    if meshcat is not None:
        visualizer = builder.AddNamedSystem(
            "obstacle_visualizer",
            ObstacleVisualizer(
                meshcat=meshcat,
                solids=[moving.solid for moving in solids],
                publish_period=scenario.recording.publish_period,
            ),
        )
        builder.Connect(shown.get_output_port(), visualizer.get_input_port())


def _connect_hand_frame(
    builder: DiagramBuilder, scenario: Scenario, planner: PregraspPlanner, hand: DrivenHand | None
) -> None:
    """Tells the planner where the hand is, in whose frame fingers have their reach."""
    if hand is not None:
        X_WH = hand.controller.GetOutputPort("X_WH")
    else:
        pose = builder.AddNamedSystem(
            "hand_pose",
            HandPose(scenario.hand.initial_X_WH(RigidTransform()), follow=scenario.hand.follow),
        )
        builder.Connect(planner.GetOutputPort("X_WO_estimated"), pose.get_input_port())
        X_WH = pose.get_output_port()
    builder.Connect(X_WH, planner.GetInputPort("X_WH"))
