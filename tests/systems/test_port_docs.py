"""The port block in each system's docstring equals the real ports, in their order."""

import importlib
import inspect
import pkgutil
import re

import numpy as np
import pytest
import yaml
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import BodyIndex, SpatialInertia
from pydrake.systems.framework import System
from scipy.spatial.transform import Rotation

import drake_pregrasp.diagrams
import drake_pregrasp.studies
import drake_pregrasp.systems
from drake_pregrasp import ObjectPlant, PlannerConfig, PregraspPlanner
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.config.object_config import Box, Conveyor
from drake_pregrasp.diagrams.hand_controller import HandController
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.hand_station import HandStation
from drake_pregrasp.diagrams.pregrasp_planner import EstimatorConfig, filter_noise
from drake_pregrasp.estimation.recorded_poses import RecordedPoses
from drake_pregrasp.geometry.motion_profiles import VelocityProfile
from drake_pregrasp.geometry.solids import BallSolid
from drake_pregrasp.grasping.grasp_state import GraspSettings
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.studies.static_versus_dynamic.methods import Reassignment, StationaryHand
from drake_pregrasp.systems.arm_posture import ArmPosture
from drake_pregrasp.systems.carrier_posture import CarrierPosture
from drake_pregrasp.systems.centroid_selector import CentroidSelector
from drake_pregrasp.systems.fingertip_goal_shaper import FingertipGoalShaper
from drake_pregrasp.systems.fingertip_sensor import FingertipSensor
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityMonitor
from drake_pregrasp.systems.grasp_sequencer import GraspSequencer
from drake_pregrasp.systems.joint_reference import JointReference
from drake_pregrasp.systems.loggers import GraspLogger, TickLogger
from drake_pregrasp.systems.noise_source import NoiseSource
from drake_pregrasp.systems.object_motion import BodyPose, Launch, ObjectMotion, PoseReplay
from drake_pregrasp.systems.obstacle_visualizer import ObstacleVisualizer
from drake_pregrasp.systems.pose_estimator import PoseEstimator
from drake_pregrasp.systems.pose_sensor import NoisyPoseSensor
from drake_pregrasp.systems.pregrasp_visualizer import PregraspVisualizer
from drake_pregrasp.systems.safe_region_partitioner import SafeRegionPartitioner
from drake_pregrasp.systems.scene_inputs import ContactWeights, HandPose, MovingObstacles
from drake_pregrasp.systems.status_labels import StatusLabels


def make_launch() -> Launch:
    plant = MultibodyPlant(0.01)
    body = plant.AddRigidBody("body", SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1))
    plant.Finalize()
    return Launch(plant, body, SpatialVelocity.Zero())


FINGERTIPS = [f"finger_{i}_tip" for i in range(5)]
HAND_FILE = "package://drake_pregrasp/five_finger_hand.yaml"
HAND = load_hand(HAND_FILE)


def make_controller(p_OC: np.ndarray) -> HandController:
    return HandController(
        GraspConfig(hand=HAND_FILE),
        HandModel(HAND),
        object_solid=BallSolid(np.zeros(3), 0.05),
        object_top=0.05,
        mass=0.4,
        p_OCoM=np.zeros(3),
        fixed=[],
        X_WO=RigidTransform(),
        p_OC=p_OC,
        target_period=0.05,
        plant_time_step=0.01,
    )


