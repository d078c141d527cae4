"""Dynamic pre-grasp planning for hands that track a moving object, made of Drake systems."""

from drake_pregrasp.config.camera_config import CameraConfig, DepthSensorConfig
from drake_pregrasp.config.grasp_config import GraspConfig, MeetingConfig, hand_limits
from drake_pregrasp.config.hand_description import HandDescription
from drake_pregrasp.config.limits_config import BallReach, BoxReach, LimitsConfig, SectorReach
from drake_pregrasp.config.object_config import Ball, Box, Conveyor, Cylinder, Mesh, Revolved
from drake_pregrasp.config.planner_config import (
    BlendConfig,
    CoordinateConfig,
    EstimatorConfig,
    PlannerConfig,
)
from drake_pregrasp.contacts.assignment import ring_contacts
from drake_pregrasp.contacts.contact_pairs import Pair
from drake_pregrasp.contacts.selection_input import ContactStatus, SelectionInput, WeightFunction
from drake_pregrasp.diagrams.depth_sensor import DepthSensor
from drake_pregrasp.diagrams.grasping_hand import AddHandController, GraspingHand, choose_approach
from drake_pregrasp.diagrams.hand_controller import HandController
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.hand_parsing import add_hand_model, complete_hand_model
from drake_pregrasp.diagrams.hand_station import HandStation
from drake_pregrasp.diagrams.object_body import add_object
from drake_pregrasp.diagrams.object_contact import separate_contacts
from drake_pregrasp.diagrams.object_plant import ObjectPlant, add_to_package_map
from drake_pregrasp.diagrams.pregrasp_planner import AddPregraspPlanner, PregraspPlanner
from drake_pregrasp.errors import (
    InvalidArgumentError,
    NoGraspError,
    OutputError,
    PregraspError,
    ScenarioError,
)
from drake_pregrasp.estimation.fault_settings import MeasurementFaults
from drake_pregrasp.estimation.pose_belief import PoseFilterNoise
from drake_pregrasp.estimation.pose_track import MeasurementVerdict, TrackingStatus
from drake_pregrasp.geometry.box_surface import box_surface
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.geometry.mesh_surface import mesh_surface
from drake_pregrasp.geometry.shapes import load_shape
from drake_pregrasp.geometry.solids import BallSolid, BoxSolid, HalfSpace
from drake_pregrasp.geometry.surface import ForbiddenPoints, ObjectSurface
from drake_pregrasp.grasping.catch_limits import CatchLimit
from drake_pregrasp.grasping.grasp_state import GiveUp, GraspPhase, describe_give_up
from drake_pregrasp.grasping.interception import MeetingSettings
from drake_pregrasp.grasping.palm_paths import PalmLimits
from drake_pregrasp.regions.capability_weights import capability_weights
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.regions.safe_regions import compute_safe_regions
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.simulation.pregrasp_station import PregraspStation
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.simulation.run import RunResult, run
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import (
    load_resolved,
    load_scenario,
    resolve,
    shipped_scenarios,
)
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.systems.centroid_selector import CentroidSelector
from drake_pregrasp.systems.differential_kinematics import DifferentialKinematics
from drake_pregrasp.systems.fingertip_sensor import FingertipSensor
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityMonitor, GraspQualityView
from drake_pregrasp.systems.grasp_sequencer import GraspSequencer
from drake_pregrasp.systems.hand_goal_shaper import HandGoalShaper
from drake_pregrasp.systems.hand_kinematics import HandKinematics
from drake_pregrasp.systems.interception_planner import InterceptionPlanner
from drake_pregrasp.systems.object_points import ObjectPoints
from drake_pregrasp.systems.pose_estimator import PoseEstimator
from drake_pregrasp.systems.pose_sensor import NoiseSource, NoisyPoseSensor
from drake_pregrasp.systems.safe_region_partitioner import SafeRegionPartitioner
from drake_pregrasp.systems.sources import BodyPose
from drake_pregrasp.systems.visible_share import VisibleShare
from drake_pregrasp.version import __version__
from drake_pregrasp.visualization.pregrasp_visualizer import PregraspVisualizer

__all__ = [
    "AddHandController",
    "AddPregraspPlanner",
    "Ball",
    "BallReach",
    "BallSolid",
    "BlendConfig",
    "BodyPose",
    "Box",
    "BoxReach",
    "BoxSolid",
    "CameraConfig",
    "CatchLimit",
    "CentroidSelector",
    "ContactStatus",
    "Conveyor",
    "CoordinateConfig",
    "Cylinder",
    "DepthSensor",
    "DepthSensorConfig",
    "DifferentialKinematics",
    "EstimatorConfig",
    "FingertipSensor",
    "ForbiddenPoints",
    "GiveUp",
    "GraspConfig",
    "GraspPhase",
    "GraspQualityMonitor",
    "GraspQualityView",
    "GraspSequencer",
    "GraspingHand",
    "HalfSpace",
    "HandController",
    "HandDescription",
    "HandGoalShaper",
    "HandKinematics",
    "HandModel",
    "HandStation",
    "InterceptionPlanner",
    "InvalidArgumentError",
    "LimitsConfig",
    "MeasurementFaults",
    "MeasurementVerdict",
    "MeetingConfig",
    "MeetingSettings",
    "Mesh",
    "MeshSolid",
    "NoGraspError",
    "NoiseSource",
    "NoisyPoseSensor",
    "ObjectPlant",
    "ObjectPoints",
    "ObjectSurface",
    "Obstacles",
    "OutputError",
    "Pair",
    "PalmLimits",
    "PlannerConfig",
    "PoseEstimator",
    "PoseFilterNoise",
    "PregraspError",
    "PregraspPlanner",
    "PregraspStation",
    "PregraspVisualizer",
    "ResolvedScenario",
    "Revolved",
    "RunResult",
    "SafeRegionPartitioner",
    "Scenario",
    "ScenarioError",
    "SectorReach",
    "SelectionInput",
    "TrackingStatus",
    "VisibleShare",
    "WeightFunction",
    "__version__",
    "add_hand_model",
    "add_object",
    "add_to_package_map",
    "box_surface",
    "capability_weights",
    "choose_approach",
    "complete_hand_model",
    "compute_safe_regions",
    "describe_give_up",
    "hand_limits",
    "load_hand",
    "load_resolved",
    "load_scenario",
    "load_shape",
    "make_diagram",
    "mesh_surface",
    "resolve",
    "ring_contacts",
    "run",
    "separate_contacts",
    "shipped_scenarios",
]
