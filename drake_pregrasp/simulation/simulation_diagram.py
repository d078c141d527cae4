"""Diagram of a scenario: plant, sensor, planner, hand, loggers and visualizers."""

from collections.abc import Callable

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_pregrasp.diagrams.hand_station import (
    TABLE,
    HandStation,
    SimulatedHand,
    add_simulated_hand,
)
from drake_pregrasp.diagrams.object_plant import ObjectPlant
from drake_pregrasp.diagrams.pregrasp_planner import AddPregraspPlanner, PregraspPlanner
from drake_pregrasp.diagrams.wiring import connect
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.quality.grasp_quality import GraspQuality
from drake_pregrasp.simulation.obstacle_config import moving_solid
from drake_pregrasp.simulation.recording import CameraView, add_visualizers
from drake_pregrasp.simulation.scenario import Scenario, hand_planner, initial_contacts
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityMonitor
from drake_pregrasp.systems.loggers import GraspLogger, GraspRecord, TickLogger, TickRecord
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
    record: bool = False,
    live: bool = False,
    camera: CameraView | None = None,
    continues: Diagram | None = None,
) -> Diagram:
    """Returns the diagram of a scenario.

    Args:
        scenario: Scenario to simulate.
        surface: Surface of the object, from `scenario.make_surface()`.
        sink: Function that is called with a record of each planning tick.
        grasp_sink: Function that is called with a record of each control tick of a hand.
        meshcat: Viewer for all drawings; None for no drawings.
        record: Whether the viewer records the simulation.
        live: Whether a viewer that records also shows the simulation, which doubles the time for
            drawing; a viewer that does not record always shows it.
        camera: Initial camera of the viewer, for a page that follows the object; by default the
            camera stays and sees the whole motion.
        continues: Diagram of a scenario with the same object and contacts, whose drawings and
            camera in the viewer this one keeps.
    """
    config, n = hand_planner(scenario), scenario.num_contacts
    period, seed = config.period, scenario.random_seed
    builder = DiagramBuilder()
    add = builder.AddNamedSystem
    p_OC, has_room = initial_contacts(scenario, surface)
    hand = finger_measures = None
    if scenario.grasp.has_hand:
        model = scenario.load_hand_model(scenario.grasp.yaw_range)
        if config.needs_finger_measures:
            finger_measures = model.finger_measures(surface)
        hand = add_simulated_hand(
            builder,
            scenario.object,
            scenario.motion,
            scenario.plant_settings,
            scenario.grasp,
            model,
            p_OCoM=surface.p_OCoM,
            p_OC=p_OC,
            target_period=period,
            obstacles=scenario.obstacle_bodies,
        )
        object_plant: ObjectPlant | HandStation = hand.station
    else:
        object_plant = ObjectPlant(
            scenario.object,
            scenario.motion,
            scenario.plant_settings,
            obstacles=scenario.obstacle_bodies,
        )
        add("object_plant", object_plant)
    noise = add("noise", NoiseSource(size=NoisyPoseSensor.NOISE_SIZE, period=period, seed=seed))
    sensor = add("pose_sensor", NoisyPoseSensor(scenario.sensor, period=period, seed=seed))
    losses = [(event.at, event.contacts) for event in scenario.damage]
    losses.append((0.0, np.flatnonzero(~has_room).tolist()))
    values = np.array(scenario.contact_weights or [0.0] * n)
    returns = [(event.until, event.contacts) for event in scenario.damage if event.until]
    capability = scenario.capability_at if scenario.capability else None
    length = scenario.capability_length
    weights = ContactWeights(values, losses, returns, capability=capability, length=length)
    add("contact_weights", weights)
    frames = None if hand is None else hand.tip_frames
    planner = AddPregraspPlanner(
        builder, config, surface, p_OC, fingertip_frames=frames, finger_measures=finger_measures
    )
    monitor = GraspQualityMonitor(scenario.measures, surface=surface, num_contacts=n)
    add("grasp_quality_monitor", monitor)
    _add_obstacles(builder, scenario, planner, hand, meshcat)
    if config.limits.reach and hand is not None:
        connect(builder, hand.controller, "X_WH", planner)
    elif config.limits.reach:
        X_WH = scenario.hand.initial_X_WH(RigidTransform())
        pose = add("hand_pose", HandPose(X_WH, follow=scenario.hand.follow))
        builder.Connect(planner.GetOutputPort("X_WO_estimated"), pose.get_input_port())
        builder.Connect(pose.get_output_port(), planner.GetInputPort("X_WH"))
    if hand is not None:
        _connect_hand(builder, scenario, hand, planner, grasp_sink)
    builder.Connect(noise.get_output_port(), sensor.GetInputPort("noise"))
    connect(builder, weights, "contact_weights", planner)
    if scenario.capability:
        connect(builder, planner, "p_WC_previous:p_WC", weights)
    connect(builder, object_plant, "X_WO", sensor)
    connect(builder, sensor, "X_WO_measured measurement_time", planner)
    connect(builder, object_plant, "X_WO", monitor)
    connect(builder, planner, "p_WC contact_status", monitor)
    if sink is not None:
        size = len(GraspQuality.names())
        logger = TickLogger(num_contacts=n, quality_size=size, period=period, sink=sink)
        add("tick_logger", logger)
        connect(builder, object_plant, "X_WO", logger)
        connect(builder, monitor, "grasp_quality", logger)
        connect(builder, planner, "p_WC contact_status contact_causes safe_regions", logger)
        connect(builder, planner, "X_WO_estimated tracking_status time_since_measurement", logger)
    if meshcat is not None:
        drawn = continues and continues.GetSubsystemByName("pregrasp_visualizer")
        add_visualizers(
            builder,
            meshcat,
            scenario,
            surface,
            object_plant,
            planner,
            record=record,
            live=live,
            camera=camera,
            continues=drawn,
        )
    diagram = builder.Build()
    diagram.set_name("pregrasp_simulation")
    return diagram


