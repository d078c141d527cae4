"""Diagram of a scenario: plant, sensor, planner, hand, loggers and visualizers."""

from collections.abc import Callable

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from drake_pregrasp.config.sensor_config import Camera
from drake_pregrasp.diagrams.depth_sensor import DepthSensor
from drake_pregrasp.diagrams.grasping_hand import GraspingHand, add_grasping_hand
from drake_pregrasp.diagrams.hand_controller import HandController
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.hand_station import HandStation
from drake_pregrasp.diagrams.object_plant import MUJOCO, TABLE, ForceMakers, ObjectPlant
from drake_pregrasp.diagrams.pregrasp_planner import AddPregraspPlanner, PregraspPlanner
from drake_pregrasp.diagrams.wiring import connect
from drake_pregrasp.simulation.obstacle_config import moving_solid
from drake_pregrasp.simulation.recording import CameraView, add_visualizers
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import resolve
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityMonitor
from drake_pregrasp.systems.loggers import GraspLogger, GraspRecord, TickLogger, TickRecord
from drake_pregrasp.systems.pose_sensor import NoiseSource, NoisyPoseSensor
from drake_pregrasp.systems.sources import (
    CloseCommand,
    ContactWeights,
    HandFramePose,
    MovingObstacles,
)
from drake_pregrasp.systems.visible_share import VisibleShare
from drake_pregrasp.visualization.obstacle_visualizer import ObstacleVisualizer
from drake_pregrasp.visualization.picture_logger import PictureLogger, PictureSink
from drake_pregrasp.visualization.point_visualizer import PointVisualizer

_PICTURE_PERIOD = 0.1  # Least time between logged pictures, in seconds.


def make_diagram(
    scenario: Scenario | ResolvedScenario,
    *,
    sink: Callable[[TickRecord], None] | None = None,
    grasp_sink: Callable[[GraspRecord], None] | None = None,
    picture_sink: PictureSink | None = None,
    meshcat: Meshcat | None = None,
    record: bool = False,
    live: bool = False,
    camera: CameraView | None = None,
    continues: Diagram | None = None,
    goals: System | None = None,
    forces: ForceMakers = (),
) -> Diagram:
    """Returns the diagram of a scenario.

    Args:
        scenario: Scenario to simulate.
        sink: Function that is called with a record of each planning tick.
        grasp_sink: Function that is called with a record of each control tick of a hand.
        picture_sink: Function that is called with the pictures of depth cameras.
        meshcat: Viewer for all drawings; None for no drawings.
        record: Whether the viewer records the simulation.
        live: Whether a viewer that records also shows the simulation, which doubles the time for
            drawing; a viewer that does not record always shows it.
        camera: Initial camera of the viewer, for a page that follows the object; by default the
            camera stays and sees the whole motion.
        continues: Diagram of a scenario with the same object and contacts, whose drawings and
            camera in the viewer this one keeps.
        goals: System that emits the goals of a hand; None for the planner (`add_grasping_hand`).
        forces: Systems with forces on the body of the object. Replayed poses ignore them.

    Raises:
        ScenarioError: If the scenario cannot be simulated.
    """
    resolved, builder = resolve(scenario), DiagramBuilder()
    weights = builder.AddNamedSystem("contact_weights", contact_weights_of(resolved))
    hand: GraspingHand | None = None
    if resolved.hand is None:
        plant: ObjectPlant | HandStation = _add_object(builder, resolved, forces)
        planner = _add_planner(builder, resolved, weights)
    else:
        hand = add_hand(builder, resolved, resolved.hand, weights, goals)
        plant = add_hand_station(builder, resolved, resolved.hand, hand.controller, forces)
        planner, close_at = hand.planner, resolved.scenario.grasp.close_at
        command = builder.AddNamedSystem("close_command", CloseCommand(close_at))
        connect(builder, command, "close", hand.controller)
    sensor = _add_sensor(builder, resolved, plant, planner)
    if resolved.scenario.capability:
        connect(builder, planner, "p_WC_previous:p_WC", weights)
    # The first logger to ask a system computes its outputs: this one measures how long that takes.
    _add_logger(builder, resolved, plant, planner, sink)
    if hand is not None and grasp_sink is not None:
        _add_grasp_logger(builder, resolved, plant, hand, grasp_sink)
    period = resolved.scenario.recording.publish_period
    if picture_sink is not None and isinstance(sensor, DepthSensor):
        depth = resolved.scenario.depth_sensor
        slower = max(period, depth.period, _PICTURE_PERIOD)
        pictures = PictureLogger(depth.cameras, period=slower, sink=picture_sink)
        builder.AddNamedSystem("picture_logger", pictures)
        for index in range(len(depth.cameras)):
            connect(builder, sensor, f"depth_image_{index}", pictures)
    if meshcat is not None:
        _add_obstacle_drawings(builder, resolved, meshcat)
        if isinstance(sensor, DepthSensor):
            points = PointVisualizer(meshcat=meshcat, publish_period=period)
            builder.AddNamedSystem("point_visualizer", points)
            connect(builder, sensor, "point_cloud", points)
        add_visualizers(
            builder,
            meshcat,
            resolved,
            plant,
            planner,
            hand and hand.controller,
            record=record,
            live=live,
            camera=camera,
            continues=continues and continues.GetSubsystemByName("pregrasp_visualizer"),
        )
    diagram = builder.Build()
    diagram.set_name("pregrasp_simulation")
    return diagram


