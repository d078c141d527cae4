"""The diagram of a trial: the same for all arms, but for who says where fingers go."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantValueSource, DiscreteTimeDelay

from drake_pregrasp.diagrams.expected_path import initial_pose
from drake_pregrasp.diagrams.hand_controller import HandController
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.hand_station import HandStation
from drake_pregrasp.diagrams.pregrasp_planner import AddPregraspPlanner, PregraspPlanner
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.region_constraints import RegionConstraints
from drake_pregrasp.planning.solids import BoxSolid
from drake_pregrasp.planning.surface import ObjectSurface
from drake_pregrasp.simulation.hand_wiring import TABLE
from drake_pregrasp.studies.static_versus_dynamic.planned_start import planned_start, planner_config
from drake_pregrasp.studies.static_versus_dynamic.reassignment import Reassignment
from drake_pregrasp.studies.static_versus_dynamic.scene import BOX, FINGERS, Scene
from drake_pregrasp.studies.static_versus_dynamic.start import Start
from drake_pregrasp.studies.static_versus_dynamic.still_hand import StillHand
from drake_pregrasp.systems.contact_weights import ContactWeights
from drake_pregrasp.systems.grasp_logger import GraspLogger, GraspRecord
from drake_pregrasp.systems.moving_obstacles import MovingObstacles
from drake_pregrasp.systems.noise_source import NoiseSource
from drake_pregrasp.systems.pose_sensor import NoisyPoseSensor

PLANT = MultibodyPlantConfig(
    time_step=0.01,
    use_sampled_output_ports=False,
    contact_model="point",
    discrete_contact_approximation="sap",
    sap_near_rigid_threshold=0.02,
)
"""The plant's settings."""