def _add_obstacles(
    builder: DiagramBuilder,
    scenario: Scenario,
    planner: PregraspPlanner,
    hand: SimulatedHand | None,
    meshcat: Meshcat | None,
) -> None:
    solids = [moving_solid(o) for o in scenario.obstacles]
    if hand is not None:
        # The table comes last, so that obstacles keep their indices of the scenario.
        applied = builder.AddNamedSystem("applied_obstacles", MovingObstacles([*solids, TABLE]))
        connect(builder, applied, "obstacles", planner)
    if not solids:
        return
    moving = MovingObstacles(solids, lookahead=scenario.planner.estimator.lookahead)
    builder.AddNamedSystem("moving_obstacles", moving)
    connect(builder, moving, "obstacles", hand.controller if hand else planner)
    if meshcat is not None and (volumes := scenario.no_touch_volumes):
        shown, period = [o.solid for o in volumes], scenario.recording.publish_period
        visualizer = ObstacleVisualizer(meshcat=meshcat, solids=shown, publish_period=period)
        builder.AddNamedSystem("obstacle_visualizer", visualizer)
        places = MovingObstacles(volumes, lookahead=scenario.planner.estimator.lookahead)
        builder.AddNamedSystem("no_touch_volumes", places)
        connect(builder, places, "obstacles", visualizer)


def _connect_hand(
    builder: DiagramBuilder,
    scenario: Scenario,
    hand: SimulatedHand,
    planner: PregraspPlanner,
    sink: Callable[[GraspRecord], None] | None,
) -> None:
    """Connects a hand to the planner, the command to close, and the logger."""
    controller = hand.controller
    connect(builder, planner, "fingertip_targets contact_status", controller)
    connect(builder, planner, "X_WO_estimated V_WO_estimated tracking_status", controller)
    connect(builder, controller, "hold_contacts V_WO_held X_WU", planner)
    command = builder.AddNamedSystem("close_command", _step_at(scenario.grasp.close_at))
    builder.Connect(command.get_output_port(), controller.GetInputPort("close"))
    if sink is None:
        return
    fingers, period = len(hand.tip_frames), scenario.grasp.period
    logger = GraspLogger(num_fingers=fingers, period=period, sink=sink)
    builder.AddNamedSystem("grasp_logger", logger)
    connect(builder, controller, "grasp_report p_GT p_WT f_T_W X_WG", logger)
    connect(builder, hand.station, "X_WO X_WD link_forces", logger)


def _step_at(time: float) -> TrajectorySource:
    """Returns a source that steps from 0 to 1 at a time in seconds."""
    if time <= 0:
        return TrajectorySource(PiecewisePolynomial(np.ones((1, 1))))
    breaks = [0.0, time, 2 * time]
    return TrajectorySource(PiecewisePolynomial.ZeroOrderHold(breaks, [[0.0, 1.0, 1.0]]))