def make_simulator(diagram: Diagram, scenario: Scenario) -> Simulator:
    """Returns a simulator of a diagram with the settings of a scenario.

    Args:
        diagram: Diagram from `make_diagram`, or one that contains it.
        scenario: Scenario with the settings.
    """
    simulator = Simulator(diagram)
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    return simulator


def contact_weights_of(resolved: ResolvedScenario) -> ContactWeights:
    """Returns the system that emits the weights of contacts and their losses."""
    scenario, n = resolved.scenario, resolved.num_contacts
    losses = [(event.at, event.contacts) for event in scenario.damage]
    losses.append((0.0, np.flatnonzero(~resolved.start.has_contact).tolist()))
    returns = [(event.until, event.contacts) for event in scenario.damage if event.until]
    return ContactWeights(
        np.array(scenario.contact_weights or [0.0] * n),
        losses,
        returns,
        capability=resolved.capability_at if scenario.capability else None,
        length=scenario.capability_length,
    )


def _add_object(
    builder: DiagramBuilder, resolved: ResolvedScenario, forces: ForceMakers
) -> ObjectPlant:
    scenario = resolved.scenario
    plant = ObjectPlant(
        scenario.object,
        resolved.motion,
        resolved.plant_config,
        shape=resolved.shape,
        obstacles=resolved.obstacle_bodies,
        forces=forces,
        engine=scenario.engine,
    )
    builder.AddNamedSystem("object_plant", plant)
    return plant


def _add_planner(
    builder: DiagramBuilder, resolved: ResolvedScenario, weights: System
) -> PregraspPlanner:
    """Adds a planner for contacts without a simulated hand."""
    scenario, config = resolved.scenario, resolved.planner
    planner = AddPregraspPlanner(
        builder,
        config,
        resolved.surface,
        resolved.start.p_OC,
        object_solid=resolved.seen_solid,
        kernels=resolved.kernels,
    )
    connect(builder, weights, "contact_weights", planner)
    if scenario.obstacles:
        solids = [moving_solid(o) for o in scenario.obstacles]
        moving = MovingObstacles(solids, lookahead=config.estimator.lookahead)
        connect(builder, builder.AddNamedSystem("obstacles", moving), "obstacles", planner)
    if config.limits.reach:
        frame = scenario.hand_frame
        pose = HandFramePose(frame.initial_X_WH(RigidTransform()), follow=frame.follow)
        builder.AddNamedSystem("hand_pose", pose)
        connect(builder, planner, "X_WO_estimated", pose)
        connect(builder, pose, "X_WH", planner)
    return planner


def add_hand(
    builder: DiagramBuilder,
    resolved: ResolvedScenario,
    model: HandModel,
    weights: System,
    goals: System | None = None,
) -> GraspingHand:
    """Adds the planner and the controller of a scenario's hand.

    Args:
        builder: Builder of the diagram.
        resolved: Scenario with the hand.
        model: Model of the hand.
        weights: System that emits `contact_weights`.
        goals: As for `make_diagram`.
    """
    scenario = resolved.scenario
    solids = [moving_solid(o) for o in scenario.obstacles]
    # The table comes last, so that obstacles keep their indices of the scenario.
    obstacles = builder.AddNamedSystem("obstacles", MovingObstacles([*solids, TABLE]))
    hand = add_grasping_hand(
        builder,
        model,
        scenario.grasp,
        resolved.planner,
        resolved.surface,
        resolved.start,
        object_solid=resolved.shape.solid,
        mass=scenario.object.mass,
        X_WO=resolved.X_WO_waiting,
        fixed=[TABLE.solid],
        plant_time_step=resolved.plant_config.time_step,
        has_sampled_outputs=scenario.engine == MUJOCO,
        weights=weights,
        obstacles=obstacles,
        kernels=resolved.kernels,
        goals=goals,
        seen_solid=resolved.seen_solid,
    )
    if solids:
        moving = builder.AddNamedSystem("hand_obstacles", MovingObstacles(solids))
        connect(builder, moving, "obstacles", hand.controller)
    return hand