PLANT = MultibodyPlantConfig(time_step=0.0125, discrete_contact_approximation="sap")
MAKERS = {
    ArmPosture: lambda s, c: ArmPosture(
        tip_frames=FINGERTIPS,
        palm_frame="palm",
        finger_azimuths=np.arange(5.0),
        X_GP=RigidTransform(),
        home=np.zeros(27),
        p_WG=np.zeros(3),
        yaw=0.0,
        lead=0.03,
        period=0.02,
    ),
    BodyPose: lambda s, c: BodyPose(BodyIndex(1)),
    CarrierPosture: lambda s, c: CarrierPosture(
        tip_frames=FINGERTIPS,
        finger_azimuths=np.arange(5.0),
        home=np.zeros(19),
        carrier=[0, 1, 2, 3],
        gain=5.0,
        period=0.02,
    ),
    CentroidSelector: lambda s, c: CentroidSelector(surface=s, p_OC=c, period=0.1),
    ContactWeights: lambda s, c: ContactWeights(np.zeros(len(c))),
    FingertipGoalShaper: lambda s, c: FingertipGoalShaper(
        tip_frames=FINGERTIPS,
        tip_radius=0.009,
        object_solid=BallSolid(np.zeros(3), 0.05),
        object_top=0.05,
        fixed=[],
        p_GT=1.5 * c,
        finger_azimuths=np.arange(5.0),
        period=0.02,
        target_period=0.05,
    ),
    FingertipSensor: lambda s, c: FingertipSensor(HandModel(HAND).kinematics),
    GraspLogger: lambda s, c: GraspLogger(num_fingers=5, period=0.02, sink=lambda record: None),
    GraspSequencer: lambda s, c: GraspSequencer(
        num_fingers=5,
        tip_radius=0.009,
        mass=0.4,
        p_OCoM=np.zeros(3),
        friction=0.5,
        settings=GraspSettings(),
        period=0.02,
    ),
    HandController: lambda s, c: make_controller(c),
    HandPose: lambda s, c: HandPose(RigidTransform()),
    Launch: lambda s, c: make_launch(),
    MovingObstacles: lambda s, c: MovingObstacles([]),
    HandStation: lambda s, c: HandStation(
        Box(), Conveyor(), PLANT, HAND, friction=0.7, initial=np.zeros(19)
    ),
    JointReference: lambda s, c: JointReference(
        HandModel(HAND).kinematics, period=0.02, initial=np.zeros(19)
    ),
    GraspQualityMonitor: lambda s, c: GraspQualityMonitor(surface=s, num_contacts=len(c)),
    ObstacleVisualizer: lambda s, c: ObstacleVisualizer(
        meshcat=Meshcat(MeshcatParams(host="localhost")), solids=[], publish_period=0.1
    ),
    StatusLabels: lambda s, c: StatusLabels(
        meshcat=Meshcat(MeshcatParams(host="localhost")),
        num_contacts=len(c),
        publish_period=0.1,
        hover=0.1,
    ),
    NoiseSource: lambda s, c: NoiseSource(size=2, period=0.1),
    NoisyPoseSensor: lambda s, c: NoisyPoseSensor(position_std=0, orientation_std=0),
    ObjectMotion: lambda s, c: ObjectMotion(VelocityProfile([[0.0, 0.0, 0.0]])),
    ObjectPlant: lambda s, c: ObjectPlant(Box(), Conveyor(), PLANT),
    PoseEstimator: lambda s, c: PoseEstimator(period=0.1, noise=filter_noise(EstimatorConfig())),
    PoseReplay: lambda s, c: PoseReplay(
        RecordedPoses(np.zeros(1), np.zeros((1, 3)), Rotation.identity(1))
    ),
    PregraspPlanner: lambda s, c: PregraspPlanner(PlannerConfig(), s, c),
    PregraspVisualizer: lambda s, c: PregraspVisualizer(
        meshcat=Meshcat(MeshcatParams(host="localhost")),
        surface=s,
        num_contacts=len(c),
        publish_period=0.1,
    ),
    Reassignment: lambda s, c: Reassignment(FINGERTIPS, azimuths=np.arange(5.0), period=0.05),
    SafeRegionPartitioner: lambda s, c: SafeRegionPartitioner(surface=s, num_contacts=len(c)),
    StationaryHand: lambda s, c: StationaryHand(
        FINGERTIPS,
        azimuths=np.arange(5.0),
        box_size=[0.1] * 3,
        limits=LimitsConfig(tip_radii=[0.009] * 5),
    ),
    TickLogger: lambda s, c: TickLogger(
        num_contacts=len(c), quality_size=5, period=0.1, sink=lambda record: None
    ),
}


def system_classes() -> set[type]:
    found = set()
    for package in (drake_pregrasp.systems, drake_pregrasp.diagrams, drake_pregrasp.studies):
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            for _, member in inspect.getmembers(importlib.import_module(module.name)):
                ours = getattr(member, "__module__", "").startswith("drake_pregrasp")
                if ours and inspect.isclass(member) and issubclass(member, System):
                    found.add(member)
    return found


def test_every_system_is_looked_at() -> None:
    assert system_classes() == set(MAKERS)


@pytest.mark.parametrize("system_class", MAKERS, ids=lambda c: c.__name__)
def test_port_block_equals_ports(system_class: type, surface, p_OC: np.ndarray) -> None:
    doc = inspect.getdoc(system_class)
    assert doc is not None
    block = doc.split(".. pydrake_system::\n\n")[1].split("\n\n")[0]
    documented = yaml.safe_load(inspect.cleandoc(block))
    system = MAKERS[system_class](surface, p_OC)
    assert documented["name"] == system_class.__name__
    inputs = [system.get_input_port(i).get_name() for i in range(system.num_input_ports())]
    outputs = [system.get_output_port(i).get_name() for i in range(system.num_output_ports())]
    assert documented.get("input_ports", []) == inputs
    assert documented.get("output_ports", []) == outputs


@pytest.mark.parametrize("system_class", MAKERS, ids=lambda c: c.__name__)
def test_every_port_has_a_sentence(system_class: type, surface, p_OC: np.ndarray) -> None:
    doc = inspect.getdoc(system_class) or ""
    if like := re.search(r"ports are as those of `(\w+)`", doc):
        (other,) = (c for c in MAKERS if c.__name__ == like.group(1))
        doc += inspect.getdoc(other) or ""
    system = MAKERS[system_class](surface, p_OC)
    names = [system.get_input_port(i).get_name() for i in range(system.num_input_ports())]
    names += [system.get_output_port(i).get_name() for i in range(system.num_output_ports())]
    assert [name for name in names if f"`{name}`" not in doc] == []