_RING = 0.092  # Radius on which fingertips of a still hand wait, in metres.
_GOALS_FIRST = 3  # Control ticks in which the goals of a still hand become those of closing.


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
    goals: LeafSystem | PregraspPlanner


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
    dynamic = arm.startswith("dynamic")
    p_OC = start.p_OC
    if arm in ("world", "frozen", "reassigned"):
        p_OC = planned_start(scene, surface, p_OC, X_WO, hand=hand, yaw=start.yaw)
    elif arm == "still":
        p_OC = _ring(hand.azimuths + start.yaw)
    builder = DiagramBuilder()
    config = planner_config(scene, hand, reach=arm == "dynamic_reach", hold=not dynamic)
    box = BoxSolid(np.zeros(3), np.eye(3), np.array(BOX.size))
    controller = builder.AddNamedSystem(
        "hand_controller",
        HandController(
            grasp,
            hand,
            object_solid=box,
            object_top=BOX.size[2] / 2,
            mass=BOX.mass,
            p_OCoM=surface.p_OCoM,
            fixed=[TABLE.solid],
            X_WO=X_WO,
            p_OC=p_OC,
            target_period=grasp.period if arm == "still" else config.period,
            plant_time_step=PLANT.time_step,
        ),
    )
    station = builder.AddNamedSystem(
        "station",
        HandStation(
            BOX,
            conveyor,
            PLANT,
            hand.description,
            friction=grasp.friction,
            initial=controller.initial,
            yaw_range=grasp.yaw_range,
        ),
    )
    noise = builder.AddSystem(
        NoiseSource(size=NoisyPoseSensor.NOISE_SIZE, period=config.period, seed=start.noise_seed)
    )
    sensor = builder.AddSystem(
        NoisyPoseSensor(position_std=scene.position_std, orientation_std=scene.orientation_std)
    )
    weights = builder.AddSystem(ContactWeights(np.zeros(FINGERS), [(scene.lost_at, start.lost)]))
    obstacles = builder.AddSystem(MovingObstacles(scene.obstacles()))
    held = _ring(hand.azimuths) if arm == "still" else p_OC
    planner = AddPregraspPlanner(
        builder,
        config,
        surface,
        surface.project(held)[0],
        fingertip_frames=hand.kinematics.tip_frames,
    )
    goals: LeafSystem | PregraspPlanner = planner
    if arm == "still":
        constraints = RegionConstraints(
            clearance=config.limits.clearance,
            tip_radii=np.array(config.limits.tip_radii),
            standoff=config.limits.standoff,
        )
        goals = builder.AddNamedSystem(
            "still_hand",
            StillHand(
                tip_frames=hand.kinematics.tip_frames,
                azimuths=hand.azimuths + start.yaw,
                ring_radius=_RING,
                box=box,
                constraints=constraints,
            ),
        )
        builder.Connect(
            planner.GetOutputPort("X_WO_estimated"), goals.GetInputPort("X_WO_estimated")
        )
        builder.Connect(obstacles.get_output_port(), goals.GetInputPort("obstacles"))
    elif arm == "reassigned":
        goals = builder.AddNamedSystem(
            "reassignment",
            Reassignment(
                tip_frames=hand.kinematics.tip_frames, azimuths=hand.azimuths, period=config.period
            ),
        )
        for name in ("fingertip_targets", "contact_status"):
            builder.Connect(planner.GetOutputPort(name), goals.GetInputPort(name))
        builder.Connect(controller.GetOutputPort("X_WH"), goals.GetInputPort("X_WH"))
    builder.Connect(weights.get_output_port(), goals.GetInputPort("contact_weights"))
    builder.Connect(obstacles.get_output_port(), planner.GetInputPort("obstacles"))
    builder.Connect(obstacles.get_output_port(), controller.GetInputPort("obstacles"))
    builder.Connect(
        controller.GetOutputPort("hold_contacts"), planner.GetInputPort("hold_contacts")
    )
    if config.limits.reach:
        builder.Connect(controller.GetOutputPort("X_WH"), planner.GetInputPort("X_WH"))
    builder.Connect(station.GetOutputPort("X_WO"), sensor.GetInputPort("X_WO"))
    builder.Connect(noise.get_output_port(), sensor.GetInputPort("noise"))
    measured = sensor.get_output_port()
    if arm == "world":
        measured = builder.AddSystem(
            ConstantValueSource(AbstractValue.Make(X_WO))
        ).get_output_port()
    builder.Connect(measured, planner.GetInputPort("X_WO_measured"))
    for name in ("fingertip_targets", "contact_status"):
        builder.Connect(goals.GetOutputPort(name), controller.GetInputPort(name))
    for name in ("X_WO_estimated", "V_WO_estimated"):
        builder.Connect(planner.GetOutputPort(name), controller.GetInputPort(name))
    for name in ("hand_state", "net_actuation"):
        builder.Connect(station.GetOutputPort(name), controller.GetInputPort(name))
    builder.Connect(
        controller.GetOutputPort("desired_state"), station.GetInputPort("desired_state")
    )
    if arm == "still":  # Its goals first have to get from the ring to the object.
        builder.ExportInput(goals.GetInputPort("close"), "close")
        told = builder.AddSystem(DiscreteTimeDelay(grasp.period, _GOALS_FIRST, 1))
        builder.ConnectInput("close", told.get_input_port())
        builder.Connect(told.get_output_port(), controller.GetInputPort("close"))
    else:
        builder.ExportInput(controller.GetInputPort("close"), "close")
    logger = builder.AddSystem(GraspLogger(num_fingers=FINGERS, period=grasp.period, sink=sink))
    for name in ("grasp_report", "p_GT", "p_WT", "X_WG"):  # Nobody asks for forces.
        builder.Connect(controller.GetOutputPort(name), logger.GetInputPort(name))
    for name in ("X_WO", "X_WD"):
        builder.Connect(station.GetOutputPort(name), logger.GetInputPort(name))
    return TrialDiagram(builder.Build(), station, planner, controller, goals)


def _ring(azimuths: FloatArray) -> FloatArray:
    """Returns points on the object's height, away from it in the fingers' ways, shape (n, 3)."""
    return _RING * np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(len(azimuths))], axis=1)
