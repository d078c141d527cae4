"""The port block in each system's docstring equals the real ports, in their order."""

import importlib
import inspect
import itertools
import pkgutil
import re

import numpy as np
import pytest
import yaml
from made_systems import (
    FRAMES,
    HAND,
    HAND_FILE,
    N,
    make_arm,
    make_carrier,
    make_estimator,
    make_partitioner,
    make_reference,
    make_selector,
    make_sequencer,
    make_shaper,
)
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
from drake_pregrasp import (
    BallSolid,
    Box,
    Conveyor,
    FingertipSensor,
    GraspConfig,
    GraspQualityMonitor,
    HandController,
    HandStation,
    LimitsConfig,
    NoiseSource,
    NoisyPoseSensor,
    ObjectPlant,
    PlannerConfig,
    PregraspPlanner,
    PregraspVisualizer,
    load_hand,
)
from drake_pregrasp.estimation.recorded_poses import RecordedPoses
from drake_pregrasp.geometry.motion_profiles import VelocityProfile
from drake_pregrasp.studies.static_versus_dynamic.methods import Reassignment, StationaryHand
from drake_pregrasp.systems.loggers import GraspLogger, TickLogger
from drake_pregrasp.systems.obstacle_visualizer import ObstacleVisualizer
from drake_pregrasp.systems.sources import (
    BodyPose,
    ContactWeights,
    HandPose,
    Launch,
    MovingObstacles,
    ObjectMotion,
    PoseReplay,
)
from drake_pregrasp.systems.status_labels import StatusLabels


def make_launch() -> Launch:
    plant = MultibodyPlant(0.01)
    body = plant.AddRigidBody("body", SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1))
    plant.Finalize()
    return Launch(plant, body, SpatialVelocity.Zero())


def make_controller(p_OC: np.ndarray) -> HandController:
    return HandController(
        GraspConfig(hand=HAND_FILE),
        HAND,
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


def make_stationary_hand() -> StationaryHand:
    limits = LimitsConfig(tip_radii=[0.009] * 5)
    return StationaryHand(FRAMES, azimuths=np.arange(5.0), box_size=[0.1] * 3, limits=limits)


def shown(system_class, **arguments):
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    return system_class(meshcat=meshcat, publish_period=0.1, **arguments)


PLANT = MultibodyPlantConfig(time_step=0.0125, discrete_contact_approximation="sap")
POSES = RecordedPoses(np.zeros(1), np.zeros((1, 3)), Rotation.identity(1))
MAKERS = [
    lambda s, c: make_arm(),
    lambda s, c: make_carrier(),
    lambda s, c: make_estimator(),
    lambda s, c: make_partitioner(s),
    lambda s, c: make_reference(),
    lambda s, c: make_selector(s, c),
    lambda s, c: make_sequencer(),
    lambda s, c: make_shaper(),
    lambda s, c: make_controller(c),
    lambda s, c: make_launch(),
    lambda s, c: make_stationary_hand(),
    lambda s, c: BodyPose(BodyIndex(1)),
    lambda s, c: ContactWeights(np.zeros(N)),
    lambda s, c: FingertipSensor(HAND.kinematics),
    lambda s, c: GraspLogger(num_fingers=N, period=0.02, sink=lambda record: None),
    lambda s, c: GraspQualityMonitor(surface=s, num_contacts=N),
    lambda s, c: HandPose(RigidTransform()),
    lambda s, c: HandStation(
        Box(), Conveyor(), PLANT, load_hand(HAND_FILE), friction=0.7, initial=np.zeros(19)
    ),
    lambda s, c: MovingObstacles([]),
    lambda s, c: NoiseSource(size=2, period=0.1),
    lambda s, c: NoisyPoseSensor(),
    lambda s, c: ObjectMotion(VelocityProfile([[0.0, 0.0, 0.0]])),
    lambda s, c: ObjectPlant(Box(), Conveyor(), PLANT),
    lambda s, c: PoseReplay(POSES),
    lambda s, c: PregraspPlanner(PlannerConfig(), s, c),
    lambda s, c: Reassignment(FRAMES, azimuths=np.arange(5.0), period=0.05),
    lambda s, c: TickLogger(num_contacts=N, quality_size=5, period=0.1, sink=lambda record: None),
    lambda s, c: shown(ObstacleVisualizer, solids=[]),
    lambda s, c: shown(PregraspVisualizer, surface=s, num_contacts=N),
    lambda s, c: shown(StatusLabels, num_contacts=N, hover=0.1),
]


def system_classes() -> set[type]:
    found = set()
    for package in (drake_pregrasp.systems, drake_pregrasp.diagrams, drake_pregrasp.studies):
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            for name, member in inspect.getmembers(importlib.import_module(module.name)):
                ours = getattr(member, "__module__", "").startswith("drake_pregrasp")
                public = ours and not name.startswith("_")
                if public and inspect.isclass(member) and issubclass(member, System):
                    found.add(member)
    return found


@pytest.fixture(scope="module")
def systems(surface, p_OC) -> dict[type, System]:
    made = [make(surface, p_OC) for make in MAKERS]
    return {type(system): system for system in made}


def ports(system: System) -> tuple[list[str], list[str]]:
    inputs = [system.get_input_port(i).get_name() for i in range(system.num_input_ports())]
    outputs = [system.get_output_port(i).get_name() for i in range(system.num_output_ports())]
    return inputs, outputs


def test_every_system_is_looked_at(systems) -> None:
    assert system_classes() == set(systems)


def test_port_blocks_equal_the_ports(systems) -> None:
    for system_class, system in systems.items():
        doc = inspect.getdoc(system_class) or ""
        block = doc.split(".. pydrake_system::\n\n")[1].split("\n\n")[0]
        documented = yaml.safe_load(inspect.cleandoc(block))
        assert documented["name"] == system_class.__name__
        listed = documented.get("input_ports", []), documented.get("output_ports", [])
        assert listed == ports(system), system_class


def test_every_port_has_a_sentence(systems) -> None:
    docs = {c.__name__: inspect.getdoc(c) or "" for c in systems}
    for system_class, system in systems.items():
        doc = docs[system_class.__name__]
        if like := re.search(r"ports are as those of `(\w+)`", doc):
            doc += docs[like.group(1)]
        assert [name for name in itertools.chain(*ports(system)) if f"`{name}`" not in doc] == []