def add_hand_station(
    builder: DiagramBuilder,
    resolved: ResolvedScenario,
    model: HandModel,
    controller: HandController,
    forces: ForceMakers = (),
) -> HandStation:
    """Adds the plant with a scenario's object and hand, and connects it to the controller."""
    scenario, grasp = resolved.scenario, resolved.scenario.grasp
    station: HandStation = builder.AddNamedSystem(
        "object_plant",
        HandStation(
            scenario.object,
            resolved.motion,
            resolved.plant_config,
            model,
            friction=grasp.friction,
            initial=controller.initial,
            period=grasp.period,
            shape=resolved.shape,
            obstacles=resolved.obstacle_bodies,
            forces=forces,
            engine=scenario.engine,
        ),
    )
    connect(builder, station, "hand_state net_actuation", controller)
    connect(builder, controller, "desired_state", station)
    if grasp.shake:
        connect(builder, controller, "grasp_report", station)
    return station


def _add_grasp_logger(
    builder: DiagramBuilder,
    resolved: ResolvedScenario,
    plant: ObjectPlant | HandStation,
    hand: GraspingHand,
    sink: Callable[[GraspRecord], None],
) -> None:
    fingers, period = resolved.num_contacts, resolved.scenario.grasp.period
    logger = GraspLogger(num_fingers=fingers, period=period, sink=sink)
    builder.AddNamedSystem("grasp_logger", logger)
    connect(builder, hand.controller, "grasp_report p_GT p_WT f_T_W X_WG catch_certificate", logger)
    connect(builder, plant, "X_WO X_WD link_forces", logger)


def _add_sensor(
    builder: DiagramBuilder,
    resolved: ResolvedScenario,
    plant: ObjectPlant | HandStation,
    planner: PregraspPlanner,
) -> NoisyPoseSensor | DepthSensor:
    """Adds the sensor of a scenario and connects it to the planner."""
    period, seed = resolved.planner.period, resolved.scenario.random_seed
    if (depth := resolved.scenario.depth_sensor).cameras:
        hand = resolved.hand and resolved.hand.diagram
        cameras = DepthSensor(depth, plant.scene_graph, hand=hand, seed=seed)
        builder.AddNamedSystem("depth_sensor", cameras)
        connect(builder, plant, "query_object", cameras)
        if hand is not None:
            connect(builder, plant, "hand_state", cameras)
        connect(builder, cameras, "point_cloud measurement_time", planner)
        return cameras
    noise = NoiseSource(size=NoisyPoseSensor.NOISE_SIZE, period=period, seed=seed)
    sensor = NoisyPoseSensor(resolved.scenario.sensor, period=period, seed=seed)
    builder.AddNamedSystem("noise", noise)
    builder.AddNamedSystem("pose_sensor", sensor)
    builder.Connect(noise.get_output_port(), sensor.GetInputPort("noise"))
    connect(builder, plant, "X_WO", sensor)
    connect(builder, sensor, "X_WO_measured measurement_time", planner)
    if isinstance(camera := resolved.scenario.sensor, Camera):
        inspector = plant.scene_graph.model_inspector()
        frame = plant.plant.GetBodyFrameIdOrThrow(plant.plant.GetBodyByName("object").index())
        p_WK, mesh = np.array(camera.position), resolved.surface.mesh
        visible = VisibleShare(p_WK, mesh, inspector, frame)
        builder.AddNamedSystem("visible_share", visible)
        connect(builder, plant, "X_WO query_object", visible)
        connect(builder, visible, "visible_share", sensor)
    return sensor


def _add_logger(
    builder: DiagramBuilder,
    resolved: ResolvedScenario,
    plant: ObjectPlant | HandStation,
    planner: PregraspPlanner,
    sink: Callable[[TickRecord], None] | None,
) -> None:
    """Adds the monitor of the quality, and a logger of planning ticks if there is a sink."""
    measures, n = resolved.measures, resolved.num_contacts
    monitor = GraspQualityMonitor(measures, surface=resolved.surface, num_contacts=n)
    builder.AddNamedSystem("grasp_quality_monitor", monitor)
    connect(builder, plant, "X_WO", monitor)
    connect(builder, planner, "p_WC contact_status", monitor)
    if sink is None:
        return
    logger = TickLogger(num_contacts=n, period=resolved.planner.period, sink=sink)
    builder.AddNamedSystem("tick_logger", logger)
    connect(builder, plant, "X_WO", logger)
    connect(builder, monitor, "grasp_quality", logger)
    connect(builder, planner, "p_WC contact_status contact_causes safe_regions", logger)
    connect(builder, planner, "X_WO_estimated tracking_status time_since_measurement", logger)


def _add_obstacle_drawings(
    builder: DiagramBuilder, resolved: ResolvedScenario, meshcat: Meshcat
) -> None:
    """Adds drawings of the no-touch volumes; bodies are drawn with the plant."""
    volumes, scenario = resolved.no_touch_volumes, resolved.scenario
    if not volumes:
        return
    shown, period = [o.solid for o in volumes], scenario.recording.publish_period
    visualizer = ObstacleVisualizer(meshcat=meshcat, solids=shown, publish_period=period)
    builder.AddNamedSystem("obstacle_visualizer", visualizer)
    places = MovingObstacles(volumes, lookahead=scenario.planner.estimator.lookahead)
    builder.AddNamedSystem("no_touch_volumes", places)
    connect(builder, places, "obstacles", visualizer)
